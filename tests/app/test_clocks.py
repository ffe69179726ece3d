"""How long the server's protocol waits for a client, and what it keeps of one: without a server, and its clocks a
hundred times faster."""

from __future__ import annotations

import asyncio
import gc
import weakref
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from brdf_service.settings import Settings

pytest.importorskip("httptools")


class Wire(asyncio.Transport):
    """Notes what happens to it."""

    closed = aborted = False
    unsent = 0

    def write(self, data: bytes | bytearray | memoryview) -> None:
        pass

    def is_closing(self) -> bool:
        return self.closed

    def close(self) -> None:
        self.closed = True

    def abort(self) -> None:
        self.closed = self.aborted = True

    def get_write_buffer_size(self) -> int:
        return self.unsent

    def pause_reading(self) -> None:
        pass

    def resume_reading(self) -> None:
        pass


GET = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"


def at_the_wire(work: Callable[[Any, Wire], Awaitable[None]], keep_alive: Any = 60) -> None:
    """Run `work` with a protocol whose clocks end after .1 s, above an application that never answers."""
    from brdf_service.server.deadlines import protocol
    from uvicorn import Config
    from uvicorn.server import ServerState

    async def never(scope: Any, receive: Any, send: Any) -> None:
        await asyncio.Event().wait()

    async def run() -> None:
        config, wire = Config(never, timeout_keep_alive=keep_alive), Wire()
        config.load()
        made = protocol(Settings(head_seconds=0.1, body_seconds=0.1, send_seconds=0.1))
        server = made(config, ServerState(), {}, asyncio.get_running_loop())
        server.connection_made(wire)
        await work(server, wire)
        tasks = set(server.tasks)
        if server.parser is not None:
            server.connection_lost(None)
        for task in tasks:
            task.cancel()
        assert server.timeout_keep_alive_task is None

    asyncio.run(run())


def answered(server: Any) -> None:
    """The application has sent its answer to the first request that waits for one."""
    server.unanswered[0].response_complete = True
    server.on_response_complete()


def test_a_slow_head_is_cut_off_when_it_is_its_turn() -> None:
    async def work(server: Any, wire: Wire) -> None:
        server.data_received(GET + GET[:20])
        await asyncio.sleep(0.3)
        assert not wire.closed  # an answer is owed
        answered(server)
        await asyncio.sleep(0.3)
        assert wire.closed

    at_the_wire(work)


def test_a_head_that_has_begun_is_not_idle() -> None:
    async def work(server: Any, wire: Wire) -> None:
        server.seconds = {**server.seconds, "head": 60}
        server.data_received(GET + GET[:20])
        answered(server)
        await asyncio.sleep(0.2)
        assert not wire.closed
        server.data_received(GET[20:])
        answered(server)
        assert not wire.closed
        await asyncio.sleep(0.2)
        assert wire.closed

    at_the_wire(work, keep_alive=0.1)


def test_a_head_that_began_while_another_was_answered_is_not_idle() -> None:
    async def work(server: Any, wire: Wire) -> None:
        server.seconds = {**server.seconds, "head": 60}
        server.data_received(GET + GET[:20])
        answered(server)
        await asyncio.sleep(0.3)
        assert not wire.closed

    at_the_wire(work, keep_alive=0.1)


def test_empty_lines_are_no_sign_of_life() -> None:
    async def work(server: Any, wire: Wire) -> None:
        server.data_received(GET)
        answered(server)
        server.data_received(b"\r\n")
        await asyncio.sleep(0.3)
        assert wire.closed

    at_the_wire(work, keep_alive=0.1)


def test_nothing_is_read_while_requests_wait() -> None:
    async def work(server: Any, wire: Wire) -> None:
        server.data_received(3 * GET)
        assert len(server.pipeline) == 2
        for waiting in (1, 0):
            assert server.flow.read_paused
            answered(server)
            assert len(server.pipeline) == waiting
        assert not server.flow.read_paused

    at_the_wire(work)


def test_a_slow_reader_is_not_one_that_takes_nothing() -> None:
    async def work(server: Any, wire: Wire) -> None:
        server.data_received(GET)
        wire.unsent = 1000
        server.pause_writing()
        for _ in range(10):
            wire.unsent -= 100
            await asyncio.sleep(0.04)
        assert not wire.closed
        wire.unsent = 0
        await asyncio.sleep(0.3)
        assert not wire.closed
        wire.unsent = 5
        server.pause_writing()
        await asyncio.sleep(0.3)
        assert wire.aborted

    at_the_wire(work)


def test_what_is_left_when_a_connection_is_closed_is_not_waited_for_for_ever() -> None:
    async def work(server: Any, wire: Wire) -> None:
        server.data_received(GET)
        answered(server)
        await asyncio.sleep(0.2)
        assert wire.closed
        wire.unsent = 5
        await asyncio.sleep(0.05)
        assert not wire.aborted
        await asyncio.sleep(0.25)
        assert wire.aborted

    at_the_wire(work, keep_alive=0.1)


def test_the_rest_of_a_body_whose_answer_is_out_has_to_come() -> None:
    async def work(server: Any, wire: Wire) -> None:
        server.data_received(GET[:-2] + b"Content-Length: 100\r\n\r\n")
        answered(server)
        for _ in range(10):
            server.data_received(b"x")
            await asyncio.sleep(0.03)
        assert wire.closed

    at_the_wire(work)


def test_after_the_rest_of_a_body_the_connection_goes_on() -> None:
    async def work(server: Any, wire: Wire) -> None:
        server.data_received(GET[:-2] + b"Content-Length: 3\r\n\r\n")
        answered(server)
        await asyncio.sleep(0.03)
        server.data_received(b"xyz")
        await asyncio.sleep(0.3)
        assert not wire.closed
        server.data_received(GET)
        assert server.unanswered

    at_the_wire(work)


def test_all_whose_client_is_gone_hear_of_it() -> None:
    async def work(server: Any, wire: Wire) -> None:
        server.data_received(GET)
        first = server.cycle
        server.data_received(GET)
        server.connection_lost(None)
        assert first.disconnected
        assert first.message_event.is_set()

    at_the_wire(work)


@pytest.mark.parametrize("sent", [b"", GET[:9], GET, 3 * GET, 3 * GET + GET[:9]])
def test_nothing_of_a_connection_stays(sent: bytes) -> None:
    """No collector of cycles is needed for it."""
    from brdf_service.server.deadlines import _Protocol

    kept: list[weakref.ref[Any]] = []

    async def work(server: Any, wire: Wire) -> None:
        server.data_received(sent)
        kept.append(weakref.ref(server))

    gc.collect()
    gc.disable()
    try:
        at_the_wire(work)
        assert isinstance(kept[0], weakref.ref)
        left = kept[0]()
        assert left is None or not isinstance(left, _Protocol)
    finally:
        gc.enable()
