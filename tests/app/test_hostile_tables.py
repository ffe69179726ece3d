"""Table files from outside whose headers say what no writer of ours does: no answer about them is a 500."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import pytest

import brdfcore as bc
from tests.app.conftest import Serve

ODD: list[Any] = [None, 5, "x", ["<script>"], {"a": 1}, [{"theta_i": "x"}], [{"theta_i": 1.0}]]
pytestmark = pytest.mark.slow
PLACES = [("error", name) for name in ("l1", "l1_stderr", "warnings", "by_theta_i", "between")]
PLACES += [("metadata", "about"), ("metadata", "model"), ("report", "warnings"), ("report", "coverage")]


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, str]:
    """Files, and what is odd about each."""
    folder, made = tmp_path_factory.mktemp("hostile"), {}
    table = bc.tabulate(bc.model("lambert"), "angle_grid", shape=(3, 3, 3))
    for part, name in PLACES:
        for number, value in enumerate(ODD):
            table.error, table.metadata, table.report = {"l1": 0.5}, {}, {}
            getattr(table, part)[name] = value
            path = folder / f"{part}-{name}-{number}.h5"
            with contextlib.suppress(bc.InputError):  # of some the writer knows better
                table.save(path)
                made[path] = f"{part}.{name} = {value!r}"
    assert len(made) > 30
    return made


def test_answers(hostile: dict[Path, str], serve: Serve) -> None:
    client = serve(data=next(iter(hostile)).parent)
    assert client.get("/v1/materials?limit=1000").status_code == 200
    for offset in range(0, len(hostile), 24):
        assert client.get(f"/?offset={offset}").status_code == 200
    for path, odd in hostile.items():
        own, codes = f"/v1/materials/{path.stem}", set()
        drawn = [f"{own}/coverage.svg"] if "coverage" in path.stem else []
        for address in (f"/materials/{path.stem}", own, f"{own}/report", *drawn):
            codes.add(client.get(address).status_code)
        codes.add(client.get(f"{own}/evaluate?theta_i=1&theta_o=1&delta_phi=1").status_code)
        assert codes <= {200, 409, 422}, odd


@pytest.mark.parametrize("name", ["error-by_theta_i-5", "error-between-4"])
def test_an_error_that_is_none_is_told_of(hostile: dict[Path, str], serve: Serve, name: str) -> None:
    client = serve(data=next(iter(hostile)).parent)
    facts = client.get(f"/v1/materials/{name}").json()
    assert facts["error"] == {}
    (told,) = [text for text in facts["warnings"] if "measured error" in text]
    assert told in client.get(f"/materials/{name}").text
