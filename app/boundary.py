"""The outermost layer: every request gets an id, a checked Host, an answer, a line in the log and its place in the
counters, whatever happens inside."""

from __future__ import annotations

import logging
import re
import secrets
import time
from functools import lru_cache
from itertools import count

from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

import brdfcore as bc
from app.errors import problem
from app.metrics import METHODS, NO_ROUTE
from app.quick import ACCEPT
from app.security import ALWAYS, check_host
from app.state import State

#: Ids of requests: random for the process, counted in it; asking the system for random bytes each time costs more.
_PROCESS, _COUNT = secrets.token_hex(4), count(1)
log = logging.getLogger("brdf.service")

#: A caller's own id is kept if it is safe in a header and in a log.
_REQUEST_ID = re.compile(rb"[A-Za-z0-9._-]{1,64}")
_ALWAYS = [(name.encode(), value.encode()) for name, value in ALWAYS.items()]
#: What is added to every answer, as lines of HTTP.
_OWN_LINES = b"".join(b"%b: %b\r\n" % header for header in _ALWAYS) + b"x-request-id: %b\r\nserver-timing: %b\r\n"
_NO_STORE = (b"cache-control", b"no-store")
#: Status in the log of a caller who went away before there was an answer.
_GONE = 499
_HOSTS_KEPT = 64


class Boundary:
    """Around the whole application, and therefore plain ASGI: each layer of the framework costs more than a look-up."""

    def __init__(self, app: ASGIApp, state: State) -> None:
        self.app = app
        self.state = state
        #: Host headers that were found good: judging one takes longer than a look-up.
        self._good_hosts: set[bytes] = set()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        begun = time.perf_counter()
        given, hosts, plain = b"", [], True
        for name, value in scope["headers"]:
            if name == b"host":
                hosts.append(value)
            elif name == b"x-request-id":
                given = value
            elif name == b"if-none-match" or (name == b"accept" and value not in ACCEPT):
                plain = False
        if given and _REQUEST_ID.fullmatch(given):
            request_id = given.decode()
        else:
            request_id = f"{_PROCESS}{next(_COUNT) & 0xFFFFFFFF:08x}"
        method: str = scope["method"]
        status = sent = 0
        if method == "HEAD":
            scope = {**scope, "method": "GET"}  # whose body the server drops: it keeps the scope as it was
        scope["brdf.state"] = self.state
        scope["brdf.request_id"] = request_id
        scope["brdf.plain"] = plain  # it wants JSON, whatever the caller may hold already

        def own_lines() -> bytes:
            return _OWN_LINES % (request_id.encode(), _timing(scope, time.perf_counter() - begun))

        scope["brdf.own_lines"] = own_lines

        async def send_with_headers(message: Message) -> None:
            nonlocal status, sent
            if message["type"] == "http.response.start":
                status = message["status"]
                headers: list[tuple[bytes, bytes]] = message["headers"]
                for name, _ in headers:
                    if name == b"cache-control":
                        break
                else:
                    headers.append(_NO_STORE)
                headers += (
                    *_ALWAYS,
                    (b"x-request-id", request_id.encode()),
                    (b"server-timing", _timing(scope, time.perf_counter() - begun)),
                )
            else:
                sent += len(message.get("body", b""))
            await send(message)

        metrics = self.state.metrics
        metrics.running += 1
        try:
            if len(hosts) != 1 or hosts[0] not in self._good_hosts:
                self._check_host(hosts)
            await self.app(scope, receive, send_with_headers)
        except ClientDisconnect:
            pass  # nobody is left to answer
        except Exception as error:
            if not isinstance(error, bc.BrdfError):
                log.exception("request %s failed", request_id)
            if not status and "brdf.sent" not in scope:
                await problem(error, request_id)(scope, receive, send_with_headers)
            elif "brdf.failed" not in scope:
                raise  # half an answer is out: only a broken connection tells the caller
        finally:
            metrics.running -= 1
            # both lead back to the scope: nothing of a request may wait for the collector of cycles
            scope.pop("brdf.own_lines", None)
            scope.pop("brdf.cycle", None)
            if not status and "brdf.sent" in scope:
                status, sent = 200, scope["brdf.sent"]
            seconds, route = time.perf_counter() - begun, _template(scope)
            metrics.request(route, method, status or _GONE, seconds, sent)
            if self.state.access_log is not None:
                self.state.access_log(_line(request_id, method, route, status or _GONE, seconds, sent))

    def _check_host(self, hosts: list[bytes]) -> None:
        check_host(self.state.settings, hosts)
        if len(hosts) == 1 and len(self._good_hosts) < _HOSTS_KEPT:
            self._good_hosts.add(hosts[0])


def _line(request_id: str, method: str, route: str, status: int, seconds: float, sent: int) -> str:
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


def _timing(scope: Scope, seconds: float) -> bytes:
    """Value of Server-Timing: milliseconds until the answer began, and those of them spent evaluating."""
    lookup = scope.get("brdf.lookup_seconds")
    first = "" if lookup is None else f"lookup;dur={1000 * lookup:.3f}, "
    return f"{first}app;dur={1000 * seconds:.3f}".encode()


def _template(scope: Scope) -> str:
    """The path as the OpenAPI document writes it: the same for every material."""
    own: str | None = scope.get("brdf.route")
    return own or str(getattr(scope.get("route"), "path", NO_ROUTE))
