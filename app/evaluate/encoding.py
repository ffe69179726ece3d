"""Values into the answer that was asked for: JSON, plain numbers or .npy, with or without the status of each point.

octet-stream   values[point][channel], little-endian, C order; with status=true one byte a point follows.
.npy           an array of shape (points, channels); with status=true a second .npy of the status follows it.
Both say the rest in headers: X-Brdf-Angles, -Dtype, -Shape, -Channels, -Id, -Error, -Has-Delta.
"""

from __future__ import annotations

import asyncio
import time
from typing import Any, NamedTuple

import numpy as np
from brdf_service.evaluate.angles import AngleRequest, Array, Unit
from brdf_service.evaluate.binary import npy_head, precision_of
from brdf_service.evaluate.json_codec import array_to_json, to_header, to_json
from brdf_service.evaluate.vectors import VectorRequest
from brdf_service.http.negotiation import INLINE_POINTS, INLINE_VALUES, Kind
from brdf_service.library.materials import Material

import brdfcore as bc

#: What is asked for, in either form.
Asked = AngleRequest | VectorRequest

VALUE_UNIT = "1/sr"
STATUS_NAMES = [s.name.lower() for s in bc.Status]


class Evaluated(NamedTuple):
    """The body of an answer, the headers that explain it, and the seconds that the look-ups took."""

    body: bytes | memoryview
    headers: dict[str, str]
    seconds: float


def answer(material: Material, asked: Asked, kind: Kind, status: bool, *, lasting: bool = False) -> Evaluated:
    """f_r at the directions. Raises `InputError` in the request's own unit and index.

    lasting  the answer is kept for ever: leave out the measured error, which is a fact of a file, not of the values.
    """
    try:
        if kind == "json":
            return _json(material, asked, status, lasting)
        return _numbers(material, asked, kind, status, lasting)
    except bc.InputError as error:
        raise asked.explained(error) from error


def error_in_short(error: dict[str, Any]) -> dict[str, Any]:
    """What an answer says of a table's measured error; the material's metadata has all of it."""
    return {k: error[k] for k in ("l1", "l1_stderr", "warnings") if k in error}


def _evaluated(brdf: bc.Brdf, asked: Asked, out: Array | None = None) -> Array:
    """The values; in the event loop a few points at a time, as long as nothing is wrong with any."""
    points = asked.points
    if INLINE_POINTS < points <= INLINE_VALUES["table"] and asked.uniform and _in_event_loop():
        values = np.empty((points, len(brdf.channels)), asked.dtype) if out is None else out
        try:
            for start in range(0, points, INLINE_POINTS):
                stop = min(start + INLINE_POINTS, points)
                asked.part(start, stop).evaluate(brdf, values[start:stop])
        except bc.InputError:  # which the whole names with its place
            return asked.evaluate(brdf, out)
        return values
    return asked.evaluate(brdf, out)


def _in_event_loop() -> bool:
    """True in the thread of the event loop, False in those that work for it."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


def _json(material: Material, asked: Asked, status: bool, lasting: bool) -> Evaluated:
    begun = time.perf_counter()
    values = _evaluated(material.brdf, asked)
    seconds = time.perf_counter() - begun
    # floats are written by their shortest text, so that they read back to the same bits
    rows = array_to_json(values.reshape(-1, values.shape[-1]))
    extra = b""
    if status:
        codes = array_to_json(asked.status(material.brdf).reshape(-1))
        extra = b'"status":%b,"status_names":%b,' % (codes, to_json(STATUS_NAMES))
    return Evaluated(b'{"values":%b,%b%b' % (rows, extra, tail(material, asked.unit, lasting)), {}, seconds)


def tail(material: Material, unit: Unit | None, lasting: bool) -> bytes:
    """The fields after the values, without their opening brace; they are the same for every answer."""
    held, key = material.parts, f"{unit} {lasting}"
    if key not in held:
        fields = {
            "channels": material.brdf.channels.to_json(),
            "unit": VALUE_UNIT,
            **({} if unit is None else {"angles": unit}),
            "id": material.id,
            **({} if lasting else {"error": error_in_short(material.facts["error"])}),
            "has_delta": bool(material.brdf.has_delta),
        }
        held[key] = to_json(fields)[1:]
    return held[key]


def _numbers(material: Material, asked: Asked, kind: Kind, status: bool, lasting: bool) -> Evaluated:
    brdf = material.brdf
    shape = (asked.points, len(brdf.channels))
    dtype = asked.dtype
    precision = precision_of(np.empty(0, dtype))
    head = npy_head(shape, f"<{precision}") if kind == "npy" else b""
    tail = npy_head(shape[:1], "|u1") if kind == "npy" and status else b""
    end = len(head) + shape[0] * shape[1] * dtype.itemsize
    # one buffer for the whole body: the kernels write where the server reads. Heads are multiples of 64 bytes
    body = np.empty(end + len(tail) + (shape[0] if status else 0), np.uint8)
    body[: len(head)] = np.frombuffer(head, np.uint8)
    values = body[len(head) : end].view(dtype).reshape(shape)
    # scalars broadcast to one point, whose result has no axis of points
    out = values[0] if asked.single else values
    begun = time.perf_counter()
    _evaluated(brdf, asked, out)
    seconds = time.perf_counter() - begun
    if not np.little_endian:
        values.byteswap(inplace=True)
    if status:
        body[end : end + len(tail)] = np.frombuffer(tail, np.uint8)
        body[end + len(tail) :] = asked.status(brdf).reshape(-1)
    headers = {
        **({} if asked.unit is None else {"x-brdf-angles": asked.unit}),
        "x-brdf-dtype": precision,
        "x-brdf-shape": f"{shape[0]},{shape[1]}",
        **_facts(material, lasting),
    }
    return Evaluated(memoryview(body.data), headers, seconds)


def _facts(material: Material, lasting: bool) -> dict[str, str]:
    """What a JSON answer says beside its values, as headers: JSON in ASCII, so that no name can break out."""
    error = {k: v for k, v in error_in_short(material.facts["error"]).items() if k != "warnings"}
    return {
        "x-brdf-channels": to_header(material.brdf.channels.to_json()),
        "x-brdf-id": material.id,
        **({} if lasting else {"x-brdf-error": to_header(error)}),
        "x-brdf-has-delta": "true" if material.brdf.has_delta else "false",
    }
