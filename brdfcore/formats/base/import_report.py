"""What an import says about its data beside what the reader found: counts, noise, symmetries, albedo, coverage.

Every part is JSON-ready; angles are in degrees, as people read them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import HALF_PI
from brdfcore.base.directions import cosine_pairs
from brdfcore.base.quadrature import hemisphere_rule
from brdfcore.base.status import Status
from brdfcore.formats.base.doubts import doubts
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.plane_report import plane_report, plane_warning
from brdfcore.tables.scattered.coverage import SAME, Coverage, invariants, sideways
from brdfcore.tables.scattered.table import Scattered

Float64Array = npt.NDArray[np.float64]

#: Angles of incidence of the albedos, degrees.
ALBEDO_ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0)
#: Seeded pairs of directions on which symmetries and coverage of a table are measured.
_PAIRS, _SEED = 4_096, 1
#: Digits worth printing.
_DIGITS = 6


def report_of(
    measurements: Measurements, table: Scattered, done: Sequence[str], policies: Mapping[str, Any]
) -> dict[str, Any]:
    """The report of scattered measurements that became `table`."""
    m = measurements
    warnings = list(m.warnings)
    counts: dict[str, Any] = dict(value_counts(m.values, m.channels))
    groups = m.groups()
    sizes = np.bincount(groups)
    identical = _identical(groups, m.values)
    counts |= {
        "invalid": dict(m.found.get("invalid", {})),
        "geometries": int(sizes.size),
        "repeated geometries": int((sizes > 1).sum()),
        "duplicate rows": identical,
    }
    negative, zero = int((m.values < 0).sum()), int((m.values == 0).sum())
    if negative and policies["negatives"] == "keep":
        warnings.append(f"{negative} of {m.values.size} values are negative (measurement noise); they are kept")
    if zero:
        warnings.append(
            f"{zero} of {m.values.size} values are exactly 0, below what the instrument resolves; they are kept as 0"
        )
    smoothed = table.report.get("smoothed", {})
    if smoothed.get("rows"):
        far = f", up to {smoothed['off by, at most']:.3g} of them" if "off by, at most" in smoothed else ""
        warnings.append(
            f"{smoothed['rows']} of {smoothed['of']} rows are smoothed: the table is over 2 % from their values{far}; "
            "smoothing=0 keeps them all"
        )
    albedo = albedo_of(table, table.coverage)
    interpolation = table.report.get("interpolation", {})
    warnings += doubts(m, albedo, interpolation.get("held-out error"))
    if table.coverage.in_plane:
        plane = plane_report(table, np.radians(ALBEDO_ANGLES))
        albedo["in plane"] = plane
        warnings.append(plane_warning(plane))
    report = {
        "format": m.format,
        "file": m.file,
        "sha256": m.source.get("sha256", ""),
        "bytes": m.source.get("bytes", 0),
        "units": "angles in degrees, f_r in 1/sr",
        "conventions": dict(m.conventions),
        "found": {**{k: v for k, v in m.found.items() if k != "invalid"}, "range": value_range(m.values, m.channels)},
        "counts": counts,
        "policies": {k: v for k, v in policies.items() if v is not None},
        "coverage": coverage_of(table.coverage),
        "noise": noise_of(m.values, groups, m.channels),
        **measured_symmetries(m),
        "albedo": albedo,
        "interpolation": interpolation,
        "smoothed": smoothed,
        "done": [*done, *table.report.get("done", [])],
        "warnings": warnings,
    }
    if "measured pairs" not in report["reciprocity"]:
        report["reciprocity"] |= symmetries(table, table.coverage)["reciprocity"]
    return report


def value_counts(values: npt.NDArray[Any], channels: Channels) -> dict[str, dict[str, int]]:
    """Negative and zero values, by channel; `values` (..., channels)."""
    flat = values.reshape(-1, len(channels))
    names = channels.labels()
    return {
        "negative": dict(zip(names, (flat < 0).sum(axis=0).tolist(), strict=True)),
        "zero": dict(zip(names, (flat == 0).sum(axis=0).tolist(), strict=True)),
    }


def value_range(values: npt.NDArray[Any], channels: Channels) -> dict[str, list[float]]:
    """[smallest, largest] value in 1/sr, by channel."""
    flat = values.reshape(-1, len(channels))
    pairs = zip(_rounded(flat.min(axis=0)), _rounded(flat.max(axis=0)), strict=True)
    return {name: list(pair) for name, pair in zip(channels.labels(), pairs, strict=True)}


def _identical(groups: npt.NDArray[np.int64], values: Float64Array) -> int:
    """Rows that repeat geometry and values of an earlier one."""
    rows = np.concatenate([groups[:, None].astype(np.float64), values], axis=1)
    return len(rows) - len(np.unique(rows, axis=0))


def noise_of(values: Float64Array, groups: npt.NDArray[np.int64], channels: Channels) -> dict[str, Any]:
    """Spread of repeated geometries, relative to their mean, by channel; {} without repeats.

    The square root of the mean variance over the mean value: sqrt(sum (f - mean)^2 / (rows - geometries)) / mean f.
    """
    count = np.bincount(groups)
    if not (count > 1).any():
        return {}
    sums = np.zeros((count.size, values.shape[1]))
    np.add.at(sums, groups, values)
    means = sums / count[:, None]
    repeated = count[groups] > 1
    residual = (values - means[groups])[repeated]
    freedom = int(repeated.sum() - (count > 1).sum())
    spread = np.sqrt((residual**2).sum(axis=0) / freedom)
    level = np.abs(values[repeated]).mean(axis=0)
    relative = np.divide(spread, level, out=np.zeros_like(spread), where=level > 0)
    return {
        "repeated geometries": int((count > 1).sum()),
        "rows": int(repeated.sum()),
        "relative": dict(zip(channels.labels(), _rounded(relative), strict=True)),
    }


# ---- symmetries -------------------------------------------------------------------------------


def measured_symmetries(m: Measurements) -> dict[str, Any]:
    """Reciprocity and bilateral symmetry of pairs of geometries that were both measured, with the worst pair."""
    found: dict[str, dict[str, Any]] = {}
    for name, partner in (
        ("reciprocity", (m.theta_o, m.theta_i, -m.delta_phi)),
        ("bilateral", (m.theta_i, m.theta_o, -m.delta_phi)),
    ):
        own = Coverage(np.stack([m.theta_i, m.theta_o, m.delta_phi], axis=1), SAME, bilateral=False)
        mate = own.nearest(*partner)
        angles = np.stack([m.theta_i[mate], m.theta_o[mate], m.delta_phi[mate]], axis=1)
        near = _close(angles, np.stack(partner, axis=1))
        rows = np.arange(len(m))
        pairs = near & (mate != rows) & ~(_close(angles, np.stack([m.theta_i, m.theta_o, m.delta_phi], axis=1)))
        if not pairs.any():
            found[name] = {"note": "no two measured geometries are such a pair"}
            continue
        a, b = m.values[rows[pairs]], m.values[mate[pairs]]
        worst = int(np.abs(a - b).sum(axis=1).argmax())
        first, second = int(rows[pairs][worst]), int(mate[pairs][worst])
        found[name] = {
            "measured pairs": int(pairs.sum()) // 2,
            "defect": _number(np.abs(a - b).sum() / max(float(np.abs(a).sum()), 1e-300)),
            "worst pair": {
                **_geometry(m.theta_i[first], m.theta_o[first], m.delta_phi[first]),
                "mean f_r": [_number(m.values[first].mean()), _number(m.values[second].mean())],
                "lines": [int(m.lines[first]), int(m.lines[second])],
            },
        }
    return found


def _close(a: Float64Array, b: Float64Array) -> npt.NDArray[np.bool_]:
    """Rows of geometries that are the same pair of directions up to their side, and on the same side."""
    same = np.abs(invariants(*a.T) - invariants(*b.T)).max(axis=1) <= SAME
    return np.asarray(same & (np.abs(sideways(*a.T) - sideways(*b.T)) <= SAME))


def symmetries(b: Brdf, coverage: Coverage | None = None) -> dict[str, Any]:
    """Reciprocity and bilateral defect of anything that can be evaluated, L1 on seeded cosine-distributed pairs, with
    the worst pair; only where both directions are covered."""
    theta_i, theta_o, delta_phi = cosine_pairs(_PAIRS, _SEED)
    swapped = {"reciprocity": (theta_o, theta_i, -delta_phi), "bilateral": (theta_i, theta_o, -delta_phi)}
    here = b.evaluate(theta_i, theta_o, delta_phi)
    found = {}
    for name, partner in swapped.items():
        used = np.ones(theta_i.size, np.bool_)
        if coverage is not None:
            for angles in ((theta_i, theta_o, delta_phi), partner):
                used &= coverage.status(*angles) <= Status.INTERPOLATED
        there = b.evaluate(*partner)
        difference = np.where(used[:, None], np.abs(here - there), 0)
        total = float(np.abs(here[used]).sum())
        worst = int(difference.sum(axis=1).argmax())
        found[name] = {
            "random pairs": int(used.sum()),
            "defect": _number(float(difference.sum()) / total) if total > 0 else 0.0,
            "worst pair": {
                **_geometry(theta_i[worst], theta_o[worst], delta_phi[worst]),
                "mean f_r": [_number(here[worst].mean()), _number(there[worst].mean())],
            },
        }
        if not used.any() or not difference.any():
            del found[name]["worst pair"]
    return found


def measures_of(b: Brdf, values: npt.NDArray[Any], before: Brdf | None = None) -> dict[str, Any]:
    """What a reader of whole tables reports beside what it found: counts of `values` (..., channels), the symmetries
    and the albedo of `b`; `before` is the table as it stands in the file, where that is another."""
    counts = value_counts(values, b.channels)
    return {
        "units": "angles in degrees, f_r in 1/sr",
        "counts": counts,
        **symmetries(b),
        "albedo": albedo_of(b, None, before),
    }


# ---- albedo and coverage ----------------------------------------------------------------------


def _covered_share(b: Brdf, coverage: Coverage, theta_i: Float64Array) -> Float64Array:
    """Share of int f cos(theta_o) dwo that lies where f follows from measurements, (angles, channels), to a percent or
    so: the other directions end abruptly, which no rule resolves at a price worth paying for a report."""
    shares = []
    for light in theta_i.tolist():
        theta_o, delta_phi, weight = hemisphere_rule(light, points=10, azimuths=48, bilateral=b.bilateral)
        theta_o = np.clip(theta_o, 0, HALF_PI)
        f = b.evaluate(light, theta_o, delta_phi)
        known = coverage.status(np.full(theta_o.size, light), theta_o, delta_phi) != Status.FILLED
        weight = weight * np.cos(theta_o)
        whole = weight @ f
        part = (weight * known) @ f
        shares.append(np.divide(part, whole, out=np.ones_like(whole), where=whole != 0))
    return np.array(shares)


def albedo_of(b: Brdf, coverage: Coverage | None = None, before: Brdf | None = None) -> dict[str, Any]:
    """Albedo before and after what the import did, the mean of the channels.

    With `coverage`, "before" leaves out the directions that a policy filled, "after" has them too; else
    "before" is the albedo of `before`.
    """
    theta = np.radians(ALBEDO_ANGLES)
    after = b.albedo(theta)
    earlier = None if before is None else before.albedo(theta)
    if coverage is not None:
        earlier = after * _covered_share(b, coverage, theta)
    return {
        "theta_i": list(ALBEDO_ANGLES),
        **({} if earlier is None else {"before": _rounded(earlier.mean(axis=1))}),
        "after": _rounded(after.mean(axis=1)),
        "meaning": "mean of the channels; before: without the directions that were filled, after: with them"
        if coverage is not None
        else "mean of the channels; before: as in the file, after: as read",
        "highest channel after": _rounded(after.max(axis=1)),
    }


def coverage_of(coverage: Coverage) -> dict[str, Any]:
    """Which angles were measured, and how much of all pairs of directions (weighted c_i c_o) is what."""
    lights = np.unique(np.round(np.degrees(coverage.angles[:, 0]), 2))
    codes = coverage.status(*cosine_pairs(_PAIRS, _SEED))
    shares = {s.name.lower(): _number((codes == s).mean()) for s in Status if s is not Status.OUTSIDE}
    return {
        "theta_i": lights.tolist() if lights.size <= 24 else [float(lights[0]), float(lights[-1])],
        "number of theta_i": int(lights.size),
        "theta_o from, to": [
            round(float(np.degrees(x)), 2) for x in (coverage.angles[:, 1].min(), coverage.angles[:, 1].max())
        ],
        "only in the plane of incidence": coverage.in_plane,
        "share of all directions": shares,
    }


def _geometry(theta_i: float, theta_o: float, delta_phi: float) -> dict[str, float]:
    names = ("theta_i", "theta_o", "delta_phi")
    return {name: round(float(np.degrees(x)), 3) for name, x in zip(names, (theta_i, theta_o, delta_phi), strict=True)}


def _rounded(values: npt.NDArray[Any]) -> list[float]:
    return [_number(x) for x in values]


def _number(value: Any) -> float:
    return float(f"{float(value):.{_DIGITS}g}")
