"""Nodes and weights: composite Gauss-Legendre and a hemisphere rule graded towards the mirror direction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray
from brdfcore.base.geometry import horizon_theta_h, outgoing_from_half

Float64Array = npt.NDArray[np.float64]

#: theta_h / horizon at the panel edges of `hemisphere_rule`: from a lobe of roughness 1e-8 to the horizon.
_GRADED = np.concatenate([[0.0], np.geomspace(1e-9, 1.0, 19)])

#: Where boxes end that are cut towards a point, and what is left of them at each cut.
_FINEST, _SHRINK = 1e-9, 0.2


@lru_cache(maxsize=32)
def _gauss(n: int) -> tuple[Float64Array, Float64Array]:
    x, w = np.polynomial.legendre.leggauss(n)
    x.flags.writeable = w.flags.writeable = False
    return x, w


def gauss_legendre(n: int, start: float = 0.0, stop: float = 1.0) -> tuple[Float64Array, Float64Array]:
    """n-point Gauss-Legendre nodes and weights on [start, stop]."""
    x, w = _gauss(n)
    return 0.5 * (stop - start) * (x + 1) + start, 0.5 * (stop - start) * w


def composite(edges: npt.ArrayLike, n: int) -> tuple[Float64Array, Float64Array]:
    """n-point Gauss-Legendre on each panel between consecutive `edges`; nodes ascending.

    Panels of at most 64 points: one rule of 12,000 points does not finish in numpy.
    """
    e = np.asarray(edges, dtype=np.float64)
    x, w = _gauss(n)
    width = np.diff(e)
    nodes = e[:-1, None] + 0.5 * width[:, None] * (x + 1)
    return nodes.reshape(-1), (0.5 * width[:, None] * w).reshape(-1)


def hemisphere_rule(
    theta_i: float, *, points: int = 12, azimuths: int = 64, bilateral: bool = False
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Quadrature over the outgoing hemisphere: (theta_o, delta_phi, weight), flat float64 arrays.

    sum_k weight_k f(theta_i, theta_o_k, delta_phi_k) cos(theta_o_k) ~ int f cos_o dwo, with dwo = 4 (wi.h) dwh.
    Integrated over the half vector on boxes in theta_h and phi_h, `points` by `azimuths`/8 Gauss-Legendre nodes each.
    In theta_h they grow geometrically from 1e-9 of the horizon (for that azimuth, exactly), so that a lobe of any
    roughness above 1e-8 is resolved; in phi_h from cos theta_i on both sides of pi/2, where the horizon of a grazing
    theta_i turns from near to far. A bilateral source is integrated over half the circle.
    The mirror direction itself is the pole of the rule: symmetric lobes converge in one azimuth.
    """
    boxes = _first_boxes(theta_i, bilateral)
    theta_o, delta_phi, weight = _nodes(theta_i, boxes, points, _per_panel(azimuths))
    return theta_o.reshape(-1), delta_phi.reshape(-1), (2.0 if bilateral else 1.0) * weight.reshape(-1)


def integrate_hemisphere(
    f: Callable[[Float64Array, Float64Array], FloatArray],
    theta_i: float,
    *,
    points: int = 12,
    azimuths: int = 64,
    bilateral: bool = False,
    tolerance: float = np.inf,
    budget: int = 0,
    centres: Sequence[tuple[float, float]] = (),
) -> tuple[Float64Array, Float64Array]:
    """(int f cos_o dwo, its estimated error), each (channels,), of f(theta_o, delta_phi) -> (n, channels).

    Starts from `hemisphere_rule` and halves the boxes with the largest estimates until their sum is at most
    `tolerance` max(1, integral), or `budget` further evaluations are spent. A box is halved across the axis on which
    its last Legendre coefficients are larger; those coefficients, times a power of the rate at which they fall, are
    the estimate: far above the error where f is smooth, about it across a kink.

    centres  directions (theta_o, delta_phi) of lobes elsewhere than at the mirror direction: boxes are halved towards
             them first, down to 1e-9, as no rule finds what falls between its nodes.
    """
    per_panel = _per_panel(azimuths)
    sides = 2.0 if bilateral else 1.0
    boxes = _first_boxes(theta_i, bilateral)
    for theta_o, delta_phi in centres:
        boxes = _towards(boxes, *_box_coordinates(theta_i, theta_o, delta_phi, bilateral))
    values, errors = _integrate(f, theta_i, boxes, points, per_panel)
    spent = 0
    while True:
        value, error = sides * values.sum(axis=0), sides * errors.sum(axis=(0, 2))
        allowed = tolerance * np.maximum(1.0, np.abs(value))
        affordable = (budget - spent) // (2 * points * per_panel)
        # written so that a channel that is not finite is left as it is
        if not (error > allowed).any() or affordable < 1:
            return value, error + 4 * np.finfo(np.float64).eps * np.abs(value)
        share = sides * errors / allowed[:, None]
        share = np.where(np.isfinite(share), share, 0.0).max(axis=1)  # of the worst channel, for each axis
        worst = np.argsort(-share.sum(axis=1))
        # leave alone the many small ones that together are half of what is allowed
        rest = np.cumsum(share.sum(axis=1)[worst][::-1])[::-1]
        chosen = worst[: min(int(np.count_nonzero(rest > 0.5)), affordable)]
        halves = _halved(boxes[chosen], share[chosen, 1] > share[chosen, 0])
        spent += halves.shape[0] * points * per_panel
        new_values, new_errors = _integrate(f, theta_i, halves, points, per_panel)
        boxes = np.concatenate([np.delete(boxes, chosen, axis=0), halves])
        values = np.concatenate([np.delete(values, chosen, axis=0), new_values])
        errors = np.concatenate([np.delete(errors, chosen, axis=0), new_errors])


def _per_panel(azimuths: int) -> int:
    return max(azimuths // 8, 2)


def _first_boxes(theta_i: float, bilateral: bool) -> Float64Array:
    """(boxes, 4): u from, u to, phi_h from, phi_h to; u = theta_h/horizon(phi_h)."""
    nearest = min(max(float(np.cos(theta_i)), 1e-7), 0.25 * np.pi)
    count = 2 + int(np.ceil(np.log(0.25 * np.pi / nearest) / np.log(4.0)))
    offsets = np.concatenate([[0.0], np.geomspace(nearest, 0.5 * np.pi, count)])
    phi = 0.5 * np.pi + np.concatenate([-offsets[:0:-1], offsets])
    pairs = np.stack([phi[:-1], phi[1:]], axis=1)
    if not bilateral:
        pairs = np.concatenate([-pairs[::-1, ::-1], pairs])
    u = np.stack([_GRADED[:-1], _GRADED[1:]], axis=1)
    return np.concatenate([np.tile(u, (pairs.shape[0], 1)), np.repeat(pairs, u.shape[0], axis=0)], axis=1)


def _box_coordinates(theta_i: float, theta_o: float, delta_phi: float, bilateral: bool) -> tuple[float, float]:
    """(u, phi_h) of a direction."""
    x = np.sin(theta_i) + np.sin(theta_o) * np.cos(delta_phi)
    y = np.sin(theta_o) * np.sin(delta_phi)
    phi_h = float(np.arctan2(abs(y) if bilateral else y, x))
    theta_h = float(np.arctan2(np.hypot(x, y), np.cos(theta_i) + np.cos(theta_o)))
    return min(theta_h / float(horizon_theta_h(theta_i, np.asarray(phi_h))), 1.0), phi_h


def _towards(boxes: Float64Array, u: float, phi: float) -> Float64Array:
    """`boxes` with those that hold the point cut at it, and then halved towards it down to `_FINEST`."""
    for start, x in ((0, u), (2, phi)):
        cut = (boxes[:, start] < x) & (boxes[:, start + 1] > x)
        low, high = boxes[cut].copy(), boxes[cut].copy()
        low[:, start + 1] = high[:, start] = x
        boxes = np.concatenate([boxes[~cut], low, high])
    point = np.array([u, u, phi, phi])
    while True:
        # a corner of each of these is the point
        corner = ((boxes == point)[:, [0, 1]].any(axis=1)) & ((boxes == point)[:, [2, 3]].any(axis=1))
        sizes = np.stack([boxes[:, 1] - boxes[:, 0], boxes[:, 3] - boxes[:, 2]], axis=1)
        chosen = np.flatnonzero(corner & (sizes.max(axis=1) > _FINEST))
        if not chosen.size:
            return boxes
        # both axes are cut where they are alike, else the longer one: the far part of each stays as it is
        new = []
        for box, size in zip(boxes[chosen], sizes[chosen]):
            for start in (0, 2):
                if size[start // 2] < 0.5 * size.max():
                    continue
                near_low = box[start] == point[start]
                edge = box[start] + (_SHRINK if near_low else 1 - _SHRINK) * (box[start + 1] - box[start])
                far = box.copy()
                far[start if near_low else start + 1] = edge
                new.append(far)
                box = box.copy()
                box[start + 1 if near_low else start] = edge
            new.append(box)
        boxes = np.concatenate([np.delete(boxes, chosen, axis=0), np.stack(new)])


def _halved(boxes: Float64Array, across_phi: npt.NDArray[np.bool_]) -> Float64Array:
    first, second = boxes.copy(), boxes.copy()
    for rows, start in ((np.flatnonzero(~across_phi), 0), (np.flatnonzero(across_phi), 2)):
        middle = 0.5 * (boxes[rows, start] + boxes[rows, start + 1])
        first[rows, start + 1] = middle
        second[rows, start] = middle
    return np.concatenate([first, second])


def _nodes(
    theta_i: float, boxes: Float64Array, points: int, per_panel: int
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """(theta_o, delta_phi, weight), each (boxes, per_panel, points)."""
    (x_u, w_u), (x_p, w_p) = _gauss(points), _gauss(per_panel)
    half_u, half_p = 0.5 * (boxes[:, 1:2] - boxes[:, 0:1]), 0.5 * (boxes[:, 3:4] - boxes[:, 2:3])
    u = boxes[:, 0:1] + half_u * (x_u + 1)
    phi_h = boxes[:, 2:3] + half_p * (x_p + 1)
    limit = horizon_theta_h(theta_i, phi_h)
    theta_h = limit[:, :, None] * u[:, None, :]
    theta_o, delta_phi, dot = outgoing_from_half(theta_i, theta_h, phi_h[:, :, None])
    weight = (half_p * w_p * limit)[:, :, None] * (half_u * w_u)[:, None, :] * np.sin(theta_h) * 4 * dot
    # the last node before the horizon may land past it by rounding
    return np.minimum(theta_o, np.pi / 2), delta_phi, weight


def _integrate(
    f: Callable[[Float64Array, Float64Array], FloatArray],
    theta_i: float,
    boxes: Float64Array,
    points: int,
    per_panel: int,
) -> tuple[Float64Array, Float64Array]:
    """Integral of each box, (boxes, channels), and its estimated error, (boxes, channels, 2): along u and phi."""
    theta_o, delta_phi, weight = _nodes(theta_i, boxes, points, per_panel)
    shape = weight.shape
    values = f(theta_o.reshape(-1), delta_phi.reshape(-1)).reshape(*shape, -1)
    terms = values * (weight * np.cos(theta_o))[..., None]
    along_u, along_p = terms.sum(axis=1), terms.sum(axis=2)
    return along_u.sum(axis=1), np.stack([_top(along_u), _top(along_p)], axis=-1)


def _top(terms: Float64Array) -> Float64Array:
    """Estimated error of n-point Gauss rules from their terms w_j g_j, (boxes, n, channels) -> (boxes, channels).

    2k + 1 times sum_j w_j P_k(x_j) g_j is the k-th Legendre coefficient of g, times the integral of 1. An analytic g
    has coefficients that fall geometrically, and an integral that is wrong by the 2n-th only: the last ones times a
    power of their ratio to those before is a bound with room to spare. Across a kink they fall as 1/k^2, which a ratio
    above 1/2 is taken for: there the last ones themselves are the estimate.
    """
    n = terms.shape[1]
    legendre = np.polynomial.legendre.legvander(_gauss(n)[0], n - 1) * (2 * np.arange(n) + 1)
    c = np.abs(np.einsum("jk,bjc->bkc", legendre, terms))
    last, before = c[:, -2:].max(axis=1), c[:, -4:-2].max(axis=1) if n >= 4 else c[:, :1].max(axis=1)
    fall = np.divide(last, before, out=np.ones_like(last), where=before > 0)
    estimate: Float64Array = last * np.minimum(2 * fall, 1.0) ** (n // 4)
    return estimate
