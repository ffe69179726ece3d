"""Who may ask and write, and what an answer may do in a browser: Host, key and Origin; content security policies."""

from __future__ import annotations

import hmac
from collections.abc import Iterable
from urllib.parse import urlsplit

from brdf_service.http.errors import ForbiddenError, ForeignHostError, KeyNeededError
from brdf_service.settings import Settings, is_loopback
from starlette.datastructures import Headers

#: On every answer.
ALWAYS = {"x-content-type-options": "nosniff"}
#: Beside the policy of whatever a browser opens as a page of its own.
NO_REFERRER = {"referrer-policy": "no-referrer"}

#: The service's own pages: nothing from anywhere else, no inline script, no frame around them.
PAGE_POLICY = (
    "default-src 'none'; img-src 'self'; style-src 'self'; script-src 'self'; connect-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
#: A figure opened by itself: it may style itself and carry its own pixels, and nothing else.
SVG_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'; sandbox"


def check_host(settings: Settings, hosts: Iterable[bytes]) -> None:
    """Refuse a request meant for another machine (`ForeignHostError`).

    A page on the internet can make a browser call 127.0.0.1 under a name of the page's own (DNS rebinding); only
    the Host header then tells. A loopback service therefore answers to loopback names alone. Elsewhere any name
    may be right, and `allowed_hosts` narrows it.
    """
    if not settings.allowed_hosts and not settings.loopback:
        return
    given = [h.decode("latin-1") for h in hosts]
    name = _name(given[0]) if len(given) == 1 else ""
    if name in settings.allowed_hosts or (not settings.allowed_hosts and is_loopback(name)):
        return
    expected = ", ".join(settings.allowed_hosts) or "localhost, 127.0.0.1 or [::1]"
    raise ForeignHostError(
        "foreign_host",
        f"this service does not answer to that Host; it answers to {expected} (setting BRDF_ALLOWED_HOSTS)",
        where="Host",
        got=", ".join(given)[:80],
        expected=expected,
    )


def check_write(settings: Settings, headers: Headers) -> None:
    """Refuse a request that would change something, unless this caller may.

    Reading is open. Writing is open on loopback, takes the key wherever one is set, and is off elsewhere. Whatever
    the address, a page from another origin may not write: the browser would do it in its visitor's name.
    """
    if not settings.writable:
        raise ForbiddenError(
            "read_only",
            "this service is read-only: it can be reached from other machines and has no key (setting BRDF_API_KEY)",
            where="X-API-Key",
        )
    origins = headers.getlist("origin")
    if origins and not (len(origins) == 1 and _same_origin(origins[0], headers.get("host", ""))):
        raise ForbiddenError(
            "foreign_origin",
            "a page from another origin may not write here",
            where="Origin",
            got=origins[0][:80],
            expected="no Origin, or this service's own",
        )
    if settings.api_key is not None:
        _check_key(settings.api_key.get_secret_value(), headers)


def _check_key(key: str, headers: Headers) -> None:
    given = headers.getlist("x-api-key")
    for value in headers.getlist("authorization"):
        scheme, _, token = value.partition(" ")
        given.append(token.strip() if scheme.lower() == "bearer" else "")
    if not given:
        how = "in the header X-API-Key or Authorization: Bearer"
        raise KeyNeededError("key_missing", f"writing takes the service's key, {how}", where="X-API-Key")
    # every one given must be right
    if not all(hmac.compare_digest(k.encode("latin-1"), key.encode()) for k in given):
        raise KeyNeededError("key_wrong", "that is not the service's key", where="X-API-Key")


def _same_origin(origin: str, host: str) -> bool:
    """True if a page at `origin` came from the machine, name and port that `host` speaks of."""
    try:
        parts = urlsplit(origin)
        default = {"http": 80, "https": 443}[parts.scheme]
        own = urlsplit(f"{parts.scheme}://{host}")
        return bool(parts.hostname) and (parts.hostname, parts.port or default) == (own.hostname, own.port or default)
    except (ValueError, KeyError):
        return False


def _name(host: str) -> str:
    """A Host header without its port, in lower case: "[::1]:8000" -> "::1"."""
    host = host.strip().lower()
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0] if host.count(":") <= 1 else host
