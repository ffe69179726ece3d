"""The XML of a material: patch averages of both sides, measured until they settle."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import RGB, Channels
from brdfcore.base.errors import InputError
from brdfcore.formats.base.one_channel import OneChannel
from brdfcore.formats.bsdf_xml.klems import BASES, Basis, cells_of, lattice
from brdfcore.formats.bsdf_xml.tree import composed
from brdfcore.metrics import compare
from brdfcore.tables.patch_grid import PatchGrid, disk

Float64Array = npt.NDArray[np.float64]

BASIS_NAMES = (*BASES, "tree")
#: CIE 1931 XYZ of linear sRGB (IEC 61966-2-1): rows X, Y, Z.
_XYZ_OF_RGB = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
_XYZ = Channels(("X", "Y", "Z"))
#: Averages are refined until they change by less than this (L1), or this many evaluations are spent.
_SETTLED, _BUDGET = 1e-3, 40_000_000
#: Points a ring that the averages begin with, and cells of azimuth that they have in each of a lattice's.
_FIRST = 4
_DIGITS = 7
#: Directions on which the cost of the averages is measured.
_DIRECTIONS = 50_000


def document(brdf: Brdf, given: dict[str, Any]) -> tuple[str, list[str]]:
    """(text, what is lost, a sentence each) of a file for `brdf`."""
    if given["channel"] is not None:
        brdf = OneChannel(brdf, given["channel"])
    if brdf.has_delta:
        raise InputError(
            "delta_not_held",
            "a BSDF file of patch averages can't hold a perfect mirror part; write the regular part alone",
            where="brdf",
        )
    matrix, labels, losses = _channels(brdf)
    basis, size = given["basis"], given["resolution"]
    if size & (size - 1):
        raise InputError(
            "bad_resolution",
            f"resolution = {size}: expected a power of two from 4 to 128",
            where="resolution",
            got=size,
        )
    kept = _own(brdf)
    if kept is not None:
        values, basis = kept
    elif basis == "tree":
        values, off = settled(brdf, lambda points: tree_averages(brdf, size, points))
    else:
        values, off = settled(brdf, lambda points: ring_averages(brdf, BASES[basis], points))
    values = values @ matrix.T
    if kept is None:
        losses.append(_cost(brdf, values @ np.linalg.inv(matrix).T, basis, off))
        values = np.array([float(f"{v:.{_DIGITS}g}") for v in values.reshape(-1)]).reshape(values.shape)
    negative = int((values < 0).sum())
    if negative:
        losses.append(f"{negative} patches are negative, which Radiance reads as 0: written as 0")
        values = np.maximum(values, 0)
    if not brdf.bilateral and basis != "tree" and kept is None:
        losses.append("the sides of the plane of incidence are kept apart, as far as the patches tell them")
    name = str(brdf.metadata.get("description") or getattr(brdf, "source", {}).get("name", "") or "BRDF")[:200]
    return "".join(_lines(name, values, labels, basis)), losses


def _channels(brdf: Brdf) -> tuple[Float64Array, list[str], list[str]]:
    """(matrix from the channels to those written, their labels, what is lost)."""
    if len(brdf.channels) == 1:
        kept = [] if brdf.channels.labels()[0] in ("value", "Y") else [brdf.channels.labels()[0]]
        return np.eye(1), ["Visible"], [f"the channel {k} is written as Visible" for k in kept]
    if brdf.channels == _XYZ:
        return np.eye(3), ["CIE-X", "Visible", "CIE-Z"], []
    if brdf.channels == RGB:
        said = "R, G, B are written as CIE X, Y, Z, those of linear sRGB"
        return _XYZ_OF_RGB, ["CIE-X", "Visible", "CIE-Z"], [said]
    listed = ", ".join(brdf.channels.labels()[:8])
    raise InputError(
        "channels_do_not_fit",
        f"a BSDF file holds one channel, or X, Y, Z (R, G, B are turned into these); this material has: {listed}: pass "
        "channel= (in the shell --write channel=NAME) for one of them",
        where="brdf",
        got=listed,
        expected="one channel, X, Y, Z or R, G, B",
    )


def _own(brdf: Brdf) -> tuple[Float64Array, str] | None:
    """The values and basis of a patch grid that has the patches of a file; None for anything else."""
    if not isinstance(brdf, PatchGrid):
        return None
    if brdf.coordinates == "disk":
        r, x, y, _ = brdf.values.shape
        return (brdf.values, "tree") if x == y == 2 * r and r & (r - 1) == 0 else None
    values = np.concatenate([brdf.values, brdf.values[:, :, ::-1]], axis=2) if brdf.bilateral else brdf.values
    for name, basis in BASES.items():
        edges = np.radians(basis.edges)
        same = np.array_equal(brdf.theta_i, edges) and np.array_equal(brdf.theta_o, edges)  # type: ignore[arg-type]
        if same and values.shape[2] == cells_of(basis, basis):
            return values, name
    return None


# ---- averages ------------------------------------------------------------------------------------


def settled(brdf: Brdf, averages: Any) -> tuple[Float64Array, float]:
    """(averages with as many points as they need, their last change as L1): points are doubled until it is small."""
    points = _FIRST
    values, weight, spent = averages(points)
    while True:
        finer, _, used = averages(2 * points)
        whole = float((np.abs(finer) * weight).sum())
        change = float((np.abs(finer - values) * weight).sum()) / whole if whole > 0 else 0.0
        spent += used
        if change <= _SETTLED or spent + 8 * used > _BUDGET:
            return finer, change
        values, points = finer, 2 * points


def ring_averages(brdf: Brdf, basis: Basis, points: int) -> tuple[Float64Array, Float64Array, int]:
    """(values (I, O, N, C) of the patches, weights (I, O, 1, 1), evaluations): f averaged over incident and outgoing
    patches, both weighed by projected solid angle.

    f depends on the difference of azimuth alone, so that the average over two patches is that over the difference,
    weighed by the overlap of the two: a trapezium, here of the rectangles of fine even cells.
    """
    count = cells_of(basis, basis)
    fine = count * max(1, points // 4)
    edges = np.radians(basis.edges)
    x, w = np.polynomial.legendre.leggauss(points)
    # in sin^2 theta the projected solid angle is even
    low, high = np.sin(edges[:-1]) ** 2, np.sin(edges[1:]) ** 2
    theta = np.arcsin(np.sqrt(0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * x))
    turns = (np.arange(fine) + 0.5) * (2 * np.pi / fine)
    half = fine // 2 if brdf.bilateral else fine
    rings = len(basis.patches)
    mean = np.empty((rings, rings, fine, len(brdf.channels)))
    for a in range(rings):
        for b in range(rings):
            f = brdf.evaluate(theta[a][:, None, None], theta[b][None, :, None], turns[:half])
            over = np.einsum("i,o,iodc->dc", 0.5 * w, 0.5 * w, f.astype(np.float64))
            mean[a, b] = np.concatenate([over, over[::-1]]) if brdf.bilateral else over
    values = np.empty((rings, rings, count, len(brdf.channels)))
    spectrum = np.fft.rfft(mean, axis=2)
    for a, n in enumerate(basis.patches):
        for b, m in enumerate(basis.patches):
            steps = lattice(n, m)
            window = _overlap(fine, n, m)
            # around the mirror: a difference of 0 between patches is delta_phi = pi
            smooth = np.fft.irfft(spectrum[a, b] * np.fft.rfft(window)[:, None], fine, axis=0)
            at = np.round(np.arange(steps) * fine / steps + fine / 2).astype(np.int64) % fine
            # cell edges are the middles of the lattice: the mean of the two fine cells beside an edge
            own = 0.5 * (smooth[at - 1] + smooth[at])
            nearest = np.mod(np.floor((np.arange(count) + 0.5) * steps / count + 0.5), steps).astype(np.int64)
            values[a, b] = np.roll(own[nearest], count // 2, axis=0)
    omega = basis.omega * np.array(basis.patches)
    return values, (omega[:, None] * omega)[:, :, None, None], mean.size // len(brdf.channels) * points * points


def _overlap(fine: int, n: int, m: int) -> Float64Array:
    """Weights (fine,) by distance in cells of the average over two boxes of a turn over n and over m, of sum 1."""
    boxes = []
    for count in (n, m):
        width = fine / count
        k = np.minimum(np.arange(fine), fine - np.arange(fine))
        boxes.append(np.clip(0.5 * width - (k - 0.5), 0, 1) / width if count > 1 else np.full(fine, 1 / fine))
    both = np.fft.irfft(np.fft.rfft(boxes[0]) * np.fft.rfft(boxes[1]), fine)
    return np.asarray(both / both.sum())


def tree_averages(brdf: Brdf, size: int, points: int) -> tuple[Float64Array, Float64Array, int]:
    """(values (R, 2R, 2R, C) of the cells of a tree, weights, evaluations): 2R = `size` cells along each axis of wo."""
    r = size // 2
    points = max(1, points // 4)
    x, w = np.polynomial.legendre.leggauss(2 * points)
    edges = np.arange(r + 1) / r
    # in rho^2 the projected solid angle of incidence is even
    middle, width = 0.5 * (edges[1:] ** 2 + edges[:-1] ** 2), 0.5 * (edges[1:] ** 2 - edges[:-1] ** 2)
    theta_i = np.arcsin(np.minimum(np.sqrt(middle[:, None] + width[:, None] * x), 1.0))
    xo, wo = np.polynomial.legendre.leggauss(points)
    along = ((np.arange(size)[:, None] + 0.5 + 0.5 * xo) / size).reshape(-1)
    rho, turn = disk(*np.meshgrid(along, along, indexing="ij"))
    theta_o = np.arcsin(np.minimum(rho, 1.0))
    values = np.empty((r, size, size, len(brdf.channels)))
    for k in range(r):
        total = 0.0
        for angle, weight in zip(theta_i[k], 0.5 * w, strict=True):
            f = brdf.evaluate(angle, theta_o, turn).astype(np.float64)
            total = total + weight * f
        shaped = np.asarray(total).reshape(size, points, size, points, -1)
        values[k] = np.einsum("p,q,xpyqc->xyc", 0.5 * wo, 0.5 * wo, shaped)
    areas = np.diff(edges**2)[:, None, None, None]
    return values, areas, theta_i.size * rho.size


def _cost(brdf: Brdf, values: Float64Array, basis: str, change: float) -> str:
    """What the averages lose, measured: the distance (L1) of the step function from the material."""
    arrays = {"values": np.ascontiguousarray(values)}
    flags = {"bilateral": False, "reciprocal": False, "energy_conserving": False, "non_negative": False}
    kind = "disk" if basis == "tree" else "rings"
    if kind == "rings":
        arrays |= dict.fromkeys(("theta_i", "theta_o"), np.radians(BASES[basis].edges))
    table = PatchGrid.from_arrays(arrays, {"coordinates": kind}, brdf.channels, flags)
    l1 = compare(brdf, table, directions=_DIRECTIONS).l1
    shape = "tensor tree" if basis == "tree" else f"Klems {basis} basis"
    said = f"averaged over the patches of a {shape}: the step function misplaces {l1:.3g} of the reflected energy (L1)"
    return said if change <= _SETTLED else f"{said}; the averages themselves are known to {change:.2g} only"


# ---- text ------------------------------------------------------------------------------------------


def _lines(name: str, values: Float64Array, labels: list[str], basis: str) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield '<WindowElement xmlns="http://windows.lbl.gov" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
    yield 'xsi:schemaLocation="http://windows.lbl.gov BSDF-v1.4.xsd">\n'
    yield "<WindowElementType>System</WindowElementType>\n<Optical>\n<Layer>\n<Material>\n"
    plain = "".join(c if c.isprintable() else "?" for c in name)
    yield f"\t<Name>{escape(plain)}</Name>\n\t<Manufacturer>unknown</Manufacturer>\n"
    yield "\t<DeviceType>Other</DeviceType>\n</Material>\n<DataDefinition>\n"
    yield f"\t<IncidentDataStructure>{'TensorTree3' if basis == 'tree' else 'Columns'}</IncidentDataStructure>\n"
    if basis == "tree":
        yield "\t<AngleBasis>\n\t\t<AngleBasisName>LBNL/Shirley-Chiu</AngleBasisName>\n\t</AngleBasis>\n"
    else:
        yield from _basis(BASES[basis])
    yield "</DataDefinition>\n"
    for k, label in enumerate(labels):
        data = composed(values[..., k]) if basis == "tree" else _matrix(values[..., k], BASES[basis])
        yield "<WavelengthData>\n\t<LayerNumber>System</LayerNumber>\n"
        yield f'\t<Wavelength unit="Integral">{label}</Wavelength>\n'
        yield "\t<SourceSpectrum>CIE Illuminant D65 1nm.ssp</SourceSpectrum>\n"
        yield f"\t<DetectorSpectrum>ASTM E308 1931 {label[-1] if '-' in label else 'Y'}.dsp</DetectorSpectrum>\n"
        for side in ("Reflection Front", "Reflection Back"):
            yield f"\t<WavelengthDataBlock>\n\t\t<WavelengthDataDirection>{side}</WavelengthDataDirection>\n"
            if basis == "tree":
                yield "\t\t<AngleBasis>LBNL/Shirley-Chiu</AngleBasis>\n"
            else:
                yield f"\t\t<ColumnAngleBasis>{BASES[basis].name}</ColumnAngleBasis>\n"
                yield f"\t\t<RowAngleBasis>{BASES[basis].name}</RowAngleBasis>\n"
            yield "\t\t<ScatteringDataType>BRDF</ScatteringDataType>\n\t\t<ScatteringData>\n"
            yield data
            yield "\n\t\t</ScatteringData>\n\t</WavelengthDataBlock>\n"
        yield "</WavelengthData>\n"
    yield "</Layer>\n</Optical>\n</WindowElement>\n"


def _basis(basis: Basis) -> Iterator[str]:
    yield f"\t<AngleBasis>\n\t\t<AngleBasisName>{basis.name}</AngleBasisName>\n"
    for low, high, n in zip(basis.edges, basis.edges[1:], basis.patches, strict=False):
        yield f"\t\t<AngleBasisBlock>\n\t\t\t<Theta>{0 if low == 0 else 0.5 * (low + high):g}</Theta>\n"
        yield f"\t\t\t<ThetaBounds>\n\t\t\t\t<LowerTheta>{low:g}</LowerTheta>\n"
        yield f"\t\t\t\t<UpperTheta>{high:g}</UpperTheta>\n\t\t\t</ThetaBounds>\n\t\t\t<nPhis>{n}</nPhis>\n"
        yield "\t\t</AngleBasisBlock>\n"
    yield "\t</AngleBasis>\n"


def _matrix(values: Float64Array, basis: Basis) -> str:
    """A row an outgoing patch, a column an incident one."""
    count = values.shape[2]
    rows = []
    for b, m in enumerate(basis.patches):
        for k in range(m):
            row: list[float] = []
            for a, n in enumerate(basis.patches):
                # the difference of azimuth lies on an edge of the fine cells: the cell after it is its own
                turn = np.mod(k / m - np.arange(n) / n + 0.5, 1.0) if lattice(n, m) > 1 else np.zeros(n)
                cell = np.mod(np.rint(turn * count).astype(np.int64), count)
                row += values[a, b, cell].tolist()
            rows.append(",\t".join(map(repr, row)))
    return ",\n".join(rows)
