"""What every request leaves behind, whichever way it was answered: its id, its Host judged, its times, its line."""

from __future__ import annotations

import re
import secrets
import time
from functools import lru_cache
from itertools import count

from brdf_service.http.metrics import METHODS
from brdf_service.http.security import check_host
from brdf_service.settings import Settings

#: A caller's own id is kept if it is safe in a header and in a log.
REQUEST_ID = re.compile(rb"[A-Za-z0-9._-]{1,64}")

#: Ids of requests: random for the process, counted in it; asking the system for random bytes each time costs more.
_PROCESS, _COUNT = secrets.token_hex(4), count(1)
_HOSTS_KEPT = 64


def new_id() -> str:
    """Id of a request whose caller gave none."""
    return f"{_PROCESS}{next(_COUNT) & 0xFFFFFFFF:08x}"


class Hosts:
    """Host headers that were found good: judging one takes longer than a look-up."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._good: set[bytes] = set()

    def known(self, hosts: list[bytes]) -> bool:
        """True if the one Host of a request is good and was seen before."""
        return len(hosts) == 1 and hosts[0] in self._good

    def check(self, hosts: list[bytes]) -> None:
        """Refuse a request meant for another machine; see `security.check_host`."""
        if self.known(hosts):
            return
        check_host(self._settings, hosts)
        if len(hosts) == 1:
            if len(self._good) >= _HOSTS_KEPT:
                self._good.clear()  # with made-up ports anyone can fill it
            self._good.add(hosts[0])


def timing(seconds: float, lookup: float | None) -> bytes:
    """Value of Server-Timing: milliseconds until the answer began, and those of them spent evaluating."""
    first = "" if lookup is None else f"lookup;dur={1000 * lookup:.3f}, "
    return f"{first}app;dur={1000 * seconds:.3f}".encode()


def log_line(request_id: str, method: str, route: str, status: int, seconds: float, sent: int) -> str:
    """One line of JSON. It holds nothing that the caller wrote, a request id of safe characters aside."""
    now = time.time()
    return (
        f'{{"time":"{_second(int(now))}.{int(now * 1000) % 1000:03d}Z","id":"{request_id}",'
        f'"method":"{method if method in METHODS else "other"}","route":"{route}","status":{status},'
        f'"ms":{1000 * seconds:.3f},"bytes":{sent}}}\n'
    )


@lru_cache(maxsize=4)
def _second(now: int) -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(now))
