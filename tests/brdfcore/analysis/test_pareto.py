"""The front of a material: what is on it, what is chosen, and that it is built and measured as said."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import brdfcore as bc
from brdfcore.analysis.pareto import peers
from brdfcore.analysis.pareto.entries import SLOWEST, USELESS, Entry, beaten_anyway, choose, mark_dominated
from brdfcore.analysis.pareto.pareto import Pareto
from brdfcore.analysis.pareto.timing import MARGIN, REPEATS, Timing, time_all
from brdfcore.base.registry import REPRESENTATIONS
from brdfcore.kernels.machine import launch
from brdfcore.reporting import words
from tests import shared
from tests.support.sources import Constant, Skewed

FEW: dict[str, Any] = {"sizes": (32_000,), "rounds": 3, "directions": 20_000}


def weighed(**options: Any) -> Pareto:
    b = bc.model("cook_torrance", roughness=0.2, ior="gold")
    return bc.pareto(b, material="gold", tolerance=0.02, **FEW, **options)


@pytest.fixture(scope="module")
def gold() -> Pareto:
    return weighed(representations=("angle_grid", "half_difference"))


def entry(name: str, nbytes: int, error: float, ns: float, kind: Any = "table") -> Entry:
    """One with given numbers; rounds that differ by a tenth."""
    l1 = bc.compare(Constant(1.0), (1 + error) * Constant(1.0), directions=10)
    made = Entry(name, "", kind, nbytes, 0.0, l1)
    made.timings = {"1000000": Timing((ns, 1.1 * ns, 1.05 * ns))}
    return made


@pytest.mark.slow
def test_every_representation_that_can_hold_it_takes_part() -> None:
    gold = weighed()
    names = {e.representation for e in gold.entries}
    can = {n for n in bc.representations() if REPRESENTATIONS.load(n).can_hold(gold.source)}
    left = {n for n in can if any(text.startswith(n) for text in gold.left_out)}
    assert can - left <= names
    assert {"angle_grid", "half_difference"} <= names
    assert {e.variant for e in gold.entries if e.representation == "cook_torrance"} == {"exact", "fast"}


def test_numbers_are_those_of_the_tables(gold: Pareto) -> None:
    for e in gold.entries:
        assert e.brdf is not None
        again = bc.compare(gold.source, e.brdf, directions=20_000)
        assert again.l1 == e.comparison.l1
        assert e.nbytes == (e.brdf.nbytes if isinstance(e.brdf, bc.Table) else 0)
        assert {"1", "1000", "1000000"} <= set(e.timings)
        assert e.nbytes <= 32_000 or e.usual or e.representation not in ("angle_grid", "half_difference")
    exact = next(e for e in gold.entries if e.variant == "exact")
    assert (exact.error, exact.nbytes) == (0.0, 0)
    assert [e.nbytes for e in gold.entries] == sorted(e.nbytes for e in gold.entries)


def test_what_is_chosen_does_what_was_asked(gold: Pareto) -> None:
    assert gold.met
    assert gold.chosen in gold.front
    assert all(e in gold.entries and e is not gold.chosen for e in gold.rivals)
    assert gold.chosen.error <= 0.02
    assert gold.table is not None
    assert gold.table.kind == "table"
    told = json.loads(json.dumps(gold.to_json(), allow_nan=False))
    assert {"material", "tolerance", "machine", "front", "chosen"} <= set(told)
    assert {"representation", "nbytes", "l1", "ns"} <= set(told["front"][0])
    assert told["chosen"]["label"] in [e["label"] for e in told["front"]]


def test_domination() -> None:
    fast = entry("fast", 1000, 0.01, 5.0)
    listed = [
        fast,
        entry("larger", 2000, 0.01, 5.0),
        entry("hardly-faster", 2000, 0.02, 4.5),  # within the margin: no reason to take it
        entry("much-faster", 2000, 0.02, 2.0),
        entry("better", 4000, 0.001, 50.0),
        entry("smaller", 100, 0.2, 5.0),
        entry("useless", 50, 0.9, 1.0),
        entry("peer", 10, 0.0, 0.1, "peer"),
    ]
    mark_dominated(listed)
    beaten = {e.label: e.dominated_by for e in listed}
    assert beaten["larger"] == beaten["hardly-faster"] == "fast"
    assert [e.label for e in listed if e.on_front] == ["fast", "much-faster", "better", "smaller"]
    assert listed[-2].error > USELESS


def test_what_another_run_may_rank_otherwise_is_said() -> None:
    """Bytes and errors decide alone where they can; a speed that is close to the margin makes a near tie."""
    base = entry("base", 1000, 0.01, 5.0)
    listed = [
        base,
        entry("just-faster", 2000, 0.02, 5.0 / (1.03 * MARGIN)),
        entry("just-not", 1500, 0.03, 5.0 / (0.97 * MARGIN)),
        entry("clearly", 3000, 0.02, 5.0 / (1.5 * MARGIN)),
        entry("clearly-not", 9000, 0.04, 6.0),
        entry("smaller", 500, 0.05, 5.0),
    ]
    mark_dominated(listed)
    assert {e.label: e.near_tie for e in listed} == {
        "base": None, "just-faster": "base", "just-not": "base", "clearly": None, "clearly-not": None, "smaller": None,
    }  # fmt: skip
    assert [e.label for e in listed if e.on_front] == ["base", "just-faster", "clearly", "smaller"]
    assert listed[1].to_json(0.01)["near_tie"] == "base"


def test_a_choice_that_hangs_on_a_near_tie_names_the_other() -> None:
    """A formula beside a table: of tables the stored times decide, which are the same in every run."""
    listed = [entry("formula", 0, 0.0, 5.0 * 1.04 * SLOWEST, "model"), entry("quick", 9000, 0.008, 5.0)]
    assert choose(listed, 0.01, None).label == "quick"
    assert choose(listed, 0.01, None, margin=MARGIN * REPEATS).label == "formula"
    assert choose(listed, 0.01, None, margin=MARGIN / REPEATS).label == "quick"


def test_what_is_beaten_whatever_the_clock_says_is_not_timed_on() -> None:
    listed = [entry("a", 1000, 0.01, 5.0), entry("b", 2000, 0.02, 9.0), entry("c", 2000, 0.02, 7.0)]
    listed += [entry("d", 2000, 0.001, 90.0), entry("peer", 2000, 0.02, 90.0, "peer")]
    times = {e.label: e.timings["1000000"] for e in listed}
    assert beaten_anyway(listed, times) == {"b"}
    counts = {}
    for settled in (None, lambda _: {"b"}):
        made = dict.fromkeys("ab", 0)

        def maker(_: int, name: str, made: dict[str, int] = made) -> Any:
            return lambda: made.__setitem__(name, made[name] + 1) or sum(range(3000))

        makers = {name: partial(maker, name=name) for name in "ab"}
        found = time_all(makers, rounds=9, headline=True, settled=settled)
        counts[settled is None] = {name: len(t["1000000"].rounds) for name, t in found.items()}
    assert counts == {True: {"a": 9, "b": 9}, False: {"a": 9, "b": 4}}


def test_what_others_do_on_the_machine_does_not_count() -> None:
    """A look-up that sleeps as long as it works is as fast as one that only works. In a process of its own: the time is
    that of all its threads, and other tests may have left some."""
    code = """
import time
from brdfcore.analysis.pareto.timing import time_all

def work():
    return sum(range(20_000))

def interrupted():
    time.sleep(0.002)
    return work()

found = time_all({"work": lambda _: work, "interrupted": lambda _: interrupted}, rounds=5, headline=True)
print(*(found[name]["1000000"].best for name in ("work", "interrupted")))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    alone, interrupted = map(float, done.stdout.split())
    assert interrupted < 2 * alone


@pytest.mark.slow
def test_the_usual_practice_gives_up_what_its_layout_can_not_hold() -> None:
    found = bc.pareto(Skewed(), sizes=(8_000,), rounds=2, directions=5_000)
    (usual,) = [e for e in found.entries if e.usual]
    assert "made reciprocal" in usual.variant
    assert usual.error > 0.01


@pytest.mark.slow
def test_tables_stop_where_they_are_far_better_than_asked() -> None:
    sizes = tuple(8_000 * 2**k for k in range(8))
    found = bc.pareto(
        bc.model("ggx", roughness=0.4), sizes=sizes, rounds=2, directions=20_000, representations=("half_difference",)
    )
    errors = [e.error for e in found.entries if e.kind == "table"]
    assert sum(error <= 0.1 * found.tolerance for error in errors) <= 1
    best = bc.pareto(
        bc.model("ggx", roughness=0.4), max_bytes=64_000, sizes=sizes[:4], rounds=2, directions=20_000,
        representations=("half_difference",),
    )  # fmt: skip
    assert len([e for e in best.entries if e.kind == "table"]) == 4  # the smallest error within bytes is asked for


def test_a_peer_that_ends_its_process_does_not_end_ours(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(peers, "find_spec", lambda _: object())
    trial = "import os, sys; print('LLVM ERROR: no such luck', file=sys.stderr, flush=True); os.abort()"
    monkeypatch.setattr(peers, "_TRIAL", trial)
    made, why = peers.mitsuba_peer(tmp_path / "aborts.bsdf", bc.model("lambert"))
    assert made == []
    assert "LLVM ERROR: no such luck" in why[0]
    monkeypatch.setattr(peers, "find_spec", lambda _: None)
    assert "not installed" in peers.mitsuba_peer(tmp_path / "none.bsdf", bc.model("lambert"))[1][0]


def test_equals_leave_one_on_the_front() -> None:
    twins = [entry("a", 1000, 0.01, 5.0), entry("b", 1000, 0.01, 5.0)]
    mark_dominated(twins)
    assert [e.dominated_by for e in twins] == [None, "a"]


def test_choice() -> None:
    listed = [
        entry("small", 1000, 0.009, 9.0),
        entry("quick", 9000, 0.008, 3.0),
        entry("as-quick", 5000, 0.008, 3.3),
        entry("exact", 50_000, 0.0, 20.0),
    ]
    assert choose(listed, 0.01, None).label == "as-quick"  # of equally fast ones the smallest
    assert choose(listed, 0.01, 2000).label == "small"
    assert choose(listed, 1e-6, None).label == "exact"
    assert choose(listed, 0.01, None, smallest_error=True).label == "exact"
    assert choose(listed, 0.001, 10_000).error == pytest.approx(0.008)  # nothing is right enough: the closest
    assert choose(listed, 0.01, 10).label == "small"  # nothing fits: the smallest
    assert choose([*listed, entry("formula", 0, 0.0, 11.0, "model")], 0.01, None).label == "formula"
    assert choose([*listed, entry("formula", 0, 0.0, 13.0, "model")], 0.01, None).label == "as-quick"


def test_a_tolerance_has_to_be_met_beyond_chance() -> None:
    loose = entry("loose", 1000, 0.0099, 5.0)
    assert loose.meets(0.01)
    for row in [*loose.comparison.by_theta_i, *loose.comparison.between]:
        row["l1_stderr"] = 0.003  # more than a fifth of the tolerance
    assert not loose.meets(0.01)


def test_the_mirror_part_counts() -> None:
    found = bc.pareto(bc.model("mirror", ior="silver"), sizes=(8_000,), rounds=2, directions=2_000)
    assert found.chosen.error == 0.0
    assert found.chosen.kind == "model"
    assert all(e.comparison.l1 != e.comparison.l1 for e in found.entries)
    json.dumps(found.to_json(), allow_nan=False)


def test_a_material_without_any_symmetry() -> None:
    found = bc.pareto(Skewed(), sizes=(64_000,), rounds=2, directions=5_000, representations=("angle_grid",))
    assert {e.representation for e in found.entries} == {"angle_grid"}
    assert found.chosen in found.entries


def test_time_runs_out() -> None:
    source = bc.model("ggx", roughness=0.3)
    found = bc.pareto(source, sizes=(8_000, 16_000, 32_000), rounds=2, directions=2_000, seconds=1e-6)
    assert found.chosen.representation == "ggx"
    assert any("the time was up" in text for text in found.left_out)
    assert found.not_tried
    assert found.not_tried[0] in words.advice(found)


@pytest.mark.parametrize("name", ["tolerance", "max_bytes", "seconds"])
@pytest.mark.parametrize("value", [0, -1.0, float("nan"), "5"])
def test_options_that_cannot_be(name: str, value: Any) -> None:
    with pytest.raises(bc.InputError) as caught:
        bc.pareto(bc.model("lambert"), **{name: value})
    assert caught.value.context["where"] == name


def test_peers_stand_beside() -> None:
    found = bc.pareto(
        bc.model("lambert"), sizes=(8_000,), rounds=2, directions=2_000, representations=("angle_grid",), peers=True
    )
    peers = [e for e in found.entries if e.kind == "peer"]
    assert "scipy RegularGridInterpolator" in {e.representation for e in peers}
    assert not any(e.on_front for e in peers)
    assert found.chosen.kind != "peer"


def test_one_thread_means_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launch, "_serial_only", False)
    before = launch.threads()
    with launch.one_thread():
        assert launch.threads() == 1
    assert launch.threads() == before


def test_timing_orders_what_differs() -> None:
    """A thousand times the work is told apart, whatever else the machine does."""
    short, long = (lambda n: lambda: sum(range(100))), (lambda n: lambda: sum(range(100_000)))
    found = time_all({"short": short, "long": long}, rounds=3)
    for key in found["short"]:
        assert found["short"][key].faster_than(found["long"][key])
        assert not found["long"][key].faster_than(found["short"][key])


@shared.needs_shared
@pytest.mark.slow
def test_a_measured_file_is_its_own_table() -> None:
    path = Path(shared.rgl_path("paper_white"))
    found = bc.pareto(
        bc.read(path), sizes=(32_000,), rounds=2, directions=5_000, representations=("vndf_warp", "angle_grid")
    )
    own = [e for e in found.entries if e.representation == "vndf_warp"]
    whole = max(own, key=lambda e: e.nbytes or 0)
    assert (whole.error, whole.nbytes) == (0.0, bc.read(path).nbytes)  # type: ignore[attr-defined]
    assert all(0 < e.error < 0.01 for e in own if e is not whole)  # fewer nodes of the normals' density


@pytest.mark.parametrize("source", [bc.model("oren_nayar", sigma=0.5), bc.model("ggx", roughness=0.02)])
def test_what_is_advised_is_what_tabulate_takes(source: bc.Brdf) -> None:
    """The same representation, and no larger: a size between the steps of `tabulate` may do as well."""
    found = bc.pareto(source, tolerance=0.02, sizes=(16_000,), rounds=2, directions=5_000)
    table = bc.tabulate(source, tolerance=0.02)
    assert found.table is not None
    assert found.table.representation == table.name
    assert found.table.nbytes <= table.nbytes
    assert found.table.meets(0.02)
    assert not found.not_tried
