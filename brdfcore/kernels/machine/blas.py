"""Keep BLAS on the calling thread."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from brdfcore.base.errors import missing_extra


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """BLAS on one thread within this block: its own threads wait for each other, which on a busy machine takes ten
    times as long as the work, and the last bits of a sum follow from how many they are."""
    try:
        from threadpoolctl import threadpool_limits
    except ImportError as error:
        raise missing_extra("threadpoolctl", "core", "linear algebra") from error
    with threadpool_limits(limits=1, user_api="blas"):
        yield
