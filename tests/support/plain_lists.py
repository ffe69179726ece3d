"""pbrt, BiRD, TracePro, ASTM read the shortest way: (theta_i, theta_o, delta_phi, values), radians, mirror at pi."""

from __future__ import annotations

import json
import math
from pathlib import Path

Row = tuple[float, float, float, tuple[float, ...]]


def pbrt(path: Path) -> list[Row]:
    words = [float(w) for line in path.read_text().splitlines() for w in line.split("#")[0].split()]
    n = int(words[0])
    rows = [words[k : k + 4 + n] for k in range(1 + n, len(words), 4 + n)]
    return [(r[0], r[2], r[3] - r[1], tuple(r[4:])) for r in rows]


def bird(path: Path) -> list[Row]:
    data = json.loads(path.read_text())["data"]
    if "variables" in data:
        names, units = zip(*((v["name"], v["unit"]) for v in data["variables"]), strict=True)
        columns = list(zip(*data["values"], strict=True))
    else:
        names, units = tuple(data), tuple(v["unit"] for v in data.values())
        columns = [v["values"] for v in data.values()]
    turn = math.pi / 180 if units[names.index("theta_i")] == "deg" else 1.0
    found: dict[tuple[float, ...], dict[float, float]] = {}
    for row in zip(*columns, strict=True):
        said = dict(zip(names, row, strict=True))
        key = (said["theta_i"] * turn, said["theta_r"] * turn, (said["phi_r"] - said["phi_i"]) * turn)
        found.setdefault(key, {})[said["wavelength_i"]] = said["BRDF"]
    return [(i, o, d, tuple(f[w] for w in sorted(f))) for (i, o, d), f in found.items()]


def tracepro(path: Path, outwards: float) -> list[Row]:
    lines = path.read_text().splitlines()
    start = lines.index("Table_BSDF_Data") + 1
    names = lines[start].split()
    found: dict[tuple[float, ...], dict[float, float]] = {}
    for line in lines[start + 1 :]:
        said = dict(zip(names, map(float, line.split()), strict=True))
        theta_i, beta, turn = (said[k] for k in ("IncAngle", "ScatterBeta", "ScatterAzimuth"))
        # projected: the light at -x, its mirror image at +x
        x = math.sin(math.radians(theta_i)) + outwards * beta * math.cos(math.radians(turn))
        y = outwards * beta * math.sin(math.radians(turn))
        if math.hypot(x, y) <= 1:
            azimuth = math.pi + math.atan2(y, x) if math.hypot(x, y) > 1e-9 else 0.0
            key = (math.radians(theta_i), math.asin(math.hypot(x, y)), azimuth)
            found.setdefault(key, {})[said["Wavelength"]] = said["BRDF"]
    return [(i, o, d, tuple(f[w] for w in sorted(f))) for (i, o, d), f in found.items()]


def astm(path: Path) -> list[Row]:
    lines = path.read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("VARS"))
    rows = [[float(w) for w in line.replace(",", " ").split()] for line in lines[head + 1 :] if line.strip()]
    return [(r[0], r[2], r[3] - r[1], tuple(r[4:])) for r in rows]
