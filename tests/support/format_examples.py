"""A small valid file of every registered format: what the hostile-file suite and the fuzzer begin from.

A format that can write any of `materials` has its example by registering; one that can't, or whose files are large,
gives its own in `OWN`.
"""

from __future__ import annotations

import struct
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np

import brdfcore as bc
from brdfcore.base.registry import FORMATS, REPRESENTATIONS
from brdfcore.formats.base.format import LossWarning
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.regrid import to_brdf
from brdfcore.formats.rgl.tensor_file import encode
from brdfcore.tables.specular_grid import SpecularGrid
from tests.support.rgl_synthetic import fields_of


@cache
def measured(channels: int = 1, bilateral: bool = True) -> bc.Brdf:
    """A few scattered geometries of a broad lobe."""
    rng = np.random.default_rng(3)
    theta_i = np.repeat([10.0, 40.0, 65.0], 6)
    theta_o, phi = rng.uniform(0, 75, 18).round(2), rng.uniform(0, 180, 18).round(2)
    if not bilateral:
        phi[::2] *= -1
    f = bc.model("ggx", roughness=0.5, diffuse=0.4, specular=0.5).evaluate(*np.radians([theta_i, theta_o, phi]))
    names = bc.Channels([450.0 + 50 * k for k in range(channels)]) if channels > 1 else bc.Channels(["value"])
    rows = Measurements.from_columns(
        theta_i, 0.0, theta_o, phi, np.repeat(f, channels, axis=1) * np.linspace(1, 1.5, channels), names,
        file="made", format="made",
    )  # fmt: skip
    return to_brdf(rows)


def specular(bilateral: bool = True, holes: bool = True) -> bc.Brdf:
    """A small grid about the mirror direction, with holes."""
    theta_i, azimuth = np.radians([10.0, 40.0, 70.0]), np.radians(np.linspace(0, 180 if bilateral else 360, 5))
    radial = np.radians([0.0, 3.0, 10.0, 30.0, 60.0, 90.0, 140.0])
    values = (
        0.1 + np.exp(-3 * radial)[None, None, :, None] * (1 + theta_i)[:, None, None, None] + np.zeros((3, 5, 7, 1))
    )
    if not bilateral:
        values[:, 1, 1:] *= 1.1
    if holes:
        values[1, 2, 4:] = np.nan
    return SpecularGrid.from_nodes(theta_i, azimuth, radial, values, bc.Channels(["value"]), bilateral=bilateral)[0]


def materials(folder: Path) -> Iterator[bc.Brdf]:
    """Materials of every kind that a format may hold; made when asked for."""
    if "scattered" in REPRESENTATIONS:
        yield measured(2)
    yield specular()
    file = folder / "material.bsdf"
    file.write_bytes(encode(fields_of()))
    yield bc.read(file)
    gold = bc.model("cook_torrance", roughness=0.4, ior="gold")
    yield gold
    yield bc.tabulate(gold, "angle_grid", shape=(6, 6, 7))


def _merl(_: Path) -> bytes:
    cells = np.random.default_rng(1).uniform(0, 500, (3, 4, 5, 6))
    cells[:, -1, -1] = -1
    return struct.pack("<3i", 4, 5, 6) + cells.astype("<f8").tobytes()


OWN: dict[str, Callable[[Path], bytes]] = {"merl": _merl}


def example(name: str, folder: Path) -> Path:
    """A valid file of format `name` in `folder`; `AssertionError` if there is none to be had."""
    entry = FORMATS.load(name)()
    path = folder / f"example-{name}{entry.EXTENSIONS[0]}"
    if name in OWN:
        path.write_bytes(OWN[name](folder))
        return path
    for material in materials(folder):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LossWarning)
            try:
                bc.write(material, path, name)
            except bc.InputError:
                continue
        return path
    raise AssertionError(f"format {name!r} writes none of the examples: give it its own in {__file__}")
