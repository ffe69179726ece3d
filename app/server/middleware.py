"""The outermost layer: every request gets an id, a checked Host, an answer, a line in the log and its place in the
counters, whatever happens inside."""

from __future__ import annotations

import logging
import re
import secrets
import time
from itertools import count
from typing import cast

from brdf_service.http.errors import problem
from brdf_service.http.metrics import NO_ROUTE
from brdf_service.http.security import ALWAYS, check_host
from brdf_service.server.request_log import RequestLog
from brdf_service.state import State
from fastapi import FastAPI
from starlette.middleware.errors import ServerErrorMiddleware
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

import brdfcore as bc

log = logging.getLogger("brdf.service")

#: A caller's own id is kept if it is safe in a header and in a log. Ours are random for the process and counted in
#: it: asking the system for random bytes each time costs more.
_REQUEST_ID = re.compile(rb"[A-Za-z0-9._-]{1,64}")
_PROCESS, _COUNT = secrets.token_hex(4), count(1)
_ALWAYS = tuple((name.encode(), value.encode()) for name, value in ALWAYS.items())
_NO_STORE = (b"cache-control", b"no-store")
_HOSTS_KEPT = 64
#: Status in the log of a caller who went away before there was an answer.
_GONE = 499


class Service(FastAPI):
    """The framework's application inside our own layers, which come before all of its own: those cost as much as a
    look-up, and take an error that nobody foresaw from the layer that tells of it."""

    layers: ASGIApp

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        scope["app"] = self
        await self.layers(scope, receive, send)

    async def framework(self, scope: Scope, receive: Receive, send: Send) -> None:
        """What the framework alone answers."""
        await super().__call__(scope, receive, send)

    def build_middleware_stack(self) -> ASGIApp:
        """Its layers without the outermost, which answers such errors itself."""
        return cast(ServerErrorMiddleware, super().build_middleware_stack()).app


class RequestMiddleware:
    """Plain ASGI, as the framework's own kind of middleware costs more than a look-up."""

    def __init__(self, app: ASGIApp, state: State, request_log: RequestLog | None) -> None:
        self.app, self.state, self.request_log = app, state, request_log
        self._good_hosts: set[bytes] = set()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        begun = time.perf_counter()
        given, hosts = b"", []
        for name, value in scope["headers"]:
            if name == b"host":
                hosts.append(value)
            elif name == b"x-request-id":
                given = value
        if given and _REQUEST_ID.fullmatch(given):
            request_id = given.decode()
        else:
            request_id = f"{_PROCESS}{next(_COUNT) & 0xFFFFFFFF:08x}"
        method: str = scope["method"]
        if method == "HEAD":
            scope = {**scope, "method": "GET"}  # whose body the server drops: it keeps the scope as it was
        scope["brdf"], scope["brdf.request_id"] = self.state, request_id
        status = sent = 0

        async def send_with_headers(message: Message) -> None:
            nonlocal status, sent
            if message["type"] == "http.response.start":
                status = message["status"]
                lookup, spent = scope.get("brdf.lookup_seconds"), 1000 * (time.perf_counter() - begun)
                timing = b"app;dur=%.3f" % spent
                if lookup is not None:
                    timing = b"lookup;dur=%.3f, %b" % (1000 * lookup, timing)
                own = *_ALWAYS, (b"x-request-id", request_id.encode()), (b"server-timing", timing)
                headers = message["headers"] = [*message["headers"], *own]
                for name, _ in headers:
                    if name == b"cache-control":
                        break
                else:
                    headers.append(_NO_STORE)
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
            if status:
                raise  # half an answer is out: only a broken connection tells the caller
            await problem(error, request_id)(scope, receive, send_with_headers)
        finally:
            # the path as the OpenAPI document writes it: the same for every material
            route = str(scope.get("brdf.route") or getattr(scope.get("route"), "path", NO_ROUTE))
            seconds = time.perf_counter() - begun
            metrics.running -= 1
            if "brdf.held" in scope:
                self.state.bodies.release(scope)
            metrics.request(route, method, status or _GONE, seconds, sent)
            if self.request_log is not None:
                self.request_log.request(request_id, method, route, status or _GONE, seconds, sent)

    def _check_host(self, hosts: list[bytes]) -> None:
        """Judge a Host not seen before, which takes longer than a look-up."""
        check_host(self.state.settings, hosts)
        if len(hosts) == 1:
            if len(self._good_hosts) >= _HOSTS_KEPT:
                self._good_hosts.clear()  # with made-up ports anyone can fill it
            self._good_hosts.add(hosts[0])
