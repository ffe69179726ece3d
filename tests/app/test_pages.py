"""The pages: every picture and link on them works, they load nothing from elsewhere, and need no script."""

from __future__ import annotations

import math
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from brdf_service.main import create_app
from brdf_service.settings import Settings
from starlette.testclient import TestClient

from tests.app.conftest import Serve, assert_problem


class Page(HTMLParser):
    """Addresses, ids and text of a page; complains about elements that are not closed."""

    VOID = frozenset({"meta", "link", "img", "input", "br"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.images: list[str] = []
        self.links: list[str] = []
        self.assets: list[str] = []
        self.inline: list[str] = []
        self.open: list[str] = []
        self.text: list[str] = []
        self.feed(text)
        assert not self.open, f"not closed: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {k: v or "" for k, v in attrs}
        if tag not in self.VOID:
            self.open.append(tag)
        if tag == "img":
            self.images.append(values["src"])
            assert values["alt"]
        if tag == "a":
            self.links.append(values["href"])
        if tag in ("script", "link"):
            self.assets.append(values.get("src") or values.get("href", ""))
        self.inline += [k for k in values if k.startswith("on") or k == "style"]

    def handle_endtag(self, tag: str) -> None:
        assert self.open, tag
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            self.inline.append(data)
        self.text.append(data)

    @property
    def said(self) -> str:
        return re.sub(r"\s+", " ", "".join(self.text))


def page_of(client: TestClient, path: str) -> Page:
    answer = client.get(path)
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    page = Page(answer.text)
    assert page.inline == []  # the policy would block it
    return page


@pytest.mark.parametrize("path", ["/", "/materials/red", "/materials/gold", "/materials/mirror", "/docs"])
def test_every_address_on_a_page_answers(shared_client: TestClient, path: str) -> None:
    page = page_of(shared_client, path)
    for address in {*page.images, *page.links, *page.assets}:
        assert address.startswith("/"), "nothing is loaded from elsewhere"
        assert shared_client.get(address).status_code == 200, address


def test_start_page_shows_every_material(shared_client: TestClient) -> None:
    page = page_of(shared_client, "/")
    assert len(page.images) == 4
    for name in ("gold", "gold-grid", "mirror", "red"):
        assert any(src.startswith(f"/v1/materials/{name}/slice.svg?") for src in page.images)
        assert f"/materials/{name}" in page.links
        assert f"curl -o {name}.png" in page.said
    assert "4 materials" in page.said
    assert "none: evaluated exactly" in page.said
    assert re.search(r"L1 0\.\d+", page.said)


def test_start_page_warns_of_a_bad_table(shared_client: TestClient) -> None:
    warnings = [m["error"].get("warnings", []) for m in shared_client.get("/v1/materials").json()["materials"]]
    said = page_of(shared_client, "/").said
    assert sum(map(bool, warnings)) > 0
    assert said.count("⚠ warning") == sum(map(bool, warnings))
    for sentence in (w for listed in warnings for w in listed):
        assert re.sub(r"\s+", " ", sentence) in said


def test_start_page_with_damage_and_odd_names(data: Path, client: TestClient) -> None:
    (data / "torn.h5").write_bytes(b"\x89HDF")
    (data / "my gold.json").write_text("{}")
    page = page_of(client, "/")
    assert "⚠ cannot be used" in page.said
    assert "my gold.json" in page.said
    assert not any("torn" in src for src in page.images)


def test_start_page_of_an_empty_folder(tmp_path: Path, serve: Serve) -> None:
    (tmp_path / "empty").mkdir()
    page = page_of(serve(data=tmp_path / "empty"), "/")
    assert page.images == []
    assert "is empty" in page.said
    assert "0 materials" in page.said


def test_start_page_in_pages(data: Path, client: TestClient) -> None:
    for k in range(30):
        (data / f"white{k:02}.json").write_text('{"model": "lambert"}')
    first = page_of(client, "/")
    assert len(first.images) == 24
    assert "/?offset=24" in first.links
    second = page_of(client, "/?offset=24")
    assert len(second.images) == 10
    assert "/?offset=0" in second.links


SPHERE = "/v1/materials/red/sphere.png"


def test_material_page_shows_what_is_asked(shared_client: TestClient) -> None:
    page = page_of(shared_client, "/materials/red?theta_i=45&view=hemisphere&scale=linear&channel=B")
    assert page.images == ["/v1/materials/red/slice.svg?theta_i=45&view=hemisphere&scale=linear&channel=B", SPHERE]
    default = page_of(shared_client, "/materials/red?channel=")
    assert default.images == ["/v1/materials/red/slice.svg?theta_i=0,30,60&view=polar&scale=log", SPHERE]


def test_a_proxy_tells_how_it_is_reached(original: Path) -> None:
    """One on this machine is believed, anybody else is not."""
    for host, expected in (("127.0.0.1", "https://brdf.example/v1"), ("192.0.2.1", "http://brdf.example/v1")):
        app = create_app(Settings(data=original, host="0.0.0.0"), warm=False)
        with TestClient(app, "http://brdf.example", client=(host, 50_000)) as client:
            text = client.get("/materials/gold", headers={"x-forwarded-proto": "https"}).text
        assert f"{expected}/materials/gold/evaluate" in text


def test_error_by_angle_of_incidence(shared_client: TestClient) -> None:
    """The page has a row for each angle that the metadata tells of, in order and in degrees; a model has none."""
    error = shared_client.get("/v1/materials/red").json()["error"]
    assert error["between"]
    rows = sorted(error["by_theta_i"] + error["between"], key=lambda row: float(row["theta_i"]))
    text = shared_client.get("/materials/red").text
    shown = re.findall(r"<tr><td>([\d.]+)°</td><td>([^<]+) ± ([^<]+) %</td><td>([^<]+) %</td></tr>", text)
    assert len(shown) == len(rows)
    for (theta, l1, stderr, albedo), row in zip(shown, rows, strict=True):
        for got, expected, rel in (
            (theta, math.degrees(row["theta_i"]), 0.01),
            (l1, 100 * row["l1"], 0.06),
            (stderr, 100 * row["l1_stderr"], 0.6),
            (albedo, 100 * row["albedo_error"], 0.06),
        ):
            assert float(got) == pytest.approx(expected, rel=rel)
    assert "by angle of incidence" not in shared_client.get("/materials/gold").text


def test_material_page_refusals(shared_client: TestClient) -> None:
    assert_problem(shared_client.get("/materials/golld"), 404, "unknown_material")
    assert_problem(shared_client.get("/materials/gold?view=sphere"), 422, "bad_choice")
    assert_problem(shared_client.get("/materials/gold?theta=3"), 422, "unknown_parameter")


def test_docs_list_every_operation(shared_client: TestClient) -> None:
    said = page_of(shared_client, "/docs").said
    for path, methods in shared_client.get("/openapi.json").json()["paths"].items():
        for method in methods:
            assert f"{method.upper()} {path}" in said
