"""What the data say of each fitted parameter: standard errors, intervals, and which cannot be told apart."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.analysis.fit.losses import Loss, Rows
from brdfcore.analysis.fit.solve import Columns, Solver, State

Float64Array = npt.NDArray[np.float64]

#: Student's quantile would differ by less than 1 % from 60 degrees of freedom on; fewer rows are no fit.
_QUANTILE = 1.959963984540054
#: Singular values of the scaled problem below this share of the largest: those directions are not told.
_UNKNOWN = 1e-4
#: A parameter has part in such a direction from this share on, and two are correlated.
_PART, _CORRELATED = 0.1, 0.95


@dataclass(frozen=True)
class Estimated:
    """name, value, standard error and 95 % interval of one parameter; None and `why` where the data do not tell."""

    name: str
    value: float
    stderr: float | None = None
    low: float | None = None
    high: float | None = None
    why: str = ""

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


def estimates(
    rows: Rows, loss: str, state: State, labels: tuple[str, ...] | list[str]
) -> tuple[list[Estimated], list[tuple[str, str, float]], float]:
    """(of each parameter, correlated pairs, condition number of the Jacobian with columns of length 1).

    The covariance is s^2 (J^T V J)^-1 for loss "relative", s^2 = sum V r^2/(N - p), the noise of the model; for the
    others, whose weights are no variances, the sandwich A^-1 B A^-1 N/(N - p) of A = J^T V J and B = sum over rows of
    their gradients' squares (H. White, Econometrica 48, 1980, DOI 10.2307/1912934): valid for any noise, and of a
    function drawn at random directions what other draws would change. By singular values: a direction whose value is
    below 1e-4 of the largest is said to be not identified.
    """
    solver, columns = Solver(rows, loss), Columns(rows)
    x, b = columns.of(state)
    g = columns.values(state)
    v, z = Loss(loss, rows).quadratic(g)
    n, channels = rows.values.shape
    free = state.free
    names, values, kinds = _parameters(state, list(labels))
    keep = [k for k, kind in enumerate(kinds) if not kind]
    slopes = solver.slopes(state)
    terms = x.shape[1]
    jacobian = np.zeros((n, channels, channels * terms + len(free)))
    for c in range(channels):
        jacobian[:, c, c * terms : (c + 1) * terms] = x
        jacobian[:, c, c * terms] += 2 * state.weights[c, 0] * b
    jacobian[:, :, channels * terms :] = slopes
    root = np.sqrt(v)
    scaled = (jacobian * root[..., None])[..., keep]
    flat = scaled.reshape(n * channels, -1)
    length = np.sqrt((flat * flat).sum(axis=0))
    length[length == 0] = 1.0
    if not keep:
        return [Estimated(m, w, why=k) for m, w, k in zip(names, values, kinds)], [], 1.0
    _, s, vt = np.linalg.svd(flat / length, full_matrices=False)
    condition = float(s[0] / s[-1]) if s[-1] > 0 else float("inf")
    known = s > _UNKNOWN * s[0]
    unknown = np.abs(vt[~known]).max(axis=0) > _PART if (~known).any() else np.zeros(len(keep), bool)
    inverse = (vt[known].T / s[known] ** 2) @ vt[known] / np.outer(length, length)
    residual = (z - g) * root
    left = n * channels - len(keep)
    if loss == "relative":
        covariance = inverse * float((residual**2).sum()) / max(left, 1)
    else:
        score = (scaled * residual[..., None]).sum(axis=1)
        covariance = inverse @ (score.T @ score) @ inverse * n / max(n - len(keep) / channels, 1)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    found = [Estimated(m, w, why=k) for m, w, k in zip(names, values, kinds)]
    for place, k in enumerate(keep):
        if unknown[place]:
            found[k] = Estimated(names[k], values[k], why="not identified")
            continue
        half = _QUANTILE * sigma[place]
        if k < channels * terms:
            slope, low, high = 1.0, values[k] - half, values[k] + half
        else:  # on the scale that it is searched on the problem is nearer to linear: the ends are taken there
            f, at = free[k - channels * terms][2], state.at(free[k - channels * terms])
            slope = f.slope(at)
            low, high = (f.value(float(np.clip(end, f.low, f.high))) for end in (at - half, at + half))
        found[k] = Estimated(names[k], values[k], float(sigma[place] * slope), float(low), float(high))
    return found, _correlated(covariance, sigma, [names[k] for k in keep], unknown), condition


def _correlated(
    covariance: Float64Array, sigma: Float64Array, names: list[str], unknown: npt.NDArray[np.bool_]
) -> list[tuple[str, str, float]]:
    size = np.where(sigma > 0, sigma, 1.0)
    correlation = covariance / np.outer(size, size)
    pairs = zip(*np.nonzero(np.triu(np.abs(correlation) > _CORRELATED, 1)))
    return [(names[a], names[b], float(correlation[a, b])) for a, b in pairs if not (unknown[a] or unknown[b])]


def _parameters(state: State, labels: list[str]) -> tuple[list[str], list[float], list[str]]:
    """(names, values, why there is no interval) in the order of the Jacobian's columns."""
    names, values, why = [], [], []
    several = len(state.lobes) > 1
    titles = [state.base if several or state.base != "lambert" else "", *(
        f"{family.model} {k + 1}" if several else "" for k, family in enumerate(state.lobes)
    )]  # fmt: skip
    for c, label in enumerate(labels):
        for k, title in enumerate(titles):
            kind = "reflectance" if k == 0 and title else "diffuse" if k == 0 else "specular"
            names.append(f"{title} {kind} {label}".strip())
            values.append(float(state.weights[c, k]))
            why.append("" if state.weights[c, k] > 0 else "at its bound")
    for where in state.free:
        k, _, f = where
        at = state.at(where)
        names.append(f"{titles[k + 1]} {f.name}".strip())
        values.append(f.value(at))
        gone = k >= 0 and not state.weights[:, k + 1].any()
        bound = min(at - f.low, f.high - at) <= 1e-9
        why.append("of a lobe that is not used" if gone else "at its bound" if bound else "")
    return names, values, why
