"""Radial basis functions: the same functions as scipy's, and what is left out without another fit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from brdfcore.tables.scattered.radial import Radial

KINDS = [("thin_plate_spline", 1e-3, 1), ("thin_plate_spline", 0.0, 1), ("linear", 3e-2, 0), ("linear", 0.0, 1)]


def scattered(n: int, seed: int = 4) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    points = rng.random((n, 4)) * [3, 1.5, 1.5, 1]
    values = np.stack([np.sin(points[:, 0]) + points[:, 1], np.cos(points @ [1, 2, 0, 1])], axis=1)
    return points, values + 0.01 * rng.normal(size=values.shape)


@pytest.mark.parametrize(("kernel", "smoothing", "degree"), KINDS)
@pytest.mark.parametrize("each", [False, True])
def test_the_functions_of_scipy(kernel: str, smoothing: float, degree: int, each: bool) -> None:
    points, values = scattered(300)
    size: Any = smoothing * np.linspace(0.5, 2, 300) if each else smoothing
    ours = Radial(points, values, kernel, size, degree)
    theirs = RBFInterpolator(points, values, kernel=kernel, smoothing=size, degree=degree)  # type: ignore[call-overload]
    at, _ = scattered(500, 9)
    assert ours(at) == pytest.approx(theirs(at), abs=1e-8)
    assert ours.fitted == pytest.approx(theirs(points), abs=1e-7)
    if not smoothing:
        assert ours.fitted == pytest.approx(values, abs=1e-12)


@pytest.mark.parametrize(("kernel", "smoothing", "degree"), KINDS)
def test_what_is_left_out_follows_from_one_factorisation(kernel: str, smoothing: float, degree: int) -> None:
    points, values = scattered(200)
    part = np.random.default_rng(1).permutation(200)[:40]
    kept = np.setdiff1d(np.arange(200), part)
    found, others = Radial(points, values, kernel, smoothing, degree).without(part, kept)
    again = Radial(points[kept], values[kept], kernel, smoothing, degree)
    assert found == pytest.approx(again(points[part]), abs=1e-8)
    assert others == pytest.approx(again.fitted, abs=1e-8)


def test_points_that_determine_nothing() -> None:
    points, values = scattered(50)
    flat = points * [1, 1, 1, 0]
    with pytest.raises(np.linalg.LinAlgError):
        Radial(flat, values, "thin_plate_spline", 1e-3, 1)
    with pytest.raises(np.linalg.LinAlgError):
        Radial(points[:5], values[:5], "thin_plate_spline", 1e-3, 1)
    twice = np.concatenate([points, points])
    with pytest.raises(np.linalg.LinAlgError):
        Radial(twice, np.concatenate([values, -values]), "thin_plate_spline", 0.0, 1)
