"""Variable projection: non-negative weights exactly for every shape, the shape by a grid and Levenberg's steps.

G. Golub and V. Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares problems whose variables
separate", SIAM J. Numer. Anal. 10, 1973, DOI 10.1137/0710036; the Jacobian in L. Kaufman's form, BIT 15, 1975,
DOI 10.1007/BF01932995. Losses that are no squares are weighted squares about the last iterate (`losses.Loss`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from brdfcore.analysis.fit.families import SIGMA, Family, Free, base_columns
from brdfcore.analysis.fit.losses import Loss, Rows

Float64Array = npt.NDArray[np.float64]

#: Step of a central difference on a parameter's scale: its error, step^2, and the rounding, 1e-15/step, meet here.
_STEP = 1e-5
#: Steps at most, and the gain, relative to the loss, that two steps have to bring.
_MOST_STEPS, _GAIN = 60, 1e-5
#: A relative loss below this is rounding.
_EXACT = 1e-13
#: Candidates of the grid that are scored by the loss itself.
_SCORED = 16
#: Columns that are kept.
_KEPT = 400
#: Ridge of normal equations, of their diagonal: columns that are all but equal share a weight.
_RIDGE = 1e-13


@dataclass(frozen=True)
class State:
    """One set of parameters: `shapes` of each lobe, `sigma` of the base, `weights` (C, 1 + lobes), base first."""

    lobes: tuple[Family, ...]
    shapes: tuple[tuple[float, ...], ...]
    base: str
    sigma: float
    weights: Float64Array
    loss: float = float("inf")

    @property
    def free(self) -> list[tuple[int, int, Free]]:
        """(lobe, place, parameter) of every shape parameter; lobe -1 is the base."""
        own = [(k, j, f) for k, family in enumerate(self.lobes) for j, f in enumerate(family.free)]
        return [*own, (-1, 0, SIGMA)] if self.base == "oren_nayar" else own

    def moved(self, where: tuple[int, int, Free], x: float) -> State:
        k, j, _ = where
        if k < 0:
            return replace(self, sigma=x)
        shape = (*self.shapes[k][:j], x, *self.shapes[k][j + 1 :])
        return replace(self, shapes=(*self.shapes[:k], shape, *self.shapes[k + 1 :]))

    def at(self, where: tuple[int, int, Free]) -> float:
        return self.sigma if where[0] < 0 else self.shapes[where[0]][where[1]]


class Columns:
    """Values of a state's terms with weight 1, kept while a shape stays."""

    def __init__(self, rows: Rows) -> None:
        self.rows = rows
        self._lobes: dict[tuple[str, tuple[float, ...]], Float64Array] = {}

    def lobe(self, family: Family, shape: tuple[float, ...]) -> Float64Array:
        key = (family.key, shape)
        if key not in self._lobes:
            if len(self._lobes) > _KEPT:
                self._lobes.clear()
            self._lobes[key] = family.column(shape, self.rows.angles)
        return self._lobes[key]

    def of(self, state: State) -> tuple[Float64Array, Float64Array]:
        """(X (n, 1 + lobes), B (n,)): the base's weight r counts r X[:, 0] + r^2 B."""
        a, b = base_columns(state.base, state.sigma, self.rows.angles)
        lobes = [self.lobe(f, s) for f, s in zip(state.lobes, state.shapes)]
        return np.stack([a, *lobes], axis=1), b

    def values(self, state: State) -> Float64Array:
        """Fitted f, (n, C)."""
        x, b = self.of(state)
        return np.asarray(x @ state.weights.T + b[:, None] * state.weights[:, 0] ** 2)


def non_negative(gram: Float64Array, right: Float64Array) -> tuple[Float64Array, Float64Array]:
    """(a, gain) of min a.G a/2 - a.h over a >= 0, for a stack (..., k, k), (..., k), k <= 5: by every support.

    gain is a.h/2, what the sum of squares falls by, halved.
    """
    k = right.shape[-1]
    scale = np.sqrt(np.maximum(np.einsum("...ii->...i", gram), 1e-300))
    g, h = gram / (scale[..., :, None] * scale[..., None, :]), right / scale
    best, found = np.zeros(right.shape[:-1]), np.zeros(right.shape)
    for size in range(1, k + 1):
        for support in combinations(range(k), size):
            s = list(support)
            part = g[..., s, :][..., s] + _RIDGE * np.eye(size)
            a = np.linalg.solve(part, h[..., s, None])[..., 0]
            gain = 0.5 * (a * h[..., s]).sum(axis=-1)
            better = (a >= 0).all(axis=-1) & (gain > best)
            best = np.where(better, gain, best)
            whole = np.zeros(right.shape)
            whole[..., s] = a
            found = np.where(better[..., None], whole, found)
    return found / scale, best


class Solver:
    """Fits of `rows` by `loss`."""

    def __init__(self, rows: Rows, loss: str) -> None:
        self.rows, self.loss, self.columns = rows, Loss(loss, rows), Columns(rows)

    # ---- where to begin -----------------------------------------------------------------------

    def starts(self, families: Sequence[Family], lobes: int, base: str, count: int, about: State | None) -> list[State]:
        """The `count` best states of `lobes` lobes on the grid of the families.

        Found by squares, over the values and as the loss weighs them about a fit with fewer lobes; of those the best by
        the loss itself. `about` with a lobe more is among them, so that more lobes never fit worse.
        """
        options = [(f, s) for f in families for s in f.starts()]
        sigmas = SIGMA.starts if base == "oren_nayar" else (0.0,)
        dictionary = np.stack([self.columns.lobe(f, s) for f, s in options], axis=1)
        channels = self.rows.values.shape[1]
        weighed = [self.loss.first()]
        if about is not None:
            weighed.append(self.loss.quadratic(self.columns.values(about)))
        tried: dict[tuple[float, tuple[int, ...]], State] = {}
        for sigma in sigmas:
            a, b = base_columns(base, sigma, self.rows.angles)
            x = np.concatenate([(a + b)[:, None], dictionary], axis=1)
            for v, z in weighed:
                # a channel's normal equations of the base and every lobe of the grid
                gram = np.stack([(x * v[:, c, None]).T @ x for c in range(channels)])
                right = np.stack([x.T @ (v[:, c] * z[:, c]) for c in range(channels)])
                for places in self._best(gram, right, lobes, _SCORED):
                    chosen = [options[p - 1] for p in places]
                    tried[sigma, places] = State(
                        tuple(f for f, _ in chosen), tuple(s for _, s in chosen), base, sigma,
                        np.zeros((channels, 1 + lobes)),
                    )  # fmt: skip
        scored = [self.weighted(state) for state in tried.values()]
        if about is not None:
            wider = np.concatenate([about.weights, np.zeros((channels, 1))], axis=1)
            for state in sorted(scored, key=lambda state: state.loss)[:count]:  # the lobe that none of its own is like
                f, s = max(zip(state.lobes, state.shapes), key=lambda lobe: self._apart(lobe, about))
                more = replace(about, lobes=(*about.lobes, f), shapes=(*about.shapes, s), weights=wider)
                scored.append(self.weighted(replace(more, loss=float("inf"))))
        return sorted(scored, key=lambda state: state.loss)[:count]

    def _apart(self, lobe: tuple[Family, tuple[float, ...]], about: State) -> float:
        return min((abs(lobe[1][0] - s[0]) if f is lobe[0] else 1.0 for f, s in zip(about.lobes, about.shapes)))

    @staticmethod
    def _best(gram: Float64Array, right: Float64Array, lobes: int, count: int) -> list[tuple[int, ...]]:
        """Sets of `lobes` columns beside the first that gain most; larger sets grow from the best smaller ones."""
        size = right.shape[1]
        kept: list[tuple[int, ...]] = [()]
        for _ in range(lobes):
            sets = sorted({tuple(sorted((*s, p))) for s in kept for p in range(1, size) if p not in s})
            places = np.array([(0, *s) for s in sets])
            part = gram[:, places[:, :, None], places[:, None, :]]
            gain = non_negative(part, right[:, places])[1].sum(axis=0)
            kept = [sets[i] for i in np.argsort(-gain)[:count]]
        return kept

    # ---- weights ------------------------------------------------------------------------------

    def weighted(self, state: State, rounds: int = 4) -> State:
        """`state` with the best weights for its shapes, and its loss."""
        x, b = self.columns.of(state)
        weights, best = state.weights, state
        if not weights.any():
            weights = self._weights(x, b, weights, *self.loss.first())
        for _ in range(rounds):
            g = x @ weights.T + b[:, None] * weights[:, 0] ** 2
            value = self.loss.value(g)
            if not value < best.loss * (1 - 1e-9):
                break
            best = replace(state, weights=weights, loss=value)
            weights = self._weights(x, b, weights, *self.loss.quadratic(g))
        return best

    @staticmethod
    def _weights(x: Float64Array, b: Float64Array, old: Float64Array, v: Float64Array, z: Float64Array) -> Float64Array:
        grams, rights = [], []
        for c in range(z.shape[1]):
            # r A + r^2 B about the old r: (A + 2 r B) r - r^2 B
            own, target = x, z[:, c]
            if b.any():
                own = x.copy()
                own[:, 0] += 2 * old[c, 0] * b
                target = target + old[c, 0] ** 2 * b
            weighted = own * v[:, c, None]
            grams.append(weighted.T @ own)
            rights.append(weighted.T @ target)
        return non_negative(np.array(grams), np.array(rights))[0]

    # ---- shapes -------------------------------------------------------------------------------

    def polished(self, state: State, steps: int = _MOST_STEPS, gain: float = _GAIN) -> State:
        """`state` moved towards a minimum of the loss."""
        now, damping, small = self.weighted(replace(state, loss=float("inf"))), 1e-3, 0
        for _ in range(steps):
            if now.loss < _EXACT or small > 1 or not now.free:
                break
            jacobian, residual = self._linear(now)
            normal, right = jacobian.T @ jacobian, jacobian.T @ residual
            size = np.maximum(np.diag(normal), 1e-300)
            gained = 0.0
            for _ in range(8):
                step = np.linalg.solve(normal + damping * np.diag(size), right)
                tried = now
                for where, d in zip(now.free, step):
                    f = where[2]
                    tried = tried.moved(where, float(np.clip(now.at(where) + np.clip(d, -0.5, 0.5), f.low, f.high)))
                tried = self.weighted(replace(tried, loss=float("inf")))
                if tried.loss < now.loss:
                    gained = (now.loss - tried.loss) / now.loss
                    now, damping = tried, max(damping / 8, 1e-12)
                    break
                damping = min(damping * 8, 1e8)
            small = small + 1 if gained < gain else 0
            if gained == 0.0:
                break
        return now

    def _linear(self, state: State) -> tuple[Float64Array, Float64Array]:
        """(J (rows, free), r): what the shapes change beyond what the weights can make good."""
        x, b = self.columns.of(state)
        g = x @ state.weights.T + b[:, None] * state.weights[:, 0] ** 2
        v, z = self.loss.quadratic(g)
        slopes = self.slopes(state)
        jacobians, residuals = [], []
        for c in range(z.shape[1]):
            s = np.sqrt(v[:, c])
            active = state.weights[c] > 0
            own = x[:, active] * s[:, None]
            q = np.linalg.qr(own)[0] if active.any() else own
            j, r = slopes[:, c, :] * s[:, None], (z[:, c] - g[:, c]) * s
            jacobians.append(j - q @ (q.T @ j))
            residuals.append(r - q @ (q.T @ r))
        return np.concatenate(jacobians), np.concatenate(residuals)

    def slopes(self, state: State) -> Float64Array:
        """d g/d shape parameter at fixed weights, (n, C, free)."""
        found = np.empty((*self.rows.values.shape, len(state.free)))
        for m, where in enumerate(state.free):
            k, _, f = where
            at = state.at(where)
            low, high = max(at - _STEP, f.low), min(at + _STEP, f.high)
            if k < 0:
                pair = [base_columns(state.base, t, self.rows.angles) for t in (low, high)]
                d, e = ((pair[1][i] - pair[0][i]) / (high - low) for i in (0, 1))
                r = state.weights[:, 0]
                found[:, :, m] = d[:, None] * r + e[:, None] * r**2
                continue
            one, two = (state.lobes[k].column(state.moved(where, t).shapes[k], self.rows.angles) for t in (low, high))
            found[:, :, m] = ((two - one) / (high - low))[:, None] * state.weights[:, k + 1]
        return found
