"""Files to try things on: one made-up paint as instruments deliver it, beside what it really is."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import FLAGS, Brdf
from brdfcore.base.catalogue import model
from brdfcore.base.channels import RGB
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import StorageError
from brdfcore.formats.io.files import write
from brdfcore.tables.vndf_warp import VndfWarp

FILES = ("paint.json", "paint.csv", "paint.bsdf")
#: Noise of the made-up instruments: a share of f_r, and what a dark channel still shows, 1/sr. One standard deviation.
RELATIVE_NOISE, DARK_NOISE = 0.01, 2e-4
#: The scan, degrees: closer together about the mirror direction, as a goniometer is driven.
THETA_I = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0)
THETA_O = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
DELTA_PHI = (0.0, 30.0, 60.0, 90.0, 120.0, 140.0, 155.0, 165.0, 172.5, 180.0)
#: The other file: slices of theta_i up to 85 degrees, each N x N over the half vector.
SLICES, N = 12, 32


def example_files(folder: str | PathLike[str], *, replace: bool = False, seed: int = 1) -> list[Path]:
    """Write three small files of one made-up paint into `folder` (made if absent) and return their paths.

    paint.json   the truth: `cook_torrance`, a red diffuse base under a rough dielectric lobe, R, G, B.
    paint.csv    a goniometer's scan of it, scattered: theta_i to 75 and theta_o to 80 degrees.
    paint.bsdf   a scan on a grid of half vectors, in the RGL database's `tensor_file`, theta_i to 85 degrees.

    Both scans hold f_r (1 + 0.01 z) + 2e-4 z' with z, z' normal, drawn by `seed`: equal seeds write equal bytes. What
    reading makes of them can be compared with the truth: `compare(read("paint.json"), read("paint.csv"))`.
    `StorageError` where one of the files exists, unless `replace`.

    >>> [path.name for path in bc.example_files("made")]
    ['paint.json', 'paint.csv', 'paint.bsdf']
    """
    folder = Path(folder)
    paths = [folder / name for name in FILES]
    if not replace and (there := [path for path in paths if path.exists()]):
        raise StorageError(
            "exists", f"{there[0]}: exists; replace it, or name another folder", where=str(there[0]), expected="no file"
        )
    folder.mkdir(parents=True, exist_ok=True)
    truth = model("cook_torrance", diffuse=[0.45, 0.12, 0.08], specular=0.5, roughness=0.25, ior="glass")
    truth.metadata["about"] = "a made-up paint: the truth behind paint.csv and paint.bsdf"
    rng = np.random.default_rng(seed)
    write(truth, paths[0], "model")
    _write_scan(truth, paths[1], rng)
    table = _sampled(truth, rng)
    table.metadata["description"] = f"made-up paint, {RELATIVE_NOISE:.0%} noise; the truth is {FILES[0]}"
    write(table, paths[2], "rgl")
    return paths


def _noisy(f: FloatArray, rng: np.random.Generator) -> FloatArray:
    z, dark = rng.standard_normal((2, *f.shape))
    return np.asarray(f * (1 + RELATIVE_NOISE * z) + DARK_NOISE * dark)


def _write_scan(truth: Brdf, path: Path, rng: np.random.Generator) -> None:
    """Columns whose header says all that a reader has to know."""
    grid = np.meshgrid(THETA_I, THETA_O, DELTA_PHI, indexing="ij")
    angles = np.stack([g.reshape(-1) for g in grid], axis=1)
    once = (angles[:, :2].min(axis=1) > 0) | (angles[:, 2] == 0)  # at the normal the azimuth is no coordinate
    angles = angles[once]
    angles = np.concatenate([angles, angles[angles[:, 2] % 180 == 0]])  # the plane of incidence twice: noise shows
    f = _noisy(truth.evaluate(*np.radians(angles.T)), rng)
    rows = [",".join(f"{x:g}" for x in a) + "," + ",".join(f"{x:.6g}" for x in v) for a, v in zip(angles, f)]
    head = f"# made-up goniometer scan of a paint, f_r in 1/sr, {RELATIVE_NOISE:.0%} noise; the truth is {FILES[0]}"
    names = [*(f"{a}_deg" for a in ("theta_i", "theta_o", "delta_phi")), *(f"f_r_{c}" for c in truth.channels)]
    write_file(path, ("\n".join([head, f"# rows: {len(rows)}", ",".join(names), *rows]) + "\n").encode())


def _sampled(truth: Brdf, rng: np.random.Generator) -> VndfWarp:
    """`truth` on an even grid over (u(theta_h), u(phi_h)): with a constant density of normals the warp is the identity.

    The samples are f_r cos(theta_o) 4 sigma(theta_i) with sigma = cos(theta_i), which keeps them even towards grazing
    light; half vectors whose mirror direction lies below the horizon hold 0.
    """
    theta_i = np.radians(np.linspace(0.0, 85.0, SLICES)).astype(np.float32)
    u = np.linspace(0.0, 1.0, N)
    phi_h, theta_h = np.meshgrid(2 * np.pi * u - np.pi, np.pi / 2 * u**2, indexing="ij")
    h = np.stack([np.sin(theta_h) * np.cos(phi_h), np.sin(theta_h) * np.sin(phi_h), np.cos(theta_h)], axis=-1)
    nodes = np.linspace(0.0, 1.0, 33)  # of sigma, over sqrt(2 theta_i / pi)
    sigma = np.maximum(np.cos(np.pi / 2 * nodes**2), 0.05)
    samples = np.zeros((SLICES, N, N, len(RGB)))
    for k, theta in enumerate(theta_i.astype(np.float64)):
        wi = np.array([np.sin(theta), 0.0, np.cos(theta)])
        wo = 2 * (h @ wi)[..., None] * h - wi
        above = wo[..., 2] > 0
        f = _noisy(truth.evaluate_vectors(wi, wo[above]), rng)
        samples[k, above] = f * wo[above, 2, None] * 4 * np.interp(np.sqrt(2 * theta / np.pi), nodes, sigma)
    return VndfWarp.from_densities(
        theta_i=theta_i,
        sigma=sigma.astype(np.float32),
        ndf=np.ones(2, np.float32),
        vndf=np.ones((SLICES, 3, 3), np.float32),
        spectra=np.moveaxis(samples, -1, 1).astype(np.float32),
        channels=RGB,
        flags=dict.fromkeys(FLAGS, False),
    )
