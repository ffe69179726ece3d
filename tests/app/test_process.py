"""Settings, and the real process: its line, its answers on the wire, and its end."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from brdf_service.main import serve
from brdf_service.server.process import ListenError, address_of, bind
from brdf_service.server.start import fill
from brdf_service.settings import Settings, setting_lines

import brdfcore as bc
from tests.app.conftest import expected_values, local
from tests.app.running import Running
from tests.app.running import running as running_service


def test_settings_from_flags_environment_and_defaults() -> None:
    environment = {
        "BRDF_PORT": "9000",
        "BRDF_DATA_DIR": "/somewhere",
        "BRDF_ALLOWED_HOSTS": "a.b, C.d",
        "BRDF_HOST": "",
    }
    made = Settings.load(environment, port=9001, log_level=None)
    assert (made.port, made.data, made.host) == (9001, Path("/somewhere"), "127.0.0.1")
    assert made.allowed_hosts == ("a.b", "c.d")
    assert Settings.load({"BRDF_STARTER": "0"}).starter is False
    assert Settings.load({}).cache_bytes == 512 * 2**20


@pytest.mark.parametrize(
    ("environment", "flags", "where"),
    [
        ({"BRDF_PORT": "eighty"}, {}, "BRDF_PORT"),
        ({}, {"port": 70000}, "--port"),
        ({"BRDF_LOG_LEVEL": "loud"}, {}, "BRDF_LOG_LEVEL"),
        ({}, {"max_points": 0}, "--max-points"),
        ({}, {"prot": 3}, "--prot"),
    ],
)
def test_bad_settings_name_themselves(environment: dict[str, str], flags: dict[str, int], where: str) -> None:
    with pytest.raises(bc.InputError) as caught:
        Settings.load(environment, **flags)
    assert caught.value.context["where"] == where
    assert where in str(caught.value)


def test_every_setting_is_described() -> None:
    environment = {**os.environ, "COLUMNS": "200", "NO_COLOR": "1"}
    command = [sys.executable, "-m", "brdfcore.cli", "serve", "--help"]
    text = subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout
    for name in Settings.model_fields:
        assert f"--{name.replace('_', '-')}" in text or f"--no-{name}" in text or f"BRDF_{name.upper()}" in text, name
    assert all(description for _, _, description in setting_lines())
    assert ("BRDF_DATA_DIR", "brdf-data") in [(v, d) for v, d, _ in setting_lines()]


@pytest.mark.parametrize(
    ("host", "loopback"),
    [("127.0.0.1", True), ("localhost", True), ("::1", True), ("127.9.9.9", True), ("0.0.0.0", False), ("::", False)],
)
def test_loopback(host: str, loopback: bool) -> None:
    assert Settings(host=host).loopback is loopback


def test_port_in_use_is_one_clear_error(data: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ListenError, match=f"127.0.0.1:{port}: the port is in use"):
            serve(port=port, data=data)


def test_hosts_that_cannot_be_listened_on() -> None:
    with pytest.raises(ListenError, match="no address of this machine"):
        bind(Settings(host="203.0.113.7", port=0))
    with pytest.raises(ListenError, match="no such host"):
        bind(Settings(host="no such host", port=0))


def test_data_folder_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(bc.StorageError, match="data folder"):
        serve(port=0, data=tmp_path / "file")


def test_port_0_takes_a_free_port() -> None:
    with bind(Settings(port=0)) as listener:
        assert re.fullmatch(r"http://127\.0\.0\.1:[1-9]\d+", address_of(listener))
        assert listener.proto == socket.IPPROTO_TCP  # or each answer waits 40 ms for Nagle


@pytest.fixture
def running(data: Path) -> Iterator[Running]:
    with running_service(data) as made:
        yield made


def test_process_answers_and_ends_on_sigterm(running: Running, data: Path) -> None:
    answer = running.ask("/v1/materials/gold-grid/evaluate?theta_i=30&theta_o=0,30&delta_phi=180")
    assert answer.status == 200
    assert json.loads(answer.body)["values"] == expected_values(local(data, "gold-grid"), 30, [0, 30], 180)
    for path in ("/v1/materials/../gold", "/v1/materials/%2e%2e", "/v1/materials/%2e%2e%2fgold", "//", "/\\"):
        refused = running.ask(path)
        assert refused.status == 404
        assert refused.headers["content-type"] == "application/problem+json"
    head = running.ask("/v1/materials/gold", "HEAD")
    assert (head.status, head.body) == (200, b"")
    assert int(head.headers["content-length"]) > 0
    code, errors = running.stop()
    assert code == 0
    assert "Traceback" not in errors


def test_endless_body_is_refused_while_it_arrives(data: Path) -> None:
    made = Running(data, "--max-body-bytes", "100000")
    try:
        with socket.create_connection(("127.0.0.1", made.port), timeout=20) as connection:
            connection.sendall(
                b"POST /v1/materials/gold/evaluate HTTP/1.1\r\nHost: localhost\r\n"
                b"Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n"
            )
            piece = b"4000\r\n" + b" " * 0x4000 + b"\r\n"
            try:
                for _ in range(1000):  # sixteen megabytes, if it were let
                    connection.sendall(piece)
            except OSError:
                pass  # the service has hung up
        assert made.ask("/health/live").status == 200
    finally:
        code, _ = made.stop()
    assert code == 0


def test_empty_folder_is_filled(tmp_path: Path) -> None:
    made = Running(tmp_path / "new")
    try:
        assert json.loads(made.ask("/v1/materials").body)["total"] > 0
    finally:
        code, errors = made.stop()
    assert code == 0
    assert "Traceback" not in errors
    assert "starter library" in errors


def test_an_interrupted_start_is_finished_by_the_next(tmp_path: Path) -> None:
    """The starter library is built again where a start was killed, and not where its owner removed a part."""
    settings = Settings.load(data=tmp_path)
    (tmp_path / ".gitkeep").touch()
    (tmp_path / ".starter-unfinished").touch()
    (tmp_path / "white-lambert.json").write_text('{"model": "lambert", "parameters": {"reflectance": 0.8}}')
    fill(settings)
    names = {p.name for p in tmp_path.iterdir()}
    assert {"gold-satin.h5", "silver-mirror.json", "white-lambert.json"} <= names
    assert ".starter-unfinished" not in names
    (tmp_path / "gold-satin.h5").unlink()
    fill(settings)
    assert not (tmp_path / "gold-satin.h5").exists()
