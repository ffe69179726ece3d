"""What goes wrong between client and service, and the way back from a problem+json to the library's own errors."""

from __future__ import annotations

import json
from typing import Any

from brdfcore.base.errors import (
    BrdfError,
    FileFormatError,
    InputError,
    LimitError,
    MissingExtraError,
    StorageError,
    UnknownNameError,
)


class ServiceError(BrdfError, ConnectionError):
    """The service cannot be reached, failed inside, or answered with something that no such service sends."""


class DeadlineError(ServiceError, TimeoutError):
    """The time the caller allows is over; context holds `seconds`, `attempts` and what the last attempt met."""


class AccessError(BrdfError, PermissionError):
    """The service does not let this caller do this: no key, a wrong one, or a service that only reads."""


class JobError(BrdfError, RuntimeError):
    """A job of the service failed, was cancelled or is no longer known; context holds `job`."""


#: By status of the answer. 422 is told apart by its code.
_CLASSES: dict[int, type[BrdfError]] = {
    400: InputError,
    401: AccessError,
    403: AccessError,
    404: UnknownNameError,
    405: InputError,
    406: InputError,
    408: DeadlineError,
    409: StorageError,
    410: UnknownNameError,
    412: StorageError,
    413: LimitError,
    415: InputError,
    421: AccessError,
    422: InputError,
    428: StorageError,
    501: MissingExtraError,
}
#: Codes of a 422 that say something about the content of a file.
_OF_FILES = {
    "anisotropic",
    "bad_field",
    "bad_header",
    "bad_model_file",
    "bad_row",
    "damaged_file",
    "damaged_table",
    "empty_file",
    "job_crashed",
    "job_failed",
    "no_rows",
    "not_a_table",
    "not_text",
    "schema_version",
    "unknown_format",
}
_CONTEXT = ("where", "index", "got", "expected", "limit", "hint", "offset")


def problem_of(content: bytes) -> dict[str, Any] | None:
    """The problem+json object of an answer's body, None if it is none."""
    try:
        found = json.loads(content)
    except ValueError:
        return None
    usable = isinstance(found, dict) and isinstance(found.get("code"), str) and isinstance(found.get("detail"), str)
    return found if usable else None


def error_of(status: int, content: bytes, url: str) -> BrdfError:
    """The local error that an answer of status >= 400 stands for.

    Code and detail are the service's own; context has where, index, got, expected, limit, hint and offset as far as
    the service sent them, `http_status`, and the `request_id` under which the service's log has it. An answer that is
    no problem+json (from a proxy, or from something else that listens there) is a `ServiceError`.
    """
    found = problem_of(content)
    if found is None:
        said = content[:200].decode("utf-8", "replace").strip()
        return ServiceError(
            "bad_answer",
            f"{url} answered {status} with what this service never sends: {said!r}; is it the right address?",
            where=url,
            got=said,
            http_status=status,
        )
    context: dict[str, Any] = {"http_status": status}
    entries = found.get("errors")
    if isinstance(entries, list) and entries and isinstance(entries[0], dict):
        context.update({k: entries[0][k] for k in _CONTEXT if k in entries[0]})
    if isinstance(found.get("request_id"), str):
        context["request_id"] = found["request_id"]
    return _class_of(status, found["code"])(found["code"], found["detail"], **context)


def _class_of(status: int, code: str) -> type[BrdfError]:
    if status == 422 and code in _OF_FILES:
        return FileFormatError
    if status == 422 and code.startswith("unknown_"):
        return UnknownNameError
    return _CLASSES.get(status, ServiceError if status >= 500 else BrdfError)


def with_index(error: BrdfError, index: list[int]) -> BrdfError:
    """`error` at another index: of the caller's arrays instead of the request's."""
    where, old = error.context.get("where"), error.context.get("index")
    detail = error.detail.replace(f"{where}{old}", f"{where}{index if index else ''}", 1)
    return type(error)(error.code, detail, **{**error.context, "index": index})
