"""The HDF5 store: whole or not at all, and nothing taken on trust."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import brdfcore as bc
from brdfcore import testing
from brdfcore.tables import store
from brdfcore.tables.angle_grid import AngleGrid
from tests.brdfcore.conftest import Run
from tests.brdfcore.kernels.test_launch import finish, start
from tests.support.tiers import first_fast

FLAGS = {"bilateral": True, "reciprocal": False, "energy_conserving": False, "non_negative": False}


def small(value: float = 0.25) -> AngleGrid:
    values = np.linspace(0, 1, 3 * 4 * 5 * 2, dtype=np.float32).reshape(3, 4, 5, 2) + np.float32(value)
    table = AngleGrid(values, bc.Channels([500.0, 600.5]), FLAGS, np.full((3, 2), 0.125))
    table.error = {"l1": 0.5, "warnings": ["text with ünïcode"]}
    table.source = {"name": "x", "format": "none", "sha256": "0" * 64}
    return table


def test_round_trip(tmp_path: Path) -> None:
    testing.check_table(small(), tmp_path)


def test_same_table_same_bytes(tmp_path: Path) -> None:
    small().save(tmp_path / "a.h5")
    small().save(tmp_path / "b.h5")
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_id_covers_all_that_an_answer_depends_on() -> None:
    base = small()
    others = [
        small(0.5),
        AngleGrid(base.values, bc.Channels([500.0, 601.0]), FLAGS, base.delta),
        AngleGrid(base.values, bc.Channels(["a", "b"]), FLAGS, base.delta),
        AngleGrid(base.values, base.channels, {**FLAGS, "bilateral": False}, base.delta),
        AngleGrid(base.values, base.channels, FLAGS, None),
        AngleGrid(base.values.reshape(4, 3, 5, 2), base.channels, FLAGS, None),
    ]
    assert len({t.id for t in (base, *others)}) == len(others) + 1


def test_header_alone(tmp_path: Path) -> None:
    small().save(tmp_path / "a.h5")
    header = store.read_header(tmp_path / "a.h5")
    assert header["representation"] == "angle_grid"
    assert header["id"] == small().id
    assert header["channels"] == [500.0, 600.5]
    assert header["code_version"] == bc.__version__


@pytest.mark.parametrize("kills", first_fast(10, 200))
def test_kill_9_loses_nothing(kills: int, tmp_path: Path) -> None:
    """Every time the file is one of the two tables, whole (checksums, finiteness, id)."""
    answer = finish(start("killed_while_saving", str(tmp_path), str(kills)))
    assert answer["kills"] == answer["whole"] == kills
    assert answer["saves"] > kills, "the kills did not hit a working process"
    assert answer["leftovers_after_next_save"] == 0


def test_paths_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(bc.StorageError, match="cannot be written"):
        small().save(tmp_path / "no such folder" / "a.h5")
    (tmp_path / "taken.h5").mkdir()
    with pytest.raises(bc.StorageError, match="is a folder"):
        small().save(tmp_path / "taken.h5")


def test_missing_foreign_and_empty_files(tmp_path: Path) -> None:
    with pytest.raises(bc.StorageError, match="No such file"):
        bc.open_table(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("hello")
    with pytest.raises(bc.FileFormatError, match="HDF5 signature"):
        bc.open_table(tmp_path / "text.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = [1.0]
    with pytest.raises(bc.FileFormatError, match="header"):
        bc.open_table(tmp_path / "other.h5")


def test_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    small().save(path)
    testing.check_damage(path, tmp_path)


def edit_header(**changes: Any) -> Callable[[Any], None]:
    def edit(file: Any) -> None:
        header = json.loads(file["header"][()].tobytes())
        header.update(changes)
        del file["header"]
        file["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)

    return edit


def replace_values(make: Callable[[Any], None]) -> Callable[[Any], None]:
    def edit(file: Any) -> None:
        del file["arrays/values"]
        make(file["arrays"])

    return edit


def replace_delta(value: float) -> Callable[[Any], None]:
    def edit(file: Any) -> None:
        file["arrays/delta"][...] = value

    return edit


def nested(levels: int) -> dict[str, Any]:
    value: dict[str, Any] = {}
    for _ in range(levels):
        value = {"x": value}
    return value


def set_nan(file: Any) -> None:
    file["arrays/values"][0, 0, 0, 0] = np.nan


def change_one_value(file: Any) -> None:
    file["arrays/values"][0, 0, 0, 0] += 1


HOSTILE: dict[str, tuple[Callable[[Any], None], type[bc.BrdfError], str]] = {
    "nan": (set_nan, bc.FileFormatError, "not finite"),
    "changed value": (change_one_value, bc.FileFormatError, "header/id"),
    "header is text": (edit_header(channels="RGB"), bc.FileFormatError, "header/channels"),
    "unknown representation": (edit_header(representation="os.system"), bc.FileFormatError, "representation"),
    "newer schema": (edit_header(schema_version=2), bc.FileFormatError, "schema version 2"),
    "newer evaluation": (edit_header(evaluation_version=2), bc.FileFormatError, "evaluation version 2"),
    "version is true": (edit_header(schema_version=True), bc.FileFormatError, "header/schema_version"),
    "error of texts": (edit_header(error={"l1": "<b>", "warnings": 5}), bc.FileFormatError, "header/error"),
    "l1 is text": (edit_header(error={"l1": "<b>"}), bc.FileFormatError, "header/error/l1"),
    "l1 is huge": (edit_header(error={"l1": 10**400}), bc.FileFormatError, "header/error/l1"),
    "l1 is infinite": (edit_header(error={"l1": float("inf")}), bc.FileFormatError, "not JSON"),
    "warnings are a number": (edit_header(error={"warnings": 5}), bc.FileFormatError, "header/error/warnings"),
    "bias is a list": (edit_header(error={"albedo_bias": [1]}), bc.FileFormatError, "header/error/albedo_bias"),
    "bias of texts": (edit_header(error={"albedo_bias": {"bias": ["x"]}}), bc.FileFormatError, "albedo_bias"),
    "ratio of texts": (edit_header(error={"log_ratio": {"p99": "x"}}), bc.FileFormatError, "log_ratio"),
    "report of numbers": (edit_header(report={"done": [5]}), bc.FileFormatError, "header/report/done"),
    "source of objects": (edit_header(source={"name": {}}), bc.FileFormatError, "header/source/name"),
    "deep metadata": (edit_header(metadata=nested(400)), bc.FileFormatError, "levels"),
    "delta above 1": (replace_delta(1.5), bc.FileFormatError, "delta"),
    "false claim": (
        edit_header(flags={**FLAGS, "non_negative": True}, channels=["below", "0"], channel_kind="name"),
        bc.FileFormatError,
        "non_negative",
    ),
    "flags missing": (edit_header(flags={}), bc.FileFormatError, "header/flags"),
    "wrong channel count": (edit_header(channels=[1.0]), bc.FileFormatError, "channel"),
    "bad channels": (edit_header(channels=[[], {}]), bc.FileFormatError, "channels"),
    "soft link": (
        replace_values(lambda g: g.__setitem__("values", h5py.SoftLink("/header"))),
        bc.FileFormatError,
        "hard link",
    ),
    "external link": (
        replace_values(lambda g: g.__setitem__("values", h5py.ExternalLink("/etc/passwd", "/"))),
        bc.FileFormatError,
        "hard link",
    ),
    "group for data": (replace_values(lambda g: g.create_group("values")), bc.FileFormatError, "Dataset"),
    "compressed": (
        replace_values(lambda g: g.create_dataset("values", data=np.zeros((3, 4, 5, 2), "f4"), compression="gzip")),
        bc.FileFormatError,
        "filter",
    ),
    "variable length": (
        replace_values(lambda g: g.create_dataset("values", (3,), dtype=h5py.string_dtype())),
        bc.FileFormatError,
        "numbers",
    ),
    "huge and never written": (
        replace_values(lambda g: g.create_dataset("values", (2**31, 2**20), "f4", chunks=(1024, 16))),
        bc.LimitError,
        "limit",
    ),
    "large and never written": (
        replace_values(lambda g: g.create_dataset("values", (2**20, 2, 2, 2), "f4", chunks=(1024, 2, 2, 2))),
        bc.FileFormatError,
        "stored",
    ),
    "virtual": (
        replace_values(lambda g: g.create_virtual_dataset("values", h5py.VirtualLayout((3, 4, 5, 2), "f4"))),
        bc.FileFormatError,
        "virtual",
    ),
    "external data": (
        replace_values(lambda g: g.create_dataset("values", (3, 4, 5, 2), "f4", external=[("/etc/passwd", 0, 480)])),
        bc.FileFormatError,
        "external",
    ),
    "float64 values": (
        replace_values(lambda g: g.create_dataset("values", data=np.zeros((3, 4, 5, 2)), chunks=(3, 4, 5, 2))),
        bc.FileFormatError,
        "float32",
    ),
    "another shape": (
        replace_values(lambda g: g.create_dataset("values", data=np.zeros((3, 4, 5), "f4"), chunks=(3, 4, 5))),
        bc.FileFormatError,
        "float32",
    ),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_hostile_file(what: str, tmp_path: Path) -> None:
    edit, error, words = HOSTILE[what]
    path = tmp_path / "hostile.h5"
    small(-0.5 if what == "false claim" else 0.25).save(path)
    with h5py.File(path, "r+") as file:
        edit(file)
    with pytest.raises(error, match=words) as caught:
        bc.open_table(path)
    assert "hostile.h5" in str(caught.value)


def test_a_table_of_an_older_evaluation_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It answers as the present evaluation does and gets that one's id; the id of its own can't be checked."""
    path = tmp_path / "old.h5"
    old = small()
    before = old.id
    old.save(path)
    monkeypatch.setattr(AngleGrid, "EVALUATION_VERSION", 2)
    opened = bc.open_table(path)
    assert opened.id == small().id != before
    assert np.array_equal(opened.evaluate(0.1, 0.2, 0.3), old.evaluate(0.1, 0.2, 0.3))


def test_values_changed_in_place_are_saved_under_their_own_id(tmp_path: Path) -> None:
    table = small()
    before = table.id
    table.to_arrays()["values"][0, 0, 0, 0] += 1
    table.save(tmp_path / "a.h5")
    assert bc.open_table(tmp_path / "a.h5").id == table.computed_id() != before


UNFIT = {"nan": float("nan"), "inf": float("inf"), "set": {1}, "object": object(), "bytes": b"x"}


@pytest.mark.parametrize("key", ["metadata", "report", "error", "source"])
@pytest.mark.parametrize("value", UNFIT.values(), ids=UNFIT)
def test_facts_that_json_cannot_hold_are_refused_by_name(key: str, value: object, tmp_path: Path) -> None:
    table = small()
    getattr(table, key)["x"] = value
    with pytest.raises(bc.InputError, match=key) as caught:
        table.save(tmp_path / "a.h5")
    assert caught.value.context["where"] == key
    assert not list(tmp_path.iterdir())


def test_what_could_not_be_opened_is_not_saved(tmp_path: Path) -> None:
    table = small()
    table.error = {"l1": "much"}
    with pytest.raises(bc.InputError, match="error/l1"):
        table.save(tmp_path / "a.h5")


@pytest.mark.parametrize("error", [{}, {"l1": None}, {"albedo_bias": {"bias": [1.0], "theta_i": [None]}, "seed": None}])
def test_info_of_any_header_that_opens(error: dict[str, Any], tmp_path: Path, run: Run) -> None:
    table = small()
    table.error = error
    table.save(tmp_path / "a.h5")
    code, _, err = run("info", tmp_path / "a.h5")
    assert (code, err) == (0, "")
