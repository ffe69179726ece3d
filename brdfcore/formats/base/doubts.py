"""What cannot be, or hardly: sentences for a report about measurements whose unit, quantity or mirror side is wrong."""

from __future__ import annotations

from typing import Any

import numpy as np

from brdfcore.formats.base.measurements import ANISOTROPY, SAME_ANGLE, Measurements

#: An albedo above this is no rounding; one below that no surface; a retro side brighter by this factor no noise.
_ABOVE, _BELOW, _BRIGHTER = 1.0, 1e-3, 1.2
#: Part of a total that a file states by which its table may miss it.
_OF_TOTAL = 0.1
#: Relative error on held-out geometries above which it is said, rad of incidence from which sides are compared.
_HELD_OUT, _FROM = 0.1, np.radians(10)


def doubts(m: Measurements, albedo: dict[str, Any], held_out: float | None) -> list[str]:
    """Sentences about `m`, the albedo of its table (`import_report.albedo_of`) and the held-out error, if known."""
    return [text for text in (*_albedo(albedo), _retro(m), *_at_the_normal(m), _total(m, albedo), _uncertain(held_out))
            if text]  # fmt: skip


def _albedo(albedo: dict[str, Any]) -> list[str]:
    angles, highest = np.array(albedo["theta_i"]), np.array(albedo["highest channel after"])
    said = []
    above = highest > _ABOVE
    if above.any():
        k = int(np.where(above, highest, -np.inf).argmax())
        said.append(
            f"the albedo is {highest[k]:.4g} at {angles[k]:g} degrees (above 1 from {angles[above][0]:g} degrees): no "
            "passive surface reflects more than it receives; is it f_r in 1/sr (options quantity, unit, scale), and is "
            "what lies between the measurements dense enough?"
        )
    mean = np.array(albedo["after"])
    if (mean < 0).any():
        k = int(mean.argmin())
        said.append(f"the albedo is {mean[k]:.4g} at {angles[k]:g} degrees, below 0: are marks for missing values left "
                    "in (option sentinel), or an offset?")  # fmt: skip
    elif (mean < _BELOW).all():
        said.append(
            f"the albedo is {mean.max():.3g} at most, below {_BELOW:g}: darker than any known surface; is it f_r in "
            "1/sr (options quantity, unit, scale)?"
        )
    return said


def _total(m: Measurements, albedo: dict[str, Any]) -> str:
    """Where the table does not integrate to a total that the file states: the first, and how many."""
    angles, after = np.array(albedo["theta_i"]), np.array(albedo["after"])
    lowest, highest = float(np.degrees(m.theta_i.min())), float(np.degrees(m.theta_i.max()))
    missed = []
    for line, stated, light in m.found.get("stated totals", ()):
        # one for all incidences is held to the nearest that is measured
        lights = np.linspace(lowest, highest, 9) if light is None else np.array([light])
        found = np.interp(lights, angles, after)
        k = int(np.abs(found - stated).argmin())
        if abs(found[k] - stated) > _OF_TOTAL * abs(stated):
            missed.append((line, stated, float(found[k]), float(lights[k])))
    if not missed:
        return ""
    line, stated, value, light = missed[0]
    more = f"; so do {len(missed) - 1} more" if len(missed) > 1 else ""
    return (
        f"line {line} states a total of {stated:.4g}, and the table integrates to {value:.4g} at {light:.3g} degrees"
        f"{more}: is it the same quantity (options quantity, unit, scale), and is what was measured all there is?"
    )


def _retro(m: Measurements) -> str:
    """Where most incidences are brightest on the light's side."""
    mean = m.values.mean(axis=1)
    lights = np.round(m.theta_i, 3)
    retro, compared, example = 0, 0, ""
    for light in np.unique(lights[lights > _FROM]):
        here = (lights == light) & (m.theta_o > _FROM)
        mirror, back = (here & (side > 0.5) for side in (-np.cos(m.delta_phi), np.cos(m.delta_phi)))
        if not (mirror.any() and back.any()):
            continue
        compared += 1
        if mean[back].max() > _BRIGHTER * max(float(mean[mirror].max()), 0.0):
            retro += 1
            at = int(np.flatnonzero(back)[mean[back].argmax()])
            example = example or (f"{mean[at]:.3g}/sr at theta_i = {np.degrees(light):.3g}, theta_o = "
                                  f"{np.degrees(m.theta_o[at]):.3g} degrees, line {m.lines[at]}")  # fmt: skip
    if retro * 2 <= compared:
        return ""
    return (
        f"{retro} of {compared} angles of incidence are brightest on the light's side ({example}): a retro-reflecting "
        "or rough diffuse surface, or the mirror direction is at the other azimuth or sign (option mirror)"
    )


def _at_the_normal(m: Measurements) -> list[str]:
    """Where the azimuth of the viewer matters though the light is at the normal."""
    rows = (m.theta_i < SAME_ANGLE) & (m.theta_o > np.radians(2))
    if rows.sum() < 2:
        return []
    mean, rings = m.values[rows].mean(axis=1), np.round(m.theta_o[rows], 4)
    _, ring, count = np.unique(rings, return_inverse=True, return_counts=True)
    level = np.bincount(ring.reshape(-1), mean) / count
    away = np.abs(mean - level[ring.reshape(-1)])
    spread = float(away.sum() / max(float(np.abs(level[ring.reshape(-1)]).sum()), 1e-300))
    if spread <= ANISOTROPY:
        return []
    k = int(np.bincount(ring.reshape(-1), away).argmax())
    those = mean[ring.reshape(-1) == k]
    text = (
        f"at normal incidence values of one theta_o differ by {spread:.0%} of their mean with the azimuth "
        f"({those.min():.3g} to {those.max():.3g}/sr at {np.degrees(rings[ring.reshape(-1) == k][0]):.3g} degrees): "
        "the material is anisotropic, and its mean is what is read"
    )
    return [text]


def _uncertain(held_out: float | None) -> str:
    if held_out is None or not held_out > _HELD_OUT:
        return ""
    return (
        f"geometries left out of the fit are missed by {held_out:.0%} on average: between the measurements f is not "
        "known better than that"
    )
