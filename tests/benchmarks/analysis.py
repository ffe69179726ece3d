"""Albedo and gloss of real files against independent integration: `python -m tests.benchmarks.analysis albedo|gloss`.

albedo  the ten files at 0, 45, 80, 85, 89 and 89.9 degrees: error of one pass (what `Brdf.albedo` was) and of
        `Brdf.albedo`, against a refinement of three million evaluations, with milliseconds an angle.
gloss   chm_light_blue at 20 and 60 degrees against four Sobol sequences of 2^20 pairs of source and receptor.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from scipy.stats import qmc

import brdfcore as bc
from brdfcore.analysis.gloss.gloss import GLOSS, gloss
from brdfcore.base.quadrature import hemisphere_rule
from tests.shared import rgl_names, rgl_path

ANGLES = (0.0, 45.0, 80.0, 85.0, 89.0, 89.9)


def albedo() -> None:
    theta = np.radians(ANGLES)
    print(
        f"{'file':<20} {'one pass: % at each angle':<44} {'albedo: % at each angle':<46} {'largest abs':>11}  ms/angle"
    )
    for name in rgl_names():
        b = bc.read(rgl_path(name))
        exact, _ = b.albedo_error(theta, tolerance=1e-6, budget=3_000_000)
        start = time.perf_counter()
        once = np.stack([_one_pass(b, t) for t in theta])
        middle = time.perf_counter()
        now = b.albedo(theta)
        end = time.perf_counter()
        cells = [" ".join(f"{x:6.3f}" for x in 100 * np.abs(a / exact - 1).max(axis=1)) for a in (once, now)]
        worst = [np.abs(a - exact).max() for a in (once, now)]
        cost = [1e3 * t / theta.size for t in (middle - start, end - middle)]
        print(f"{name:<20} {cells[0]}    {cells[1]}    {worst[0]:.4f} {worst[1]:.5f}  {cost[0]:.0f} {cost[1]:.0f}")


def _one_pass(b: bc.Brdf, theta_i: float) -> np.ndarray:
    theta_o, delta_phi, weight = hemisphere_rule(theta_i, bilateral=b.bilateral)
    return np.asarray((weight * np.cos(theta_o)) @ b.evaluate(theta_i, theta_o, delta_phi))


def gloss_against_sobol() -> None:
    b = bc.read(rgl_path("chm_light_blue"))
    for geometry in GLOSS[:2]:
        start = time.perf_counter()
        found = gloss(b, geometries=[geometry], haze=None).gloss[geometry.name]
        seconds = time.perf_counter() - start
        s, c = np.sin(np.radians(geometry.theta)), np.cos(np.radians(geometry.theta))
        ends = [np.tan(np.radians(a) / 2) for a in (*geometry.source, *geometry.receptor)]
        estimates = []
        for seed in range(4):
            x0, y0, x, y = ((2 * qmc.Sobol(4, seed=seed).random_base2(20) - 1) * ends).T
            wi, wo = np.stack([s + x0 * c, y0, c - x0 * s], 1), np.stack([-s - x * c, y, c - x * s], 1)
            share = np.linalg.norm(wi, axis=1) ** -3
            weight = share / share.mean() * np.linalg.norm(wo, axis=1) ** -4 * wo[:, 2] * 4 * ends[2] * ends[3]
            estimates.append(100 * (weight @ b.evaluate_vectors(wi, wo)) / weight.size / found.reference)
        mean, spread = np.mean(estimates, axis=0), np.std(estimates, axis=0) / 2
        print(f"gloss {geometry.name}: {np.round(found.values, 3)} ± {np.round(found.error, 3)}, {seconds:.1f} s")
        print(f"    Sobol {np.round(mean, 3)} ± {np.round(spread, 3)}; off by {np.round(found.values - mean, 3)}")


if __name__ == "__main__":
    {"albedo": albedo, "gloss": gloss_against_sobol}[sys.argv[1]]()
