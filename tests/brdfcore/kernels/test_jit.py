"""Compiling: for the whole of the processor's vectors, and once for all processes that share a cache."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import llvmlite.binding
import pytest

from tests.brdfcore.kernels.test_launch import finish, start

HOST = llvmlite.binding.get_host_cpu_features()
needs_avx512 = pytest.mark.skipif(not HOST.get("avx512f"), reason="this processor has no AVX-512")


def compiled(cache: Path, **environment: str) -> Any:
    return start("compile_once", NUMBA_CACHE_DIR=str(cache), **environment)


def test_processes_that_start_together_compile_a_kernel_once(tmp_path: Path) -> None:
    children = [compiled(tmp_path) for _ in range(2)]
    answers = [finish(child) for child in children]
    names = [name for answer in answers for name in answer["compiled"] if name.startswith("trilinear")]
    assert names, answers
    assert len(names) == len(set(names)), answers
    assert len({answer["value"] for answer in answers}) == 1


@pytest.mark.slow
@needs_avx512
def test_whole_vectors_and_half_ones_stand_beside_each_other_in_the_cache(tmp_path: Path) -> None:
    """The default uses whole vectors; NUMBA_CPU_FEATURES and NUMBA_CPU_NAME decide instead where they are set."""
    host = HOST.flatten()
    cases = [{}, {"NUMBA_CPU_FEATURES": host}, {"NUMBA_CPU_NAME": llvmlite.binding.get_host_cpu_name()}]
    whole, half, named = (finish(compiled(tmp_path, **environment)) for environment in cases)
    assert whole["features"] == [*host.split(","), "-prefer-256-bit"]
    assert half["features"] == named["features"] == host.split(",")
    assert whole["compiled"]
    assert half["compiled"] == whole["compiled"], "machine code of other features was loaded"
    assert whole["value"] == half["value"]
    assert finish(compiled(tmp_path))["compiled"] == [], "it was compiled again"
