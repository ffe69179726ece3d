"""Expansions as tables: look-ups, the smallest degree, storage, refusals; slices and real files."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import RGB
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.harmonics.expansion import HarmonicExpansion, expanded
from brdfcore.harmonics.grids import grid_values
from brdfcore.harmonics.legendre import legendre
from brdfcore.harmonics.rules import lobe_widths, rule_for
from brdfcore.kernels.harmonics.harmonic import LANES, harmonic_numpy
from brdfcore.kernels.machine import blocks
from brdfcore.kernels.machine.launch import one_thread
from tests import shared
from tests.support.formulas import Formula, evaluated_error, lopsided

# ---- auto -------------------------------------------------------------------------------------------


def test_auto_finds_the_smallest_degree() -> None:
    source = bc.model("ggx", roughness=0.5)
    h = bc.project(source, "auto", tolerance=0.02)
    assert h.report["harmonics"]["truncation"]["target"] <= 0.02
    assert h.error["tolerance"] == 0.02
    with pytest.raises(bc.LimitError, match=f"lmax = {h.lmax - 1} has an error of"):
        bc.project(source, h.lmax - 1, tolerance=0.02)
    again = bc.project(source, h.lmax)
    assert again.report["harmonics"]["truncation"]["target"] == pytest.approx(
        h.report["harmonics"]["truncation"]["target"], rel=1e-3
    )


@pytest.mark.slow
def test_auto_refuses_with_numbers() -> None:
    with pytest.raises(bc.LimitError, match="half_difference does it in") as caught:
        bc.project(bc.model("cook_torrance", roughness=0.001, ior="gold"), "auto", tolerance=0.05)
    context = caught.value.context
    assert context["degree"] > 1_000
    assert context["bytes"] > 1e9
    assert context["table"]["bytes"] < 1e7
    assert context["table"]["error"] <= 0.05


# ---- sums that separate ---------------------------------------------------------------------------


@pytest.mark.parametrize("target", ["f_cos_cos", "f", "f_cos_o"])
@pytest.mark.parametrize("kind", ["packed", "sines"])
def test_grids_and_albedo_in_closed_form(kind: str, target: str) -> None:
    """Against single values, and against their integral by the quadrature that any `Brdf` has."""

    def turned(theta_i: Any, theta_o: Any, delta_phi: Any) -> Any:
        f = lopsided(theta_i, theta_o, delta_phi) + 0.1 * np.sin(theta_i) * np.sin(theta_o) * np.sin(delta_phi)
        return np.stack([f, f**2, f**-1], axis=-1)

    packed = bc.model("ggx", roughness=0.4, ior="gold")
    source = packed if kind == "packed" else Formula(turned, reciprocal=False, bilateral=False, channels=RGB)
    made = expanded(source, 12, target=target)
    theta_i, theta_o = np.array([0.0, 0.3, 1.2, np.pi / 2]), np.array([0.0, 0.8, 1.5])
    delta_phi = np.array([0.0, 1.0, np.pi, 4.0])
    found = grid_values(made, theta_i, theta_o, delta_phi)
    one_by_one = made.evaluate(theta_i[:, None, None], theta_o[:, None], delta_phi)
    np.testing.assert_allclose(found, one_by_one, rtol=1e-11, atol=1e-13 * np.abs(one_by_one).max())
    in_closed_form, error = made.albedo_error(theta_i)
    by_quadrature, uncertain = Brdf._albedo(made, theta_i, 12, 64, 1e-9, 10**6)
    assert np.abs(in_closed_form - by_quadrature).max() < 1e-8 + uncertain.max()
    assert (error <= 1e-14 * np.abs(in_closed_form)).all()
    assert made.albedo(theta_i[:, None]).shape == (4, 1, len(made.channels))
    with pytest.raises(bc.InputError):
        made.albedo(2.0)


# ---- look-ups, storage, refusals ----------------------------------------------------------------------


@pytest.mark.parametrize("lmax", [1, 2, 15])
@pytest.mark.parametrize("kind", ["packed", "full", "sines"])
def test_kernel_is_its_twin(lmax: int, kind: str) -> None:
    def turned(theta_i: Any, theta_o: Any, delta_phi: Any) -> Any:
        f = lopsided(theta_i, theta_o, delta_phi) + 0.1 * np.sin(theta_i) * np.sin(theta_o) * np.sin(delta_phi)
        return np.stack([f, f**2, f**-1], axis=-1)

    source: Brdf = {
        "packed": bc.model("ggx", roughness=0.4, ior="gold"),
        "full": Formula(lambda i, o, d: lopsided(i, o, d) ** -2, reciprocal=False),
        "sines": Formula(turned, reciprocal=False, bilateral=False, channels=RGB),
    }[kind]
    h = expanded(source, lmax)
    rng = np.random.default_rng(1)
    angles = [rng.uniform(0, np.pi / 2, 77), rng.uniform(0, np.pi / 2, 77), rng.uniform(-9, 9, 77)]
    angles[0][:3], angles[1][:3] = (0, np.pi / 2, np.pi / 2), (np.pi / 2, 0, np.pi / 2)
    channels = len(h.channels)
    out = np.empty(77 * channels)
    outside = harmonic_numpy(
        *angles, out, *h._steps, h._bases, h._cores, channels, h.packed, np.pi / 2, LANES
    )  # fmt: skip
    assert outside == 0
    np.testing.assert_allclose(h.evaluate(*angles).reshape(-1), out, rtol=1e-11, atol=1e-13)
    angles[1][5] = np.nan
    with pytest.raises(bc.InputError, match="theta_o"):
        h.evaluate(*angles)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_blocks_and_threads_change_no_bit(dtype: type[np.floating[Any]], monkeypatch: pytest.MonkeyPatch) -> None:
    """Many blocks, the last of them short, on several threads and on one; and what is wrong in the last one is told."""
    h = expanded(bc.model("ggx", roughness=0.4, ior="gold"), 16)
    angles = (np.random.default_rng(3).random((3, 20_011)) * np.pi / 2).astype(dtype)
    monkeypatch.setattr(blocks, "threads", lambda: 3)
    spread = h.evaluate(*angles)
    with one_thread():
        monkeypatch.setattr(blocks, "threads", lambda: 1)
        np.testing.assert_array_equal(h.evaluate(*angles), spread)
    some = slice(None, None, 997)
    np.testing.assert_array_equal(h.evaluate(*angles[:, some]), spread[some])
    angles[1, -1] = np.nan
    with pytest.raises(InputError, match=r"theta_o\[20010\]"):
        h.evaluate(*angles)


def test_evaluation_at_a_high_degree() -> None:
    """One order's top coefficients at lmax = 200 against the double-double functions: the recursion by two holds."""
    lmax = 200
    source = expanded(bc.model("ggx", roughness=0.5), 4)
    ranks = np.array([[(lmax - m + 1) // 2] * 2 for m in range(lmax)], np.int32)
    sizes = ranks[:, 0].astype(np.int64) * (ranks[:, 0] + 1) // 2
    theta = np.concatenate([np.linspace(0, np.pi / 2, 40), [1e-8, 1e-3, np.pi / 2 - 1e-9]])
    for m in (0, 1, 60, 190):
        cores = np.zeros(sizes.sum())
        cores[sizes[: m + 1].sum() - 1] = 1.0  # the last of the upper triangle: l = l' = the largest
        h = HarmonicExpansion.from_arrays(
            {"cores": cores, "ranks": ranks},
            {"lmax": lmax, "target": "f_cos_cos", "window": "none", "packed": True},
            bc.Channels(["value"]),
            source.flags,
        )
        q = legendre(lmax, np.cos(theta), parity="odd", over_x=True, first_order=m, last_order=m)[-1]
        want = (1 if m == 0 else 2) * q * q * np.cos(m * 0.3)
        np.testing.assert_allclose(h.evaluate(theta, theta, 0.3)[:, 0], want, atol=1e-10 * np.abs(want).max())


def test_low_rank_says_what_it_drops() -> None:
    h = expanded(bc.model("ggx", roughness=0.3), 32)
    stated = h.report["harmonics"]
    assert h.to_arrays()["bases"].size + h.to_arrays()["cores"].size < h.size
    assert 0 < stated["factors"]["target"] <= 0.1 * stated["truncation"]["target"]
    assert stated["truncation"]["target"] <= 1.006 * stated["projection"]["target"]
    assert (np.diff(stated["by_degree"]) <= 1e-12).all()
    assert stated["by_degree"][-1] == pytest.approx(stated["projection"]["target"], rel=1e-9)


def test_tabulate_and_fold() -> None:
    source = Formula(lopsided, reciprocal=False)
    h = bc.tabulate(source, "harmonic", shape=(6,), fold="reciprocal")
    assert isinstance(h, HarmonicExpansion)
    assert h.lmax == 6
    assert h.reciprocal
    turned = Formula(lambda i, o, d: 1 + 0.5 * np.sin(i) * np.sin(o) * np.sin(d), bilateral=False, reciprocal=False)
    folded = bc.tabulate(turned, "harmonic", shape=(6,), fold="bilateral")
    assert folded.bilateral
    np.testing.assert_allclose(folded.evaluate(0.5, 0.6, [0.7, -0.7]), 1.0, atol=0.01)
    for bad in ({"shape": (4, 4)}, {"negatives": "zero"}, {"interpolation": "cubic"}):
        with pytest.raises(bc.InputError):
            bc.tabulate(source, "harmonic", **bad)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("arguments", "options", "code"),
    [
        ((0,), {}, "bad_lmax"),
        ((2.5,), {}, "bad_lmax"),
        (("all",), {}, "bad_lmax"),
        ((5_000,), {}, "lmax_too_large"),
        (("auto",), {}, "options_exclude"),
        ((8,), {"tolerance": -1}, "bad_option"),
        ((8,), {"target": "g"}, "bad_target"),
        ((8,), {"window": "boxcar"}, "bad_window"),
        ((8,), {"target": "f_cos_o", "symmetrise": True}, "bad_target"),
        ((8,), {"tolerance": 1e-9}, "tolerance_not_met"),
    ],
    ids=lambda value: str(value),
)
def test_refusals(arguments: tuple[Any], options: dict[str, Any], code: str) -> None:
    with pytest.raises(bc.BrdfError) as caught:
        bc.project(bc.model("ggx", roughness=0.5), *arguments, **options)
    assert caught.value.code == code


def test_refuses_what_is_not_finite() -> None:
    source = Formula(lambda i, o, d: np.where((i > 1) & (o > 1), np.nan, 1.0))
    with pytest.raises(bc.InputError, match="not finite") as caught:
        bc.project(source, 6)
    assert caught.value.context["got"][0] > 57


def test_too_large_is_refused_before_work() -> None:
    source = Formula(lopsided, reciprocal=False, bilateral=False, channels=RGB)
    with pytest.raises(bc.LimitError, match="bytes of coefficients"):
        bc.project(source, 1_000)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"lmax": 7}, "ranks"),
        ({"lmax": True}, "lmax"),
        ({"target": "g"}, "target"),
        ({"window": None}, "window"),
        ({"packed": 1}, "packed"),
        ({"packed": False}, "cores"),
    ],
    ids=lambda value: str(value),
)
def test_arrays_that_do_not_fit(change: dict[str, Any], field: str) -> None:
    h = expanded(bc.model("ggx", roughness=0.5), 6)
    with pytest.raises(FileFormatError) as caught:
        HarmonicExpansion.from_arrays(h.to_arrays(), {**h.attributes(), **change}, h.channels, h.flags)
    assert caught.value.context["where"] == field


@pytest.mark.parametrize("name", ["cores", "ranks"])
def test_damaged_arrays(name: str) -> None:
    h = expanded(bc.model("ggx", roughness=0.5), 6)
    for damage in (
        lambda a: a[:-1],
        lambda a: a.astype(np.int16),
        lambda a: -np.abs(a) * np.inf if a.dtype != np.int32 else a * 99,
    ):
        arrays = {k: v.copy() for k, v in h.to_arrays().items()}
        with np.errstate(all="ignore"):
            arrays[name] = damage(arrays[name])
        with pytest.raises(FileFormatError):
            HarmonicExpansion.from_arrays(arrays, h.attributes(), h.channels, h.flags)


def test_lobe_widths_choose_the_rule() -> None:
    assert lobe_widths(bc.model("lambert")) == (1.0, 1.0)
    mirror = lobe_widths(bc.model("ggx", roughness=0.01))[0]
    assert 0.005 < mirror < 0.03
    assert rule_for(bc.model("ggx", roughness=0.01), 16).graded
    assert not rule_for(bc.model("lambert"), 16).graded


def test_slices_of_a_material() -> None:
    """Not bilateral, windowed, three channels: the slice's sum is what a product grid finds."""
    source = Formula(
        lambda i, o, d: np.stack([np.exp(np.cos(d - 0.3) * np.sin(o)), 1 + 0 * o, np.cos(o)], axis=-1),
        bilateral=False, reciprocal=False, channels=RGB,
    )  # fmt: skip
    s = bc.project_slice(source, 0.7, 16)
    theta, phi = np.linspace(0, 1.4, 9)[:, None], np.linspace(-3, 3, 8)
    np.testing.assert_allclose(s.evaluate(theta, phi), source.evaluate(0.7, theta, phi), atol=0.02)
    assert s.truncation["target"] < 2e-3
    windowed = bc.project_slice(source, 0.7, 16, window="hann")
    assert windowed.truncation["target"] > 5 * s.truncation["target"]
    for bad in ({"target": "f_cos_cos"}, {"window": "x"}):
        with pytest.raises(bc.InputError):
            bc.project_slice(source, 0.7, 8, **bad)  # type: ignore[arg-type]
    with pytest.raises(bc.InputError):
        bc.project_slice(source, 2.0, 8)


# ---- real files -------------------------------------------------------------------------------------


@shared.needs_shared
@pytest.mark.parametrize("name", ["paper_white", "satin_purple"])
def test_real_files(name: str) -> None:
    """Not reciprocal: Parseval's error is what evaluation finds, and quadrature's is small beside it."""
    source = bc.read(shared.rgl_path(name))
    h = expanded(source, 16)
    assert not h.reciprocal
    stated = h.report["harmonics"]
    assert evaluated_error(source, h)[0] == pytest.approx(stated["truncation"]["target"], rel=0.01)
    assert stated["quadrature"]["target"] < 0.05 * stated["truncation"]["target"]
    assert h.source["sha256"] == source.source["sha256"]  # type: ignore[attr-defined]
    folded = expanded(source, 16, symmetrise=True)
    assert 0 < folded.report["harmonics"]["symmetrised"]["energy_removed"] < 0.05


def test_project_measures_the_l1_too() -> None:
    h = bc.project(bc.model("ggx", roughness=0.5), 8, window="hann")
    assert 0 < h.error["l1"] < 0.5
    assert h.error["warnings"] == []
    assert h.report["harmonics"]["window"]["undershoot"] < 0.03
