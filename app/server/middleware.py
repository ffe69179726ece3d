"""The outermost layer: every request gets an id, a checked Host, an answer, a line in the log and its place in the
counters, whatever happens inside."""

from __future__ import annotations

import logging
import time

from brdf_service.http.errors import problem
from brdf_service.http.metrics import NO_ROUTE
from brdf_service.http.security import ALWAYS
from brdf_service.server.request import REQUEST_ID, log_line, new_id, timing
from brdf_service.state import State
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

import brdfcore as bc

log = logging.getLogger("brdf.service")

_ALWAYS = [(name.encode(), value.encode()) for name, value in ALWAYS.items()]
_NO_STORE = (b"cache-control", b"no-store")
#: Status in the log of a caller who went away before there was an answer.
_GONE = 499


class Boundary:
    """Around the whole application, and therefore plain ASGI: each layer of the framework costs more than a look-up."""

    def __init__(self, app: ASGIApp, state: State) -> None:
        self.app = app
        self.state = state

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        begun = time.perf_counter()
        given, hosts = b"", []
        for name, value in scope["headers"]:
            if name == b"host":
                hosts.append(value)
            elif name == b"x-request-id":
                given = value
        request_id = given.decode() if REQUEST_ID.fullmatch(given) else new_id()
        method: str = scope["method"]
        status = sent = 0
        if method == "HEAD":
            scope = {**scope, "method": "GET"}  # whose body the server drops: it keeps the scope as it was
        scope["brdf.state"] = self.state
        scope["brdf.request_id"] = request_id

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
                    (b"server-timing", timing(time.perf_counter() - begun, scope.get("brdf.lookup_seconds"))),
                )
            else:
                sent += len(message.get("body", b""))
            await send(message)

        metrics = self.state.metrics
        metrics.running += 1
        try:
            self.state.hosts.check(hosts)
            await self.app(scope, receive, send_with_headers)
        except ClientDisconnect:
            pass  # nobody is left to answer
        except Exception as error:
            if not isinstance(error, bc.BrdfError):
                log.exception("request %s failed", request_id)
            if not status:
                await problem(error, request_id)(scope, receive, send_with_headers)
            elif "brdf.failed" not in scope:
                raise  # half an answer is out: only a broken connection tells the caller
        finally:
            metrics.running -= 1
            seconds, route = time.perf_counter() - begun, _template(scope)
            metrics.request(route, method, status or _GONE, seconds, sent)
            if self.state.access_log is not None:
                self.state.access_log(log_line(request_id, method, route, status or _GONE, seconds, sent))


def _template(scope: Scope) -> str:
    """The path as the OpenAPI document writes it: the same for every material."""
    own: str | None = scope.get("brdf.route")
    return own or str(getattr(scope.get("route"), "path", NO_ROUTE))
