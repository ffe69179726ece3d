"""Fitted models: exactness, intervals, what is lost, beside many starts of a general solver.

`python -m tests.benchmarks.fit [--quick]`; takes minutes.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares, nnls

import brdfcore as bc
from brdfcore.analysis.fit.families import FAMILIES, Family, base_columns
from brdfcore.analysis.fit.fit import drawn_rows, search
from brdfcore.analysis.fit.intervals import estimates
from brdfcore.analysis.fit.losses import Loss, Rows
from brdfcore.metrics.comparison import WHOLE
from tests.shared import rgl_names, rgl_path

Float64Array = npt.NDArray[np.float64]
EVERYWHERE = {"light": WHOLE, "view": WHOLE}


def random_model(rng: np.random.Generator) -> tuple[Family, dict[str, object]]:
    """One lobe on a Lambertian, of any family, three channels, its lobe seen."""
    family = [f for each in FAMILIES.values() for f in each][int(rng.integers(8))]
    shape = []
    for f in family.free:
        if f.name == "roughness":
            shape.append(rng.uniform(-2.5, -0.3))
        elif f.name == "exponent":
            shape.append(rng.uniform(0.5, 5.0))
        else:
            shape.append(rng.uniform(0.1, 0.5))
    diffuse, specular = rng.uniform(0.05, 0.5, 3), rng.uniform(0.1, 0.5, 3)
    return family, {"diffuse": diffuse.tolist(), "specular": specular.tolist(), **family.parameters(shape)}


def exact(count: int) -> Iterator[str]:
    """Random models from their own exact values."""
    rng, l1, worst, unknown, missed = np.random.default_rng(1), [], [], 0, 0
    for _ in range(count):
        family, parameters = random_model(rng)
        found = bc.fit(bc.model(family.model, **parameters), family.model, 1)
        l1.append(found.l1)
        if found.condition >= 1e4 or any(e.why == "not identified" for e in found.estimates):
            unknown += 1
            continue
        term = found.terms[0]["parameters"] if len(found.terms) == 1 else {}
        off = [
            float(np.max(np.abs(np.asarray(term[k], float) / np.asarray(v, float) - 1)))
            for k, v in parameters.items()
            if not isinstance(v, str) and k in term
        ]
        worst.append(max(off, default=np.inf))
        missed += worst[-1] > 1e-6
    yield f"exact, {count} models: largest L1 {max(l1):.2g} (goal 1e-8); {sum(x > 1e-8 for x in l1)} above"
    yield f"  parameters off by at most {max(worst):.2g}, {missed} above 1e-6; {unknown} not identified"


def intervals(count: int) -> Iterator[str]:
    """Share of true parameters within their 95 % interval; 2 % noise on 400 directions."""
    rng, inside, total, bound = np.random.default_rng(2), 0, 0, 0
    for _ in range(count):
        family, parameters = random_model(rng)
        b = bc.model(family.model, **parameters)
        rows = drawn_rows(b, 520, int(rng.integers(1 << 30)), EVERYWHERE)
        few = slice(0, 400)
        angles = (rows.angles[0][few], rows.angles[1][few], rows.angles[2][few])
        noisy = rows.values[few] * (1 + 0.02 * rng.standard_normal(rows.values[few].shape))
        given = Rows(angles, noisy, rows.weight[few])
        state = search(given, "relative", [family], [1], "lambert")
        found, _, _ = estimates(given, "relative", state, ["0", "1", "2"])
        truth = {f"{k} {c}": v[c] for k, v in parameters.items() if isinstance(v, list) for c in range(3)}
        truth |= {k: v for k, v in parameters.items() if isinstance(v, float)}  # type: ignore[misc]
        for e in found:
            if e.low is None or e.high is None:
                bound += 1
                continue
            total += 1
            inside += e.low <= truth[e.name] <= e.high
    share = inside / total
    yield f"intervals, {count} fits, {total} of them: {share:.3f} hold the truth (goal .93 to .97); {bound} have none"


def floor(rows: Rows) -> float:
    """L1 of a non-negative mixture of 200 lobes and a Lambertian, each channel by reweighted nnls."""
    every = [Family("ggx", f.free) for f in FAMILIES["ggx"]]
    columns = [base_columns("lambert", 0.0, rows.angles)[0]]
    for family in every:
        for r in np.linspace(-3.5, 0, 40):
            columns += [family.column((r, *rest), rows.angles) for rest in ([(x,) for x in (0.1, 0.2, 0.45, 0.8)]
                        if len(family.free) > 1 else [()])]  # fmt: skip
    x = np.stack(columns, axis=1)
    fitted = np.empty_like(rows.values)
    for c in range(rows.values.shape[1]):
        f, v = rows.values[:, c], rows.weight / np.maximum(rows.values[:, c], 1e-6)
        for _ in range(12):
            s = np.sqrt(v)
            g = x @ nnls(x * s[:, None], f * s, maxiter=5_000)[0]
            r = np.abs(g - f)
            v = rows.weight / np.maximum(r, 1e-3 * np.median(r))
        fitted[:, c] = g
    return Loss("energy", rows).value(fitted)


def starts(rows: Rows, family: Family, count: int, seed: int) -> float:
    """Smallest energy loss of one lobe from `count` random starts of a general solver, on the same rows."""
    rng, loss = np.random.default_rng(seed), Loss("energy", rows)
    base = base_columns("lambert", 0.0, rows.angles)[0]
    best = np.inf
    channels = rows.values.shape[1]

    def values(p: Float64Array) -> Float64Array:
        lobe = family.column(tuple(p[: len(family.free)]), rows.angles)
        w = p[len(family.free) :].reshape(2, channels)
        return base[:, None] * w[0] + lobe[:, None] * w[1]

    def residuals(p: Float64Array) -> Float64Array:
        return np.sqrt(rows.weight[:, None] * np.hypot(values(p) - rows.values, 1e-4) / rows.energy).ravel()

    low = [f.low for f in family.free] + [0.0] * 2 * channels
    high = [f.high for f in family.free] + [np.inf] * 2 * channels
    for _ in range(count):
        p = [rng.uniform(f.starts[0], f.starts[-1]) for f in family.free]
        found = least_squares(residuals, [*p, *rng.uniform(0.05, 0.5, 2 * channels)], bounds=(low, high), max_nfev=60)
        best = min(best, loss.value(values(found.x)))
    return best


def files(floors: bool) -> Iterator[str]:
    """L1 of one GGX lobe, and of the best model, for the ten files."""
    one, best, seconds = [], [], []
    for path in map(rgl_path, rgl_names()):
        b = bc.read(path)
        t = time.process_time()
        single = bc.fit(b, "ggx", 1)
        t1 = time.process_time()
        many = bc.fit(b)
        t2 = time.process_time()
        one.append(single.l1)
        best.append(many.l1)
        seconds.append((t1 - t, t2 - t1))
        more = f", floor {floor(drawn_rows(b, 1_500, 5, EVERYWHERE)):.3f}" if floors else ""
        models = " + ".join(term["model"] for term in many.terms)
        yield f"{path.stem:<28} one ggx {single.l1:.3f}, best {many.l1:.3f} ({models}){more}"
    yield f"ten files: one ggx median {np.median(one):.3f}, worst {max(one):.3f} (goal .17, .42)"
    yield f"  best: median {np.median(best):.3f} (goal .15), worst {max(best):.3f}"
    t = np.median(np.array(seconds), axis=0)
    yield f"  processor time, RGB: one lobe {t[0]:.2f} s (goal .3), up to three of all models {t[1]:.2f} s (goal 1.5)"


def beside(models: int) -> Iterator[str]:
    """Never worse than 32 starts."""
    rng, worse, total = np.random.default_rng(3), 0, 0
    sources = [bc.read(path) for path in map(rgl_path, rgl_names())]
    for _ in range(models):
        family, parameters = random_model(rng)
        broad = bc.model("phong", exponent=float(rng.uniform(2, 40)), specular=0.2)
        sources.append(bc.model(family.model, **parameters) + broad)
    for k, b in enumerate(sources):
        family = FAMILIES["ggx"][0]
        rows = drawn_rows(b, 1_500, 9, EVERYWHERE)
        ours = search(rows, "energy", [family], [1], "lambert").loss
        theirs = starts(rows, family, 32, k)
        worse += ours > 1.01 * theirs
        total += 1
        yield f"  source {k}: {ours:.4f}, best of 32 starts {theirs:.4f}"
    yield f"worse than 32 starts by > 1 %: {worse} of {total} (goal 0)"


def main() -> None:
    quick = "--quick" in sys.argv
    rows = [exact(20 if quick else 200), intervals(40 if quick else 300), files(not quick), beside(2 if quick else 30)]
    for part in rows:
        for text in part:
            print(text, flush=True)


if __name__ == "__main__":
    main()
