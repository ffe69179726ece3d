"""Where the service is and how to talk to it: what a synchronous and an asynchronous client have in common."""

from __future__ import annotations

import ipaddress
import os
from dataclasses import dataclass
from typing import Any

import httpx2

from brdfcore.base.errors import InputError
from brdfcore.client.progress import Progress
from brdfcore.client.retry import RetryPolicy

KEY_VARIABLE = "BRDF_API_KEY"
#: Points sent at a time: 6 MB of float64, few enough for a bar to move, enough for the round trip not to count.
CHUNK_POINTS = 262_144
#: Values (points x channels) asked for at a time: what a service answers at most by default.
CHUNK_VALUES = 4_000_000


@dataclass(frozen=True)
class Connection:
    """Checked options of a client. `in_process` has no network and no proxy."""

    base: str
    key: str | None
    timeout: float
    policy: RetryPolicy
    progress: Progress | bool
    chunk_points: int

    @classmethod
    def checked(
        cls,
        url: str,
        key: str | None = None,
        timeout: float = 30.0,
        deadline: float = 60.0,
        progress: Progress | bool = True,
        chunk_points: int = CHUNK_POINTS,
    ) -> Connection:
        """Raises `InputError` naming the option. A key that is not given is read from BRDF_API_KEY."""
        try:
            parsed = httpx2.URL(url)
        except (httpx2.InvalidURL, TypeError) as error:
            raise _bad_url(url) from error
        if parsed.scheme not in ("http", "https") or not parsed.host or parsed.query or parsed.fragment:
            raise _bad_url(url)
        if not (isinstance(timeout, (int, float)) and 0 < timeout < float("inf")):
            raise InputError("bad_option", f"timeout: expected seconds > 0, got {timeout!r}", where="timeout")
        if not (isinstance(chunk_points, int) and chunk_points >= 1):
            raise InputError(
                "bad_option", f"chunk_points: expected a whole number >= 1, got {chunk_points!r}", where="chunk_points"
            )
        key = os.environ.get(KEY_VARIABLE) or None if key is None else key
        if key is not None and not (key.isascii() and key.isprintable() and key.strip() == key):
            raise InputError(
                "bad_key",
                f"the key must be printable ASCII without spaces around it; it is from key= or {KEY_VARIABLE}",
                where="key",
            )
        return cls(str(parsed).rstrip("/"), key, float(timeout), RetryPolicy(deadline), progress, chunk_points)

    def options(self) -> dict[str, Any]:
        """Arguments of both of httpx2's clients."""
        headers = {"user-agent": "brdf-tables-client"}
        if self.key is not None:
            headers["authorization"] = f"Bearer {self.key}"
        return {
            "base_url": self.base,
            "headers": headers,
            # a proxy of the environment cannot reach the loopback of this machine
            "trust_env": not _is_loopback(httpx2.URL(self.base).host),
            # without TLS there is nothing to verify, and reading the certificates takes 40 ms; redirects, which could
            # lead to https, are not followed
            "verify": self.base.startswith("https:"),
            "follow_redirects": False,
        }

    def chunk(self, channels: int) -> int:
        """Points of one request."""
        return max(1, min(self.chunk_points, CHUNK_VALUES // channels))


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def _bad_url(url: object) -> InputError:
    return InputError(
        "bad_url",
        f"expected the address of a service, for example http://127.0.0.1:8000; got {str(url)[:80]!r}",
        where="url",
        got=str(url)[:80],
        expected="http://host:port or https://host",
    )
