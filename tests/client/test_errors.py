"""What the service complains of is raised here as the library would raise it, with the same place and words."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.errors import (
    BrdfError,
    FileFormatError,
    InputError,
    LimitError,
    MissingExtraError,
    StorageError,
    UnknownNameError,
)
from brdfcore.client import AccessError, Client, RemoteBrdf, ServiceError
from brdfcore.client.errors import error_of
from tests.client.scripted import FACTS, Scripted, say_json, say_problem

HALF_PI = np.pi / 2


@pytest.mark.parametrize(
    "angles",
    [
        (2.0, 0.1, 0.1),
        ([0.1, np.nan], 0.1, 0.1),
        (np.zeros((2, 1)), [[0.1, 0.2, -0.1]], 0.0),
        (0.1, 0.1, [[0.0], [np.inf]]),
        (np.float32(0.1), np.full((2, 2), 1.6, np.float32), np.float32(0)),
        ([0.1, 0.2], [0.1, 0.2, 0.3], 0.0),
        ("text", 0.1, 0.1),
    ],
)
def test_wrong_angles(client: Client, local: dict[str, bc.Brdf], angles: Any) -> None:
    """The same class, code, words and context as of a local material; nothing is sent."""
    raised = []
    for b in (local["gold-grid"], client.material("gold-grid")):
        with pytest.raises(InputError) as caught:
            b.evaluate(*angles)
        raised.append((type(caught.value), caught.value.code, caught.value.detail, caught.value.context))
    assert raised[0] == raised[1]


def test_out_that_does_not_fit(client: Client) -> None:
    with pytest.raises(InputError) as caught:
        client.material("gold").evaluate(0.1, 0.2, 0.3, out=np.empty(2))
    assert caught.value.context["where"] == "out"


def test_what_the_service_itself_finds(client: Client) -> None:
    with pytest.raises(UnknownNameError, match="did you mean gold") as caught:
        client.material("goldd")
    assert isinstance(caught.value, KeyError)
    assert caught.value.context["where"] == "name"
    assert caught.value.context["got"] == "goldd"
    assert len(caught.value.context["request_id"]) == 16
    with pytest.raises(UnknownNameError, match="id"):
        client.table("0" * 64)
    with pytest.raises(InputError, match="one angle") as angle:
        client.material("gold").slice([0.1, 0.2], view="hemisphere")
    assert angle.value.context["where"] == "theta_i"
    with pytest.raises(InputError) as outside:
        client.material("gold").slice([0.1, 2.0])
    assert (outside.value.context["index"], outside.value.context["got"]) == ([1], 2.0)  # in radians, as given
    with pytest.raises(UnknownNameError, match="no channel"):
        client.material("gold").slice(0.1, channel="X")
    with pytest.raises(LimitError) as many:
        client.material("gold").slice(np.linspace(0, 1, 17))
    assert many.value.context["limit"] == 16


def test_a_status_is_a_class() -> None:
    """Problem to class, and back through pickle with code, words and context."""
    for status, code, kind in (
        (400, "bad_json", InputError),
        (401, "key_missing", AccessError),
        (403, "read_only", AccessError),
        (404, "unknown_material", UnknownNameError),
        (409, "material_damaged", StorageError),
        (412, "changed", StorageError),
        (413, "too_many_points", LimitError),
        (415, "unsupported_media_type", InputError),
        (418, "teapot", BrdfError),
        (421, "foreign_host", AccessError),
        (422, "angle_outside", InputError),
        (422, "unknown_parameter", UnknownNameError),
        (422, "damaged_file", FileFormatError),
        (422, "unknown_format", FileFormatError),
        (500, "internal_error", ServiceError),
        (501, "missing_extra", MissingExtraError),
        (503, "queue_full", ServiceError),
    ):
        said = say_problem(status, code, "what it says", where="here", index=[3], got=1.5, expected="less", hint="h")
        error = error_of(status, said.body, "http://x/v1")
        assert type(error) is kind, code
        for copy in (error, pickle.loads(pickle.dumps(error))):
            assert (copy.code, str(copy)) == (code, "what it says")
            assert copy.context == {
                "http_status": status,
                "where": "here",
                "index": [3],
                "got": 1.5,
                "expected": "less",
                "hint": "h",
                "request_id": "r1",
            }


def test_every_exception_of_the_service_comes_back_as_its_own_base() -> None:
    """The service's table and this one agree on the library's classes."""
    from brdf_service.http.errors import STATUS, problem

    bases = (InputError, UnknownNameError, LimitError, StorageError, MissingExtraError)
    for kind, status in STATUS.items():
        if not issubclass(kind, BrdfError) or status >= 500:
            continue
        answer = problem(kind("some_code", "words"), "r")
        found = error_of(answer.status_code, bytes(answer.body), "http://x")
        if kind in (UnknownNameError, bc.FileFormatError):
            continue  # told apart by their codes
        for base in bases:
            if issubclass(kind, base):
                assert isinstance(found, base), kind


@pytest.mark.parametrize(
    "body", [b"", b"<html>", b"[]", b"null", b'{"code": 1}', b'{"detail": "x"}', b'{"code":"a","detail":2}', b"\xff"]
)
def test_what_is_no_problem(body: bytes) -> None:
    error = error_of(404, body, "http://x/v1")
    assert type(error) is ServiceError
    assert "right address" in error.detail
    odd = b'{"code": "a", "detail": "b", "errors": [3], "request_id": 5}'
    assert error_of(422, odd, "http://x").context == {"http_status": 422}


def test_a_replaced_material_never_answers_for_the_old_one() -> None:
    """Questions go to the id; once nothing has it any more, they end."""

    def answer(asked: Any) -> Any:
        if asked.path == "/v1/materials/grey":
            return say_json(FACTS)
        return say_problem(404, "unknown_table", "no table of this id", where="id")

    with Client.in_process(Scripted(answer)) as client:
        grey = client.material("grey")
        assert isinstance(grey, RemoteBrdf)
        with pytest.raises(UnknownNameError, match="no table of this id"):
            grey.evaluate(0.1, 0.2, 0.3)
