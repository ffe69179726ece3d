"""The compose file of docs/deployment.md: all it names exists, and two services on one folder do what it promises."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from brdf_service.settings import Settings, variable_of

from tests.app.running import Running, running
from tests.app.test_dockerfile import of

ROOT = Path(__file__).parents[2]
KEY = "a key of eight or more"


def compose() -> dict[str, Any]:
    text = (ROOT / "docs" / "deployment.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    made: dict[str, Any] = yaml.safe_load(block)
    return made


def replicas() -> dict[str, Any]:
    return {name: s for name, s in compose()["services"].items() if "build" in s}


def environment(service: dict[str, Any]) -> dict[str, str]:
    """As compose would set it."""
    return {k: KEY if v == "${BRDF_API_KEY:?}" else v for k, v in service["environment"].items()}


def test_replicas_are_the_image_with_known_settings() -> None:
    content, services = compose(), replicas()
    assert list(services) == ["one", "two"]
    known = {variable_of(name) for name in Settings.model_fields}
    for name, service in services.items():
        assert (ROOT / service["build"] / "Dockerfile").is_file()
        assert service["hostname"] == name
        assert set(service["environment"]) <= known
        assert all(isinstance(v, str) for v in service["environment"].values())
        settings = Settings.load(environment(service), host="0.0.0.0")
        assert settings.writable
        assert settings.starter is (name == "one")  # two that fill one folder would do the work twice
        volume, _, place = service["volumes"][0].partition(":")
        assert volume in content["volumes"]
        assert [place] == of("VOLUME")
    assert services["two"]["depends_on"] == {"one": {"condition": "service_healthy"}}
    assert of("HEALTHCHECK")


def test_proxy_reaches_both_and_lets_uploads_through() -> None:
    content = compose()
    proxy = content["services"]["proxy"]
    (mounted,) = proxy["configs"]
    text = content["configs"][mounted["source"]]["content"]
    (port,) = of("EXPOSE")
    assert re.findall(r"server (\w+):(\d+);", text) == [(name, port) for name in replicas()]
    assert json.loads(of("CMD")[0])[-2:] == ["--port", port]
    assert "ip_hash;" in text
    (upstream,) = re.findall(r"upstream (\w+) ", text)
    assert f"proxy_pass http://{upstream};" in text
    (listens,) = re.findall(r"listen (\d+);", text)
    assert proxy["ports"] == [f"127.0.0.1:8080:{listens}"]  # this machine only: who publishes it adds TLS
    (most,) = re.findall(r"client_max_body_size (\d+)m;", text)
    assert int(most) * 2**20 >= Settings().max_upload_bytes
    assert "$$http_host" in text  # a single $ is a variable to compose
    assert not re.search(r"(?<!\$)\$(?!\$)", text)
    assert text.count("{") == text.count("}")


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Running, Running]]:
    """The two services of the file on one folder, bound as the image binds them."""
    data = tmp_path_factory.mktemp("shared")
    one, two = ({**environment(s), "BRDF_STARTER": "0"} for s in replicas().values())
    host = json.loads(of("CMD")[0])[2:4]
    with running(data, *host, **one) as first, running(data, *host, **two) as second:
        yield first, second


def say(service: Running, method: str, path: str, body: Any = None, **headers: str) -> Any:
    content = None if body is None else json.dumps(body)
    named = {"X_API_Key": KEY, "Content_Type": "application/json", **headers}
    return service.ask(path, method, content, **named)


VALUE = "/v1/materials/{}/evaluate?theta_i=30&theta_o=40&delta_phi=170"


def test_what_one_writes_the_other_serves(both: tuple[Running, Running]) -> None:
    model = {"model": "lambert", "parameters": {"reflectance": 0.5}}
    for k, (writer, reader) in enumerate((both, both[::-1])):
        name = f"grey-{k}"
        assert reader.ask(VALUE.format(name)).status == 404
        assert say(writer, "PUT", f"/v1/materials/{name}", model).status == 201
        answers = [s.ask(VALUE.format(name)) for s in both]
        assert [a.status for a in answers] == [200, 200]
        assert answers[0].body == answers[1].body
        # one replaces what the other has loaded
        brighter = {"model": "lambert", "parameters": {"reflectance": 1.0}}
        etag = reader.ask(f"/v1/materials/{name}").headers["etag"]
        assert say(writer, "PUT", f"/v1/materials/{name}", brighter, If_Match=etag).status in (200, 201)
        values = [json.loads(s.ask(VALUE.format(name)).body)["values"] for s in both]
        assert values[0] == values[1] != json.loads(answers[0].body)["values"]
        assert say(reader, "DELETE", f"/v1/materials/{name}", If_Match="*").status == 204
        assert [s.ask(VALUE.format(name)).status for s in both] == [404, 404]


def test_a_job_belongs_to_one_of_them(both: tuple[Running, Running]) -> None:
    one, two = both
    body = {"model": "lambert", "tabulate": {"representation": "angle_grid", "shape": [4, 4, 5]}}
    accepted = say(one, "PUT", "/v1/materials/table", body)
    assert accepted.status == 202
    job = accepted.headers["location"]
    told = two.ask(job)  # by its record
    assert (told.status, json.loads(told.body)["material"]) == (200, "table")
    assert job.rpartition("/")[2] in [j["id"] for j in json.loads(two.ask("/v1/jobs").body)["jobs"]]
    lost = two.ask(f"{job}/events")
    assert (lost.status, json.loads(lost.body)["code"]) == (404, "job_lost")
    assert "another replica" in json.loads(lost.body)["detail"]
    assert say(two, "DELETE", job).status == 404
    until = time.monotonic() + 60
    while json.loads(one.ask(job).body)["state"] not in ("done", "failed") and time.monotonic() < until:
        time.sleep(0.1)
    assert json.loads(one.ask(job).body)["state"] == "done"
    found = two.ask("/v1/materials/table")  # as the answer says: the material tells
    assert json.loads(found.body)["kind"] == "table"
    assert [s.ask(VALUE.format("table")).status for s in both] == [200, 200]
