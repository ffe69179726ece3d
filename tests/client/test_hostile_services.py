"""What a service, or something that is none, may answer: the client ends, in time and with bounded memory."""

from __future__ import annotations

import asyncio
import gzip
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from brdfcore.client import AsyncClient, Client, DeadlineError, ServiceError
from tests.client.scripted import Asked, Said, Scripted, in_turn, say_json

PAGE = {"materials": [], "total": 1, "offset": 0, "limit": 1000}


@pytest.mark.parametrize("steps", [("/v1/materials?offset=0",), ("/v1/materials?a", "/v1/materials?b")])
def test_pages_that_lead_back(steps: tuple[str, ...]) -> None:
    count = iter(range(10**9))
    app = Scripted(lambda _: say_json({**PAGE, "next": steps[next(count) % len(steps)]}))
    with Client.in_process(app) as client, pytest.raises(ServiceError) as caught:
        client.materials()
    assert caught.value.code == "bad_answer"
    assert len(app.asked) <= len(steps) + 1


def test_nested_json() -> None:
    with Client.in_process(in_turn(Said(200, b"[" * 200_000))) as client, pytest.raises(ServiceError):
        client.material("grey")


def test_an_answer_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("brdfcore.client.driver.MOST_ANSWER", 10**6)

    def answer(asked: Asked) -> Said:
        return Said(200, gzip.compress(bytes(20 * 10**6)), {"content-encoding": "gzip"})

    with Client.in_process(Scripted(answer)) as client, pytest.raises(ServiceError) as caught:
        client.material("grey")
    assert caught.value.code == "answer_too_large"


@contextmanager
def dripping() -> Iterator[str]:
    """A server whose head comes byte by byte, without end."""
    listener = socket.create_server(("127.0.0.1", 0))
    ended = threading.Event()

    def serve() -> None:
        while not ended.is_set():
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            threading.Thread(target=drip, args=(connection,), daemon=True).start()

    def drip(connection: socket.socket) -> None:
        with connection:
            try:
                connection.sendall(b"HTTP/1.1 200 OK\r\n")
                while not ended.wait(0.05):
                    connection.sendall(b"x")
            except OSError:
                return

    threading.Thread(target=serve, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"
    finally:
        ended.set()
        listener.close()


def test_a_head_that_drips() -> None:
    with dripping() as url:
        begun = time.monotonic()
        with Client(url, timeout=5, deadline=1.0) as client, pytest.raises(DeadlineError):
            client.material("grey")
        assert time.monotonic() - begun < 4

        async def ask() -> None:
            async with AsyncClient(url, timeout=5, deadline=1.0) as client:
                with pytest.raises(DeadlineError):
                    await client.material("grey")

        begun = time.monotonic()
        asyncio.run(ask())
        assert time.monotonic() - begun < 4
