"""Who may write, and what hostile files and callers get: a refusal, while the service goes on."""

from __future__ import annotations

import json
import os
import socket
import struct
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from brdf_service.settings import Settings
from starlette.testclient import TestClient

from brdfcore.formats.rgl.tensor_file import encode
from tests.app.conftest import Serve, assert_problem
from tests.app.running import Running, running
from tests.app.test_writing import OCTET, PAINT, VALUE, WHITE, ended, leftovers
from tests.support.rgl_synthetic import fields_of

KEY = "a long secret key"


def test_elsewhere_is_read_only_without_a_key(serve: Serve, data: Path) -> None:
    client = serve(host="0.0.0.0")
    before = sorted(p.name for p in data.iterdir())
    for answer in (
        client.put("/v1/materials/white", json=WHITE),
        client.put("/v1/materials/white", content=b"not even JSON", headers={"x-api-key": KEY}),
        client.post("/v1/materials/white/upload", content=PAINT),
        client.delete("/v1/materials/gold", headers={"if-match": "*"}),
        client.delete("/v1/jobs/" + "0" * 32),
    ):
        assert_problem(answer, 403, "read_only")
    assert client.get(f"/v1/materials/gold/{VALUE}").status_code == 200
    body = {"theta_i": 1, "theta_o": 2, "delta_phi": 3}
    assert client.post("/v1/materials/gold/evaluate", json=body).status_code == 200
    assert sorted(p.name for p in data.iterdir()) == before


@pytest.mark.parametrize("host", ["0.0.0.0", "127.0.0.1"])
def test_writing_takes_the_key(serve: Serve, host: str) -> None:
    client = serve(host=host, api_key=KEY)
    missing = client.put("/v1/materials/white", json=WHITE)
    assert_problem(missing, 401, "key_missing")
    assert missing.headers["www-authenticate"].startswith("Bearer")
    for wrong in (
        {"x-api-key": KEY + "x"},
        {"x-api-key": ""},
        {"x-api-key": "\xe9"},
        {"authorization": "Bearer no"},
        {"authorization": f"Basic {KEY}"},
        {"authorization": "Bearer no", "x-api-key": KEY},
    ):
        encoded = {k: v.encode("latin-1") for k, v in wrong.items()}
        answer = client.put("/v1/materials/white", json=WHITE, headers=encoded)
        assert_problem(answer, 401, "key_wrong")
        assert KEY not in answer.text
    assert client.put("/v1/materials/white", json=WHITE, headers={"x-api-key": KEY}).status_code == 201
    bearer = {"authorization": f"bearer {KEY}", "if-match": "*"}
    assert client.delete("/v1/materials/white", headers=bearer).status_code == 204
    assert client.get(f"/v1/materials/gold/{VALUE}").status_code == 200
    document = client.get("/openapi.json").json()
    assert document["paths"]["/v1/materials/{name}"]["put"]["security"]
    assert "security" not in document["paths"]["/v1/materials/{name}"]["get"]


def test_the_key_is_told_to_nobody() -> None:
    settings = Settings.load({"BRDF_API_KEY": KEY})
    assert KEY not in repr(settings)
    with pytest.raises(ValueError, match="BRDF_API_KEY") as caught:
        Settings.load({"BRDF_API_KEY": "short"})
    assert "short'" not in str(caught.value)
    assert Settings.load({"BRDF_API_KEY": ""}).api_key is None


@pytest.mark.parametrize(
    ("origin", "good"),
    [
        ("http://127.0.0.1:8000", True),
        ("https://evil.example", False),
        ("http://127.0.0.1:8001", False),
        ("https://127.0.0.1:8000", True),  # a proxy in front may speak TLS
        ("http://127.0.0.1", False),
        ("http://localhost:8000", False),
        ("null", False),
        ("http://127.0.0.1:8000.evil.example", False),
        ("http://[", False),
        ("", False),
    ],
)
def test_pages_from_elsewhere_may_not_write(client: TestClient, origin: str, good: bool) -> None:
    answer = client.put("/v1/materials/white", json=WHITE, headers={"origin": origin})
    if good:
        assert answer.status_code == 201
    else:
        assert_problem(answer, 403, "foreign_origin")
    assert client.get(f"/v1/materials/gold/{VALUE}", headers={"origin": origin}).status_code == 200


# ---- hostile files ---------------------------------------------------------------------------------------------


def _zip_bomb(folder: Path) -> bytes:
    """An HDF5 file of some kilobytes that unpacks to a gigabyte."""
    with h5py.File(folder / "bomb.h5", "w") as file:
        file.create_dataset("header", data=np.zeros(10, np.uint8))
        file.create_dataset("arrays/values", (2**30,), "u1", chunks=(2**24,), compression="gzip", fillvalue=0)
    return (folder / "bomb.h5").read_bytes()


def _huge(shape: tuple[int, ...]) -> bytes:
    """A measurement whose first field says that it has `shape`."""
    data = bytearray(encode(fields_of()))
    (length,) = struct.unpack_from("<H", data, 18)
    (count,) = struct.unpack_from("<H", data, 20 + length)
    for k in range(count):
        struct.pack_into("<Q", data, 20 + length + 11 + 8 * k, shape[k % len(shape)])
    return bytes(data)


XML = b"""<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">
<!ENTITY c SYSTEM "file:///etc/passwd">]><WindowElement>&b;&c;</WindowElement>"""


def test_hdf5_is_refused_by_default(client: TestClient, tmp_path: Path, data: Path) -> None:
    bomb = _zip_bomb(tmp_path)
    shifted = bytes(1024) + bomb
    for body, query in ((bomb, ""), (bomb, "?format=rgl"), (shifted, ""), ((data / "red.h5").read_bytes(), "")):
        answer = client.post(f"/v1/materials/bomb/upload{query}", content=body, headers=OCTET)
        assert_problem(answer, 415, "hdf5_refused")
    answer = client.post("/v1/materials/bomb/upload?format=table", content=b"something", headers=OCTET)
    assert_problem(answer, 415, "hdf5_refused")
    assert leftovers(data) == []


def test_hdf5_if_it_is_allowed(serve: Serve, data: Path, tmp_path: Path) -> None:
    client = serve(allow_hdf5=True, job_memory_bytes=2**30, job_seconds=20)
    body = (data / "red.h5").read_bytes()
    answer = client.post("/v1/materials/red2/upload", content=body, headers=OCTET)
    assert ended(client, answer)["state"] == "done"
    assert client.get("/v1/materials/red2").json()["id"] == client.get("/v1/materials/red").json()["id"]
    answer = client.post("/v1/materials/bomb/upload", content=_zip_bomb(tmp_path), headers=OCTET)
    assert ended(client, answer)["problem"]["code"] == "damaged_table"
    assert client.get(f"/v1/materials/gold-grid/{VALUE}").status_code == 200


def test_hostile_measurements(client: TestClient, data: Path) -> None:
    wrong = {
        "noise": (os.urandom(10_000), 422, "unknown_format"),
        "empty": (b"", 422, "empty_file"),
        "xml": (XML, None, None),
        "svg": (b"<svg xmlns='http://www.w3.org/2000/svg' onload='alert(1)'/>", None, None),
        "huge": (_huge((2**31, 2**31)), None, None),
        "huger": (_huge((2**63, 2**63)), None, None),
        "cut": (PAINT[: len(PAINT) // 2], None, None),
        "deep": (b'{"model": ' + b"[" * 50_000, None, None),
        "odd": (b'{"model": "lambert", "parameters": {"reflectance": "<script>"}}', None, None),
    }
    for name, (body, status, code) in wrong.items():
        answer = client.post(f"/v1/materials/{name}/upload", content=body, headers=OCTET)
        if answer.status_code == 202:
            assert code is None, name
            job = ended(client, answer)
            assert job["state"] == "failed", name
            assert job["problem"]["code"] not in ("internal_error", "job_crashed"), (name, job)
            assert str(data) not in json.dumps(job)
        else:
            assert_problem(answer, status or 422, code or answer.json()["code"])
            assert str(data) not in answer.text
    assert client.get(f"/v1/materials/gold-grid/{VALUE}").status_code == 200
    assert client.get("/v1/materials").json()["total"] == 4
    assert leftovers(data) == []


def test_a_job_that_needs_too_much(serve: Serve, data: Path) -> None:
    client = serve(job_memory_bytes=2**30, max_table_bytes=2**33, job_seconds=20)
    body = {"model": "lambert", "parameters": {}, "tabulate": {"shape": [900, 900, 900]}}
    job = ended(client, client.put("/v1/materials/large", json=body))
    assert job["state"] == "failed"
    assert job["problem"]["code"] in ("job_memory", "job_crashed", "job_seconds"), job
    assert client.get("/v1/materials/large").status_code == 404


def test_a_job_that_takes_too_long(serve: Serve) -> None:
    client = serve(job_seconds=1)
    body = {"model": "cook_torrance", "parameters": {}, "tabulate": {"shape": [200, 200, 200]}}
    job = ended(client, client.put("/v1/materials/long", json=body))
    assert (job["state"], job["problem"]["code"]) == ("failed", "job_seconds")


def test_uploads_are_counted_while_they_arrive(serve: Serve, data: Path) -> None:
    client = serve(max_upload_bytes=10_000)
    received = 0

    def endless() -> Any:
        nonlocal received
        for _ in range(1000):
            received += 1000
            yield bytes(1000)

    answer = client.post("/v1/materials/new/upload", content=endless(), headers=OCTET)
    assert_problem(answer, 413, "body_too_large")
    assert_problem(client.post("/v1/materials/new/upload", content=bytes(10_001), headers=OCTET), 413, "body_too_large")
    assert leftovers(data) == []
    assert set(client.app.state.brdf.jobs.counts()) == {"failed"}  # type: ignore[attr-defined]


def test_bodies_on_the_wire_slow_endless_and_broken(data: Path) -> None:
    arguments = (
        "--max-upload-bytes",
        "100000",
        "--upload-seconds",
        "1",
        "--body-seconds",
        "1",
        "--max-body-bytes",
        "9999",
    )
    with running(data, *arguments) as made:
        slow = b"POST %b HTTP/1.1\r\nHost: localhost\r\nContent-Type: %b\r\nContent-Length: 5000\r\n\r\n"
        for path, kind in (
            (b"/v1/materials/new/upload", b"application/octet-stream"),
            (b"/v1/materials/gold/evaluate", b"application/octet-stream"),
            (b"/v1/materials/gold/evaluate", b"application/json"),
        ):
            with socket.create_connection(("127.0.0.1", made.port), timeout=20) as connection:
                begun = time.monotonic()
                connection.sendall(slow % (path, kind))
                answer = b""
                connection.settimeout(0.2)
                while b"body_too_slow" not in answer:
                    try:
                        more = connection.recv(65_536)
                    except TimeoutError:
                        connection.sendall(b"x")  # a byte now and then, until there is an answer
                        continue
                    assert more, answer
                    answer += more
                assert answer.startswith(b"HTTP/1.1 408")
                assert 0.8 < time.monotonic() - begun < 10
        for path in ("/v1/materials/new/upload", "/v1/materials/gold/evaluate"):
            with socket.create_connection(("127.0.0.1", made.port), timeout=20) as connection:
                head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/octet-stream\r\n"
                connection.sendall(head.encode() + b"Transfer-Encoding: chunked\r\n\r\n")
                sent = 0
                try:
                    for _ in range(2000):  # thirty-two megabytes, if it were let
                        connection.sendall(b"4000\r\n" + b" " * 0x4000 + b"\r\n")
                        sent += 0x4000
                except OSError:
                    pass  # the service has hung up
                assert sent < 2000 * 0x4000
        with socket.create_connection(("127.0.0.1", made.port), timeout=20) as connection:
            connection.sendall(slow % (b"/v1/materials/new/upload", b"application/octet-stream") + b"only this")
        for path in ("/v1/materials/../x/upload", "/v1/materials/%2e%2e%2fx/upload", "/v1/materials/..%5cx/upload"):
            refused = made.ask(path, "POST", PAINT)
            assert refused.status in (404, 422)
        assert made.ask("/health/live").status == 200
        until = time.monotonic() + 10
        while leftovers(data) and time.monotonic() < until:
            time.sleep(0.05)
        assert leftovers(data) == []
        code, errors = made.stop()
    assert code == 0
    assert "Traceback" not in errors


def all_of(made: Running) -> list[dict[str, Any]]:
    """Every line of the list: many kills leave more than a page of materials."""
    lines, path = [], "/v1/materials?limit=1000"
    while path:
        page = json.loads(made.ask(path).body)
        lines += page["materials"]
        path = page["next"]
    return lines


def test_kill_in_the_middle_of_uploads(data: Path) -> None:
    """Whatever was there stays readable; what was being written is there whole or not at all."""
    wanted = {p.stem for p in data.iterdir()}
    body = {"model": "lambert", "parameters": {"reflectance": 0.5}}
    for k in range(int(os.environ.get("BRDF_KILLS", "3"))):
        with running(data, "--log-level", "error") as made:
            names = {m["name"] for m in all_of(made)}
            assert wanted <= names, wanted - names
            until = time.monotonic() + 0.2 + 0.37 * (k % 5)
            n = 0
            while time.monotonic() < until:
                name = f"k{k}-{n}"
                answer = made.ask(f"/v1/materials/{name}", "PUT", json.dumps(body), Content_Type="application/json")
                assert answer.status == 201
                wanted.add(name)  # answered: from now on it must be there, whatever happens
                replaced = made.ask(
                    "/v1/materials/red", "PUT", json.dumps(body), Content_Type="application/json", If_Match="*"
                )
                assert replaced.status == 200
                if n % 3 == 0:
                    made.ask(f"/v1/materials/u{k}-{n}/upload", "POST", PAINT)
                    made.ask("/v1/materials/red/upload", "POST", PAINT, If_Match="*")
                n += 1
            made.kill()
    with running(data) as made:
        listed = all_of(made)
        assert wanted <= {m["name"] for m in listed}
        assert [m for m in listed if m.get("problem")] == []
        assert [n for n in leftovers(data) if n.startswith(".job-")] == []
        for name in sorted(wanted)[:20]:
            assert made.ask(f"/v1/materials/{name}/{VALUE}").status == 200
