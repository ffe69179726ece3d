"""Look-ups answered in front of the framework, whose layers, matching and parsing would cost more than they do. A
single value by GET seldom gets here: see `quick`.

The same handlers are routes of the framework as well: they document themselves there, and are found there by anyone
who calls the application in another way.
"""

from __future__ import annotations

from brdf_service.routes.addressing import BY_ID_ADDRESS, BY_NAME_ADDRESS, Address
from brdf_service.routes.evaluate import HANDLERS
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

#: Third part of the path -> how it names a material, the name of that path parameter, and the route.
_ADDRESSES: dict[str, tuple[Address, str, str]] = {
    a.label: (a, str(a.parameter["name"]), f"{a.prefix}/evaluate") for a in (BY_NAME_ADDRESS, BY_ID_ADDRESS)
}


class HotPath:
    """Plain ASGI middleware that knows one kind of path: /v1/(materials|tables)/{key}/evaluate."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        path: str = scope["path"]
        if path.endswith("/evaluate"):
            parts = path.split("/")
            handler = HANDLERS.get(scope["method"])
            if len(parts) == 5 and parts[1] == "v1" and parts[2] in _ADDRESSES and parts[3] and handler is not None:
                address, parameter, route = _ADDRESSES[parts[2]]
                scope["brdf.route"] = route
                scope["path_params"] = {parameter: parts[3]}
                request = Request(scope, receive)
                response = await handler(request, address)
                await response(scope, receive, send)
                return
        await self.app(scope, receive, send)
