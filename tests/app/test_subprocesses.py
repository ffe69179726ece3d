"""What child processes of the service import from, and how their errors come back."""

from __future__ import annotations

import os
import sys
from contextlib import closing
from pathlib import Path

import pytest
from brdf_service.work import subprocesses
from brdf_service.work.subprocesses import Child, rebuilt, told

import brdfcore as bc

ROOT = Path(bc.__file__).parents[1]


def places() -> list[str]:
    return subprocesses._environment({})["PYTHONPATH"].split(os.pathsep)


def test_the_current_folder_is_no_place_to_import_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "link").symlink_to(tmp_path)
    monkeypatch.setattr(sys, "path", ["", str(tmp_path), str(tmp_path / "link"), str(ROOT), *sys.path])
    monkeypatch.chdir(tmp_path)
    assert "" not in places()
    assert not [p for p in places() if os.path.realpath(p) == str(tmp_path.resolve())]
    assert str(ROOT) in places()
    monkeypatch.chdir(ROOT)  # the package itself is there
    assert str(tmp_path) in places()
    assert str(ROOT) in places()


def test_a_current_folder_that_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert "" not in places()
    monkeypatch.chdir(tmp_path)


def test_the_key_stays_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BRDF_API_KEY", "secret of the service")
    assert "secret of the service" not in subprocesses._environment({"MORE": "1"}).values()


def test_errors_travel_as_names_of_errors_only() -> None:
    error = bc.LimitError("too_large", "it is too large", got=3, limit=2)
    back = rebuilt(told(error))
    assert (type(back), back.code, back.detail, back.context) == (
        bc.LimitError,
        "too_large",
        "it is too large",
        error.context,
    )
    for kind in ("read", "Table", "no such name", None):
        assert type(rebuilt({"kind": kind, "code": "c", "detail": "d"})) is bc.BrdfError


def test_a_child_that_is_late_and_one_that_has_ended() -> None:
    with closing(Child("drawing_process")) as child:
        with child.within(0.2):
            assert child.hear() is None  # it waits for a task
        assert child.late
        child.send({"too": "late"})
        assert child.hear() is None
        assert child.read(10) == b""
    assert child.process.returncode is not None
