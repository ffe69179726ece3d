"""What is tried again, when, for how long, and what is said when it was in vain."""

from __future__ import annotations

import socket
import ssl
import threading
import time
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from typing import Any

import httpx2
import pytest

from brdfcore.base.errors import InputError, UnknownNameError
from brdfcore.client import AccessError, Client, DeadlineError, ServiceError
from brdfcore.client.calls import Call
from brdfcore.client.retry import Attempts, RetryPolicy, retry_after
from tests.client.scripted import FACTS, Asked, Said, Scripted, in_turn, say_json, say_problem


@pytest.fixture
def pauses(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Seconds that the client would have slept; time passes as it asks, without anyone waiting."""
    slept: list[float] = []
    real = time.monotonic
    monkeypatch.setattr("brdfcore.client.driver.sleep", slept.append)
    monkeypatch.setattr("brdfcore.client.retry.monotonic", lambda: real() + sum(slept))
    return slept


@pytest.mark.parametrize("status", [502, 503, 504])
def test_a_busy_service_is_asked_again(pauses: list[float], status: int) -> None:
    app = in_turn(Said(status), say_problem(status, "busy"), say_json(FACTS))
    with Client.in_process(app) as client:
        assert client.material("grey").name == "grey"
    assert len(app.asked) == 3
    assert 0.05 <= pauses[0] <= 0.1 <= pauses[1] <= 0.2


def test_retry_after_is_obeyed(pauses: list[float]) -> None:
    later = format_datetime(datetime.now(UTC) + timedelta(seconds=10), usegmt=True)
    app = in_turn(
        say_problem(503, "busy", headers={"retry-after": "7"}),
        say_problem(503, "busy", headers={"retry-after": later}),
        say_json(FACTS),
    )
    with Client.in_process(app) as client:
        client.material("grey")
    assert 7 <= pauses[0] < 7.5
    assert 8 <= pauses[1] <= 10.5


def test_a_retry_after_past_the_deadline_ends_it_at_once(pauses: list[float]) -> None:
    app = in_turn(say_problem(503, "queue_full", "8 jobs wait", headers={"retry-after": "120"}))
    with Client.in_process(app, deadline=20) as client, pytest.raises(DeadlineError) as caught:
        client.material("grey")
    assert pauses == []
    assert isinstance(caught.value, TimeoutError)
    assert "queue_full: 8 jobs wait; it asks to wait 120 s" in caught.value.detail


def test_the_deadline_is_of_all_attempts_together(pauses: list[float]) -> None:
    app = in_turn(Said(503))
    with Client.in_process(app, deadline=20) as client, pytest.raises(DeadlineError) as caught:
        client.material("grey")
    assert 17 < sum(pauses) < 20
    assert all(p <= 3 for p in pauses)
    assert caught.value.context["attempts"] == len(app.asked) == len(pauses) + 1
    for told in ("GET http://127.0.0.1/v1/materials/grey", "deadline 20 s", "answered 503"):
        assert told in caught.value.detail


def test_other_errors_are_not_repeated(pauses: list[float]) -> None:
    for status, kind in ((404, UnknownNameError), (422, InputError), (500, ServiceError), (401, AccessError)):
        app = in_turn(say_problem(status, "code", "said"))
        with Client.in_process(app) as client, pytest.raises(kind, match="said"):
            client.material("grey")
        assert len(app.asked) == 1
    assert pauses == []


def test_deadline_zero_is_one_attempt(pauses: list[float]) -> None:
    app = in_turn(say_problem(503, "busy", "later"))
    with Client.in_process(app, deadline=0) as client, pytest.raises(ServiceError, match="later"):
        client.material("grey")
    assert len(app.asked) == 1


def test_what_changes_something_is_repeated_only_if_nothing_was_done(pauses: list[float]) -> None:
    for status, attempts in ((503, 2), (502, 1), (504, 1)):
        app = in_turn(Said(status), Said(204, b""))
        with Client.in_process(app) as client:
            if attempts == 1:
                with pytest.raises(ServiceError):
                    client.delete("grey")
            else:
                client.delete("grey")
        assert len(app.asked) == attempts


def test_failures_on_the_way() -> None:
    """Never sent: again, always. Broken off: again if it changes nothing. Timed out: not again."""
    refused, broken, silent = httpx2.ConnectError("refused"), httpx2.ReadError("reset"), httpx2.ReadTimeout("silent")
    for repeat, error, expected in (
        ("any", refused, float),
        ("undone", refused, float),
        ("none", refused, ServiceError),
        ("any", broken, float),
        ("undone", broken, ServiceError),
        ("any", silent, DeadlineError),
    ):
        attempts = Attempts(Call("POST", "/v1/x", repeat=repeat), RetryPolicy(10), "http://x")  # type: ignore[arg-type]
        if expected is float:
            assert 0.05 <= attempts.after_failure(error) <= 0.1
        else:
            with pytest.raises(expected) as caught:
                attempts.after_failure(error)
            assert caught.value.__cause__ is error
            assert type(caught.value) is expected


def test_what_waiting_does_not_help() -> None:
    for cause in (socket.gaierror(socket.EAI_NONAME, "no such name"), ssl.SSLCertVerificationError("not its own")):
        error = httpx2.ConnectError(str(cause))
        error.__cause__ = httpx2.ConnectError("inner")
        error.__cause__.__context__ = cause
        with pytest.raises(ServiceError) as caught:
            Attempts(Call("GET", "/v1/x"), RetryPolicy(10), "http://x").after_failure(error)
        assert type(caught.value) is ServiceError
    again = httpx2.ConnectError("later")
    again.__cause__ = socket.gaierror(socket.EAI_AGAIN, "the name server is busy")
    assert Attempts(Call("GET", "/v1/x"), RetryPolicy(10), "http://x").after_failure(again) > 0


def test_the_pause_grows_up_to_its_limit() -> None:
    policy = RetryPolicy(first_pause=0.1, longest_pause=3)
    assert [policy.pause(k, 1.0) for k in (1, 2, 3, 6, 7, 10_000)] == [0.1, 0.2, 0.4, 3, 3, 3]
    assert policy.pause(3, 0.0) == 0.2


def test_reading_retry_after() -> None:
    assert retry_after(" 12 ") == 12
    assert retry_after("Wed, 21 Oct 2015 07:28:00 GMT") == 0
    for unreadable in ("", "soon", "-3", "1.5", "²"):
        assert retry_after(unreadable) is None


def test_nobody_listens() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{free.getsockname()[1]}"
    started = time.monotonic()
    with Client(url, deadline=0.4) as client, pytest.raises(DeadlineError) as caught:
        client.materials()
    assert time.monotonic() - started < 2
    assert caught.value.context["attempts"] > 1
    assert "onnect" in caught.value.detail
    with Client(url, deadline=0) as client, pytest.raises(ServiceError, match="does the service run there"):
        client.materials()


def test_silence_ends_with_the_timeout() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        url = f"http://127.0.0.1:{listener.getsockname()[1]}"
        with Client(url, timeout=0.2) as client, pytest.raises(DeadlineError, match="ReadTimeout"):
            client.materials()


def test_a_trickle_ends_with_the_deadline() -> None:
    """An answer that never stops arriving keeps within every time-out, but not within the deadline."""

    def trickle() -> None:
        connection, _ = listener.accept()
        with connection:
            connection.recv(65536)
            connection.sendall(b"HTTP/1.1 200 OK\r\ncontent-length: 1000\r\n\r\n")
            try:
                while True:
                    connection.sendall(b" ")
                    time.sleep(0.02)
            except OSError:
                return

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=trickle)
        thread.start()
        url = f"http://127.0.0.1:{listener.getsockname()[1]}"
        started = time.monotonic()
        with Client(url, timeout=5, deadline=0.5) as client, pytest.raises(DeadlineError, match="still arriving"):
            client.materials()
        assert time.monotonic() - started < 2
        thread.join()


def test_bad_options() -> None:
    options: list[tuple[str, dict[str, Any]]] = [
        ("timeout", {"timeout": 0}),
        ("deadline", {"deadline": -1}),
        ("deadline", {"deadline": float("nan")}),
        ("chunk_points", {"chunk_points": 0}),
        ("key", {"key": "two\nlines"}),
    ]
    for name, given in options:
        with pytest.raises(InputError) as caught:
            Client("http://127.0.0.1:1", **given)
        assert caught.value.context["where"] == name
    for url in ("127.0.0.1:8000", "ftp://x", "http://", "", "http://x/?q=1"):
        with pytest.raises(InputError, match="address of a service"):
            Client(url)


def test_the_key_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    def keys(**given: Any) -> list[str | None]:
        app = in_turn(say_json(FACTS))
        with Client.in_process(app, **given) as client:
            client.material("grey")
        return [a.headers.get("authorization") for a in app.asked]

    monkeypatch.delenv("BRDF_API_KEY", raising=False)
    assert keys() == [None]
    monkeypatch.setenv("BRDF_API_KEY", "from-outside")
    assert keys() == ["Bearer from-outside"]
    assert keys(key="given") == ["Bearer given"]


def test_what_is_no_such_service() -> None:
    pages = [
        Said(200, b"<html>", {"content-type": "text/html"}),
        Said(404, b"<html>", {"content-type": "text/html"}),
        Said(301, b"", {"location": "http://elsewhere/"}),
        say_json([]),
        say_json({"name": "x"}),
        Said(200, b"not gzip", {"content-encoding": "gzip"}),
    ]
    for page in pages:
        with Client.in_process(in_turn(page)) as client, pytest.raises(ServiceError):
            client.material("grey")


def test_an_application_that_fails() -> None:
    def fails(asked: Asked) -> Said:
        raise RuntimeError("inside")

    with Client.in_process(Scripted(fails)) as client, pytest.raises(ServiceError, match="500"):
        client.materials()


def test_names_that_no_material_can_have_are_not_sent() -> None:
    app = in_turn(say_json(FACTS))
    with Client.in_process(app) as client:
        for name in ("", "..", ".", "a/b", "-x", "a b", "x" * 65, "é"):
            with pytest.raises(InputError, match="name"):
                client.material(name)
    assert app.asked == []
