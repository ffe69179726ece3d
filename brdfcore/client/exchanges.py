"""What is said between client and service, as generators: each yields a `Call`, a `Pause` or a `Read`, is sent what
comes of it, or thrown the error it ended in, and returns its result. `driver` runs them, for both clients.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray, as_float, broadcast_shape, flatten_vectors
from brdfcore.base.errors import BrdfError, InputError, LimitError
from brdfcore.base.sampling import Sample
from brdfcore.client import calls
from brdfcore.client.calls import Answer, Call, Pause, Read
from brdfcore.client.connection import Connection
from brdfcore.client.errors import with_index
from brdfcore.client.progress import reporting
from brdfcore.names import MATERIAL_NAME

T = TypeVar("T")
Exchange = Generator[Call | Pause | Read, Any, T]

Flat = tuple[FloatArray, FloatArray, FloatArray]

#: Angles of one albedo request: what a service takes by default.
_ANGLES_AT_ONCE = 16

_NAME = re.compile(MATERIAL_NAME)
#: What every material's metadata says.
_FACTS = ("name", "id", "channels", "bilateral", "reciprocal", "energy_conserving", "non_negative", "has_delta")


def checked_name(name: str) -> str:
    """`name`, unless no material can have it; a path is never built from such a name."""
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise InputError(
            "bad_name",
            f"no material can have the name {str(name)[:80]!r}: 1 to 64 letters, digits, dots, dashes and underscores, "
            "a letter or digit first",
            where="name",
            got=str(name)[:80],
            expected=_NAME.pattern,
        )
    return name


def materials() -> Exchange[list[dict[str, Any]]]:
    """Every line of the list, page by page, in order of the names."""
    lines: list[dict[str, Any]] = []
    seen: set[str] = set()
    call: Call | None = calls.get("materials", query={"limit": 1000})
    while call is not None:
        answer: Answer = yield call
        page = answer.json()
        if not isinstance(page, dict) or not isinstance(page.get("materials"), list):
            raise calls.unexpected(answer, "a list of materials")
        lines += page["materials"]
        following = page.get("next")
        if following is not None:
            # a page that leads back would be asked for without end
            if not isinstance(following, str) or not following.startswith("/v1/") or following in seen:
                raise calls.unexpected(answer, "the path of the next page, none that was there before")
            seen.add(following)
        call = Call("GET", following, {"accept": calls.JSON}) if following else None
    return lines


def jobs() -> Exchange[list[dict[str, Any]]]:
    """Every job that the service tells of."""
    answer: Answer = yield calls.get("jobs")
    found = answer.json()
    if not isinstance(found, dict) or not isinstance(found.get("jobs"), list):
        raise calls.unexpected(answer, "a list of jobs")
    return list(found["jobs"])


def facts(*address: str) -> Exchange[dict[str, Any]]:
    """Metadata of a material."""
    answer: Answer = yield calls.get(*address)
    found = answer.json()
    if not isinstance(found, dict) or any(k not in found for k in _FACTS):
        raise calls.unexpected(answer, "the metadata of a material")
    return found


def evaluate(id: str, stage: str, angles: Flat, out: FloatArray, connection: Connection) -> Exchange[None]:
    """f_r of n checked pairs into `out` (n, channels), in several requests if they are many.

    A service that wants fewer points at a time gets fewer. An error that names an index names it in the whole batch.
    """

    def part(start: int, stop: int) -> Call:
        a, b, c = (x[start:stop] for x in angles)
        return calls.evaluate(id, (a, b, c))

    yield from _in_parts(part, stage, out, connection)


def evaluate_vectors(
    id: str, stage: str, wi: FloatArray, wo: FloatArray, out: FloatArray, connection: Connection
) -> Exchange[None]:
    """As `evaluate`, of n pairs of checked directions (n, 3)."""
    yield from _in_parts(
        lambda start, stop: calls.evaluate_vectors(id, wi[start:stop], wo[start:stop]), stage, out, connection
    )


def uncertainty(id: str, stage: str, angles: Flat, out: FloatArray, connection: Connection) -> Exchange[None]:
    """As `evaluate`, half-widths of 95 % intervals."""

    def part(start: int, stop: int) -> Call:
        a, b, c = (x[start:stop] for x in angles)
        return calls.evaluate(id, (a, b, c), beside="uncertainty")

    yield from _in_parts(part, stage, out, connection, calls.read_widths)


def _in_parts(
    part: Callable[[int, int], Call],
    stage: str,
    out: FloatArray,
    connection: Connection,
    read: Callable[[Answer, FloatArray], None] = calls.read_values,
) -> Exchange[None]:
    count, start = out.shape[0], 0
    size = connection.chunk(out.shape[1])
    with reporting(connection.progress if count > size else False) as report:
        while start < count:
            stop = min(start + size, count)
            try:
                answer: Answer = yield part(start, stop)
            except LimitError as error:
                size = _smaller(error, stop - start)
                continue
            except InputError as error:
                raise _in_batch(error, start) from error
            read(answer, out[start:stop])
            start = stop
            report(start, count, stage)


def _smaller(error: LimitError, size: int) -> int:
    """Points to send at a time after so many were refused as too many."""
    if size == 1:
        raise error
    limit = error.context.get("limit")
    allowed = limit if error.context.get("where") == "points" and isinstance(limit, int) and limit >= 1 else size
    return min(allowed, size // 2)


def _in_batch(error: BrdfError, start: int) -> BrdfError:
    index = error.context.get("index")
    if not isinstance(index, list) or not all(isinstance(k, int) for k in index):
        return error
    return with_index(error, [start + (index[0] if index else 0)])


def in_shape(error: BrdfError, *angles: npt.ArrayLike) -> BrdfError:
    """A service's complaint about point k of a flat batch, with k as an index of the caller's broadcast arrays."""
    index = error.context.get("index")
    if "http_status" not in error.context or not isinstance(index, list) or len(index) != 1:
        return error
    shape = np.broadcast_shapes(*(np.shape(a) for a in angles))
    return with_index(error, [int(k) for k in np.unravel_index(index[0], shape)] if shape else [])


def status(id: str, angles: Flat, channels: int, connection: Connection) -> Exchange[npt.NDArray[np.uint8]]:
    """Status codes of n checked pairs, (n,)."""
    count, size = angles[0].size, connection.chunk(channels)
    codes = np.empty(count, np.uint8)
    start = 0
    while start < count:
        stop = min(start + size, count)
        a, b, c = (x[start:stop] for x in angles)
        try:
            answer: Answer = yield calls.evaluate(id, (a, b, c), beside="status")
        except LimitError as error:
            size = _smaller(error, stop - start)
            continue
        codes[start:stop] = calls.read_codes(answer, a.dtype, (stop - start, channels))
        start = stop
    return codes


def reflectances(id: str, name: str, theta_i: npt.NDArray[np.float64], channels: int) -> Exchange[FloatArray]:
    """What the albedo answer calls `name` ("values": the albedo) at n checked angles, (n, channels), float64."""
    found = np.empty((theta_i.size, channels))
    start, size = 0, _ANGLES_AT_ONCE
    while start < theta_i.size:
        part = np.s_[start : min(start + size, theta_i.size)]
        try:
            answer: Answer = yield calls.get("tables", id, "albedo", query={"theta_i": theta_i[part], "angles": "rad"})
        except LimitError as error:
            size = _smaller(error, part.stop - start)
            continue
        calls.read_rows(answer, name, found[part])
        start = part.stop
    return found


def told(id: str, name: str, query: Mapping[str, Any] | None = None) -> Exchange[dict[str, Any]]:
    """What the service says of a material under `name`, an object of JSON."""
    answer: Answer = yield calls.get("tables", id, name, query=query)
    found = answer.json()
    if not isinstance(found, dict):
        raise calls.unexpected(answer, f"the {name} of a material")
    return found


def drawn(*address: str, query: Mapping[str, Any] | None = None) -> Exchange[bytes]:
    """A picture or a text, as it comes."""
    answer: Answer = yield calls.get(*address, query=query, accept="*/*")
    return answer.content


def import_report(id: str) -> Exchange[dict[str, Any]]:
    """What reading the source found and did; {} for a model."""
    answer: Answer = yield calls.get("tables", id, "report")
    found = answer.json()
    if not isinstance(found, dict) or not isinstance(found.get("report"), dict):
        raise calls.unexpected(answer, "an import report")
    return dict(found["report"])


def sample(id: str, wi: npt.ArrayLike, u: npt.ArrayLike) -> Exchange[Sample]:
    """One direction for each wi and pair u, float64; the shape that they broadcast to."""
    held, numbers = as_float("wi", wi), as_float("u", u)
    if held.ndim == 0 or held.shape[-1] != 3:
        flatten_vectors(held, np.ones(3))  # the error that says so
    if numbers.ndim == 0 or numbers.shape[-1] != 2:
        said = f"u: expected numbers of shape (..., 2), got {numbers.shape}"
        raise InputError("not_pairs", said, where="u", got=list(numbers.shape), expected="(..., 2)")
    shape = broadcast_shape(("wi", "u"), (held.shape[:-1], numbers.shape[:-1]))
    full = [np.broadcast_to(x, (*shape, x.shape[-1])).reshape(-1, x.shape[-1]).tolist() for x in (held, numbers)]
    body = {"wi": full[0], "u": full[1]}
    answer: Answer = yield calls.send_json("POST", "tables", id, "sample", body=body, repeat="any")
    found = answer.json()
    try:
        wo, weight = (np.array(found[name], np.float64) for name in ("wo", "weight"))
        pdf = np.where(found["delta"], np.inf, np.array(found["pdf"], np.float64))
        return Sample(wo.reshape(*shape, 3), weight.reshape(*shape, len(found["channels"])), pdf.reshape(shape))
    except (KeyError, TypeError, ValueError) as error:
        raise calls.unexpected(answer, "directions, weights and densities") from error


def relight(
    id: str,
    normals: npt.ArrayLike,
    views: npt.ArrayLike,
    map: npt.ArrayLike | None,
    lights: Sequence[tuple[npt.ArrayLike, npt.ArrayLike]],
    lmax: int,
) -> Exchange[FloatArray]:
    """Radiance of n surfaces, broadcast shape + (channels,), float64."""
    pairs = flatten_vectors(normals, views)
    body: dict[str, Any] = {"normals": pairs.wi.tolist(), "views": pairs.wo.tolist()}
    if map is not None:
        body["map"] = as_float("map", map).tolist()
    if len(lights):
        body["lights"] = [
            {"direction": as_float("direction", d).tolist(), "irradiance": as_float("irradiance", e).tolist()}
            for d, e in lights
        ]
    call = calls.send_json("POST", "tables", id, "relight", body=body, query={"lmax": lmax}, repeat="any")
    answer: Answer = yield call
    found = answer.json()
    rows = found.get("radiance") if isinstance(found, dict) else None
    if not isinstance(rows, list) or not rows or not isinstance(rows[0], list):
        raise calls.unexpected(answer, "radiances of normals and channels")
    radiance = np.empty((pairs.wi.shape[0], len(rows[0])))
    calls.read_rows(answer, "radiance", radiance)
    return radiance.reshape(*pairs.shape, -1)


def plain(value: Any) -> Any:
    """`value` as JSON takes it: numpy's numbers and arrays become Python's, complex ones a refractive index."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, (set, frozenset)):
        return sorted(value)
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    return {"n": value.real, "k": value.imag} if isinstance(value, complex) else value
