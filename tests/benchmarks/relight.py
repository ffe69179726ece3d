"""Relighting through harmonics against plain quadrature: `python -m tests.benchmarks.relight [--pairs N] [--lmax ...]`.

Two environments, made here as maps of a million pixels: a smooth sky over ground, and the same with a sun of half a
degree, 40 degrees high, five times the sky's irradiance. The reference is a sum over all pixels above the surface of
radiance times solid angle times f_r times cosine, with f_r from the file itself: no harmonics in it. `halved` is how
far the same sum over every second column is off, more than what the million pixels are off by.

Errors are relative RMS over pairs of normal and view (seeded, theta_o up to 80 degrees) and channels. The degree is
that of material and light both. "sun apart": the sky in harmonics, the sun a directional light, reflected by the file.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

import brdfcore as bc
from brdfcore.harmonics.environment import solid_angles
from brdfcore.harmonics.expansion import expanded
from brdfcore.harmonics.irradiance import kernel_energy
from brdfcore.harmonics.light import Light
from brdfcore.harmonics.transfer import Transfer
from tests import shared
from tests.benchmarks.timing import machine

FILES = ("paper_white", "ilm_l3_37_matte", "satin_purple", "vch_golden_yellow", "chm_light_blue")
ROWS, COLUMNS = 708, 1_416
SUN = np.array([np.cos(np.radians(40)) * 0.6, np.cos(np.radians(40)) * 0.8, np.sin(np.radians(40))])
SUN_RADIUS = np.radians(0.27)
Array = Any


def directions() -> Array:
    theta, phi = (np.arange(ROWS) + 0.5) * np.pi / ROWS, (np.arange(COLUMNS) + 0.5) * 2 * np.pi / COLUMNS
    t, p = np.meshgrid(theta, phi, indexing="ij")
    return np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)


def environments(w: Array) -> tuple[Array, Array, Array]:
    """(sky, sky with sun, irradiance of the sun): radiances (h, w, 3), and what faces the sun gets from it."""
    z = w[..., 2:]
    above = 1 / (1 + np.exp(-8 * z))  # the horizon in haze
    up = np.clip(z, 0, 1)
    blue = np.array([0.25, 0.45, 0.9]) + np.array([0.7, 0.5, 0.15]) * np.exp(-4 * up)
    glow = np.array([0.5, 0.4, 0.3]) * np.exp(-3 * (1 - w @ SUN))[..., None]
    ground = np.array([0.18, 0.15, 0.1]) * (1 + 0.3 * w[..., :1])
    sky = above * (blue + glow) + (1 - above) * ground
    disc = (np.linalg.norm(w - SUN, axis=-1) <= 2 * np.sin(SUN_RADIUS / 2)).astype(float)[..., None]
    size = float((solid_angles(ROWS, COLUMNS)[:, None] * disc[..., 0]).sum())
    power = 5 * np.pi * np.array([0.6, 0.6, 0.6])
    return sky, sky + disc * power / size, power


def pairs(n: int, seed: int = 20_261_122) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    views = np.empty_like(normals)
    for k, normal in enumerate(normals):
        while True:
            v = rng.normal(size=3)
            v /= np.linalg.norm(v)
            if v @ normal > np.cos(np.radians(80)):
                views[k] = v
                break
    return normals, views


def summed(b: bc.Brdf, w: Array, maps: list[Array], normals: Array, views: Array) -> Array:
    """(environments, pairs, channels): the sum over all pixels, and over every second column."""
    weights = np.broadcast_to(solid_angles(ROWS, COLUMNS)[:, None], (ROWS, COLUMNS)).reshape(-1)
    flat, light = w.reshape(-1, 3), [m.reshape(-1, 3) for m in maps]
    even = np.broadcast_to(np.arange(COLUMNS) % 2 == 0, (ROWS, COLUMNS)).reshape(-1)
    found = np.empty((2, len(maps), len(normals), 3))
    for k, (n, v) in enumerate(zip(normals, views)):
        x = v - (v @ n) * n
        x /= np.linalg.norm(x)
        cosine = flat @ n
        above = cosine > 0
        local = np.stack([flat[above] @ x, flat[above] @ np.cross(n, x), cosine[above]], axis=1)
        f = b.evaluate_vectors(local, np.array([v @ x, 0.0, v @ n])) * (weights[above] * cosine[above])[:, None]
        for j, m in enumerate(light):
            product = f * m[above]
            found[0, j, k] = product.sum(axis=0)
            found[1, j, k] = 2 * product[even[above]].sum(axis=0)
    return found


def rms(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def accuracy(count: int, degrees: list[int]) -> None:
    w = directions()
    sky, sunny, power = environments(w)
    normals, views = pairs(count)
    c_o = np.einsum("ni,ni->n", normals, views)[:, None]
    top = max(degrees)
    full = {"smooth sky": Light.from_map(sky, top), "sky with a sun": Light.from_map(sunny, top)}
    print(f"\nmaps of {ROWS} x {COLUMNS} pixels, relative L2 error over the sphere if the light ends at a degree")
    print(f"{'':16}" + "".join(f"{d:>10}" for d in degrees))
    for name, light in full.items():
        print(f"{name:16}" + "".join(f"{light.error_by_degree()[d]:10.2e}" for d in degrees))
    cosines = np.maximum(normals @ w.reshape(-1, 3).T, 0) * np.repeat(solid_angles(ROWS, COLUMNS), COLUMNS)
    held = kernel_energy(2)
    print(
        f"\nirradiance of {count} normals, nine coefficients (l <= 2: {100 * held['energy']:.3f} % of the kernel's "
        f"energy, {100 * held['l2']:.3f} % L2 error of it), against the sum over all pixels"
    )
    for name, m in (("smooth sky", sky), ("sky with a sun", sunny)):
        exact = cosines @ m.reshape(-1, 3)
        errors = [f"l <= {d}: {rms(full[name].irradiance(normals, d), exact):.2e}" for d in (2, 4, 8, top)]
        print(f"  {name:16} " + ", ".join(errors))
    del cosines
    sun = Light.directional(SUN, power[None])
    print(f"\nradiance of {count} pairs, relative RMS error of L_o | of c_o L_o, by degree of material and light")
    print(f"{'material':20} {'environment':22} {'halved':>8}" + "".join(f"{d:>20}" for d in degrees))
    for name in FILES:
        source = bc.read(shared.rgl_path(name))
        start = time.perf_counter()
        exact, halved = summed(source, w, [sky, sunny], normals, views)
        spent = time.perf_counter() - start
        expansions = {d: expanded(source, d) for d in degrees}
        direct = bc.relight(source, sun, normals, views)
        rows = {
            "smooth sky": (exact[0], halved[0], lambda d: full["smooth sky"].truncated(d), 0.0),
            "sky with a sun": (exact[1], halved[1], lambda d: full["sky with a sun"].truncated(d), 0.0),
            "  sun apart": (exact[1], halved[1], lambda d: full["smooth sky"].truncated(d), direct),
        }
        for environment, (right, rough, light, added) in rows.items():
            line = f"{name if environment == 'smooth sky' else '':20} {environment:22} {rms(rough, right):8.1e}"
            for d in degrees:
                found = Transfer(expansions[d], d).radiance(light(d), normals, views) + added
                line += f"{rms(found, right):10.2e} |{rms(found * c_o, right * c_o):8.1e}"
            print(line, flush=True)
        print(f"{'':20} the sums took {spent:.1f} s, {spent / count:.3f} s a pair and million samples", flush=True)


def speed(count: int, degrees: list[int]) -> None:
    print(f"\n{count} normals with a view each, three channels, {machine()}")
    source = bc.read(shared.rgl_path("satin_purple"))
    normals, views = pairs(count)
    light = Light.from_map(environments(directions())[0], max(degrees))
    print(f"{'degree':>6} {'expansion s':>12} {'transfer s':>11} {'wall s':>8} {'cpu s':>8} {'us a normal':>12}")
    for d in degrees:
        start = time.perf_counter()
        made = expanded(source, d)
        expansion = time.perf_counter() - start
        start = time.perf_counter()
        transfer, ended = Transfer(made, d), light.truncated(d)
        transfer.radiance(ended, normals[:1], views[:1])
        prepared = time.perf_counter() - start
        start, begun = time.perf_counter(), time.process_time()
        transfer.radiance(ended, normals, views)
        wall, cpu = time.perf_counter() - start, time.process_time() - begun
        print(f"{d:6} {expansion:12.2f} {prepared:11.3f} {wall:8.2f} {cpu:8.2f} {1e6 * wall / count:12.1f}", flush=True)
    start = time.perf_counter()
    light.irradiance(normals)
    print(f"irradiance, nine coefficients: {time.perf_counter() - start:.3f} s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=24, help="normals with a view that are compared")
    parser.add_argument("--normals", type=int, default=100_000, help="normals that are timed")
    parser.add_argument("--lmax", type=int, nargs="+", default=[2, 4, 8, 16, 32, 64], help="degrees")
    parser.add_argument("--timed", type=int, nargs="+", default=[8, 16, 32], help="degrees that are timed")
    given = parser.parse_args()
    if not shared.RGL.is_dir():
        print(f"the real files are not at {shared.RGL}")
        return
    if given.pairs:
        accuracy(given.pairs, given.lmax)
    if given.normals:
        speed(given.normals, given.timed)


if __name__ == "__main__":
    main()
