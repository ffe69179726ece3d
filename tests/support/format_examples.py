"""A small valid file of every registered format: what the hostile-file suite and the fuzzer begin from.

A format that can write any of `materials` has its example by registering; one that can't, or whose files are large,
gives its own in `OWN`.
"""

from __future__ import annotations

import json
import struct
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

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


def speos_text(
    kind: str = "anisotropicbsdf",
    percent: tuple[float, ...] = (30.0, 30.0),
    rotations: tuple[float, ...] = (1.0,),
    theta: Any = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0),
    phi: Any = (0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0, 360.0),
    width: float = 25.0,
    skew: float = 0.0,
    intensity: bool = False,
    other_angles: bool = False,
) -> str:
    """A Speos file of a lobe about the mirror direction at 20 and 50 degrees; `rotations` are its levels."""
    theta, phi = np.asarray(theta, np.float64), np.asarray(phi, np.float64)

    def table(theta_i: float, level: float, t: Any) -> list[str]:
        i, o, p = np.radians(theta_i), np.radians(t)[:, None], np.radians(phi)
        cosine = np.cos(i) * np.cos(o) + np.sin(i) * np.sin(o) * np.cos(p)
        v = level * (0.3 + np.exp(-((np.degrees(np.arccos(np.clip(cosine, -1, 1))) / width) ** 2)))
        v = v * (1 + skew * np.sin(p)) * (np.cos(o) if intensity else 1)
        rows = ["\t".join(map(repr, [a, *row])) for a, row in zip(t.tolist(), v.tolist(), strict=True)]
        return [f"{t.size}\t{phi.size}", "\t" + "\t".join(map(repr, phi.tolist())), *rows]

    lines = [f"OPTIS - {'Anisotropic BSDF' if kind != 'brdf' else 'brdf'} surface file v8.0", "0", "Comment"]
    lines += ["4", "made"]
    flags = ["1\t0", str(int(not intensity))]
    if kind == "brdf":
        lines += [*flags, "2\t2", "20.0\t50.0", "400\t700"]
        for k, p in enumerate(percent):
            lines += [repr(p), *table((20.0, 50.0)[k // 2], 1.0, theta)]
    else:
        lines += ["0\t1\t0", *flags, str(len(rotations)), "\t".join(str(30.0 * k) for k in range(len(rotations)))]
        lines += ["2", "20.0\t50.0"] * len(rotations)
        lines += ["50.0\t0", "", "2", f"400\t{percent[0]}", f"700\t{percent[1]}"]
        for level in rotations:
            lines += table(20.0, level, np.array([0.0, 10.0, 30.0, 60.0, 90.0]) if other_angles else theta)
            lines += table(50.0, level, theta)
        lines += ["End of file"]
    return "\n".join(lines) + "\n"


def alta_text() -> str:
    """An ALTA file of a few geometries, f cos(theta_v), one of them at the horizon."""
    lines = ["#DIM 3 1", "#VS 0", "#PARAM_IN ISOTROPIC_TL_TV_PROJ_DPHI", "#PARAM_OUT INV_STERADIAN_COSINE_FACTOR"]
    for theta_i in (0.3, 0.7, 1.1):
        for theta_o in (0.0, 0.4, 0.8, 1.2, 1.5707963267948966):
            for turn in (0.0, 1.0, 2.0, 3.0) if theta_o else (0.0,):
                x, y = theta_o * np.cos(turn), theta_o * np.sin(turn)
                lines.append(f"{theta_i} {x!r} {y!r} {(0.2 + 0.1 * theta_i) * np.cos(theta_o)!r}")
    return "\n".join(lines).replace("np.float64(", "").replace(")", "") + "\n"


def samples() -> list[tuple[float, float, float, float, float]]:
    """(theta_i, phi_i, theta_o, phi_o, f) of a broad lobe, degrees, the light at azimuth 30."""
    b, rows = bc.model("ggx", roughness=0.5), []
    for theta_i in (10.0, 40.0, 65.0):
        for theta_o in (0.0, 20.0, 45.0, 70.0):
            for turn in (0.0, 60.0, 120.0, 180.0) if theta_o else (0.0,):
                f = float(b.evaluate(*np.radians([theta_i, theta_o, turn]))[0])
                rows.append((theta_i, 30.0, theta_o, (turn + 30.0) % 360, f))
    return rows


def pbrt_text(waves: tuple[float, ...] = (450.0, 550.0, 650.0)) -> str:
    lines = [f"# irregular isotropic samples\n{len(waves)}", " ".join(map(repr, waves))]
    for *angles, f in samples():
        values = [f * (1 + k) for k in range(len(waves))]
        lines.append(" ".join(map(repr, [*np.radians(angles).tolist(), *values])))
    return "\n".join(lines) + "\n"


def bird_text(version: int = 1, waves: tuple[float, ...] = (450.0, 650.0), radians: bool = False) -> str:
    """A file of the BiRD format: version 1.0, or the first form (version 0)."""
    turn = np.radians if radians else (lambda x: x)
    rows = [(w, *map(float, turn(np.array(a))), f * w / 450, 0.01) for *a, f in samples() for w in waves]
    names = ("wavelength_i", "theta_i", "phi_i", "theta_r", "phi_r", "BRDF", "uBRDF")
    units = ("nm", *["rad" if radians else "deg"] * 4, "sr^-1", "sr^-1")
    lamp = {"illumination_system": {"source": {"model": "a lamp"}}}
    metadata = {"type": "BRDF", "instrumentation": lamp, "sample": {"name": "made"}}
    if version:
        columns = zip(names, units, zip(*rows, strict=True), strict=True)
        data: dict[str, Any] = {name: {"unit": unit, "values": list(values)} for name, unit, values in columns}
    else:
        variables = [{"name": name, "type": "number", "unit": unit} for name, unit in zip(names, units, strict=True)]
        data = {"variables": variables, "values": [list(row) for row in rows]}
    return json.dumps({"metadata": metadata, "data": data}, indent=1) + "\n"


def tracepro_text(waves: tuple[float, ...] = (0.55,), outwards: float = 1.0) -> str:
    """A TracePro export: ScatterAzimuth 0 away from the light, or (outwards=-1) towards the normal."""
    b = bc.model("ggx", roughness=0.5)
    lines = ["TracePro Surface Property Data", "Name\tmade", "Solve\tBRDF", "", "Temperature\tWavelength", "300\t0.55"]
    lines += ["Table_BSDF_Data"]
    lines += ["Temperature\tWavelength\tIncAngle\tAziAngle\tScatterBeta\tScatterAzimuth\tBRDF\tBTDF"]
    for theta_i in (0.0, 30.0, 60.0):
        for beta in (0.0, 0.1, 0.3, 0.6, 1.2):
            for azimuth in range(0, 360, 45) if beta else (0,):
                x = np.sin(np.radians(theta_i)) + outwards * beta * np.cos(np.radians(azimuth))
                y = outwards * beta * np.sin(np.radians(azimuth))
                rho = float(np.hypot(x, y))
                angles = (np.radians(theta_i), np.arcsin(min(rho, 1)), np.pi + np.arctan2(y, x))
                f = float(b.evaluate(*angles)[0]) if rho <= 1 else 0.0
                lines += [f"300\t{w}\t{theta_i}\t0\t{beta}\t{azimuth}\t{f * w / 0.55!r}\t0\t" for w in waves]
    return "\n".join(lines) + "\n"


def _small(name: str, **options: Any) -> Callable[[Path], bytes]:
    """A file as small as a format's options make it."""

    def made(folder: Path) -> bytes:
        path = folder / f"small-{name}"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LossWarning)
            bc.write(bc.model("ggx", roughness=0.5), path, name, **options)
        return path.read_bytes()

    return made


OWN: dict[str, Callable[[Path], bytes]] = {
    "merl": _merl,
    "speos": lambda _: speos_text().encode(),
    "alta": lambda _: alta_text().encode(),
    "pbrt": lambda _: pbrt_text().encode(),
    "bird": lambda _: bird_text().encode(),
    "tracepro": lambda _: tracepro_text().encode(),
    "rgl": lambda _: encode(fields_of()),
    "bsdf_xml": _small("bsdf_xml", basis="quarter"),
    "mbsdf": _small("mbsdf", shape="4,6"),
}


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
