"""Tables as functions of arrays and as shaders: `python -m tests.benchmarks.arrays [arrays] [shaders]`.

- torch and jax, float32, against `evaluate` in float64 of the same numbers: median of the error over max(f, 1e-30).
- Derivatives by the three angles against central differences of `evaluate`, where both one-sided ones agree.
- Look-ups a second: jax compiled, torch, the table's own kernels; all cores.
- Shaders in headless Chromium, WebGL2 and WGSL: 1e5 float32 vectors read back, the largest error over max(f, 1 % of
  its mean) against `evaluate_vectors` of the same; lobes down to 1e-3 rad; none within 1e-3 rad of the horizon.
What is not installed is named and left out. Asserts nothing.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import brdfcore as bc
from brdfcore.out.shader import shader_text
from tests import shared
from tests.benchmarks.timing import machine
from tests.support import chromium
from tests.support.exported import HALF_PI, angles, vectors

POINTS = 1_000_000
_STEP = 1e-4


def tables() -> Iterator[tuple[str, bc.Table]]:
    """What is measured: lobes of 0.3 to 1e-3 rad, one channel and three, and a measured file."""
    half, gold = "half_difference", {"ior": "gold"}
    yield "Cook-Torrance .2, half_difference", bc.tabulate(bc.model("cook_torrance", roughness=0.2, **gold), half)
    sharp = bc.model("ggx", roughness=0.0316, **gold)  # alpha = 1e-3
    yield "GGX alpha 1e-3, half_difference", bc.tabulate(sharp, half, shape=(120, 20, 20))
    coated = bc.model("cook_torrance", diffuse=[0.3, 0.2, 0.1], specular=0.5, roughness=0.1, ior="glass")
    yield "three channels, half_difference", bc.tabulate(coated, half, shape=(60, 30, 30))
    yield "Phong 2000, half_difference", bc.tabulate(bc.model("phong", exponent=2_000), half, shape=(60, 30, 30))
    yield "GGX .1, lobe_grid", bc.tabulate(bc.model("ggx", roughness=0.1, **gold), "lobe_grid", shape=(60, 30, 24))
    rough = bc.model("cook_torrance", roughness=0.4, **gold)
    yield "Cook-Torrance .4, angle_grid", bc.tabulate(rough, "angle_grid", shape=(61, 61, 121))
    if shared.RGL.exists():
        name = shared.rgl_names()[0]
        measured = bc.read(shared.rgl_path(name))
        assert isinstance(measured, bc.Table)
        yield f"{name}, vndf_warp", measured
        yield f"{name}, half_difference", bc.tabulate(measured, half, shape=(60, 30, 30))


def libraries() -> dict[str, Any]:
    """Those that are installed."""
    found = {n: importlib.import_module(n) for n in ("jax", "torch") if importlib.util.find_spec(n)}
    for name in {"jax", "torch"} - set(found):
        print(f"left out: {name} (not installed)")
    return found


def called(name: str, module: Any, f: Any) -> Callable[..., Any]:
    """f of numpy arrays in a library, its answer as numpy."""
    if name == "torch":
        return lambda *x: f(*(module.from_numpy(a) for a in x)).numpy()
    compiled = module.jit(f)
    return lambda *x: np.asarray(compiled(*(module.numpy.asarray(a) for a in x)))


def gradients(name: str, module: Any, f: Any, given: list[Any]) -> list[Any]:
    """Derivatives of the first channel by each angle."""
    if name == "torch":
        at = [module.from_numpy(x).requires_grad_() for x in given]
        f(*at)[:, 0].sum().backward()
        return [x.grad.numpy() for x in at]
    grad = module.jit(module.grad(lambda x: f(*x)[:, 0].sum()))
    return [np.asarray(g) for g in grad([module.numpy.asarray(x) for x in given])]


def differences(t: bc.Table, given: list[Any]) -> list[tuple[Any, Any, Any]]:
    """(derivative, its level, where it is one) by each angle."""
    exact, found = [x.astype(np.float64) for x in given], []
    middle = t.evaluate(*exact)[:, 0]
    for k in range(3):
        sides = []
        for step in (-_STEP, _STEP):
            moved = [x + (step if m == k else 0) for m, x in enumerate(exact)]
            sides.append(t.evaluate(*(np.clip(x, 0, HALF_PI) for x in moved[:2]), moved[2])[:, 0])
        slope = (sides[1] - sides[0]) / (2 * _STEP)
        level = np.maximum(np.maximum(np.abs(slope), np.abs(middle)), 1e-30)
        bend = np.abs(sides[1] - 2 * middle + sides[0]) / _STEP
        found.append((slope, level, (bend < 1e-3 * level) & (exact[k] > _STEP)))
    return found


def rate(run: Callable[[], object]) -> tuple[float, float]:
    """Look-ups in millions a second, by the clock and by processor time of one core; the best of five."""
    run()
    clock, processor = [], []
    for _ in range(5):
        start, used = time.perf_counter(), time.process_time()
        run()
        clock.append(time.perf_counter() - start)
        processor.append(time.process_time() - used)
    return POINTS / min(clock) / 1e6, POINTS / min(processor) / 1e6


def arrays(name: str, t: bc.Table, modules: dict[str, Any]) -> None:
    """Accuracy, derivatives and speed of the function of arrays."""
    f, given = bc.array_function(t), angles(20_000, 1, np.float32)
    exact = t.evaluate(*(x.astype(np.float64) for x in given))
    slopes = differences(t, given)
    many = angles(POINTS, 2, np.float32)
    for library, module in modules.items():
        far = np.median(np.abs(called(library, module, f)(*given) - exact) / np.maximum(np.abs(exact), 1e-30))
        off = [
            float(np.median((np.abs(g - slope) / level)[good]))
            for g, (slope, level, good) in zip(gradients(library, module, f, given), slopes)
        ]
        if library == "jax":
            at = [module.numpy.asarray(x) for x in many]
            nodes = f.nodes_like(at[0])
            compiled = module.jit(lambda a, b, c, n: f(a, b, c, nodes=n))
            speed = rate(lambda at=at, nodes=nodes, run=compiled: run(*at, nodes).block_until_ready())
        else:
            at = [module.from_numpy(x) for x in many]
            speed = rate(lambda at=at: f(*at))
        print(
            f"{name:38} {library:6} median {far:.2g}  derivatives {', '.join(f'{x:.1g}' for x in off)}  "
            f"{speed[0]:.3g} M/s ({speed[1]:.3g} M/s a core by processor time)",
            flush=True,
        )
    own = rate(lambda: t.evaluate(*many))
    print(f"{name:38} kernels {own[0]:.3g} M/s ({own[1]:.3g} M/s a core by processor time)", flush=True)


def shaders(name: str, t: bc.Table) -> None:
    """Accuracy in the browser."""
    if t.name == "vndf_warp":
        return
    wi, wo = vectors(100_000, 3, np.float32)
    exact = t.evaluate_vectors(wi.astype(np.float64), wo.astype(np.float64))
    level = np.maximum(np.abs(exact), 0.01 * np.abs(exact).mean())
    own = (np.abs(t.evaluate_vectors(wi, wo) - exact) / level).max()
    found = []
    for language in ("glsl", "wgsl"):
        values = chromium.run(language, "m", shader_text(t, language, "m", "m"), bc.array_bytes(t), wi, wo)
        found.append(f"{language} {(np.abs(values[:, : exact.shape[1]] - exact) / level).max():.2g}")
    print(f"{name:38} {', '.join(found)}; the kernels in float32 {own:.2g}", flush=True)


def main() -> None:
    wanted = sys.argv[1:] or ["arrays", "shaders"]
    print(machine())
    made = list(tables())
    if "arrays" in wanted:
        modules = libraries()
        print("\nfunctions of arrays, float32; derivatives by theta_i, theta_o, delta_phi")
        for name, t in made:
            arrays(name, t, modules)
    if "shaders" not in wanted:
        return
    print("\nshaders, largest error over max(f, 1 % of the mean)")
    if chromium.BROWSER is None:
        print("left out: no Chromium is installed")
        return
    for name, t in made:
        shaders(name, t)


if __name__ == "__main__":
    main()
