"""What a report says of measurements in one plane: the albedo under each assumption of what lies out of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI
from brdfcore.base.quadrature import composite
from brdfcore.tables.scattered.fit import Predictor, Settings
from brdfcore.tables.scattered.in_plane import Plane, misfits, not_ruled_out
from brdfcore.tables.scattered.table import Scattered, merged

Float64Array = npt.NDArray[np.float64]

#: Panels around the mirror direction, rad, and nodes in each.
_OFF = np.array([0.004, 0.015, 0.05, 0.15, 0.35, 0.8])
_NODES = 8


def plane_report(table: Scattered, theta_i: Float64Array) -> dict[str, Any]:
    """Albedo at `theta_i` (n,) rad, the mean of the channels, of `table`'s measurements in the plane of incidence.

    Keys: assumed, power; albedo of the table; lowest, highest: under every assumption that the data do not rule out,
    widened by how far the albedo moves when every second geometry is left out, and as far as the table's, whose lattice
    goes between the measurements otherwise than what it was made from; by assumption; difference from a product
    (rms of ln f) by which they were chosen.
    """
    points, values = merged(table.angles, table.measured, True)[:2]
    values = values.mean(axis=1, keepdims=True)
    settings = table.settings
    found = misfits(points, values)
    chosen: float | str = settings.power if settings.plane != "lobe" else "lobe"
    chosen_plane = Plane(settings.plane, settings.power)
    tried: set[float | str] = {
        "lobe" if plane.name == "lobe" else plane.power for plane in not_ruled_out(found, chosen_plane)
    }
    named: dict[float | str, str] = {0.0: "f", 1.0: "f_cos_cos", "lobe": "lobe"}
    shown = {k: _albedo(_predictor(points, values, settings, k), theta_i) for k in sorted({*named, *tried}, key=str)}
    order = np.lexsort((_signed(points), points[:, 0]))
    halves = [
        _albedo(_predictor(points[order[k::2]], values[order[k::2]], settings, chosen), theta_i)
        for k in (0, 1)
        if len(points) >= 40
    ]
    coarse = np.mean([np.abs(half - shown[chosen]) for half in halves], axis=0) if halves else 0.0
    own = table.albedo(theta_i).mean(axis=1)
    span = np.array([shown[kind] for kind in tried])
    lowest, highest = np.maximum(span.min(axis=0) - coarse, 0), span.max(axis=0) + coarse
    return {
        "assumed": chosen_plane._asdict(),
        "theta_i": np.degrees(theta_i).round(3).tolist(),
        "albedo": _short(own),
        "lowest": _short(np.minimum(lowest, own)),
        "highest": _short(np.maximum(highest, own)),
        "by assumption": {name: _short(shown[kind]) for kind, name in named.items()},
        "difference from a product": {name: float(f"{found[kind]:.3g}") for kind, name in named.items()},
        "not ruled out": [named.get(k, f"power {k}") for k in sorted(tried, key=str)],
    }


def plane_warning(report: dict[str, Any]) -> str:
    """One sentence of `plane_report` for the list of warnings."""
    k = report["theta_i"].index(60.0) if 60.0 in report["theta_i"] else len(report["theta_i"]) // 2
    name, power = report["assumed"]["name"], report["assumed"]["power"]
    how = {
        "f": "f is assumed to keep its value",
        "f_cos_cos": "f cos(theta_i) cos(theta_o) is assumed to keep its value",
        "power": f"f (cos(theta_i) cos(theta_o))^{power:.2f} is assumed to keep its value",
        "lobe": "f is assumed to depend on the angle to the mirror direction",
    }[name]
    return (
        f"only the plane of incidence was measured: out of it {how} (in_plane=), nothing there is measured; the albedo "
        f"at {report['theta_i'][k]:g} degrees is {report['albedo'][k]:.3g}, between {report['lowest'][k]:.3g} and "
        f"{report['highest'][k]:.3g} by what may be assumed"
    )


def _predictor(points: Float64Array, values: Float64Array, settings: Settings, kind: float | str) -> Predictor:
    plane = {"plane": "lobe", "power": 0.0} if isinstance(kind, str) else {"plane": "power", "power": float(kind)}
    return Predictor(points, values, True, True, replace(settings, **plane))  # type: ignore[arg-type]


def _signed(points: Float64Array) -> Float64Array:
    return np.asarray(np.where(np.cos(points[:, 2]) <= 0, points[:, 1], -points[:, 1]))


def _albedo(predictor: Predictor, theta_i: Float64Array) -> Float64Array:
    """2 int_0^pi int f cos sin dtheta dphi, (n,), panels refined towards the mirror direction."""
    phi, weight_phi = composite(np.concatenate([[0.0], 2 * _OFF, [np.pi]]), _NODES)
    found = []
    for light in theta_i:
        edges = np.concatenate([[0.0, HALF_PI], light - _OFF, [light], light + _OFF])
        theta, weight = composite(np.unique(np.clip(edges, 0, HALF_PI)), _NODES)
        grid = np.meshgrid(theta, np.pi - phi, indexing="ij")
        f = predictor.at(np.full(grid[0].size, light), grid[0].ravel(), grid[1].ravel())[:, 0]
        found.append(2 * float((weight * np.sin(theta) * np.cos(theta)) @ f.reshape(grid[0].shape) @ weight_phi))
    return np.array(found)


def _short(values: Float64Array) -> list[float]:
    return [float(f"{x:.4g}") for x in values]
