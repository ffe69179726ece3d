"""ASAM OpenMATERIAL 3D look-up tables: rows, the declared grid, what is refused and where, and conversion reports."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.base.registry import REPRESENTATIONS
from brdfcore.base.status import Status
from brdfcore.formats.base.format import LossWarning
from brdfcore.formats.openmaterial.text import parse
from brdfcore.tables.specular_grid import SpecularGrid
from tests.shared import needs_shared, rgl_path
from tests.support.format_examples import specular

scattered = pytest.mark.skipif(
    "scattered" not in REPRESENTATIONS, reason="the representation of scattered rows is not installed"
)


def document(rows: Any, **beside: Any) -> str:
    metadata = {"name": "made", "uuid": "42e8da0f-ba1d-4cc8-b07a-178819c894c0"}
    waves = sorted({r[0] for r in rows if r[0] is not None})
    return json.dumps({"metadata": metadata, "brdf": {"wavelengths": waves, "lookupTable": rows}, **beside})


def rows(waves: tuple[float | None, ...] = (5.5e-7,)) -> list[list[float | None]]:
    """Lambertian rows, with a lobe at phi = pi."""
    return [
        [w, i, o, p, 0.1 + 0.3 * float(p > 3 and abs(i - o) < 0.01)]
        for w in waves for i in (0.2, 0.6, 1.0) for o in (0.0, 0.2, 0.6, 1.0, 1.3) for p in (0.0, 1.5, 3.1415926535)
    ]  # fmt: skip


def put(folder: Path, text: str) -> Path:
    path = folder / "made_brdf.xompt"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("bilateral", [True, False])
def test_a_grid_comes_back_to_the_bit(tmp_path: Path, bilateral: bool) -> None:
    b = specular(bilateral)
    bc.write(b, tmp_path / "a_brdf.xompt")
    c = bc.read(tmp_path / "a_brdf.xompt")
    assert isinstance(c, SpecularGrid)
    assert isinstance(b, SpecularGrid)
    for name, array in b.to_arrays().items():
        assert np.array_equal(c.to_arrays()[name], array), name
    assert c.channels == b.channels
    bc.write(c, tmp_path / "b_brdf.xompt")
    assert (tmp_path / "b_brdf.xompt").read_bytes() == (tmp_path / "a_brdf.xompt").read_bytes()


def test_what_is_written_follows_the_standards_schema(tmp_path: Path) -> None:
    """Required keys, units and limits of material_brdf_schema.json, version 1.0.0; rows sorted."""
    with pytest.warns(LossWarning):
        bc.write(bc.model("ggx", roughness=[0.2, 0.3, 0.4]), tmp_path / "m_brdf.xompt", shape="5,4,6")
    content = json.loads((tmp_path / "m_brdf.xompt").read_text())
    required = {
        "name",
        "uuid",
        "materialVersion",
        "openMaterial3dVersion",
        "copyrights",
        "license",
        "authors",
        "sources",
    }
    assert required <= set(content["metadata"])
    table = np.array(content["brdf"]["lookupTable"])
    assert sorted(set(table[:, 0])) == content["brdf"]["wavelengths"] == [4.642e-7, 5.491e-7, 6.114e-7]
    assert (table[:, 1:3] >= 0).all()
    assert table[:, 1:3].max() <= 1.570796
    assert 0 <= table[:, 3].min() <= table[:, 3].max() <= 6.283185
    assert (table[:, 4] >= 0).all()
    assert table.tolist() == sorted(table.tolist())
    # f itself at the row's own angles, the mirror direction at phi = pi
    red = table[table[:, 0] == 6.114e-7]
    f = bc.model("ggx", roughness=0.2).evaluate(red[:, 1], red[:, 2], red[:, 3])[:, 0]
    assert np.allclose(red[:, 4], f, rtol=2e-4, atol=1e-6)
    assert bc.read(tmp_path / "m_brdf.xompt").channels == ("R", "G", "B")


def test_channels_and_wavelengths(tmp_path: Path) -> None:
    path = tmp_path / "c_brdf.xompt"
    with pytest.warns(LossWarning):
        bc.write(bc.model("lambert"), path, shape="3,3,4", wavelengths=[905])
    assert bc.read(path).channels == (905.0,)
    assert json.loads(path.read_text())["brdf"]["wavelengths"] == [9.05e-7]
    grid = specular()
    assert isinstance(grid, SpecularGrid)
    named = SpecularGrid.from_arrays(grid.to_arrays(), {}, bc.Channels(["infrared"]), grid.flags)
    with pytest.raises(InputError, match="pass wavelengths="):
        bc.write(named, path)
    bc.write(named, path, wavelengths=905)
    assert bc.read(path).channels == ("infrared",)
    for bad in ([1, 2], [0.5], "x"):
        with pytest.raises(InputError):
            bc.write(named, path, wavelengths=bad)
    with pytest.raises(InputError, match="mirror"):
        bc.write(bc.model("mirror"), path)
    with pytest.raises(InputError, match="shape"):
        bc.write(bc.model("lambert"), path, shape="1,2")


@scattered
@pytest.mark.slow
def test_rows_of_others_are_measurements(tmp_path: Path) -> None:
    path = put(tmp_path, document(rows((4.5e-7, 6.5e-7))))
    b = bc.read(path)
    assert b.channels == (450.0, 650.0)
    assert b.report["found"]["rows"] == 90
    assert b.report["found"]["geometries"] == 45
    assert (b.status([0.6], [0.6], [np.pi]) == Status.MEASURED).all()
    at_mirror, at_retro = b.evaluate(0.6, 0.6, [np.pi, 0.0])[:, 0]
    assert at_mirror > 2 * at_retro
    turned = bc.read(path, mirror="0")
    assert turned.evaluate(0.6, 0.6, 0.0)[0] > 2 * turned.evaluate(0.6, 0.6, np.pi)[0]
    assert "mirror" in turned.report["conventions"]["phi"]


@scattered
def test_a_declared_grid_that_the_rows_do_not_fit_is_left_aside(tmp_path: Path) -> None:
    grid = {"bilateral": True, "theta_i": [0.2, 1.0], "azimuth": [0, np.pi], "radial": [0, 1.0]}
    b = bc.read(put(tmp_path, document(rows(), brdfTables={"grid": grid})))
    assert not isinstance(b, SpecularGrid)
    assert any("left aside" in w for w in b.report["warnings"])


@pytest.mark.parametrize(
    ("row", "column", "value", "said"),
    [
        (3, 1, 1.6, "theta_i"),
        (3, 2, -0.1, "theta_o"),
        (44, 3, 7.0, "phi"),
        (0, 0, 550.0, "wavelength"),
        (7, 0, None, "wavelength"),
        (2, 1, None, "theta_i"),
    ],
)
def test_what_is_out_of_the_standards_limits_is_named_with_its_byte(
    tmp_path: Path, row: int, column: int, value: float | None, said: str
) -> None:
    table = rows()
    table[row][column] = value
    path = put(tmp_path, document(table))
    with pytest.raises(FileFormatError) as caught:
        bc.read(path)
    assert caught.value.context["field"] == f"brdf.lookupTable[{row}], {said}"
    at = caught.value.context["offset"]
    assert path.read_bytes()[at:].startswith(json.dumps(value).encode())


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ('{"brdf": {"lookupTable": [[1,2,3,4,5],]}}', "brdf.lookupTable[1]"),
        ('{"brdf": {"lookupTable": [[1,2,3,4]]}}', "brdf.lookupTable[0]"),
        ('{"brdf": {"lookupTable": [[1,2,3,4,5,6]]}}', "brdf.lookupTable[0]"),
        ('{"brdf": {"lookupTable": [[1,2,"3",4,5]]}}', "brdf.lookupTable[0], theta_o"),
        ('{"brdf": {"lookupTable": [[1,2,3,4,NaN]]}}', "brdf.lookupTable[0], f"),
        ('{"brdf": {"lookupTable": [[1,2,3,4,1e999]]}}', "brdf.lookupTable[0], f"),
        ('{"brdf": {"lookupTable": [[1,2,3,4,5][1,2,3,4,5]]}}', "brdf.lookupTable"),
        ('{"brdf": {"lookupTable": []}}', "brdf.lookupTable"),
        ('{"brdf": {}}', "brdf.lookupTable"),
        ('{"brdf": {"lookupTable": [[1,2,3,4,5]', "brdf.lookupTable[1]"),
    ],
)
def test_damaged_rows_are_named(text: str, field: str) -> None:
    with pytest.raises(FileFormatError) as caught:
        parse(text.encode(), "x")
    assert caught.value.context["field"] == field, caught.value.detail


def test_the_table_is_found_wherever_it_stands() -> None:
    trap = json.dumps(
        {"metadata": {"name": '"lookupTable": [[1,2,3,4,5]]'}, "brdf": {"lookupTable": [[1, 2, 3, 4, None]]}}
    )
    found = parse(trap.encode(), "x")
    assert found.rows.shape == (1, 5)
    assert np.isnan(found.rows[0, 4])


@needs_shared
def test_conversion_of_a_measured_file_is_reported(tmp_path: Path) -> None:
    source = bc.read(rgl_path("chm_light_blue"))
    found = bc.convert(source, tmp_path / "c_brdf.xompt")
    assert found.comparison is not None
    assert found.comparison.l1 <= 0.06
    worst = found.worst
    at = np.radians([worst[k] for k in ("theta_i", "theta_o", "delta_phi")])
    channel = source.channels.find(worst["channel"])
    # the angles are rounded to 1e-4 degrees for people
    assert source.evaluate(*at)[channel] == pytest.approx(worst["before"], rel=1e-2)
    assert found.result.evaluate(*at)[channel] == pytest.approx(worst["after"], rel=1e-2)
    told = " ".join([*found.losses, *found.lost])
    for part in ("sampled at", "negative values written as 0", "the sign of", "extrapolated or filled"):
        assert part in told
    json.dumps(found.to_json(), allow_nan=False)


def test_a_conversion_that_loses_nothing_says_so(tmp_path: Path) -> None:
    found = bc.convert(specular(), tmp_path / "s_brdf.xompt")
    assert found.comparison is not None
    assert (found.comparison.l1, found.lost, found.format) == (0.0, [], "openmaterial")


def test_another_name_than_the_standard_s_is_told(tmp_path: Path) -> None:
    with pytest.warns(LossWarning, match="_brdf.xompt"):
        bc.write(specular(), tmp_path / "paint.xompt")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        bc.write(specular(), tmp_path / "paint_brdf.xompt")


def test_a_slip_in_a_row_leaves_the_grid(tmp_path: Path) -> None:
    """Near a node is at the node; a row that is none is left aside with a warning; many make scattered points."""
    table = bc.tabulate(bc.model("phong", specular=0.5, exponent=5), "specular_grid", shape=(8, 10, 20))
    path = tmp_path / "a_brdf.xompt"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        bc.write(table, path)
    whole = bc.read(path)
    slipped = json.loads(path.read_text())
    rows = slipped["brdf"]["lookupTable"]
    row = rows[len(rows) // 2]
    row[2] += 3e-5
    path.write_text(json.dumps(slipped))
    near = bc.read(path)
    assert type(near) is type(whole)
    assert np.array_equal(near.evaluate(0.3, 0.2, 3.0), whole.evaluate(0.3, 0.2, 3.0))
    row[2] = abs(row[2] - 0.01)
    path.write_text(json.dumps(slipped))
    odd = bc.read(path)
    assert type(odd) is type(whole)
    assert any("1 of" in w and "left aside" in w for w in odd.report["warnings"])
