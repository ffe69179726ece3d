"""Values into the answer that was asked for: JSON, plain numbers or .npy, with or without the status of each point.

octet-stream   values[point][channel], little-endian, C order; with status=true one byte a point follows, with
               uncertainty=true half-widths[point][channel] in the type of the values after that.
.npy           an array of shape (points, channels); with status=true a .npy of the status follows it, with
               uncertainty=true one of the half-widths after that.
Both say the rest in headers: X-Brdf-Angles, -Dtype, -Shape, -Channels, -Id, -Error, -Has-Delta.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import orjson
from brdf_service.evaluate.binary_body import npy_head
from brdf_service.evaluate.directions import Array, Directions
from brdf_service.http.json import to_header, to_json
from brdf_service.http.negotiation import MEDIA_TYPES, Kind
from brdf_service.library.materials import Material
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

import brdfcore as bc

STATUS_NAMES = [s.name.lower() for s in bc.Status]
#: Answers of up to this many values are made in the event loop: a thread would cost more than they do, and much more
#: when the service is busy. Tables are compiled loops; a model may take a microsecond a value.
INLINE_VALUES = {"table": 24_000, "model": 1024}
#: Points evaluated at a time there: more would wake the threads of a parallel kernel, and the loop would wait for them.
_INLINE_POINTS = 8000
_CONTENT_TYPES = {kind: (b"content-type", media_type.encode()) for kind, media_type in MEDIA_TYPES.items()}
#: Values encoded at a time: the interpreter's lock is held meanwhile, and other requests must get a turn in between.
_ENCODED = 65_536


class Evaluated(NamedTuple):
    """The body of an answer, the headers that explain it, and the seconds that the look-ups took."""

    body: bytes | memoryview
    headers: dict[str, str]
    seconds: float


class Beside(NamedTuple):
    """What is asked for beside the values."""

    status: bool = False
    uncertainty: bool = False


class PlainResponse(Response):
    """A 200 answer of two messages and lower-case headers: the framework's own class costs as much as a look-up."""

    def __init__(self, made: Evaluated, headers: dict[str, str], kind: Kind) -> None:
        self.status_code, self.body, self.background = 200, made.body, None
        headers.update(made.headers)
        self.raw_headers = [(name.encode(), value.encode("latin-1")) for name, value in headers.items()]
        self.raw_headers += (_CONTENT_TYPES[kind], (b"content-length", b"%d" % len(made.body)))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": self.raw_headers})
        await send({"type": "http.response.body", "body": self.body})


def answer(
    material: Material, asked: Directions, points: int, kind: Kind, beside: Beside, inline: bool, lasting: bool
) -> Evaluated:
    """f_r at the directions. Raises `InputError` in the request's own unit and index.

    inline   in the event loop: a few points at a time.
    lasting  the answer is kept for ever: leave out the measured error, which is a fact of a file, not of the values.
    """
    try:
        if kind != "json":
            return _numbers(material, asked, points, kind, beside, inline, lasting)
        begun = time.perf_counter()
        values = _evaluated(material.brdf, asked, points, None, inline)
        seconds = time.perf_counter() - begun
        extra = b""
        if beside.status:
            codes = array_to_json(asked.status(material.brdf).reshape(-1))
            extra = b'"status":%b,"status_names":%b,' % (codes, to_json(STATUS_NAMES))
        if beside.uncertainty:
            widths = asked.uncertainty(material.brdf)
            extra += b'"uncertainty":%b,' % array_to_json(widths.reshape(-1, widths.shape[-1]))
        rest = material.parts.get((asked.unit, lasting)) or _rest(material, asked, lasting)
        # floats are written by their shortest text, so that they read back to the same bits
        rows = array_to_json(values.reshape(-1, values.shape[-1]))
        return Evaluated(b'{"values":%b,%b%b' % (rows, extra, rest), {}, seconds)
    except bc.InputError as error:
        raise asked.explained(error) from error


def _rest(material: Material, asked: Directions, lasting: bool) -> bytes:
    """The fields after the values, without their opening brace; they are the same for every answer."""
    fields = {
        "channels": material.brdf.channels.to_json(),
        "unit": "1/sr",
        **({} if asked.unit is None else {"angles": asked.unit}),
        "id": material.id,
        **({} if lasting else {"error": _error_in_short(material)}),
        "has_delta": bool(material.brdf.has_delta),
    }
    made = to_json(fields)[1:]
    material.parts[asked.unit, lasting] = made
    return made


def _error_in_short(material: Material) -> dict[str, Any]:
    """What an answer says of a table's measured error; the material's metadata has all of it."""
    error = material.facts["error"]
    return {k: error[k] for k in ("l1", "l1_stderr", "warnings") if k in error}


def _evaluated(brdf: bc.Brdf, asked: Directions, points: int, out: Array | None, inline: bool) -> Array:
    """The values; in the event loop a few points at a time, as long as nothing is wrong with any."""
    if points > _INLINE_POINTS and inline and all(x.size in (1, points) for x in asked.lists):
        values = np.empty((points, len(brdf.channels)), np.result_type(*asked.lists)) if out is None else out
        try:
            for start in range(0, points, _INLINE_POINTS):
                stop = min(start + _INLINE_POINTS, points)
                asked.part(start, stop).evaluate(brdf, values[start:stop])
        except bc.InputError:  # which the whole names with its place
            return asked.evaluate(brdf, out)
        return values
    return asked.evaluate(brdf, out)


def _numbers(
    material: Material, asked: Directions, points: int, kind: Kind, beside: Beside, inline: bool, lasting: bool
) -> Evaluated:
    brdf = material.brdf
    shape, dtype = (points, len(brdf.channels)), np.result_type(*asked.lists)
    precision = "f4" if dtype == np.float32 else "f8"
    head = npy_head(shape, f"<{precision}") if kind == "npy" else b""
    end = len(head) + shape[0] * shape[1] * dtype.itemsize
    more = b""
    if beside.status:
        more += npy_head(shape[:1], "|u1") if kind == "npy" else b""
        more += asked.status(brdf).tobytes()
    if beside.uncertainty:
        more += head + asked.uncertainty(brdf).astype(dtype.newbyteorder("<"), copy=False).tobytes()
    # one buffer for the whole body: the kernels write where the server reads. Heads are multiples of 64 bytes
    body = np.empty(end + len(more), np.uint8)
    body[: len(head)] = np.frombuffer(head, np.uint8)
    values = body[len(head) : end].view(dtype).reshape(shape)
    # scalars broadcast to one point, whose result has no axis of points
    single = all(x.ndim == 0 for x in asked.lists)
    begun = time.perf_counter()
    _evaluated(brdf, asked, points, values[0] if single else values, inline)
    seconds = time.perf_counter() - begun
    if not np.little_endian:
        values.byteswap(inplace=True)
    body[end:] = np.frombuffer(more, np.uint8)
    error = {k: v for k, v in _error_in_short(material).items() if k != "warnings"}
    headers = {  # JSON in ASCII, so that no name can break out
        **({} if asked.unit is None else {"x-brdf-angles": asked.unit}),
        "x-brdf-dtype": precision,
        "x-brdf-shape": f"{shape[0]},{shape[1]}",
        "x-brdf-channels": to_header(brdf.channels.to_json()),
        "x-brdf-id": material.id,
        **({} if lasting else {"x-brdf-error": to_header(error)}),
        "x-brdf-has-delta": "true" if brdf.has_delta else "false",
    }
    return Evaluated(memoryview(body.data), headers, seconds)


def array_to_json(values: npt.NDArray[Any]) -> bytes:
    """A contiguous array as nested lists: floats read back to the same bits, not finite ones are null."""
    if values.dtype == np.float32:
        values = values.astype(np.float64)  # its shortest text is that of another float64
    if values.size <= _ENCODED or values.ndim == 0:
        return orjson.dumps(values, option=orjson.OPT_SERIALIZE_NUMPY)
    step = max(1, _ENCODED * len(values) // values.size)
    parts = [
        orjson.dumps(values[k : k + step], option=orjson.OPT_SERIALIZE_NUMPY)[1:-1] for k in range(0, len(values), step)
    ]
    return b"[%b]" % b",".join(parts)
