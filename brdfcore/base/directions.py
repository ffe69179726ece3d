"""Seeded sets of direction pairs with their densities: what errors are measured on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import InputError
from brdfcore.base.geometry import outgoing_from_half, pair_from_angles

Float64Array = npt.NDArray[np.float64]

#: GGX widths of the lobe part: one set serves lobes from a satin paint to a polished metal.
LOBE_WIDTHS = (0.003, 0.01, 0.03, 0.1, 0.3)
#: Most pairs drawn at once: 7 GB.
LARGEST = 2**26


@dataclass(frozen=True, slots=True)
class DirectionSet:
    """n direction pairs drawn from a known density; all arrays (n,), radians, float64.

    density  of the pair over solid angles, 1/sr^2 (both parts of the mixture at every sample).
    weight   cos_i cos_o / density: (1/n) sum weight f estimates int f c_i c_o dwi dwo;
             0 for a draw whose wo is below the horizon (kept, so that n counts every draw).
    lobe     True where the pair was drawn around the mirror direction.
    """

    theta_i: Float64Array
    theta_o: Float64Array
    delta_phi: Float64Array
    density: Float64Array
    weight: Float64Array
    lobe: npt.NDArray[np.bool_]
    seed: int


def mixture(n: int, seed: int, *, cosine_share: float = 0.5, widths: tuple[float, ...] = LOBE_WIDTHS) -> DirectionSet:
    """wi cosine-distributed; wo cosine-distributed with probability `cosine_share`, else mirrored at a GGX normal.

    p = s c_i c_o / pi^2 + (1 - s) (c_i/pi) mean_a D_a(h) (n.h) / (4 wo.h), s = `cosine_share` >= .3 so that
    the weight of a direction far from the lobe stays bounded (w <= pi^2/s). Independent draws of PCG64(seed).
    """
    rng = _generator(n, seed)
    theta_i = np.arcsin(np.sqrt(rng.random(n)))
    lobe = rng.random(n) >= cosine_share
    alpha = rng.choice(np.asarray(widths), n)
    u, phi = rng.random(n), rng.uniform(-np.pi, np.pi, n)
    # cosine-distributed wo, and GGX-distributed h: tan theta_h = alpha sqrt(u/(1-u))
    theta_flat = np.arcsin(np.sqrt(u))
    theta_h = np.arctan(alpha * np.sqrt(u / (1 - u)))
    theta_lobe, delta_lobe, _ = outgoing_from_half(theta_i, theta_h, phi)
    theta_o = np.where(lobe, theta_lobe, theta_flat)
    delta_phi = np.where(lobe, delta_lobe, phi)
    below = theta_o >= np.pi / 2
    theta_o = np.where(below, 0.0, theta_o)
    pair = pair_from_angles(theta_i, theta_o, delta_phi)
    tan2 = pair.tan2_h
    nh = 1 / np.sqrt(1 + tan2)
    d = np.mean([((a * (1 + tan2)) / (tan2 + a * a)) ** 2 / np.pi for a in widths], axis=0)
    density = cosine_share * pair.cos_i * pair.cos_o / np.pi**2
    density = density + (1 - cosine_share) * (pair.cos_i / np.pi) * d * nh / (4 * pair.cos_d)
    weight = np.where(below, 0.0, pair.cos_i * pair.cos_o / density)
    return DirectionSet(theta_i, theta_o, delta_phi, density, weight, lobe, seed)


def _generator(n: int, seed: int) -> np.random.Generator:
    """PCG64(seed), after holding the number of pairs and the seed to what can be drawn."""
    for name, value, least, most in (("directions", n, 1, LARGEST), ("seed", seed, 0, 2**63 - 1)):
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not least <= value <= most:
            raise InputError(
                "bad_option",
                f"{name}: expected a whole number from {least} to {most}",
                where=name,
                expected=f"[{least}, {most}]",
            )
    return np.random.default_rng(seed)


def cosine_pairs(n: int, seed: int) -> tuple[Float64Array, Float64Array, Float64Array]:
    """n pairs with both directions cosine-distributed: (theta_i, theta_o, delta_phi)."""
    rng = _generator(n, seed)
    return (
        np.arcsin(np.sqrt(rng.random(n))),
        np.arcsin(np.sqrt(rng.random(n))),
        rng.uniform(-np.pi, np.pi, n),
    )
