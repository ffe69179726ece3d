"""Who may ask, and what an answer may do in a browser: the Host rule and the content security policies."""

from __future__ import annotations

import ipaddress
from collections.abc import Iterable

from app.errors import ForeignHostError
from app.settings import Settings

#: On every answer.
ALWAYS = {"x-content-type-options": "nosniff", "referrer-policy": "no-referrer"}

#: The service's own pages: nothing from anywhere else, no inline script, no frame around them.
PAGE_POLICY = (
    "default-src 'none'; img-src 'self'; style-src 'self'; script-src 'self'; connect-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
#: A figure opened by itself: it may style itself and carry its own pixels, and nothing else.
SVG_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'; sandbox"


def check_host(settings: Settings, hosts: Iterable[bytes]) -> None:
    """Refuse a request meant for another machine.

    A page on the internet can make a browser call 127.0.0.1 under a name of the page's own (DNS rebinding); only
    the Host header then tells. A loopback service therefore answers to loopback names alone. Elsewhere any name
    may be right, and `allowed_hosts` narrows it.
    """
    if not settings.allowed_hosts and not settings.loopback:
        return
    given = [h.decode("latin-1") for h in hosts]
    name = _name(given[0]) if len(given) == 1 else ""
    if settings.allowed_hosts:
        allowed = name in settings.allowed_hosts
        expected = ", ".join(settings.allowed_hosts)
    else:
        allowed = _is_loopback(name)
        expected = "localhost, 127.0.0.1 or [::1]"
    if not allowed:
        raise ForeignHostError(
            "foreign_host",
            f"this service does not answer to that Host; it answers to {expected} (setting BRDF_ALLOWED_HOSTS)",
            where="Host",
            got=", ".join(given)[:80],
            expected=expected,
        )


def _name(host: str) -> str:
    """A Host header without its port, in lower case: "[::1]:8000" -> "::1"."""
    host = host.strip().lower()
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0] if host.count(":") <= 1 else host


def _is_loopback(name: str) -> bool:
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False
