"""Requests and answers as plain values, and one function a request: no socket, no clock, no httpx2.

Angles are always sent in radians and as they are (`angles=rad`, float64 or float32), so that the service computes on
the same bits as a local `Brdf`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import Any, Literal
from urllib.parse import quote, urlencode

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import InputError
from brdfcore.client.errors import ServiceError

BINARY = "application/octet-stream"
JSON = "application/json"
#: Bytes of an answer, unpacked: above any that a request of this client has.
MOST_ANSWER = 256 * 2**20
#: dtypes of the wire, little-endian whatever this machine is.
_WIRE: dict[np.dtype[Any], tuple[str, np.dtype[Any]]] = {
    np.dtype(np.float32): ("f4", np.dtype("<f4")),
    np.dtype(np.float64): ("f8", np.dtype("<f8")),
}

#: Which failures a request may be repeated after. "any": it changes nothing. "undone": only those that prove that
#: nothing was done (connection refused, 503). "none": the caller wants to know at once.
Repeat = Literal["any", "undone", "none"]


@dataclass(frozen=True)
class Call:
    """One request. `path` is percent-encoded and carries its query; `what` names it in errors."""

    method: str
    path: str
    headers: Mapping[str, str] = field(default_factory=dict)
    content: bytes = b""
    repeat: Repeat = "any"


@dataclass(frozen=True)
class Pause:
    """Wait this long before the next step."""

    seconds: float


@dataclass(frozen=True)
class Read:
    """Read a file of this machine."""

    file: str | PathLike[str]


@dataclass(frozen=True)
class Answer:
    """What came back; header names in lower case."""

    status: int
    headers: Mapping[str, str]
    content: bytes
    url: str

    def json(self) -> Any:
        """The body as JSON; `ServiceError` if it is none."""
        try:
            return json.loads(self.content)
        except (ValueError, RecursionError) as error:
            raise unexpected(self, "JSON") from error


def unexpected(answer: Answer, expected: str) -> ServiceError:
    """The error for an answer of a good status and a wrong form."""
    got = f"{len(answer.content)} bytes of {answer.headers.get('content-type', 'no type')}"
    return ServiceError(
        "bad_answer",
        f"{answer.url} answered {answer.status} with {got}; expected {expected}; is it the right address and version?",
        where=answer.url,
        got=got,
        expected=expected,
    )


def path_of(*parts: str, query: Mapping[str, Any] | None = None) -> str:
    """/v1/part/part?query, percent-encoded; None values of the query are left out, arrays become 1,2,3."""
    path = "/v1/" + "/".join(quote(p, safe="") for p in parts)
    given = {k: _text(v) for k, v in (query or {}).items() if v is not None}
    return f"{path}?{urlencode(given, safe=',')}" if given else path


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (np.ndarray, list, tuple)):
        return ",".join(_text(v) for v in np.asarray(value).reshape(-1).tolist())
    return repr(float(value)) if isinstance(value, (float, np.floating)) else str(value)


def get(*parts: str, query: Mapping[str, Any] | None = None, accept: str = JSON) -> Call:
    """A GET of /v1/parts."""
    return Call("GET", path_of(*parts, query=query), {"accept": accept})


def send_json(
    method: str,
    *parts: str,
    body: Any,
    headers: Mapping[str, str] | None = None,
    query: Mapping[str, Any] | None = None,
    repeat: Repeat = "undone",
) -> Call:
    """A request with a JSON body, by default one that changes something. Raises `InputError` for what JSON cannot
    say."""
    try:
        content = json.dumps(body, allow_nan=False).encode()
    except (TypeError, ValueError) as error:
        raise InputError("bad_body", f"this cannot be sent as JSON: {error}", where="parameters") from error
    told = {"accept": JSON, "content-type": JSON, **(headers or {})}
    return Call(method, path_of(*parts, query=query), told, content, repeat=repeat)


def evaluate(id: str, angles: tuple[FloatArray, FloatArray, FloatArray], *, beside: str | None = None) -> Call:
    """f_r of n pairs by id: angles of shape (n,), all float32 or all float64, radians; with status or uncertainty."""
    name, wire = _WIRE[angles[0].dtype]
    content = b"".join(np.ascontiguousarray(x, wire).data for x in angles)  # one copy
    headers = {"accept": BINARY, "content-type": BINARY, "accept-encoding": "identity"}  # noise does not compress
    query = {"dtype": name, "angles": "rad", **({} if beside is None else {beside: True})}
    return Call("POST", path_of("tables", id, "evaluate", query=query), headers, content)


def evaluate_vectors(id: str, wi: FloatArray, wo: FloatArray) -> Call:
    """f_r of n pairs of directions by id: wi and wo of shape (n, 3), both float32 or both float64, as they are."""
    name, wire = _WIRE[wi.dtype]
    content = b"".join(np.ascontiguousarray(x, wire).data.cast("B") for x in (wi, wo))
    headers = {"accept": BINARY, "content-type": BINARY, "accept-encoding": "identity"}
    path = path_of("tables", id, "evaluate", query={"dtype": name, "input": "vectors"})
    return Call("POST", path, headers, content)


def read_values(answer: Answer, out: FloatArray) -> None:
    """The values of an `evaluate` answer into `out` (n, channels). Raises `ServiceError` if they don't fit it."""
    _check_binary(answer, out.dtype, out.shape, 0)
    out[...] = np.frombuffer(answer.content, _WIRE[out.dtype][1]).reshape(out.shape)


def read_codes(answer: Answer, dtype: np.dtype[Any], shape: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """The status codes (n,) that follow the values, of shape (n, channels), of an answer that was asked for them."""
    _check_binary(answer, dtype, shape, shape[0])
    return np.frombuffer(answer.content, np.uint8, count=shape[0], offset=len(answer.content) - shape[0])


def read_widths(answer: Answer, out: FloatArray) -> None:
    """The half-widths that follow the values of an answer that was asked for them into `out` (n, channels)."""
    _check_binary(answer, out.dtype, out.shape, out.nbytes)
    out[...] = np.frombuffer(answer.content, _WIRE[out.dtype][1], offset=out.nbytes).reshape(out.shape)


def _check_binary(answer: Answer, dtype: np.dtype[Any], shape: tuple[int, ...], more: int) -> None:
    name, wire = _WIRE[dtype]
    said = answer.headers.get("x-brdf-dtype"), answer.headers.get("x-brdf-shape")
    size = int(np.prod(shape)) * wire.itemsize + more
    if len(answer.content) != size or said != (name, ",".join(str(n) for n in shape)):
        raise unexpected(answer, f"{name} values of shape {shape}, {size} bytes")


def read_rows(answer: Answer, name: str, out: npt.NDArray[np.float64]) -> None:
    """The rows under `name` of a JSON answer into `out` (n, channels)."""
    content = answer.json()
    try:
        rows = np.array(content[name], dtype=np.float64)
    except (TypeError, KeyError, ValueError) as error:
        raise unexpected(answer, f"{name} as rows of numbers") from error
    if rows.shape != out.shape:
        raise unexpected(answer, f"{name} of shape {out.shape}")
    out[...] = rows
