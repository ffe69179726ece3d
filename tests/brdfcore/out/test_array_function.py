"""Functions of arrays: the table's own answers in each library, derivatives, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from tests.support.exported import HALF_PI, MADE, angles, table, vectors
from tests.support.tiers import first_fast

strict = pytest.importorskip("array_api_strict", reason="array-api-strict is not installed")

#: Median relative error in float32 against float64 of the same numbers.
MEDIAN = 1e-6
#: Normal, mirror direction, retro-reflection, horizon, beside them, and outside the domain.
CORNERS = [
    (0, 0, 0), (0, 0.5, 1), (0.5, 0, 1), (0.5, 0.5, np.pi), (0.5, 0.5, -np.pi), (0.5, 0.5, 0), (0.5, 0.5, 3 * np.pi),
    (HALF_PI, 0.3, 1), (0.3, HALF_PI, 1), (HALF_PI, HALF_PI, np.pi), (HALF_PI, HALF_PI, 0), (HALF_PI, HALF_PI, 1),
    (1e-12, 1e-12, np.pi), (1e-20, 1e-20, 0), (1e-30, 1e-30, 1), (2, 0.3, 0), (np.nan, 0, 0), (0, 0.1, np.inf),
]  # fmt: skip
CORNER_VECTORS = [
    ((0, 0, 1), (0, 0, 1)), ((0.5, 0, 0.8), (-0.5, 0, 0.8)), ((0.5, 0, 0.8), (0.5, 0, 0.8)), ((1, 0, 0), (0, 0, 1)),
    ((1, 0, 1e-20), (0, 0, 1)), ((1, 0, 1e-7), (-1, 0, 1e-7)), ((0, 0, 0), (0, 0, 1)), ((0, 0, -1), (0, 0, 1)),
    ((np.nan, 0, 1), (0, 0, 1)), ((1e-25, 0, 1), (1e-25, 1e-25, 1)),
]  # fmt: skip


def in_numpy(dtype: Any) -> tuple[Callable[..., Any], Callable[[Any], Any]]:
    return (lambda f, *x: f(*x)), np.asarray


def in_strict(dtype: Any) -> tuple[Callable[..., Any], Callable[[Any], Any]]:
    return (lambda f, *x: f(*(strict.asarray(a) for a in x))), np.asarray


def in_torch(dtype: Any) -> tuple[Callable[..., Any], Callable[[Any], Any]]:
    torch = pytest.importorskip("torch", reason="torch is not installed")
    return (lambda f, *x: f(*(torch.from_numpy(a) for a in x))), lambda y: y.numpy()


def in_jax(dtype: Any) -> tuple[Callable[..., Any], Callable[[Any], Any]]:
    jax = pytest.importorskip("jax", reason="jax is not installed")
    if dtype is np.float64:
        pytest.skip("jax has float32 unless it is told otherwise")
    return (lambda f, *x: jax.jit(f)(*(jax.numpy.asarray(a) for a in x))), np.asarray


LIBRARIES = {"numpy": in_numpy, "strict": in_strict, "torch": in_torch, "jax": in_jax}


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("library", LIBRARIES)
@pytest.mark.parametrize("name", MADE)
def test_the_values_of_evaluate(name: str, library: str, dtype: Any) -> None:
    run, back = LIBRARIES[library](dtype)
    t, given = table(name), angles(3_000, 1, dtype)
    f = bc.array_function(t)
    expected = t.evaluate(*(x.astype(np.float64) for x in given))
    found = back(run(f, *given))
    assert found.dtype == dtype
    assert found.shape == expected.shape
    far = np.abs(found - expected) / np.maximum(np.abs(expected), 1e-30)
    assert np.median(far) <= (MEDIAN if dtype is np.float32 else 2e-7)
    # the kernels' own rounding in float64, as they find steps by the bits of a float32
    level = np.maximum(np.abs(expected), 0.01 * np.abs(expected).mean())
    if "nearest" not in name:
        assert (np.abs(found - expected) / level).max() <= (5e-3 if dtype is np.float32 else 2e-4)


@pytest.mark.parametrize("library", LIBRARIES)
@pytest.mark.parametrize("name", MADE)
def test_the_values_of_evaluate_vectors(name: str, library: str) -> None:
    """In float32, and exactly 0 below the horizon."""
    run, back = LIBRARIES[library](np.float32)
    t, (wi, wo) = table(name), vectors(3_000, 2, np.float32)
    expected = t.evaluate_vectors(wi.astype(np.float64), wo.astype(np.float64))
    found = back(run(bc.array_function(t).vectors, wi, wo))
    below = (wi[:, 2] <= 0) | (wo[:, 2] <= 0)
    assert below.sum() > 100
    assert (found[below] == 0).all()
    far = np.abs(found - expected)[~below] / np.maximum(np.abs(expected[~below]), 1e-30)
    assert np.median(far) <= MEDIAN


def test_shapes_broadcast_and_numbers_go_beside_arrays() -> None:
    f, t = bc.array_function(table("angle_grid")), table("angle_grid")
    theta_o, delta_phi = np.linspace(0, 1, 4)[:, None], np.linspace(0, 3, 5)
    assert np.allclose(f(0.3, theta_o, delta_phi), t.evaluate(0.3, theta_o, delta_phi), rtol=1e-12)
    assert f(0.3, 0.2, 1.0).shape == (1,)
    assert f(np.zeros((0, 2)), 0.2, 1).shape == (0, 2, 1)
    assert f.vectors(np.array([0.0, 0, 1]), np.ones((2, 1, 3))).shape == (2, 1, 1)


@pytest.mark.parametrize("name", MADE)
def test_any_delta_phi_and_nan_outside_the_domain(name: str) -> None:
    f = bc.array_function(table(name))
    assert np.allclose(f(0.3, 0.4, np.array([1.0, 1 + 20 * np.pi, 1 - 6 * np.pi])), f(0.3, 0.4, 1.0), rtol=1e-9)
    outside = f(np.array([-1e-9, 1.6, np.nan, 0.1, 0.1]), np.array([0.1] * 4 + [2]), np.array([0, 0, 0, np.inf, 0]))
    assert np.isnan(outside).all()
    assert np.isfinite(f(np.float32([HALF_PI]), np.float32([HALF_PI]), np.float32([1]))).all()
    assert np.isnan(f.vectors(np.array([[0, 0, 0], [np.nan, 0, 1], [0, 0, np.inf]]), np.array([0.0, 0, 1]))).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", first_fast(*MADE))
def test_torch_derivatives_are_finite(name: str, dtype: Any) -> None:
    """By angles, vectors and nodes, also at the normal, mirror direction, retro-reflection and horizon."""
    torch = pytest.importorskip("torch", reason="torch is not installed")
    f = bc.array_function(table(name))
    for call, corners in ((f, CORNERS), (f.vectors, CORNER_VECTORS)):
        given = [torch.from_numpy(np.array(x, dtype)).requires_grad_() for x in zip(*corners, strict=True)]
        nodes = f.nodes_like(given[0])
        nodes = {n: x.clone().requires_grad_() if x.is_floating_point() else x for n, x in nodes.items()}
        values = call(*given, nodes=nodes)
        values[torch.isfinite(values)].sum().backward()
        for x in (*given, *nodes.values()):
            assert x.grad is None or torch.isfinite(x.grad).all()
        assert values.requires_grad


@pytest.mark.parametrize("name", first_fast(*MADE))
def test_jax_derivatives_are_finite(name: str) -> None:
    jax = pytest.importorskip("jax", reason="jax is not installed")
    f = bc.array_function(table(name))

    def total(call: Any, given: Any, nodes: Any) -> Any:
        values = call(*given, nodes={**held, **nodes})
        return jax.numpy.where(jax.numpy.isfinite(values), values, 0).sum()

    for call, corners in ((f, CORNERS), (f.vectors, CORNER_VECTORS)):
        given = [jax.numpy.asarray(np.array(x, np.float32)) for x in zip(*corners, strict=True)]
        held = f.nodes_like(given[0])
        nodes = {n: x for n, x in held.items() if x.dtype == np.float32}
        found = jax.jit(jax.grad(lambda x, n, call=call: total(call, x, n), argnums=(0, 1)))(given, nodes)
        assert all(np.isfinite(x).all() for x in jax.tree.leaves(found))


@pytest.mark.parametrize("library", ["torch", "jax"])
@pytest.mark.parametrize("name", first_fast(*(n for n in MADE if "nearest" not in n)))
def test_derivatives_are_those_of_differences(name: str, library: str) -> None:
    """By angles in float32 against differences of `evaluate`, where both sides agree: no node is between."""
    module = pytest.importorskip(library, reason=f"{library} is not installed")
    t, f = table(name), bc.array_function(table(name))
    given = angles(2_000, 5, np.float32)
    exact = [x.astype(np.float64) for x in given]
    if library == "torch":
        at = [module.from_numpy(x).requires_grad_() for x in given]
        f(*at)[:, 0].sum().backward()
        found = [x.grad.numpy() for x in at]
    else:
        grad = module.jit(module.grad(lambda x: f(*x)[:, 0].sum()))
        found = [np.asarray(g) for g in grad([module.numpy.asarray(x) for x in given])]
    # wide against the rounding of the kernels' steps by float32 bits, narrow against the cells
    h = 1e-4
    for k in range(3):
        low, high = ([x + (step if m == k else 0) for m, x in enumerate(exact)] for step in (-h, h))
        inside = np.all([(x >= 0) & (x <= HALF_PI) for x in (*low[:2], *high[:2])], axis=0)
        f_low, f_mid, f_high = (
            t.evaluate(*[np.clip(x, 0, HALF_PI) if m < 2 else x for m, x in enumerate(p)])[:, 0]
            for p in (low, exact, high)
        )
        left, right, both = (f_mid - f_low) / h, (f_high - f_mid) / h, (f_high - f_low) / (2 * h)
        level = np.maximum(np.maximum(np.abs(both), np.abs(f_mid)), 1e-30)
        smooth = inside & (np.abs(left - right) < 1e-3 * level)
        assert smooth.sum() > 200
        assert np.median((np.abs(found[k] - both) / level)[smooth]) <= 1e-3


def test_derivatives_by_nodes_are_the_weights() -> None:
    """Of a trilinear grid: they sum to 1, and no more than eight are not 0."""
    torch = pytest.importorskip("torch", reason="torch is not installed")
    f = bc.array_function(table("angle_grid"))
    at = [torch.tensor([x], dtype=torch.float64) for x in (0.3, 0.7, 2.0)]
    values = f.nodes_like(at[0])["values"].clone().requires_grad_()
    f(*at, nodes={"values": values}).sum().backward()
    assert values.grad.sum().item() == pytest.approx(1, abs=1e-12)
    assert int((values.grad != 0).sum()) == 8


def test_dask_computes_block_by_block() -> None:
    da = pytest.importorskip("dask.array", reason="dask is not installed")
    t = table("half_difference")
    f, given = bc.array_function(t), angles(1_000, 7)
    found = f(*(da.from_array(x, chunks=300) for x in given))
    assert found.chunks == ((300, 300, 300, 100), (1,))
    assert np.array_equal(found.compute(), f(*given))
    wi, wo = vectors(1_000, 8)
    found = f.vectors(da.from_array(wi, chunks=(300, 2)), da.from_array(wo, chunks=300))
    assert np.array_equal(found.compute(), f.vectors(wi, wo))


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (lambda: bc.array_function(bc.model("lambert", reflectance=0.5)), "not_a_table"),
        (lambda: bc.array_function(bc.tabulate(bc.model("lambert"), "half_angle_grid", shape=(4, 4, 5))), "no_array"),
        (lambda: bc.array_function(table("angle_grid"))(np.arange(3), 0.1, 0.2), "not_floats"),
        (lambda: bc.array_function(table("angle_grid"))("a", 0.1, 0.2), "not_arrays"),
        (lambda: bc.array_function(table("angle_grid"))(np.zeros(2), strict.zeros(2), 0.2), "not_arrays"),
        (lambda: bc.array_function(table("angle_grid")).vectors(np.zeros(4), np.zeros(3)), "bad_vectors"),
        (lambda: bc.array_function(table("angle_grid"))(0.1, 0.1, 0.1, nodes={"a": np.zeros(1)}), "unknown_nodes"),
        (lambda: bc.array_function(table("angle_grid"))(0.1, 0.1, 0.1, nodes={"values": np.zeros(1)}), "bad_nodes"),
        (lambda: bc.array_function(table("angle_grid"))(np.zeros(2), np.zeros(3), 0.1), "do_not_broadcast"),
    ],
)
def test_what_is_refused(wrong: Callable[[], object], code: str) -> None:
    with pytest.raises(bc.InputError) as caught:
        wrong()
    assert code in caught.value.code
