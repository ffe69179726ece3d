"""What another package brings: a model, its compiled lobe, a representation and a format, each found by its entry point
alone and held to the suites of the built-in ones. So a new one is its own file and one line."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

import brdfcore as bc
from brdfcore import testing
from brdfcore.base import registry
from brdfcore.models.base.model import Model
from tests.brdfcore.conftest import Run
from tests.support import sheen_kernel

ENTRIES = {"model": ("sheen", "Sheen"), "representation": ("grey", "Grey"), "format": ("grey_file", "GreyFile")}


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    def plugins(group: str) -> dict[str, EntryPoint]:
        name, entry = ENTRIES[group.removeprefix("brdfcore.").removesuffix("s")]
        return {name: EntryPoint(name, f"tests.support.strangers:{entry}", group)}

    monkeypatch.setattr(registry, "_plugins", plugins)


def test_a_model(run: Run, tmp_path: Path) -> None:
    model = bc.model("sheen", weight=[0.1, 0.2, 0.3])
    testing.check_brdf(model)
    testing.check_pickle(model)
    assert "sheen" in run("models")[1]
    bc.write(model, tmp_path / "m.json")
    code, out, err = run("eval", tmp_path / "m.json", "--theta-i", "30", "--theta-o", "30", "--delta-phi", "180")
    assert (code, err) == (0, ""), err
    assert "0.2" in out


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_its_compiled_lobe(dtype: type) -> None:
    fast, exact = (bc.model("sheen", weight=[0.1, 0.3], precision=p) for p in ("fast", "exact"))
    assert isinstance(fast, Model)
    angles = [x.astype(dtype) for x in testing.sample_angles(600)]
    angles = [x[np.abs(angles[2]) < 9] for x in angles]
    angles[:2] = [np.minimum(x, dtype(1.57)) for x in angles[:2]]
    got = fast.evaluate(*angles)
    np.testing.assert_allclose(got, exact.evaluate(*angles), rtol=2e-5)
    out = np.empty(got.size, dtype)
    assert sheen_kernel.sheen_numpy(*angles, out, *fast._fast_by_dtype[np.dtype(dtype)]) == 0
    assert np.array_equal(out.reshape(got.shape), got)


def test_a_representation(tmp_path: Path) -> None:
    table = bc.tabulate(bc.model("lambert", reflectance=[0.2, 0.5, 0.8]), "grey")
    testing.check_brdf(table)
    testing.check_table(table, tmp_path)
    assert table.error["l1"] == pytest.approx(0, abs=1e-12)
    table.save(tmp_path / "t.h5")
    assert bc.open_table(tmp_path / "t.h5").id == table.id
    assert bc.check(table).verdict == "pass"


def test_a_format(run: Run, tmp_path: Path) -> None:
    table = bc.tabulate(bc.model("lambert"), "grey")
    path = tmp_path / "t.grey"
    bc.write(table, path)
    assert bc.sniff(path) == "grey_file"
    assert np.array_equal(bc.read(path).evaluate(0.1, 0.2, 0.3), table.evaluate(0.1, 0.2, 0.3))
    code, out, _ = run("info", path)
    assert code == 0
    assert "grey" in out
    assert run("convert", path, tmp_path / "again.h5")[0] == 0
    assert np.array_equal(bc.open_table(tmp_path / "again.h5").evaluate(0.1, 0.2, 0.3), table.evaluate(0.1, 0.2, 0.3))
