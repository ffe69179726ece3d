"""Large batches go in pieces, their errors come back whole, and a bar is drawn on a terminal only."""

from __future__ import annotations

import io
import sys
from typing import Any

import numpy as np
import pytest

from brdfcore.base.errors import InputError, LimitError
from brdfcore.client import Client, ServiceError
from tests.client.scripted import FACTS, Said, Scripted, grey_service, say_json


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def angles(n: int = 100, dtype: Any = np.float64) -> list[Any]:
    return [np.linspace(0, 1.5, n).astype(dtype) for _ in range(3)]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_pieces(dtype: Any) -> None:
    seen: list[int] = []
    with Client.in_process(grey_service(seen=seen), chunk_points=30) as client:
        i, o, d = angles(dtype=dtype)
        values = client.material("grey").evaluate(i, o, d)
    assert seen == [30, 30, 30, 10]
    assert values.dtype == dtype
    assert np.array_equal(values[:, 0], i + dtype(2) * o)


def test_vectors_in_pieces() -> None:
    seen: list[int] = []
    wi, wo = np.random.default_rng(1).normal(size=(2, 100, 3))
    with Client.in_process(grey_service(limit=40, seen=seen), chunk_points=60) as client:
        values = client.material("grey").evaluate_vectors(wi, wo)
    assert seen == [30, 30, 30, 10]
    assert np.array_equal(values[:, 0], wi[:, 2] + 2 * wo[:, 2])


def test_a_service_that_takes_fewer_points_gets_fewer() -> None:
    seen: list[int] = []
    with Client.in_process(grey_service(limit=40, seen=seen)) as client:
        i, o, d = angles()
        assert np.array_equal(client.material("grey").evaluate(i, o, d)[:, 0], i + 2 * o)
        assert seen == [40, 40, 20]
    with Client.in_process(grey_service(limit=0)) as client, pytest.raises(LimitError, match="no") as caught:
        client.material("grey").evaluate(*angles())
    assert caught.value.context["limit"] == 0


def test_an_index_is_one_of_the_callers_arrays() -> None:
    with Client.in_process(grey_service(bad_point=72), chunk_points=30) as client:
        i, o, d = angles()
        with pytest.raises(InputError) as caught:
            client.material("grey").evaluate(i.reshape(4, 25), o.reshape(4, 25), d.reshape(4, 25))
    error = caught.value
    assert (error.code, error.context["where"], error.context["index"]) == ("angle_outside", "theta_i", [2, 22])
    assert error.detail == "theta_i[2, 22] = 1.5 is bad"
    assert error.context["request_id"] == "r1"


def test_spectra_go_in_smaller_pieces() -> None:
    """What counts is points times channels."""
    facts = {**FACTS, "channels": [400 + k for k in range(200)], "channel_kind": "wavelength"}
    sizes: list[int] = []

    def answer(asked: Any) -> Said:
        if not asked.path.endswith("/evaluate"):
            return say_json(facts)
        n = len(asked.body) // 12
        sizes.append(n)
        return Said(200, bytes(n * 200 * 4), {"x-brdf-dtype": "f4", "x-brdf-shape": f"{n},200"})

    with Client.in_process(Scripted(answer)) as client:
        zero = np.zeros(25_000, np.float32)
        assert client.material("grey").evaluate(zero, zero, zero).shape == (25_000, 200)
    assert sizes == [20_000, 5_000]


def test_answers_that_do_not_fit_are_no_values() -> None:
    for said in (
        Said(200, b"\0" * 7, {"x-brdf-dtype": "f8", "x-brdf-shape": "1,1"}),
        Said(200, b"\0" * 8, {"x-brdf-dtype": "f4", "x-brdf-shape": "2,1"}),
        Said(200, b"\0" * 8, {"x-brdf-dtype": "f8", "x-brdf-shape": "1,2"}),
        say_json({"values": [[1.0]]}),
    ):
        app = Scripted(lambda asked, said=said: said if asked.path.endswith("/evaluate") else say_json(FACTS))
        with Client.in_process(app) as client, pytest.raises(ServiceError, match="8 bytes"):
            client.material("grey").evaluate(0.1, 0.2, 0.3)


@pytest.mark.parametrize("terminal", [True, False])
def test_a_bar_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch, terminal: bool) -> None:
    stream = Terminal() if terminal else io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    with Client.in_process(grey_service(), chunk_points=30) as client:
        material = client.material("grey")
        material.evaluate(0.1, 0.2, 0.3)
        assert stream.getvalue() == ""  # not for one request
        material.evaluate(*angles())
    if terminal:
        assert "grey [" in stream.getvalue()
        assert "100/100" in stream.getvalue()
        assert stream.getvalue().endswith("\r\x1b[K")
    else:
        assert stream.getvalue() == ""


def test_progress_as_the_caller_wants_it(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    calls: list[tuple[int, int, str]] = []
    with Client.in_process(grey_service(), chunk_points=30, progress=lambda *a: calls.append(a)) as client:
        client.material("grey").evaluate(*angles())
    assert calls == [(30, 100, "grey"), (60, 100, "grey"), (90, 100, "grey"), (100, 100, "grey")]
    with Client.in_process(grey_service(), chunk_points=30, progress=False) as client:
        client.material("grey").evaluate(*angles())
    assert stream.getvalue() == ""
