"""The lattice of a `scattered` table: predicted nodes, what policies make of them, and the guide beside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI
from brdfcore.base.errors import InputError
from brdfcore.base.status import Status
from brdfcore.tables.base.half_lattice import steps_z
from brdfcore.tables.base.layout import Layout, angles_of
from brdfcore.tables.base.table import Progress
from brdfcore.tables.scattered.coverage import Coverage
from brdfcore.tables.scattered.fit import Predictor

Float64Array = npt.NDArray[np.float64]

#: Nodes along theta_h, theta_d and half a turn of phi_d where no shape is asked for.
DEFAULT_SHAPE = (64, 28, 24)
#: Sweeps in which the lattice is moved to meet the predictor at the measurements.
_SWEEPS = 20
#: Nodes predicted at a time.
_CHUNK = 8_192


@dataclass(frozen=True)
class Policy:
    """How measurements become a lattice; what each field means: `Scattered.PARAMETERS`. `gap` in rad."""

    holes: str = "continue"
    negatives: str = "keep"
    smoothing: float | None = None
    gap: float = float(np.radians(15))
    shape: tuple[int, ...] | None = None
    plane: str = "auto"


def lattice_shape(shape: tuple[int, ...] | None, bilateral: bool) -> tuple[int, int, int]:
    given = DEFAULT_SHAPE if shape is None else shape
    if len(given) != 3 or min(given) < 4:
        raise InputError(
            "bad_shape",
            f"shape = {list(given)}: expected 3 numbers of nodes (theta_h, theta_d, phi_d), each at least 4",
            where="shape",
            got=list(given),
            expected="3 whole numbers >= 4",
        )
    return given[0], given[1], given[2] * (1 if bilateral else 2) - (0 if bilateral else 1)


def layout_of(bilateral: bool) -> Layout:
    """Nodes along theta_h half by octave, down to a milliradian, half uniform; along the others uniform in the angle.

    The guide along theta_h follows from the nodes; there is none along theta_d.
    """
    from brdfcore.kernels.tables.half_difference import grid_u, grid_w

    t = np.sqrt(grid_u())
    x = t / (1 + t)
    even = 0.5 * np.maximum(np.log2(x) + 10, 0) / 10 + 0.5 * x
    theta_d = np.arccos(np.sqrt(grid_w()))
    z = np.linspace(0.0 if bilateral else -2.0, 2.0, steps_z(bilateral, False) + 1)
    quarter = np.floor(np.abs(z))
    part = np.abs(z) - quarter
    phi = np.sign(z) * (quarter * HALF_PI + np.arctan2(part, 1 - part))
    layout = Layout(
        guide_h=np.zeros(t.size),
        guide_d=np.zeros(theta_d.size),
        map_h=(even - even[0]) / (even[-1] - even[0]),
        map_d=theta_d / theta_d[0],
        map_p=(phi - phi[0]) / (phi[-1] - phi[0]),
        factor="none",
        mirror=False,
        bilateral=bilateral,
        reciprocal=False,
    )
    return layout.rounded()  # what a look-up will see


def nodes_of(
    predictor: Predictor,
    layout: Layout,
    shape: tuple[int, int, int],
    coverage: Coverage,
    values: Float64Array,
    policy: Policy,
    progress: Progress | None,
) -> tuple[Float64Array, list[str]]:
    """(predicted nodes over the guide, what was done); sets the guide of `layout`."""
    places = [np.arange(n, dtype=np.float64) for n in shape]
    u, w, z = layout.coordinates(places, shape)
    u[0] = 0.0  # the map begins at 2^-28; the mirror direction itself is the first node
    grids = [g.reshape(-1) for g in np.meshgrid(u, w, z, indexing="ij")]
    theta_i, theta_o, delta_phi = angles_of(grids[0], grids[1], grids[2])
    theta_h, theta_d = np.arctan(np.sqrt(grids[0])), np.arccos(np.sqrt(grids[1]))
    features = predictor.features(theta_h, theta_d, theta_i, theta_o, delta_phi)
    nodes, limited = np.empty((theta_i.size, values.shape[1])), 0
    for start in range(0, theta_i.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        nodes[part], above_limit = predictor(features[part], theta_i[part], theta_o[part])
        limited += above_limit
        if progress is not None:
            progress(min(start + _CHUNK, theta_i.size), theta_i.size, "predicting the nodes")
    above = (theta_i <= HALF_PI) & (theta_o <= HALF_PI)
    holes = np.zeros(theta_i.size, np.bool_)
    codes = coverage.status(theta_i[above], theta_o[above], delta_phi[above])
    holes[above] = codes == Status.FILLED
    done = _settled(nodes, holes, above, (theta_i, theta_o, delta_phi), coverage, values, policy)
    if limited:
        done.append(f"{limited} of {nodes.size} nodes held to twice the largest measured value of their channel")
    shaped = nodes.reshape(*shape, -1)
    if not layout.bilateral:  # z = -2 and z = 2 are one direction: no step at delta_phi = pi
        shaped[:, :, 0] = shaped[:, :, -1] = 0.5 * (shaped[:, :, 0] + shaped[:, :, -1])
    # phi_d has no meaning at h = n and at wi = wo: one value each
    shaped[0] = shaped[0].mean(axis=1, keepdims=True)
    shaped[:, 0] = shaped[:, 0].mean(axis=1, keepdims=True)
    weight = np.where(above, np.cos(np.minimum(theta_i, HALF_PI)) * np.cos(np.minimum(theta_o, HALF_PI)), 0)
    layout.guide_h = _guide(shaped, weight.reshape(shape), layout)
    layout.guide_h = layout.rounded().guide_h
    return shaped / np.exp2(np.interp(u, layout.grids()[0], layout.guide_h))[:, None, None, None], done


def meet(nodes: Float64Array, layout: Layout, angles: Float64Array, targets: Float64Array) -> None:
    """Move `nodes`, in place, until the lattice meets the predictor at the measured geometries, not only between.

    Linear interpolation between nodes cuts a lobe's peak. Each node takes the mean misfit of the geometries around it,
    weighted by their nearness, `_SWEEPS` times (simultaneous iterative reconstruction).
    """
    from brdfcore.kernels.tables.half_coordinates import coordinates_numpy

    shape = nodes.shape[:3]
    at = coordinates_numpy(angles[:, 0], angles[:, 1], angles[:, 2], layout.bilateral, False)
    guide = layout.growth(angles[:, 0], angles[:, 1], at[0], at[1])
    places = layout.positions(at, shape)
    cells = [np.minimum(p.astype(np.int64), n - 2) for p, n in zip(places, shape, strict=True)]
    parts = [p - c for p, c in zip(places, cells, strict=True)]
    corner = np.array([(q >> 2, q >> 1 & 1, q & 1) for q in range(8)])
    place = [c[:, None] + up for c, up in zip(cells, corner.T, strict=True)]
    # one node where phi_d has no meaning, and where its ends meet
    turn = np.where((place[0] == 0) | (place[1] == 0), 0, place[2])
    if not layout.bilateral:
        turn = np.where(turn == shape[2] - 1, 0, turn)
    index = np.ravel_multi_index((place[0], place[1], turn), shape)
    weight = np.prod([np.where(up == 1, p[:, None], 1 - p[:, None]) for p, up in zip(parts, corner.T, strict=True)], 0)
    total = np.bincount(index.ravel(), weight.ravel(), int(np.prod(shape)))[:, None]
    flat, wanted = nodes.reshape(-1, nodes.shape[3]), targets / guide[:, None]
    lowest = min(float(flat.min()), 0.0)
    for _ in range(_SWEEPS):
        misfit = wanted - np.einsum("pk,pkc->pc", weight, flat[index])
        change = np.zeros_like(flat)
        np.add.at(change, index, weight[:, :, None] * misfit[:, None, :])
        flat += np.divide(change, total, out=change, where=total > 1e-9)
        np.maximum(flat, lowest, out=flat)
    if not layout.bilateral:
        nodes[:, :, -1] = nodes[:, :, 0]
    nodes[0], nodes[:, 0] = nodes[0, :, :1], nodes[:, 0, :1]


def _settled(
    nodes: Float64Array,
    holes: npt.NDArray[np.bool_],
    above: npt.NDArray[np.bool_],
    angles: tuple[Float64Array, Float64Array, Float64Array],
    coverage: Coverage,
    values: Float64Array,
    policy: Policy,
) -> list[str]:
    """Apply the policies for holes and negatives to `nodes`, in place; what was done."""
    done = []
    if holes.any():
        what = {
            "continue": "continued from the limits of the measured range",
            "nearest": "given the value of the nearest measurement",
            "zero": "set to 0",
        }[policy.holes]
        if policy.holes == "nearest":
            nodes[holes] = values[coverage.nearest(*(a[holes] for a in angles))]
        elif policy.holes == "zero":
            nodes[holes] = 0
        share = holes.sum() / above.sum()
        done.append(f"{share:.0%} of the directions above the horizon are holes: {what} (holes={policy.holes!r})")
    negative = int((nodes[above] < 0).sum())
    measured = int((values < 0).sum())
    if negative and (policy.negatives == "zero" or not measured):
        np.maximum(nodes, 0, out=nodes)
        why = "as asked" if measured else "no measurement is negative"
        done.append(f"{negative} negative nodes set to zero, {why}")
    return done


def _guide(nodes: Float64Array, weight: Float64Array, layout: Layout) -> Float64Array:
    """The lobe's shape along theta_h, exponents of 2, at most 0: the geometric mean of each slice of nodes, geometric
    between them."""
    size = np.abs(nodes).mean(axis=3)
    floor = 1e-6 * float(size.max()) or 1.0
    total = weight.sum(axis=(1, 2))
    log = (weight * np.log2(np.maximum(size, floor))).sum(axis=(1, 2)) / np.maximum(total, 1e-300)
    reached = total > 1e-9
    place = np.arange(len(log), dtype=float)
    log = np.interp(place, place[reached], log[reached])
    return np.asarray(np.interp(layout.map_h * (len(log) - 1), place, log - log.max()))
