"""Compile kernels: one Python function, a serial and a parallel machine version, cached wherever a folder is writable.

    @kernel
    def scale(x, factor, out):
        for k in prange(x.size):
            out[k] = factor * x[k]
        return 0

    scale(x.size, x, np.float32(2), out)      # launch.run chooses the version

`prange` runs as `range` in the serial version, so both do the same operations on each element and give the
same bits; fastmath, which may reorder sums differently in each, stays off. The body has to stand directly
in the prange loop: numba emits vector gathers only there.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import logging
import os
import tempfile
import time
import types
from collections.abc import Callable, Iterator
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import IO, Any

from brdfcore.base.errors import missing_extra
from brdfcore.kernels.machine import launch

try:
    import fcntl
except ModuleNotFoundError:  # not POSIX
    fcntl = None  # type: ignore[assignment]

try:
    import llvmlite.binding
    import numba
    from numba.core.compiler_lock import global_compiler_lock
except ImportError as error:
    raise missing_extra("numba", "core", "a compiled look-up") from error

log = logging.getLogger("brdfcore.kernels")
#: Seconds to wait for another process to compile a kernel; the slowest takes 10 on a busy machine.
_MOST_SECONDS = 60.0

prange = numba.prange
AnyFunction = Callable[..., Any]


def _use_whole_vectors() -> None:
    """Let the compiler fill AVX-512 registers, where the processor has them: for such processors LLVM keeps to half of
    each ("prefer-256-bit"), as early ones slowed their clock. Measured on a newer one (Sapphire Rapids): look-ups in a
    `vndf_warp` table 1.8, `half_difference` 1.7, `angle_grid` 1.1 to 1.7 times as fast, in the same bits, as the
    operations on an element are the same; a batch of 16 to 100 loses half a microsecond to the wider registers' waking.

    It holds for what numba compiles in this process. NUMBA_CPU_FEATURES or NUMBA_CPU_NAME, if set, decide instead.
    The features are part of the key of numba's cache, which keeps versions of both kinds beside each other.
    """
    config = numba.config
    if config.CPU_NAME is not None or config.CPU_FEATURES is not None or not config.ENABLE_AVX:
        return
    with contextlib.suppress(RuntimeError):  # LLVM does not know what this processor can do
        features = llvmlite.binding.get_host_cpu_features()
        if features.get("avx512f"):
            # CPU_FEATURES replaces the host's own list, which also says what a virtual machine masks
            config.CPU_FEATURES = f"{features.flatten()},-prefer-256-bit"


_use_whole_vectors()  # before the first decorator: the target is made there, once for the process


class Kernel:
    """A compiled loop. Call it as `kernel(n, *args)`, n the number of elements; `python` is the source function."""

    def __init__(self, function: AnyFunction) -> None:
        self.python = function
        self.serial = _compile(function, parallel=False)
        self.parallel = _compile(function, parallel=True)

    def __call__(self, n: int, *args: Any) -> Any:
        return launch.run(self, n, args)


def kernel(function: AnyFunction) -> Kernel:
    """Decorator: a function whose outer loop is `for k in prange(n)` becomes a `Kernel`."""
    return Kernel(function)


def on_one_thread(function: AnyFunction) -> Any:
    """Decorator: a loop for the calling thread, for `blocks.run` to spread. A parallel version takes the compiler three
    times as long, as it is optimised again with each function around it."""
    return _compile(function, parallel=False)


def inline(function: AnyFunction) -> Any:
    """Decorator for a helper that kernels call. The vectoriser sees a loop only as far as it has no calls, so LLVM has
    to inline it; numba's own `inline="always"` types the merged body anew and takes eight times as long to compile."""
    return numba.njit(nogil=True, forceinline=True, error_model="numpy")(function)


def merged(function: AnyFunction) -> Any:
    """As `inline`, merged by numba before LLVM sees it: where LLVM's own inlining renews the alias scopes of
    `kernels.machine.vectorised` and the loop stays scalar (`kernels.tables.warp`: 4 instead of 50 million a second)."""
    return numba.njit(nogil=True, inline="always", error_model="numpy")(function)


def with_names(function: AnyFunction, names: dict[str, Any]) -> AnyFunction:
    """A function of the same code that finds `names` where it looks for global ones: a loop over other helpers.

    `names` has to hold all that the function reads, and `__name__`, under which the result is cached.
    """
    made = types.FunctionType(function.__code__, names, function.__name__, function.__defaults__)
    made.__module__ = names["__name__"]
    # numba's cache goes by the file of the code and the qualified name: another name, or one loads the other's kernel
    made.__qualname__ = f"{names['__name__'].rpartition('.')[2]}.{function.__qualname__}"
    return made


def _compile(function: AnyFunction, *, parallel: bool) -> Any:
    # numba's cache is keyed by module, qualified name and line, and by the kernel's own file: without a name of
    # its own the parallel version would be loaded where the serial one was asked for, and without the hash of the
    # sources a kernel would outlive a change of its helpers
    clone = types.FunctionType(function.__code__, function.__globals__, function.__name__, function.__defaults__)
    clone.__qualname__ = f"{function.__qualname__}_{'parallel' if parallel else 'serial'}_{_sources()}"
    clone.__module__ = function.__module__
    options: dict[str, Any] = {"nogil": True, "parallel": parallel, "error_model": "numpy"}
    with contextlib.suppress(RuntimeError):  # "no locator available": neither the package nor home is writable
        return _watched(numba.njit(cache=True, **options)(clone))
    with _cache_in_temporary_folder() as found:
        return _watched(numba.njit(cache=found, **options)(clone))


def _watched(dispatcher: Any) -> Any:
    """Of several processes that want a kernel at the same time (a service and what draws for it, the workers of a test
    run), let one compile it and the others load what that one cached: numba itself has no such lock. And log the
    processor time that it took."""
    folder, compile_it, name = dispatcher._cache.cache_path, dispatcher.compile, dispatcher.py_func.__qualname__
    lock = None if folder is None else Path(folder) / f"{name}.lock"

    def compile_once(signature):
        # numba's own lock first, or two threads could hold one each and wait for the other
        with global_compiler_lock, _locked(lock):
            before, begun = sum(dispatcher.stats.cache_misses.values()), time.thread_time()
            made = compile_it(signature)
            if sum(dispatcher.stats.cache_misses.values()) > before:
                log.debug("compiled %s in %.2f s", name, time.thread_time() - begun)
            return made

    dispatcher.compile = compile_once
    return dispatcher


@contextlib.contextmanager
def _locked(path: Path | None) -> Iterator[None]:
    """Hold a lock between processes; the system releases that of one that died. Who waits too long, for one that was
    stopped say, goes on without: all that it may cost is that a kernel is compiled twice."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # read-only by now, or a file system without locks
            if path is not None and fcntl is not None:
                _wait_for(stack.enter_context(open(path, "ab")))
        yield


def _wait_for(file: IO[bytes]) -> None:
    until = time.monotonic() + _MOST_SECONDS
    while time.monotonic() < until:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(0.01)
        else:
            return


@cache
def _sources() -> str:
    """Short hash over the sources of all kernels."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:8]


@contextlib.contextmanager
def _cache_in_temporary_folder() -> Iterator[bool]:
    """Point numba's cache at a private temporary folder while a function is decorated; yields whether there is one."""
    folder = _private_folder()
    before = numba.config.CACHE_DIR
    if folder is not None:
        numba.config.CACHE_DIR = str(folder)
    try:
        yield folder is not None
    finally:
        numba.config.CACHE_DIR = before


def _private_folder() -> Path | None:
    """A folder only this user can write: cached code is executed, so another user's must not be loaded."""
    folder = Path(tempfile.gettempdir()) / f"brdfcore-kernels-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        mine = not hasattr(os, "getuid") or (status.st_uid == os.getuid() and status.st_mode & 0o077 == 0)
        return folder if mine and folder.is_dir() and not folder.is_symlink() and os.access(folder, os.W_OK) else None
    except OSError:
        return None


def _load_tbb() -> None:
    """Load libtbb from the `tbb` package, if installed, before numba looks for it.

    pip puts the library into the environment's lib folder, which the dynamic loader does not search; once
    loaded under its name, numba's threading layer finds it. Without it numba uses OpenMP or its own queue.
    """
    try:
        listed = files("tbb") or []
    except PackageNotFoundError:
        return
    for file in listed:
        if file.name in ("libtbb.so.12", "libtbb.12.dylib", "tbb12.dll"):
            with contextlib.suppress(OSError):
                ctypes.CDLL(str(file.locate()), mode=ctypes.RTLD_GLOBAL)
            return


_load_tbb()
