"""What a fit makes small, as weighted least squares about the last iterate: sum V (g - Z)^2."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Float64Array = npt.NDArray[np.float64]

LOSSES = ("energy", "relative", "cube_root", "log")
#: Smallest |g - f| that counts as such, of the median: below, |r| is rounded off to sqrt(r^2 + d^2).
_ROUNDED = 1e-3


@dataclass(frozen=True)
class Rows:
    """What is fitted: f (n, C) in 1/sr at angles (n,) each, with the row's share of the integral c_i c_o dw."""

    angles: tuple[Float64Array, Float64Array, Float64Array]
    values: Float64Array
    weight: Float64Array

    @property
    def energy(self) -> float:
        """sum w f, channels added: what L1 is relative to."""
        return float((self.weight[:, None] * self.values).sum())


class Loss:
    """One of `LOSSES` over `rows`.

    energy     sum w |g - f| / sum w f, channels added: the share of the reflected energy that is misplaced
    relative   mean of 2 (f/g - 1 - ln(f/g)), which is ((f - g)/g)^2 for a small one: the likelihood of noise in
               proportion to the value (the deviance of a gamma distribution); rows count alike
    cube_root  sum w ((g c_i)^(1/3) - (f c_i)^(1/3))^2 / sum w
    log        sum w (ln(1 + g c_i) - ln(1 + f c_i))^2 / sum w
    """

    def __init__(self, name: str, rows: Rows) -> None:
        self.name, self.rows = name, rows
        self._cos = np.cos(rows.angles[0])[:, None]
        self._w = rows.weight[:, None]
        self._least = 1e-9 * float(np.abs(rows.values).mean())

    def value(self, g: Float64Array) -> float:
        """Of fitted values g (n, C)."""
        f = self.rows.values
        if self.name == "energy":
            return float((self._w * np.abs(g - f)).sum()) / self.rows.energy
        if self.name == "relative":
            x = f / np.maximum(g, self._least) - 1
            small = np.abs(x) < 1e-4  # the difference would be rounding
            return float(np.where(small, x * x * (1 - x / 1.5), 2 * (x - np.log1p(np.maximum(x, -0.999)))).mean())
        difference = self._transformed(g) - self._transformed(f)
        return float((self._w * difference**2).sum() / (self._w.sum() * f.shape[1]))

    def quadratic(self, g: Float64Array) -> tuple[Float64Array, Float64Array]:
        """(V, Z), (n, C) each, about g."""
        f = self.rows.values
        if self.name == "energy":
            r = np.abs(g - f)
            weighted = r[self._w[:, 0] > 0]
            d = _ROUNDED * float(np.median(weighted)) + 1e-300
            return self._w / np.sqrt(r * r + d * d), f
        if self.name == "relative":
            return 1 / np.maximum(g, self._least) ** 2, f
        g = np.maximum(g, 1e3 * self._least)
        if self.name == "cube_root":
            slope = np.cbrt(self._cos) / 3 * np.cbrt(g) ** -2
        else:
            slope = self._cos / (1 + np.maximum(g, 0) * self._cos)
        return self._w * slope**2, g - (self._transformed(g) - self._transformed(f)) / slope

    def first(self) -> tuple[Float64Array, Float64Array]:
        """(V, Z) before anything is fitted: squares over the value, between an energy and a ratio."""
        f = self.rows.values
        w = np.ones_like(self._w) / f.shape[0] if self.name == "relative" else self._w
        size = np.abs(f)
        if self.name == "relative":
            return w / np.maximum(size, 1e-2 * float(size.mean())) ** 2, f
        return w / (size + 1e-3 * float((w * size).sum() / w.sum() / f.shape[1])), f

    def _transformed(self, g: Float64Array) -> Float64Array:
        x = g * self._cos
        return np.asarray(np.cbrt(x) if self.name == "cube_root" else np.log1p(np.maximum(x, -0.999)))
