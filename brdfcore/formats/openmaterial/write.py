"""What an OpenMATERIAL file says of a material: its rows, its metadata, and the block that declares the grid."""

from __future__ import annotations

import hashlib
import uuid
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import RGB, VALUE
from brdfcore.base.errors import InputError
from brdfcore.tables.base.mirror_coordinates import above_horizon, node_directions
from brdfcore.tables.base.table import BuildOptions
from brdfcore.tables.specular_grid import SpecularGrid

Float64Array = npt.NDArray[np.float64]

#: The block beside the standard's own.
KEY = "brdfTables"
SCHEMA = "https://raw.githubusercontent.com/asam-ev/OpenMATERIAL-3D/refs/tags/v1.0.0/schemas/material_brdf_schema.json"
#: Dominant wavelengths of the sRGB primaries (IEC 61966-2-1, CIE 1931 observer, D65), nm: what R, G, B are written as.
NOMINAL_RGB = (611.4, 549.1, 464.2)
#: Decimals of an angle in rad, and the standard's largest zenith and azimuth.
DECIMALS = 9
_LARGEST_THETA, _LARGEST_PHI = 1.570796, 6.283185
#: Digits of a value that is sampled, not measured: more than any measurement has.
_DIGITS = 7


def document(brdf: Brdf, given: dict[str, Any]) -> tuple[dict[str, Any], Float64Array, list[str]]:
    """(content without rows, rows (n, 5) sorted by their columns, what is lost) of a file for `brdf`."""
    if brdf.has_delta:
        raise InputError(
            "delta_not_held",
            "an OpenMATERIAL table can't hold a perfect mirror part; write its regular part alone, or another format",
            where="brdf",
        )
    waves = _wavelengths(brdf, given["wavelengths"])
    kept = brdf.metadata.get("openmaterial")
    done: list[str] = list(kept["done"]) if isinstance(kept, dict) else []
    before = len(done)
    measured = getattr(brdf, "measured", None), getattr(brdf, "angles", None)
    if isinstance(measured[0], np.ndarray) and isinstance(measured[1], np.ndarray):
        angles, values, grid = _rounded(*measured[1].T), measured[0], None
    else:
        table = brdf if isinstance(brdf, SpecularGrid) else _gridded(brdf, given["shape"], done)
        angles, values, grid = _of_grid(table)
    negative = int((values < 0).sum())
    if negative and given["negatives"] == "zero":
        values = np.where(values < 0, 0.0, values)
        done.append(f"{negative} negative values written as 0: the standard has none below 0")
    rows = np.concatenate(
        [np.column_stack([np.full(len(angles), w), angles, column]) for w, column in zip(waves, values.T)]
    )
    keys = np.where(np.isnan(rows[:, 0]), 0.0, rows[:, 0])
    rows = rows[np.lexsort((rows[:, 3], rows[:, 2], rows[:, 1], keys))]
    block: dict[str, Any] = {"done": done}
    if brdf.channels.kind == "name" and brdf.channels != VALUE:
        block["channels"], block["wavelengths"] = brdf.channels.to_json(), waves
    if grid is not None:
        block["grid"] = grid
    content = {
        "$schema": SCHEMA,
        "metadata": _metadata(brdf, rows, given, done),
        "brdf": {"wavelengths": sorted(w for w in waves if w == w)},
        KEY: block,
    }
    return content, rows, done[before:]


def _wavelengths(brdf: Brdf, given: Any) -> list[float]:
    """Metres of each channel; NaN for a channel "value" without one."""
    channels = brdf.channels
    if given is not None:
        nm = np.atleast_1d(given).tolist()
        if len(nm) != len(channels) or len(set(nm)) != len(nm):
            raise InputError(
                "bad_wavelengths",
                f"{len(nm)} wavelengths for {len(channels)} channels; give one for each, all different",
                where="wavelengths",
                got=len(nm),
                expected=len(channels),
            )
    elif channels.kind == "wavelength":
        nm = list(channels)
    elif channels == RGB:
        nm = list(NOMINAL_RGB)
    elif channels == VALUE:
        return [float("nan")]
    else:
        raise InputError(
            "wavelengths_needed",
            f"the rows of an OpenMATERIAL table have wavelengths, and the channels {', '.join(map(str, channels)):.80} "
            "have none: pass wavelengths=, one for each, in nm",
            where="wavelengths",
            got=channels.to_json(),
            expected="wavelengths in nm",
            options="wavelengths=550" if len(channels) == 1 else "wavelengths=[450,550]",
        )
    metres = [float(f"{1e-9 * w:.12g}") for w in nm]
    if not all(1e-9 <= w <= 17.16e-3 for w in metres):
        raise InputError(
            "bad_wavelengths", "the standard takes wavelengths from 1 nm to 17.16 mm", where="wavelengths", got=nm
        )
    return metres


def _gridded(brdf: Brdf, shape: str, done: list[str]) -> SpecularGrid:
    try:
        sizes = tuple(int(n) for n in shape.split(","))
    except ValueError:
        sizes = ()
    if len(sizes) != 3 or min(sizes) < 3 or max(sizes) > 2_000:
        raise InputError(
            "bad_shape",
            f"shape = {shape[:40]!r}: expected 3 whole numbers of nodes from 3 to 2000, e.g. 28,19,40",
            where="shape",
            got=shape[:40],
            expected="e.g. 28,19,40",
        )
    table = SpecularGrid.build(brdf, BuildOptions(shape=sizes))
    done.append(
        f"sampled at {' x '.join(map(str, table.values.shape[:3]))} nodes of theta_i and of azimuth and distance about "
        f"the mirror direction, {_DIGITS} digits"
    )
    with np.errstate(divide="ignore"):
        places = _DIGITS - 1 - np.floor(np.log10(np.abs(table.values)))
    scale = 10.0 ** np.where(np.isfinite(places), np.clip(places, -290, 290), 0)
    table.values = np.rint(table.values * scale) / scale
    return table


def _of_grid(table: SpecularGrid) -> tuple[Float64Array, Float64Array, dict[str, Any]]:
    """(angles (n, 3), values (n, C), the declared grid) of the nodes that have a value."""
    kept = ~(table.filled > 0).all(axis=(1, 2))  # a slice that only stands in at theta_i = 0 is not written
    theta_i = table.theta_i[kept]
    cells, directions = node_rows(theta_i, table.azimuth, table.radial, bilateral=table.bilateral)
    given = table.filled[kept][cells] == 0
    grid = {
        "kind": SpecularGrid.name,
        "bilateral": table.bilateral,
        "theta_i": theta_i.tolist(),
        "azimuth": table.azimuth.tolist(),
        "radial": table.radial.tolist(),
    }
    return directions[given], table.values[kept][cells][given], grid


def node_rows(
    theta_i: Float64Array, azimuth: Float64Array, radial: Float64Array, *, bilateral: bool
) -> tuple[tuple[npt.NDArray[np.int64], ...], Float64Array]:
    """Nodes that are rows of their own: (their indices along the three axes, their angles (n, 3) as written).

    Left out: below the horizon, all azimuths but one at distance 0 and at theta_i = 0, the second end of a whole turn.
    """
    own = above_horizon(theta_i, azimuth, radial)
    own[:, 1:, 0] = False
    if theta_i[0] == 0:
        own[0, 1:] = False
    if not bilateral:
        own[:, -1] = False
    angles = _rounded(*(x[own] for x in node_directions(theta_i, azimuth, radial)))
    return np.nonzero(own), angles


def _rounded(theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
    """Angles as they are written: 9 decimals, within the standard's limits, phi in [0, 2 pi)."""
    phi = np.round(np.mod(delta_phi, 2 * np.pi), DECIMALS)
    phi = np.where(phi > _LARGEST_PHI, 0.0, phi)
    thetas = (np.minimum(np.round(t, DECIMALS), _LARGEST_THETA) for t in (theta_i, theta_o))
    return np.column_stack([*thetas, phi]) + 0.0  # no -0


def _metadata(brdf: Brdf, rows: Float64Array, given: dict[str, Any], done: list[str]) -> dict[str, Any]:
    """The standard's required facts; those of the file that was read where there is one."""
    kept = brdf.metadata.get("openmaterial")
    if isinstance(kept, dict) and kept["metadata"]:
        return dict(kept["metadata"])
    source = getattr(brdf, "source", {}) or {}
    model = brdf.metadata.get("model")
    origin = f"model {model}" if model else "a table"
    if source.get("name"):
        origin = f"{source.get('format', '')} file {source['name']}"
    about = str(brdf.metadata.get("description", ""))
    sentences = [about, *done]
    if brdf.channels == RGB and given["wavelengths"] is None:
        sentences.append("channels R, G, B stand at the dominant wavelengths of the sRGB primaries")
    digest = hashlib.sha256(np.ascontiguousarray(rows).tobytes()).hexdigest()
    return {
        "name": (about or str(source.get("name") or model or "BRDF"))[:80],
        "description": "; ".join(s for s in sentences if s),
        "uuid": str(uuid.uuid5(uuid.NAMESPACE_URL, f"urn:sha256:{digest}")),
        "materialVersion": "1.0.0",
        "openMaterial3dVersion": "1.0.0",
        "copyrights": [given["copyright"]],
        "license": given["license"],
        "authors": [given["author"]],
        "sources": f"{'simulation' if model and not source.get('name') else 'measurement'}: {origin}",
    }
