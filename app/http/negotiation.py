"""Which of the three kinds of body a request has and an answer gets: JSON, plain numbers, or a .npy file."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Literal

from brdf_service.http.errors import MediaTypeError, NotAcceptableError

Kind = Literal["json", "octet", "npy"]

#: .npy has no registered type; this is the one numpy's users send.
MEDIA_TYPES: dict[Kind, str] = {
    "json": "application/json",
    "octet": "application/octet-stream",
    "npy": "application/x-npy",
}
_KINDS: dict[str, Kind] = {media_type: kind for kind, media_type in MEDIA_TYPES.items()}
_OFFERED = ", ".join(MEDIA_TYPES.values())
_QUALITY = re.compile(r"\s*q\s*=\s*([01](?:\.[0-9]{0,3})?)\s*", re.IGNORECASE)
_MOST_RANGES = 32


def media_type_of(headers: Iterable[tuple[bytes, bytes]]) -> str:
    """What Content-Type says, without its parameters."""
    given = next((value for name, value in headers if name == b"content-type"), b"")
    return given.decode("latin-1").partition(";")[0].strip().lower()


def kind_of_body(headers: Iterable[tuple[bytes, bytes]]) -> Kind:
    """Kind of the request's body, by its Content-Type. Raises `MediaTypeError`."""
    media_type = media_type_of(headers)
    if media_type not in _KINDS:
        raise MediaTypeError(
            "unsupported_media_type",
            f"the body must be one of {_OFFERED}; say which in the header Content-Type",
            where="Content-Type",
            got=media_type[:80],
            expected=_OFFERED,
        )
    return _KINDS[media_type]


def kind_of_answer(headers: Iterable[tuple[bytes, bytes]], default: Kind) -> Kind:
    """Kind that the Accept header likes best; `default` if it takes anything, or is not there.

    Raises `NotAcceptableError` if it takes none of the three.
    """
    given = [value for name, value in headers if name == b"accept"]
    if not given:
        return default
    accept = b",".join(given).decode("latin-1")
    if accept == "*/*":
        return default
    if accept in _KINDS:
        return _KINDS[accept]
    return _best(accept, default)


def _best(accept: str, default: Kind) -> Kind:
    if not accept.strip():
        return default
    # the most specific range that fits a type decides about it (RFC 9110, 12.5.1)
    quality: dict[str, float] = {}
    for part in accept.split(",")[:_MOST_RANGES]:
        media_range, *parameters = part.split(";")
        found = [float(m[1]) for p in parameters if (m := _QUALITY.fullmatch(p))]
        quality[media_range.strip().lower()] = found[0] if found else 1.0
    rest = quality.get("application/*", quality.get("*/*", 0.0))
    offers: list[Kind] = [default, *(k for k in MEDIA_TYPES if k != default)]
    best = max(offers, key=lambda kind: quality.get(MEDIA_TYPES[kind], rest))
    if quality.get(MEDIA_TYPES[best], rest) <= 0:
        raise NotAcceptableError(
            "not_acceptable",
            f"the answer can be {_OFFERED}; the Accept header takes none of them",
            where="Accept",
            got=accept[:80],
            expected=_OFFERED,
        )
    return best
