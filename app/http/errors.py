"""One table from exception to HTTP status, and the RFC 9457 problem that every failure is answered with."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from starlette.exceptions import HTTPException
from starlette.responses import Response

import brdfcore as bc

PROBLEM_TYPE = "application/problem+json"
_LONGEST_VALUE = 80
_LONGEST_DETAIL = 1000


class NotFoundError(bc.UnknownNameError):
    """The path names a material, a table or a page that does not exist."""


class MaterialDamagedError(bc.StorageError):
    """The material is in the data folder but its file cannot be used."""


class MalformedBodyError(bc.InputError):
    """The body is no JSON at all, so there is no field to point at."""


class MediaTypeError(bc.InputError):
    """The body is of a type that this route does not read."""


class ForeignHostError(bc.BrdfError):
    """The Host header names a machine that this service is not."""


class KeyNeededError(bc.BrdfError):
    """Writing takes a key that the request does not show."""


class ForbiddenError(bc.BrdfError):
    """Writing is not for this caller: the service is read-only, or a page from elsewhere asks."""


class NotAcceptableError(bc.BrdfError):
    """No type that the Accept header takes is offered."""


class SlowBodyError(bc.BrdfError):
    """The body did not arrive in time."""


class ConflictError(bc.BrdfError):
    """The material exists, and the request does not say that it may be replaced."""


class PreconditionError(bc.BrdfError):
    """If-Match or If-None-Match speaks of another state than the present one."""


class BusyError(bc.BrdfError):
    """As many jobs wait as may."""


class NotReadyError(bc.BrdfError):
    """The service is still warming up."""


#: The one table. The most derived class in it that an exception is an instance of gives the status.
STATUS: dict[type[Exception], int] = {
    MalformedBodyError: 400,
    KeyNeededError: 401,
    ForbiddenError: 403,
    NotFoundError: 404,
    NotAcceptableError: 406,
    SlowBodyError: 408,
    ConflictError: 409,
    MaterialDamagedError: 409,
    PreconditionError: 412,
    bc.LimitError: 413,
    MediaTypeError: 415,
    ForeignHostError: 421,
    bc.InputError: 422,
    bc.FileFormatError: 422,
    bc.UnknownNameError: 422,
    bc.BrdfError: 422,
    bc.MissingExtraError: 501,
    BusyError: 503,
    NotReadyError: 503,
    bc.StorageError: 503,
    Exception: 500,
}

#: What the router itself refuses: its exceptions carry a status but no words worth reading.
_ROUTER = {
    404: ("unknown_path", "nothing is at this path; / lists the materials and /docs lists every path"),
    405: ("method_not_allowed", "this path does not take that method; the Allow header and /docs list those it takes"),
}


def status_of(error: Exception) -> int:
    """HTTP status of an exception, by the table."""
    if isinstance(error, HTTPException):
        return error.status_code
    return next(STATUS[kind] for kind in type(error).__mro__ if kind in STATUS)


def problem(error: Exception, request_id: str) -> Response:
    """The answer to a request that ended in `error`.

    The request is never echoed: of its input only the offending value appears, cut to 80 characters.
    """
    status = status_of(error)
    headers = {"cache-control": "no-store"}
    if isinstance(error, bc.BrdfError):
        code, detail, errors = error.code, error.detail, _entries(error.context)
        if "retry_after" in error.context:
            headers["retry-after"] = str(error.context["retry_after"])
        if isinstance(error, KeyNeededError):
            headers["www-authenticate"] = 'Bearer realm="brdf"'
        if error.context.get("rest_unread"):
            headers["connection"] = "close"  # or the server would go on receiving what nobody reads
    elif isinstance(error, HTTPException):
        code, detail = _ROUTER.get(status, (f"http_{status}", str(error.detail)))
        errors = []
        headers.update(error.headers or {})
    else:
        # what went wrong inside is for the log, not for strangers
        code = "internal_error"
        detail = "an error inside the service; it is in the service's log under this request_id"
        errors = []
    body = {
        "type": "about:blank",
        "title": HTTPStatus(status).phrase,
        "status": status,
        "code": code,
        "detail": _cut(detail, _LONGEST_DETAIL),
        "errors": errors,
        "request_id": request_id,
    }
    return Response(json.dumps(body, allow_nan=False), status, headers, media_type=PROBLEM_TYPE)


def describe(error: Exception) -> dict[str, Any]:
    """Code and detail of an error that is shown inside a successful answer: a damaged file in a list."""
    if isinstance(error, bc.BrdfError):
        return {"code": error.code, "detail": _cut(error.detail, _LONGEST_DETAIL)}
    return {"code": "unreadable", "detail": "the file cannot be used; the service's log says why"}


def _entries(context: Mapping[str, Any]) -> list[dict[str, Any]]:
    """`errors[]` of the problem: where, index, got, expected, as far as the exception knows them."""
    entry = {k: plain(context[k]) for k in ("where", "index", "got", "limit", "offset") if k in context}
    # the service's own words, not the request's: lists of known names may be long
    entry.update({k: plain(context[k], _LONGEST_DETAIL) for k in ("expected", "hint") if k in context})
    return [entry] if entry else []


def plain(value: Any, longest: int = _LONGEST_VALUE) -> Any:
    """`value` as bounded JSON: whatever an exception carries, the problem can be written."""
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, int) and abs(value) < 2**53:
        return int(value)
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else str(value)
    if isinstance(value, (list, tuple)) and len(value) <= 16:
        return [plain(v, longest) for v in value]
    try:
        return _cut(str(value), longest)
    except ValueError:  # an integer of more digits than Python prints
        return "a number of several thousand digits"


def _cut(text: str, length: int) -> str:
    return text if len(text) <= length else text[: length - 1] + "…"
