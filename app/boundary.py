"""The outermost layer: every request gets an id, a checked Host and an answer, whatever happens inside."""

from __future__ import annotations

import logging
import re
import secrets

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

import brdfcore as bc
from app.errors import problem
from app.security import ALWAYS, check_host
from app.settings import Settings

log = logging.getLogger("brdf.service")

#: A caller's own id is kept if it is safe in a header and in a log.
_REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")


class Boundary:
    """Plain ASGI middleware: a middleware class of the framework would cost more than a look-up."""

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self.app = app
        self.settings = settings

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        given = headers.get("x-request-id", "")
        request_id = given if _REQUEST_ID.fullmatch(given) else secrets.token_hex(8)
        started = False

        async def send_with_headers(message: Message) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                out = MutableHeaders(scope=message)
                out["x-request-id"] = request_id
                for name, value in ALWAYS.items():
                    out[name] = value
                out.setdefault("cache-control", "no-store")
            await send(message)

        # HEAD is GET whose body the server drops
        inner = {
            **scope,
            "brdf.request_id": request_id,
            "method": "GET" if scope["method"] == "HEAD" else scope["method"],
        }
        try:
            check_host(self.settings, (v for k, v in scope["headers"] if k == b"host"))
            await self.app(inner, receive, send_with_headers)
        except ClientDisconnect:
            return  # nobody is left to answer
        except Exception as error:
            if not isinstance(error, bc.BrdfError):
                log.exception("request %s failed", request_id)
            if started:
                raise  # half an answer is out: only a broken connection tells the caller
            await problem(error, request_id)(inner, receive, send_with_headers)
