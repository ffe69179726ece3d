"""What others' libraries make of the same data, as `Brdf`s with a call to time: the `bench` extra brings them.

scipy and interpn read the nodes of an angle grid, so their error is the grid's; Mitsuba reads a file of the RGL
database with its `measured` plug-in. What is not installed is left out, and named.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import FloatArray

#: A few look-ups of the file whose path is the argument.
_TRIAL = """
import sys
import drjit as dr, mitsuba as mi
mi.set_variant("llvm_ad_rgb")
bsdf = mi.load_dict({"type": "measured", "filename": sys.argv[1]})
interaction = dr.zeros(mi.SurfaceInteraction3f, 100)
interaction.wi = mi.warp.square_to_uniform_hemisphere(mi.Point2f(dr.linspace(mi.Float, 0, 1, 100), 0.3))
dr.eval(bsdf.eval(mi.BSDFContext(), interaction, interaction.wi))
dr.sync_thread()
"""
_TRIAL_SECONDS = 60.0

Angles = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class Peer:
    """Someone else's look-up.

    maker    from float32 angles, the call to time.
    brdf     the same as a `Brdf`, to measure; None: its error is that of the representation `like`.
    single   context manager that keeps it on one thread; it may use all otherwise.
    """

    name: str
    detail: str
    nbytes: int
    maker: Callable[[Angles], Callable[[], object]]
    brdf: Brdf | None
    single: Callable[[], Any]


def grid_peers(values: FloatArray, bilateral: bool) -> tuple[list[Peer], list[str]]:
    """scipy and interpn on an angle grid's nodes, (n_i, n_o, n_d, channels); who was left out, and why."""
    from scipy.interpolate import RegularGridInterpolator

    size = " x ".join(str(n) for n in values.shape[:3])
    turn = np.pi if bilateral else 2 * np.pi
    axes = [np.linspace(0, top, n) for top, n in zip((np.pi / 2, np.pi / 2, turn), values.shape[:3])]
    table = RegularGridInterpolator(axes, values)

    def scipy_maker(angles: Angles) -> Callable[[], object]:
        points = np.stack(_reduced(angles, bilateral), axis=1)
        return lambda: table(points)

    peers = [Peer("scipy RegularGridInterpolator", size, values.nbytes, scipy_maker, None, _nothing)]
    try:
        import interpn
    except ImportError:
        return peers, ["interpn: not installed (the `bench` extra brings it)"]
    dims = list(values.shape[:3])
    starts = np.zeros(3, np.float32)
    steps = np.array([axis[1] for axis in axes], np.float32)
    planes = [np.ascontiguousarray(values[..., c]).reshape(-1) for c in range(values.shape[3])]
    alone = _Threads()

    def interpn_maker(angles: Angles) -> Callable[[], object]:
        given = [np.ascontiguousarray(x) for x in _reduced(angles, bilateral)]
        out = np.empty((len(planes), given[0].size), np.float32)

        def part(a: int, b: int) -> None:
            for plane, row in zip(planes, out):
                interpn.raw.interpn_linear_regular_f32(dims, starts, steps, plane, [x[a:b] for x in given], row[a:b])

        return lambda: alone.spread(given[0].size, part)

    peers.append(Peer("interpn linear", size, values.nbytes, interpn_maker, None, alone.single))
    return peers, []


def mitsuba_peer(path: Path, source: Brdf) -> tuple[list[Peer], list[str]]:
    """Mitsuba 3's `measured` plug-in on a file of the RGL database, RGB; or why not.

    It is tried in a process of its own first: with some versions of LLVM its compiler ends the process it runs in.
    """
    if why := _tried(path):
        return [], [f"Mitsuba: {why}"]
    try:
        import drjit as dr
        import mitsuba as mi

        mi.set_variant("llvm_ad_rgb")
        bsdf = mi.load_dict({"type": "measured", "filename": str(path)})
    except (ImportError, RuntimeError, AttributeError) as error:
        return [], [f"Mitsuba: {str(error).splitlines()[0][:120] if str(error) else type(error).__name__}"]
    context = mi.BSDFContext()

    def maker(angles: Angles) -> Callable[[], Any]:
        theta_i, theta_o, delta_phi = angles
        wi = mi.Vector3f(np.sin(theta_i), np.zeros_like(theta_i), np.cos(theta_i))
        wo = mi.Vector3f(np.sin(theta_o) * np.cos(delta_phi), np.sin(theta_o) * np.sin(delta_phi), np.cos(theta_o))
        interaction = dr.zeros(mi.SurfaceInteraction3f, theta_i.size)
        interaction.wi = wi
        dr.eval(wi, wo, interaction)

        def call() -> Any:
            value = bsdf.eval(context, interaction, wo)
            dr.eval(value)
            dr.sync_thread()
            return value

        return call

    @contextmanager
    def single() -> Iterator[None]:
        before = dr.thread_count()
        dr.set_thread_count(1)
        try:
            yield
        finally:
            dr.set_thread_count(before)

    size, like = path.stat().st_size, _Mitsuba(maker, source)
    return [Peer("Mitsuba 3 measured", f"version {mi.__version__}", size, maker, like, single)], []


@cache
def _tried(path: Path) -> str:
    """Why Mitsuba can't look up this file here; "" if it can."""
    if find_spec("mitsuba") is None:
        return "not installed (the `bench` extra brings it)"
    try:
        done = subprocess.run(
            [sys.executable, "-c", _TRIAL, str(path)], capture_output=True, text=True, errors="replace",
            timeout=_TRIAL_SECONDS, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"its trial did not end: {type(error).__name__}"
    if done.returncode == 0:
        return ""
    said = [line for line in done.stderr.splitlines() if "error" in line.lower()] or ["nothing said"]
    return f"its trial ended with {done.returncode}: {said[-1 if done.returncode > 0 else 0].strip()[:120]}"


class _Mitsuba(Brdf):
    """Its values without the cosine."""

    def __init__(self, maker: Callable[[Angles], Callable[[], Any]], like: Brdf) -> None:
        super().__init__()
        self.channels = like.channels
        self.bilateral, self.reciprocal, self.non_negative = like.bilateral, like.reciprocal, like.non_negative
        self.energy_conserving = like.energy_conserving
        self._maker = maker

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        value = np.array(self._maker((theta_i, theta_o, delta_phi))()).T
        out[...] = value / np.cos(theta_o)[:, None]
        return True


def _reduced(angles: Angles, bilateral: bool) -> list[FloatArray]:
    theta_i, theta_o, delta_phi = angles
    return [theta_i, theta_o, np.abs(delta_phi) if bilateral else np.mod(delta_phi, 2 * np.pi).astype(delta_phi.dtype)]


@contextmanager
def _nothing() -> Iterator[None]:
    yield


class _Threads:
    """Runs a batch in as many threads as our own look-ups use, or on one."""

    def __init__(self) -> None:
        self._single = False

    @contextmanager
    def single(self) -> Iterator[None]:
        self._single = True
        try:
            yield
        finally:
            self._single = False

    def spread(self, n: int, part: Callable[[int, int], None]) -> None:
        from brdfcore.kernels.machine import launch

        count = 1 if self._single or n < launch.PARALLEL_FROM else launch.threads()
        if count == 1:
            part(0, n)
            return
        edges = np.linspace(0, n, count + 1).astype(int)
        workers = [Thread(target=part, args=(int(a), int(b))) for a, b in pairwise(edges)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
