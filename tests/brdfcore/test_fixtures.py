"""Files written by earlier versions open with the same bits ever after; `tests/fixtures` says how they were made."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.tables.store import read_header
from tests.fixtures.make import answers, functions

FOLDER = Path(__file__).parents[1] / "fixtures"
#: Its look-ups between two theta_i near the horizon were up to 43 % too high: refused, with what to do.
REFUSED = "v0.1.0/specular_grid.h5"
#: What such a table may hold has grown since, and with it what its id is a digest of; its answers are the same.
ANOTHER_ID = "v0.1.0/scattered.h5", "id"
FILES = sorted(p.relative_to(FOLDER).as_posix() for end in ("h5", "json") for p in FOLDER.glob(f"*/*.{end}"))

#: Evaluated by numpy, whose float64 functions differ in their last bits between processors: the same bits where those
#: functions are the ones that the file's answers were made with. Compiled look-ups have the same bits on all.
BY_NUMPY = (".json",)


def test_every_representation_of_the_first_version_is_there() -> None:
    tables = [FOLDER / f for f in FILES if f.startswith("v0.1.0/") and f.endswith(".h5")]
    names = {read_header(path)["representation"] for path in tables}
    grids = {"angle_grid", "half_angle_grid", "specular_grid"}
    assert names == grids | {"half_difference", "vndf_warp", "harmonic", "scattered"}


def test_a_file_whose_look_ups_were_wrong_is_refused() -> None:
    with pytest.raises(bc.FileFormatError, match="make the table again from its source") as refused:
        bc.open_table(FOLDER / REFUSED)
    assert refused.value.code == "evaluation_version"


@pytest.mark.parametrize("file", [f for f in FILES if f != REFUSED])
def test_the_same_bits(file: str) -> None:
    path = FOLDER / file
    with np.load(path.parent / "answers.npz") as kept:
        same_functions = str(kept["functions"]) == functions()
        expected = {key.partition("/")[2]: kept[key] for key in kept if key.startswith(f"{path.name}/")}
    found = answers(bc.read(path))
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        if (file, name) == ANOTHER_ID:
            continue
        got = np.asarray(found[name])
        assert got.dtype == value.dtype, name
        if name == "float64" and path.name.endswith(BY_NUMPY) and not same_functions:
            np.testing.assert_allclose(got, value, rtol=1e-13)
        else:
            assert np.array_equal(got, value), (name, got, value)


@pytest.mark.parametrize("file", [f for f in FILES if f.endswith(".h5") and f != REFUSED])
def test_saved_again_it_is_the_same_table(file: str, tmp_path: Path) -> None:
    table = bc.open_table(FOLDER / file)
    table.save(tmp_path / "again.h5")
    again = bc.open_table(tmp_path / "again.h5")
    assert again.id == table.id
    assert (again.error, again.source, again.report) == (table.error, table.source, table.report)
