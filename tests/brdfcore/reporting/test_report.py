"""The report of a material: the page, its numbers, its pictures, and the table that was written."""

from __future__ import annotations

import io
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import brdfcore as bc
from brdfcore.base.registry import REPRESENTATIONS
from brdfcore.metrics.incidence import worst
from brdfcore.reporting import words
from brdfcore.reporting.appearance import appearance, flip
from brdfcore.reporting.error_map import error_map
from brdfcore.reporting.item import Subject
from brdfcore.reporting.report import Report, file_name, report
from tests.brdfcore.conftest import Run
from tests.support.sources import Constant

FEW: dict[str, Any] = {
    "sizes": (8_000, 32_000),
    "rounds": 2,
    "directions": 20_000,
    "representations": ("angle_grid", "half_difference"),
}
NASTY = '<script>alert(1)</script> | `gold` & "co"'


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Report:
    gold, white = bc.model("cook_torrance", roughness=0.3, ior="gold"), bc.model("oren_nayar")
    subjects = [Subject(NASTY, gold, "cook_torrance:roughness=0.3"), Subject("clay", white, "oren_nayar")]
    folder = tmp_path_factory.mktemp("report") / "tables"
    return report(subjects, tolerance=0.02, tables=folder, command="brdf report ...", **FEW)


@pytest.fixture(scope="module")
def html(made: Report) -> str:
    return made.render("html").decode()


class Page(HTMLParser):
    """Everything a page would load, its text by element, its ids."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.open: list[str] = []
        self.found: dict[str, list[str]] = {}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.loaded += [str(given[k]) for k in ("src", "href", "action", "data") if k in given]
        if tag not in ("meta", "img", "br", "link"):
            self.open.append(f"{tag}.{given['class']}" if "class" in given else tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop().partition(".")[0] == tag

    def handle_data(self, data: str) -> None:
        if self.open and data.strip():
            self.found.setdefault(self.open[-1], []).append(data)


def test_the_page_loads_nothing_and_is_well_formed(html: str) -> None:
    text, page = html, Page(html)
    assert page.open == []
    assert all(x.startswith(("data:image/png;base64,", "#")) for x in page.loaded)
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text)
    assert "default-src 'none'" in text
    assert "<script>alert" not in text
    assert NASTY in page.found["h2"]


def test_the_answer_comes_first(html: str) -> None:
    page = Page(html)
    answers = [*page.found["p.answer"]]
    assert len(answers) == 2
    assert all(
        re.match(r"Use .*: error .*, (no table|[\d.]+ [kM]?B.*), [\d.]+ (ns|µs) a look-up\.", a) for a in answers
    )


def test_the_script_gets_every_entry(made: Report, html: str) -> None:
    page = Page(html)
    for item, text in zip(made.items, [t for t in page.found["script"] if t.startswith("{")]):
        data = json.loads(text)
        assert [e["label"] for e in data["entries"]] == [e.label for e in item.found.entries]
        assert data["entries"][data["chosen"]]["label"] == item.found.chosen.label
        assert {e["representation"] for e in data["entries"]} <= set(data["looks"])


def test_json_has_the_agreed_keys(made: Report) -> None:
    told = json.loads(made.render("json"))
    for material in told["materials"]:
        assert {"material", "tolerance", "machine", "front", "chosen", "table_path"} <= set(material)
        for line in material["front"]:
            assert {"representation", "nbytes", "l1", "ns"} <= set(line)
        assert material["flip"]["mean"] is not None


def test_the_table_written_holds_what_was_promised(made: Report) -> None:
    for item in made.items:
        assert item.table_path is not None
        table = bc.open_table(item.table_path)
        fresh = bc.compare(item.subject.brdf, table, seed=31)
        assert fresh.l1 <= 1.1 * 0.02
        assert item.verified is not None
        assert item.verified["l1"] == pytest.approx(fresh.l1, rel=0.2)
        assert item.verified["error"] == pytest.approx(worst([*fresh.by_theta_i, *fresh.between]), rel=0.2)
        assert table.error["tolerance"] == 0.02


def test_pictures_and_markdown(made: Report) -> None:
    picture = Image.open(io.BytesIO(made.render("png")))
    assert picture.size[0] > 1000
    assert len(picture.convert("RGB").resize((200, 200)).getcolors(40_000) or []) > 50
    text = made.render("md").decode()
    assert "\\<script\\>" in text
    for item in made.items:
        for e in item.found.entries:
            assert e.variant.replace("_", "\\_") in text
    with pytest.raises(bc.InputError):
        made.render("pdf")  # type: ignore[arg-type]


def test_flip_of_equal_and_of_different_pictures() -> None:
    """0 for equal ones; 1 is the largest difference, black and white in large fields nearly so."""
    black, white = np.zeros((64, 64, 3)), np.ones((64, 64, 3))
    assert flip(black, black).max() == 0
    assert 0.9 < flip(black, white).mean() <= 1
    a = appearance(Constant(0.2), Constant(0.2), pixels=64)
    b = appearance(Constant(0.2), Constant(0.25), pixels=64)
    c = appearance(Constant(0.2), Constant(0.1), pixels=64)
    assert a.mean == 0.0
    assert b.mean is not None
    assert c.mean is not None
    assert 0 < b.mean < c.mean < 1


def test_error_map_of_a_scaled_lambertian() -> None:
    """f' = .9 f: |f' - f|/(f + albedo/pi) = .1/2 wherever both directions are above the horizon."""
    white = bc.model("lambert", reflectance=0.6)
    found = error_map(white, 0.9 * white)
    there = ~np.isnan(found.error)
    assert found.error[there] == pytest.approx(0.05, rel=1e-9)
    # theta_h + theta_d < 90 degrees is above the horizon for every phi_d, theta_h near 90 degrees for none
    assert there[:40, :20].all()
    assert not there[-1, :-1].any() or there[-1, 0]


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.0, "0"), (1e-9, "below 0.0001 %"), (0.00891, "0.89 %"), (0.12345, "12 %"), (34.1, "3400 %"), (0.01, "1.0 %"),
     (float("nan"), "not finite"), (0.0999, "10.0 %"), (2.5e-5, "0.0025 %")],
)  # fmt: skip
def test_percent(share: float, text: str) -> None:
    assert words.percent(share) == text


@pytest.mark.parametrize(
    ("ns", "text"), [(2.21, "2.2 ns"), (0.0, "0 ns"), (97_161.0, "97 µs"), (263.4, "260 ns"), (9_700.0, "9700 ns")]
)
def test_nanoseconds(ns: float, text: str) -> None:
    assert words.nanoseconds(ns) == text


@pytest.mark.parametrize(
    ("label", "name"), [("a/b:c=1,[2]", "a-b-c-1-2"), ("../..", "material"), ("gold.h5", "gold.h5")]
)
def test_file_names(label: str, name: str) -> None:
    assert file_name(label) == name


def test_command_line(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(REPRESENTATIONS, "names", lambda: FEW["representations"])
    out = tmp_path / "white.json"
    code, text, err = run("report", "lambert:reflectance=0.5", "-o", out, "--no-peers", "--seconds", "1")
    assert (code, err) == (0, "")
    told = json.loads(out.read_text())["materials"][0]
    assert text.startswith(f"{told['material']}: Use the formula itself")
    assert told["chosen"]["representation"] == "lambert"
    if told["table_path"] is not None:
        assert bc.open_table(told["table_path"]).error["l1"] < 1e-3


@pytest.mark.parametrize(
    ("words_given", "code"),
    [
        (["lambert", "-o", "x.pdf"], "bad_extension"),
        (["lambert", "-o", "nowhere/x.html"], "cannot_write"),
        (["lamber", "-o", "x.html"], "unknown_model"),
        (["lambert", "-o", "x.html", "--tolerance", "0"], "bad_option"),
        (["lambert", "-o", "x.html", "--max-bytes", "many"], "bad_bytes"),
        (["no.h5", "-o", "x.html"], "cannot_open"),
    ],
)
def test_what_can_not_be_reported(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words_given: list[str], code: str
) -> None:
    monkeypatch.chdir(tmp_path)
    status, _, err = run("report", *words_given, "--json")
    assert status in (1, 2)
    assert json.loads(err)["error"]["code"] == code
    assert list(tmp_path.iterdir()) == []
