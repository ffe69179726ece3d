"""What is expanded: f times cosines, extended to the whole sphere so that it has no step at the horizon.

f c extended oddly is continuous there, f extended evenly too; f extended by zero has a step, whose 9 % of ringing never
shrinks. So each direction has one cosine and odd functions (l + m odd), or none and even ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import InputError
from brdfcore.base.parameters import shown
from brdfcore.harmonics.legendre import Parity, degrees, order_size
from brdfcore.names import Target as TargetName

#: A MERL file, the usual measure of a large table: what an expansion above it has to be told beside.
MERL_BYTES = 34_992_012


@dataclass(frozen=True)
class Target:
    """f c_i^cos_i c_o^cos_o."""

    name: TargetName
    cos_i: int
    cos_o: int

    @property
    def parity_i(self) -> Parity:
        return "odd" if self.cos_i else "even"

    @property
    def parity_o(self) -> Parity:
        return "odd" if self.cos_o else "even"

    @property
    def symmetric(self) -> bool:
        """Whether swapping the directions maps the target to itself."""
        return self.cos_i == self.cos_o


TARGETS: MappingProxyType[str, Target] = MappingProxyType(
    {t.name: t for t in (Target("f_cos_cos", 1, 1), Target("f", 0, 0), Target("f_cos_o", 0, 1))}
)


def target_named(name: object) -> Target:
    """The target; `InputError` listing the others."""
    if not isinstance(name, str) or name not in TARGETS:
        raise InputError(
            "bad_target",
            f"target = {shown(name)}: expected one of {', '.join(TARGETS)}",
            where="target",
            got=shown(name),
            expected=", ".join(TARGETS),
        )
    return TARGETS[name]


@dataclass(frozen=True)
class Block:
    """One order: the coefficients of cos(m delta_phi), or of sin(m delta_phi) where `sine`."""

    m: int
    sine: bool
    rows: int
    columns: int

    @property
    def weight(self) -> float:
        """2 - delta_m0: how often the order's energy counts."""
        return 1.0 if self.m == 0 else 2.0


def blocks(lmax: int, target: Target, bilateral: bool) -> list[Block]:
    """Cosine blocks m = 0 ... lmax, then sine blocks m = 1 ... lmax unless bilateral; none without coefficients."""

    def block(m: int, sine: bool) -> Block:
        return Block(m, sine, order_size(lmax, m, target.parity_i), order_size(lmax, m, target.parity_o))

    found = [block(m, False) for m in range(lmax + 1)]
    found += [] if bilateral else [block(m, True) for m in range(1, lmax + 1)]
    return [b for b in found if b.rows and b.columns]


def count(lmax: int, target: Target, bilateral: bool, symmetric: bool) -> int:
    """Coefficients a channel: half of each block where it is symmetric."""
    return sum(
        b.rows * (b.rows + 1) // 2 if symmetric and bilateral else b.rows * b.columns
        for b in blocks(lmax, target, bilateral)
    )


def degrees_of(block: Block, lmax: int, target: Target) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """l of the rows (theta_i) and l' of the columns (theta_o) of a block."""
    return degrees(lmax, block.m, target.parity_i), degrees(lmax, block.m, target.parity_o)
