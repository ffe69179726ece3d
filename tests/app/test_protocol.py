"""The server's protocol on the wire: slow, endless and silent heads are cut off, whole answers are sound."""

from __future__ import annotations

import concurrent.futures
import contextlib
import json
import shutil
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.app.running import Running, running

pytest.importorskip("httptools")

PATH = "/v1/materials/gold/evaluate?theta_i=30&theta_o=40&delta_phi=170"


@pytest.fixture(scope="module")
def live(original: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    data = Path(shutil.copytree(original, tmp_path_factory.mktemp("live") / "data"))
    with running(data, "--head-seconds", "1") as made:
        deadline = time.monotonic() + 60
        while made.ask("/health/ready").status != 200:
            assert time.monotonic() < deadline
            time.sleep(0.1)
        yield made


@contextlib.contextmanager
def connected(live: Running) -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", live.port), timeout=10) as connection:
        yield connection


def rest(connection: socket.socket) -> bytes:
    """All until the server closes."""
    received = b""
    with contextlib.suppress(ConnectionError):
        while piece := connection.recv(65536):
            received += piece
    return received


def closed_after(connection: socket.socket) -> tuple[float, bytes]:
    begun = time.monotonic()
    said = rest(connection)
    return time.monotonic() - begun, said


def one_answer(connection: socket.socket) -> tuple[bytes, bytes]:
    """The next answer, and nothing of the one after it."""
    received = b""
    while b"\r\n\r\n" not in received:
        seen = connection.recv(65536, socket.MSG_PEEK)
        assert seen, received
        end = (received + seen).find(b"\r\n\r\n")
        received += connection.recv(len(seen) if end < 0 else end + 4 - len(received))
    head = received[:-4]
    length = int(head.lower().partition(b"content-length:")[2].split(b"\r\n")[0])
    body = b""
    while len(body) < length:
        body += connection.recv(length - len(body))
    return head, body


def test_silent_connection(live: Running) -> None:
    with connected(live) as connection:
        seconds, said = closed_after(connection)
    assert 0.5 < seconds < 4
    assert said == b""


def test_slow_head(live: Running) -> None:
    """A header now and then keeps no connection."""
    with connected(live) as connection:
        connection.sendall(b"GET /health/live HTTP/1.1\r\nHost: 127.0.0.1\r\n")
        begun = time.monotonic()
        with contextlib.suppress(ConnectionError):
            for k in range(40):
                connection.sendall(b"X-%d: 1\r\n" % k)
                time.sleep(0.1)
                connection.setblocking(False)
                with contextlib.suppress(BlockingIOError):
                    if connection.recv(10, socket.MSG_PEEK) is not None:
                        break
                connection.setblocking(True)
        assert time.monotonic() - begun < 3
        connection.setblocking(True)
        assert rest(connection).startswith(b"HTTP/1.1 408 ")


def test_slow_second_head(live: Running) -> None:
    with connected(live) as connection:
        connection.sendall(f"GET {PATH} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
        assert one_answer(connection)[0].startswith(b"HTTP/1.1 200 ")
        time.sleep(1.5)  # between requests that is no slow head
        connection.sendall(b"GET / HT")
        seconds, said = closed_after(connection)
    assert 0.5 < seconds < 4
    assert said.startswith(b"HTTP/1.1 408 ")


def test_endless_head(live: Running) -> None:
    with connected(live) as connection:
        connection.sendall(b"GET /health/live HTTP/1.1\r\nHost: 127.0.0.1\r\n")
        with contextlib.suppress(ConnectionError):
            for k in range(200):
                connection.sendall(b"X-%d: %b\r\n" % (k, b"y" * 1000))
            said = rest(connection)
            assert b"431" in said[:20] or said == b""
    assert live.ask("/health/live").status == 200


def test_slow_body_is_no_slow_head(live: Running) -> None:
    body = json.dumps({"theta_i": 30, "theta_o": 40, "delta_phi": 170}).encode()
    head = f"POST /v1/materials/gold/evaluate HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {len(body)}\r\n"
    with connected(live) as connection:
        connection.sendall(head.encode() + b"Content-Type: application/json\r\n\r\n" + body[:10])
        time.sleep(1.6)
        connection.sendall(body[10:])
        assert one_answer(connection)[0].startswith(b"HTTP/1.1 200 ")


def headers_of(head: bytes) -> dict[bytes, bytes]:
    pairs = [line.partition(b": ") for line in head.split(b"\r\n")[1:]]
    names = [name for name, _, _ in pairs]
    assert len(set(names)) == len(names)
    return {name: value for name, _, value in pairs}


def test_whole_answers_are_those_of_the_framework(live: Running) -> None:
    """Sent in one piece or in the usual two: the same lines, the same bytes."""
    ours = {b"x-request-id", b"server-timing", b"date"}
    found: list[Any] = []
    for more in (
        b"",
        b"Accept: application/json, */*;q=0.5\r\n",
    ):  # the second is not asked often enough for a short way
        with connected(live) as connection:
            connection.sendall(f"GET {PATH} HTTP/1.1\r\nHost: 127.0.0.1\r\n".encode() + more + b"\r\n")
            head, body = one_answer(connection)
        headers = headers_of(head)
        assert ours <= headers.keys()
        assert headers[b"x-content-type-options"] == b"nosniff"
        found.append((head.split(b"\r\n")[0], {k: v for k, v in headers.items() if k not in ours}, body))
    assert found[0] == found[1]


def test_pipelined_and_kept_connections(live: Running) -> None:
    request = f"GET {PATH} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode()
    with connected(live) as connection:
        first = None
        for _ in range(20):
            connection.sendall(request)
            body = one_answer(connection)[1]
            first = first or body
            assert body == first
        connection.sendall(5 * request)
        received = b""
        while received.count(b"HTTP/1.1 200 OK") < 5 or not received.endswith(body):
            received += connection.recv(65536)
        assert received.count(body) == 5
    with connected(live) as connection:
        connection.sendall(f"HEAD {PATH} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n".encode())
        said = rest(connection)
        assert said.endswith(b"\r\n\r\n")
        assert b"content-length: %d\r\n" % len(body) in said
    with connected(live) as connection:
        connection.sendall(f"GET {PATH} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n".encode())
        assert rest(connection).endswith(body)
    with connected(live) as connection:
        connection.sendall(f"GET {PATH} HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n".encode())
        assert rest(connection).endswith(body)


def test_what_follows_an_answer_comes_after_it(live: Running) -> None:
    """In one packet: a value, and what is answered without the application, with it, or not at all."""
    request = f"GET {PATH} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode()
    with connected(live) as connection:
        connection.sendall(request + b"nonsense\r\n\r\n")
        said = rest(connection)
        assert said.startswith(b"HTTP/1.1 200 OK")
        assert b"HTTP/1.1 400 Bad Request" in said
    with connected(live) as connection:
        connection.sendall(request + b"GET / HTTP/1.1\r\nX: " + b"y" * 70_000)
        time.sleep(0.1)
        connection.sendall(b"y" * 70_000)
        said = rest(connection)
        assert said.startswith(b"HTTP/1.1 200 OK")
        assert said.count(b"HTTP/1.1 ") == 2
        assert b" 431 " in said
    with connected(live) as connection:
        connection.sendall(request)
        connection.shutdown(socket.SHUT_WR)
        assert rest(connection).startswith(b"HTTP/1.1 200 OK")
    mixed = [
        f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Request-Id: q{k}\r\n\r\n".encode()
        for k, path in enumerate((PATH, "/health/live", PATH, "/v1/materials/none", PATH, PATH))
    ]
    with connected(live) as connection:
        for _ in range(5):
            connection.sendall(b"".join(mixed))
            received = b""
            while received.count(b"x-request-id") < len(mixed):
                received += connection.recv(65536)
            at = [received.index(b"x-request-id: q%d\r" % k) for k in range(len(mixed))]
            assert at == sorted(at)
            connection.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                received += connection.recv(65536)
            connection.setblocking(True)


def test_a_get_with_a_body(live: Running) -> None:
    with connected(live) as connection:
        for _ in range(3):
            connection.sendall(f"GET {PATH} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 5\r\n\r\n12345".encode())
            assert one_answer(connection)[0].startswith(b"HTTP/1.1 200 ")


def flood(connection: socket.socket, request: bytes, seconds: float, *, reading: bool) -> int:
    """Send without waiting for answers; how many requests went out before the time was over or the connection."""
    packet, sent, until = 2000 * request, 0, time.monotonic() + seconds
    connection.settimeout(0.05)
    with contextlib.suppress(ConnectionError):
        while time.monotonic() < until:
            with contextlib.suppress(TimeoutError):
                sent += connection.send(packet[sent % len(packet) :])
            with contextlib.suppress(TimeoutError):
                if reading:
                    connection.recv(2**20)
    return sent // len(request)


@pytest.mark.parametrize("reading", [False, True])
def test_a_client_that_does_not_wait(live: Running, reading: bool) -> None:
    """It takes its own connection's room and its turn, and nothing from the others."""
    request = f"GET {PATH} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode()
    memory = Path(f"/proc/{live.process.pid}/statm")
    if not memory.exists():
        pytest.skip("no /proc here to see the memory of a process")
    before = int(memory.read_text().split()[1])
    with connected(live) as connection, concurrent.futures.ThreadPoolExecutor(1) as pool:
        flooding = pool.submit(flood, connection, request, 3, reading=reading)
        spent = []
        while not flooding.done():
            begun = time.monotonic()
            assert live.ask(PATH).status == 200
            spent.append(time.monotonic() - begun)
            time.sleep(0.05)
        assert flooding.result() > 5000
    grown = (int(memory.read_text().split()[1]) - before) * 4096 / 2**20
    assert grown < 200, f"{grown:.0f} MiB"
    assert sorted(spent)[len(spent) // 2] < 0.5


def test_who_takes_nothing_is_cut_off(original: Path, tmp_path: Path) -> None:
    data = Path(shutil.copytree(original, tmp_path / "data"))
    body = json.dumps({"theta_i": [30] * 200_000, "theta_o": 40, "delta_phi": 170}).encode()
    head = f"POST {PATH.partition('?')[0]} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {len(body)}\r\n".encode()
    with running(data, "--send-seconds", "1") as live, connected(live) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        for _ in range(20):  # more than the system's own buffers hold
            with contextlib.suppress(TimeoutError, ConnectionError):
                connection.settimeout(0.5)
                connection.sendall(head + b"Content-Type: application/json\r\n\r\n" + body)
        deadline = time.monotonic() + 20
        while not any("nothing of an answer was taken" in line for line in live.errors):
            assert time.monotonic() < deadline
            time.sleep(0.1)
        assert live.ask("/health/live").status == 200


def test_heads_that_begin_in_the_packet_before(live: Running) -> None:
    """Each gets its own time to arrive."""
    request = f"GET {PATH} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode()
    with connected(live) as connection:
        connection.sendall(request[:20])
        for _ in range(15):
            connection.sendall(request[20:] + request[:20])
            assert one_answer(connection)[0].startswith(b"HTTP/1.1 200 ")
            time.sleep(0.1)


def test_junk_behind_a_request_is_no_answer_to_it(live: Running) -> None:
    with connected(live) as connection:
        connection.sendall(b"GET /health/live HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\nnonsense\r\n\r\n")
        assert not rest(connection).startswith(b"HTTP/1.1 400 ")


def test_a_body_that_breaks_off(live: Running) -> None:
    """Who sends it is told at once, and after the answers to what came before it."""
    request = f"GET {PATH} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode()
    head = f"POST {PATH.partition('?')[0]} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
    for before in (0, 1, 3):
        with connected(live) as connection:
            connection.sendall(before * request + head.encode() + b"Transfer-Encoding: chunked\r\n\r\nno length\r\n")
            seconds, said = closed_after(connection)
        assert seconds < 4
        assert said.count(b"HTTP/1.1 200 ") == before
        assert said.count(b"HTTP/1.1 400 ") == said.count(b"HTTP/1.1 ") - before == 1


@pytest.mark.parametrize("method", ["GET", "POST"])
def test_endless_trailers(live: Running, method: str) -> None:
    """What may follow the last piece of a body is nobody's, and has a limit too."""
    path = "/health/live" if method == "GET" else PATH.partition("?")[0]
    with connected(live) as connection:
        head = f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
        connection.sendall(head.encode() + b"Transfer-Encoding: chunked\r\n\r\n0\r\n")
        sent = 0
        with contextlib.suppress(ConnectionError):
            while sent < 2**26:
                connection.sendall(1000 * b"a: b\r\n")
                sent += 6000
        assert sent < 2**25  # the buffers of the system aside
    assert live.ask("/health/live").status == 200


def test_many_small_pieces_of_a_body(live: Running) -> None:
    body = json.dumps({"theta_i": [30] * 30_000, "theta_o": 40, "delta_phi": 170}).encode()
    pieces = b"".join(b"1;a-word-beside-it\r\n%c\r\n" % byte for byte in body)
    with connected(live) as connection:
        head = f"POST {PATH.partition('?')[0]} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
        connection.sendall(head.encode() + b"Transfer-Encoding: chunked\r\n\r\n" + pieces + b"0\r\nx: y\r\n\r\n")
        assert one_answer(connection)[0].startswith(b"HTTP/1.1 200 ")


def test_each_is_in_the_log_and_the_counters(live: Running) -> None:
    named = {"X_Request_Id": "a-request-of-mine"}
    answer = live.ask(PATH, **named)
    assert (answer.status, answer.headers["x-request-id"]) == (200, "a-request-of-mine")
    deadline = time.monotonic() + 5
    while not (lines := [x for x in live.errors if "a-request-of-mine" in x]) and time.monotonic() < deadline:
        time.sleep(0.02)
    line = json.loads(lines[0])
    assert (line["route"], line["status"], line["bytes"]) == ("/v1/materials/{name}/evaluate", 200, len(answer.body))
    counted = live.ask("/metrics").body.decode()
    assert 'brdf_requests_total{method="GET",route="/v1/materials/{name}/evaluate",status="200"}' in counted
