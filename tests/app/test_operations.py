"""What an operator sees: one line a request, counters, timings, an end in time, memory that stays."""

from __future__ import annotations

import json
import re
import signal
import socket
import threading
import time
from pathlib import Path

from starlette.testclient import TestClient

from tests.app.conftest import Serve
from tests.app.running import running
from tests.app.test_writing import VALUE

LINE = re.compile(r"^(\w+)(?:\{(.*)\})? (\S+)$")


def metrics(client: TestClient) -> dict[str, float]:
    answer = client.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    found = {}
    for line in answer.text.splitlines():
        if not line.startswith("#"):
            match = LINE.match(line)
            assert match, line
            found[line.rpartition(" ")[0]] = float(match[3])
    return found


def test_metrics(client: TestClient) -> None:
    client.get(f"/v1/materials/gold-grid/{VALUE}")
    client.get(f"/v1/materials/gold-grid/{VALUE}")
    client.post("/v1/materials/red/evaluate", json={"theta_i": [1, 2, 3], "theta_o": 1, "delta_phi": 1})
    client.get("/v1/materials/secret-name/evaluate")
    client.get('/no/such/"path"%0A')
    client.request("BREW", "/v1/materials")
    client.get("/v1/materials/gold/slice.json?theta_i=30")
    text = client.get("/metrics").text
    found = metrics(client)
    route = "/v1/materials/{name}/evaluate"
    assert found[f'brdf_requests_total{{method="GET",route="{route}",status="200"}}'] == 2
    assert found[f'brdf_requests_total{{method="POST",route="{route}",status="200"}}'] == 1
    assert found[f'brdf_requests_total{{method="GET",route="{route}",status="422"}}'] == 1
    assert found['brdf_requests_total{method="GET",route="none",status="404"}'] == 1
    assert found['brdf_requests_total{method="GET",route="/v1/materials/{name}/slice.json",status="200"}'] == 1
    assert found[f'brdf_request_seconds_count{{route="{route}"}}'] == 4
    assert found[f'brdf_request_seconds_bucket{{le="+Inf",route="{route}"}}'] == 4
    assert found["brdf_lookups_total"] == 5
    assert found["brdf_lookup_seconds_total"] > 0
    assert found["brdf_table_bytes"] > 0
    assert found["brdf_cache_hits_total"] >= 1
    assert found["brdf_cache_misses_total"] == 3
    assert found["process_resident_memory_bytes"] > 1e6
    assert "secret-name" not in text
    assert "BREW" not in text
    kinds = re.findall(r"# TYPE (\w+) (\w+)", text)
    assert len({name for name, _ in kinds}) == len(kinds)


def test_server_timing(shared_client: TestClient) -> None:
    timing = shared_client.get(f"/v1/materials/gold-grid/{VALUE}").headers["server-timing"]
    assert re.fullmatch(r"lookup;dur=\d+\.\d{3}, app;dur=\d+\.\d{3}", timing)
    assert re.fullmatch(r"app;dur=\d+\.\d{3}", shared_client.get("/health/live").headers["server-timing"])


def test_one_line_of_json_for_each_request_and_an_end_in_time(data: Path) -> None:
    with running(data) as made:
        made.ask(f"/v1/materials/gold-grid/{VALUE}", X_Request_Id="mine-1")
        made.ask("/v1/materials/<svg onload=alert(1)>".replace(" ", "%20"), X_Request_Id="mine-2")
        made.ask("/v1/materials/gold", "HEAD", X_Request_Id="mine-3")
        code, errors = made.stop()
    assert code == 0
    lines = [json.loads(line) for line in errors.splitlines() if line.startswith("{")]
    by_id = {line["id"]: line for line in lines}
    assert set(by_id) == {"mine-1", "mine-2", "mine-3"}
    first = by_id["mine-1"]
    assert set(first) == {"time", "id", "method", "route", "status", "ms", "bytes"}
    assert (first["method"], first["route"], first["status"]) == ("GET", "/v1/materials/{name}/evaluate", 200)
    assert first["bytes"] > 50
    assert first["ms"] > 0
    assert by_id["mine-2"]["status"] == 404
    assert by_id["mine-3"]["method"] == "HEAD"
    assert "svg" not in errors


def test_log_level_switches_the_lines_off(data: Path) -> None:
    with running(data, "--log-level", "warning") as made:
        made.ask("/health/live")
        _, errors = made.stop()
    assert "/health/live" not in errors


def test_requests_under_way_are_finished_after_sigterm(data: Path) -> None:
    body = json.dumps({"theta_i": 30, "theta_o": 30, "delta_phi": 180}).encode()
    with running(data) as made, socket.create_connection(("127.0.0.1", made.port), timeout=20) as connection:
        head = b"POST /v1/materials/gold/evaluate HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        connection.sendall(head + b"Content-Length: %d\r\n\r\n" % len(body) + body[:10])
        time.sleep(0.2)
        made.process.send_signal(signal.SIGTERM)
        time.sleep(0.2)
        connection.sendall(body[10:])
        answer = connection.recv(65_536)
        assert answer.startswith(b"HTTP/1.1 200")
        made.process.wait(timeout=10)
        assert made.end()[0] == 0


def test_sigterm_ends_events_and_jobs_within_the_time_to_drain(data: Path) -> None:
    slow = {"model": "cook_torrance", "parameters": {}, "tabulate": {"shape": [150, 150, 300]}}
    with running(data) as made:
        job = json.loads(made.ask("/v1/materials/slow", "PUT", json.dumps(slow), Content_Type="application/json").body)
        told: list[bytes] = []
        listener = threading.Thread(target=lambda: told.append(made.ask(job["links"]["events"]).body))
        listener.start()
        time.sleep(1.0)
        begun = time.monotonic()
        code, errors = made.stop()
        assert time.monotonic() - begun < 10
        listener.join(5)
    assert code == 0
    assert "Traceback" not in errors
    assert b"event: running" in told[0]
    assert not [p for p in data.iterdir() if p.name.startswith(".job-")]


def test_albedo(shared_client: TestClient, serve: Serve, original: Path) -> None:
    import numpy as np
    from brdf_service.schemas.analysis import AlbedoAnswer

    from tests.app.conftest import assert_problem, local

    answer = shared_client.get("/v1/materials/red/albedo?theta_i=0,30,60")
    content = AlbedoAnswer.model_validate_json(answer.content)
    assert content.values == local(original, "red").albedo(np.radians([0.0, 30.0, 60.0])).tolist()
    mirror = shared_client.get("/v1/materials/mirror/albedo?theta_i=0.5&angles=rad").json()
    assert mirror["values"] == local(original, "mirror").albedo([0.5]).tolist()
    assert mirror["has_delta"] is True
    assert answer.headers["content-location"].endswith("/albedo?theta_i=0,30,60")
    content = assert_problem(shared_client.get("/v1/materials/red/albedo?theta_i=0,95"), 422, "angle_outside")
    assert content["errors"][0]["got"] == 95.0
    assert_problem(serve(max_theta_i=2).get("/v1/materials/red/albedo?theta_i=1,2,3"), 413, "too_many_slices")
