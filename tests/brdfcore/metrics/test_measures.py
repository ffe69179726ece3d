"""Every error measure against closed forms, and against an implementation in plain Python loops."""

from __future__ import annotations

import math
import statistics
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

import brdfcore as bc
from brdfcore import metrics
from brdfcore.base.brdf import Brdf
from brdfcore.base.directions import mixture
from brdfcore.metrics.comparison import energy_draws
from brdfcore.metrics.estimators import quantiles
from brdfcore.metrics.lobes import Lobes
from brdfcore.metrics.symmetry import symmetry_defects
from tests.support.sources import Constant, Multilinear, Skewed


class Rising(Constant):
    """f = (1 + cos theta_i)/pi: not reciprocal."""

    reciprocal = False

    def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
        out[:, 0] = (1 + np.cos(theta_i)) / np.pi
        return True


def over_light(g: Any, low: float = 0.0) -> float:
    """int g(c) c dc / int c dc over c = cos theta_i in [low, 1]: a mean over pairs, if g depends on c only."""
    return float(quad(lambda c: g(c) * c, low, 1)[0] / quad(lambda c: c, low, 1)[0])


def test_relative_l2_against_its_integral() -> None:
    found = bc.compare(Constant(1 / np.pi), Rising(0.0))
    assert over_light(lambda c: c * c) == pytest.approx(0.5)
    assert found.rel_l2 == pytest.approx(math.sqrt(0.5), abs=4 * found.rel_l2_stderr)
    assert 0 < found.rel_l2_stderr < 3e-3


def test_log_rms_against_its_integral() -> None:
    a, b = 0.4, 2.5
    exact = math.sqrt(over_light(lambda c: (math.log1p(b * c) - math.log1p(a * c)) ** 2))
    found = bc.compare(Constant(a), Constant(b))
    assert found.rms_log == pytest.approx(exact, abs=4 * found.rms_log_stderr)
    assert 0 < found.rms_log_stderr < 0.01 * exact


def test_cube_root_against_its_closed_form() -> None:
    """((b c)^(1/3) - (a c)^(1/3))^2 = (b^(1/3) - a^(1/3))^2 c^(2/3), and int c^(5/3) dc / int c dc = 3/4."""
    a, b = 0.125, 1.0
    found = bc.compare(Constant(a), Constant(b))
    assert found.rms_cube_root == pytest.approx(0.5 * math.sqrt(0.75), abs=4 * found.rms_cube_root_stderr)


def test_log_ratio_of_a_constant_factor() -> None:
    found = bc.compare(Constant(0.3), Constant(0.9))
    for name in ("p50", "p95", "p99", "p999", "max"):
        assert found.log_ratio[name] == pytest.approx(math.log(3), rel=1e-5)
    assert found.log_ratio_interval["p99"] == pytest.approx([math.log(3)] * 2, rel=1e-5)


def test_albedo_bias_and_its_uncertainty() -> None:
    """Albedo of (1 + cos theta_i)/pi against 1/pi: the bias is cos theta_i."""
    found = bc.compare(Constant(1 / np.pi), Rising(0.0)).albedo_bias
    off = np.abs(np.array(found["bias"]) - np.cos(found["theta_i"]))
    assert (off <= np.array(found["error"]) + 1e-12).all()
    assert np.degrees(found["theta_i"]) == pytest.approx([0, 30, 60, 80, 85, 89, 89.9])


def test_over_the_angles_seen() -> None:
    """theta_i up to 60 degrees, c from 1/2: int c^2 dc / int c dc = (7/24)/(3/8) = 7/9."""
    found = bc.compare(Constant(1 / np.pi), Rising(0.0), light=(0.0, np.pi / 3), view=(0.2, 1.0))
    assert over_light(lambda c: c, 0.5) == pytest.approx(7 / 9)
    assert found.l1 == pytest.approx(7 / 9, abs=4 * found.l1_stderr)
    with pytest.raises(bc.InputError) as caught:
        bc.compare(Constant(1.0), Constant(1.0), directions=100, view=(0.3, 0.3))
    assert caught.value.context["where"] == "view"


def test_reciprocity_defect_against_its_closed_form() -> None:
    """E|x - y| = 4/15 for x, y of density 2x; E(1 + x) = 5/3: the defect is 4/25."""
    found = symmetry_defects(Rising(0.0), pairs=40_000)
    assert found["reciprocity"] == pytest.approx(0.16, abs=4 * found["reciprocity_stderr"])
    assert found["bilateral"] == 0.0
    sharp = bc.compare(bc.model("ggx", roughness=0.01), bc.model("ggx", roughness=0.02), directions=1_000)
    assert sharp.symmetry["reference"]["reciprocity"] < 1e-12


def plain(reference: Brdf, candidate: Brdf, directions: int, seed: int) -> dict[str, float]:
    """The measures once more: one pair after the other, from the definitions, sorted lists for quantiles."""
    l1 = energy = square = energy2 = 0.0
    around = energy_draws(Lobes([reference, candidate], seed), directions, seed)
    for k in range(directions):
        if around.weight[k] == 0:
            continue
        angles = (around.theta_i[k], around.theta_o[k], around.delta_phi[k])
        for a, b in zip(*(x.evaluate(*angles).tolist() for x in (reference, candidate))):
            l1 += around.weight[k] * abs(b - a)
            energy += around.weight[k] * a
            square += around.weight[k] * (b - a) ** 2
            energy2 += around.weight[k] * a * a
    drawn = mixture(directions, seed)
    logs = roots = count = 0.0
    ratios: list[float] = []
    albedo = 0.0
    rows = []
    for k in range(directions):
        if drawn.weight[k] == 0:
            continue
        angles = (drawn.theta_i[k], drawn.theta_o[k], drawn.delta_phi[k])
        f, g = (b.evaluate(*angles) for b in (reference, candidate))
        rows.append((float(drawn.weight[k]), math.cos(angles[0]), f, g))
        albedo += rows[-1][0] * float(np.mean(f))
    floor = 1e-6 * albedo / len(rows) / math.pi / math.pi
    for w, c, f, g in rows:
        for a, b in zip(f.tolist(), g.tolist()):
            if 1 + a * c > 0 and 1 + b * c > 0:
                logs += w * (math.log(1 + b * c) - math.log(1 + a * c)) ** 2
                count += w
            roots += w * (math.copysign(abs(b * c) ** (1 / 3), b) - math.copysign(abs(a * c) ** (1 / 3), a)) ** 2
            if a >= 0 and b >= 0:
                ratios.append(abs(math.log((b + floor) / (a + floor))))
    total = sum(row[0] for row in rows) * len(rows[0][2])
    cuts = statistics.quantiles(ratios, n=1000, method="inclusive")
    return {
        "l1": l1 / energy,
        "rel_l2": math.sqrt(square / energy2),
        "rms_log": math.sqrt(logs / count),
        "rms_cube_root": math.sqrt(roots / total),
        "p50": cuts[499],
        "p95": cuts[949],
        "p99": cuts[989],
        "p999": cuts[998],
        "max": max(ratios),
        "negatives": sum(x < 0 for row in rows for x in row[3].tolist()),
    }


@pytest.mark.parametrize(
    ("reference", "candidate"),
    [
        (bc.model("ggx", roughness=[0.3, 0.2, 0.1]), bc.model("ggx", roughness=[0.31, 0.22, 0.1])),
        (bc.model("cook_torrance", roughness=0.02, ior="gold"), bc.model("ward", roughness=0.03)),
        (Skewed(), 1.1 * Skewed()),
        (Multilinear(), Constant(2.0)),
    ],
    ids=["rgb", "sharp", "negative", "smooth"],
)
def test_a_second_implementation_agrees(reference: Brdf, candidate: Brdf) -> None:
    found = bc.compare(reference, candidate, directions=1_500, seed=4).to_json()
    for name, value in plain(reference, candidate, 1_500, 4).items():
        got = found["log_ratio"][name] if name in found["log_ratio"] else found[name]
        assert got == pytest.approx(value, rel=1e-5, abs=1e-6), name  # log ratios are kept as float32


def test_standard_errors_are_the_spread_over_seeds() -> None:
    a, b = bc.model("ggx", roughness=0.3), bc.model("ggx", roughness=0.33)
    runs = [bc.compare(a, b, directions=3_000, seed=k) for k in range(40)]
    for name in ("rel_l2", "rms_log", "rms_cube_root"):
        spread = np.std([getattr(r, name) for r in runs])
        assert np.mean([getattr(r, f"{name}_stderr") for r in runs]) == pytest.approx(spread, rel=0.4), name


def test_quantile_intervals_cover_the_true_quantile() -> None:
    """In 95 of 100 samples; 400 samples, so within 4 standard deviations of the binomial."""
    rng = np.random.default_rng(0)
    held = dict.fromkeys(("p50", "p95", "p99"), 0)
    for _ in range(400):
        middle, interval = quantiles(rng.random(2_000), 2_000)
        for name, level in (("p50", 0.5), ("p95", 0.95), ("p99", 0.99)):
            held[name] += interval[name][0] <= level <= interval[name][1]
            assert interval[name][0] <= middle[name] <= interval[name][1]
    assert all(0.9 < n / 400 <= 1 for n in held.values()), held


def test_what_has_no_meaning_is_skipped_and_said() -> None:
    nothing = bc.compare(bc.model("mirror"), bc.model("mirror"), directions=500)
    assert any("no regular part" in text for text in nothing.skipped)
    assert nothing.to_json()["l1"] is None
    assert all(x != x for x in nothing.albedo_bias["bias"])
    below = bc.compare(Constant(0.5), Constant(-3.0), directions=500)
    assert any("logarithm" in text for text in below.skipped)
    assert any("log ratios" in text for text in below.skipped)
    assert bc.compare(Constant(0.5), Constant(0.6), directions=500).skipped == []


def test_speed_and_bytes_on_request() -> None:
    table = bc.tabulate(Constant(0.2), "angle_grid", shape=(5, 5, 9))
    plain_one = bc.compare(Constant(0.2), table, directions=500)
    assert (plain_one.ns, plain_one.nbytes, plain_one.flip) == (None, None, None)
    found = bc.compare(Constant(0.2), table, directions=500, speed=True)
    assert found.nbytes == table.nbytes
    assert found.ns is not None
    assert {"1", "1000", "1000000"} <= set(found.ns)
    assert all(0 < t["best"] <= t["median"] <= t["high"] for t in found.ns.values())
    assert found.ns["1"]["best"] > found.ns["1000000"]["best"]  # a call costs microseconds, a look-up in it does not
    assert metrics.compare(Constant(0.2), table, directions=500).l1 == found.l1
