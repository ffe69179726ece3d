"""An application whose answers a test writes down beforehand, and which remembers what it was asked."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

FACTS: dict[str, Any] = {
    "name": "grey",
    "id": "0" * 64,
    "channels": ["value"],
    "channel_kind": "name",
    "bilateral": True,
    "reciprocal": True,
    "energy_conserving": True,
    "non_negative": True,
    "has_delta": False,
    "metadata": {},
}


@dataclass(frozen=True)
class Asked:
    """One request as it arrived."""

    method: str
    path: str
    query: str
    headers: dict[str, str]
    body: bytes


@dataclass(frozen=True)
class Said:
    """One answer."""

    status: int = 200
    body: bytes = b"{}"
    headers: dict[str, str] = field(default_factory=dict)


def say_json(content: Any, status: int = 200, **headers: str) -> Said:
    named = {k.replace("_", "-"): v for k, v in headers.items()}
    return Said(status, json.dumps(content).encode(), {"content-type": "application/json", **named})


def say_problem(
    status: int, code: str, detail: str = "no", headers: dict[str, str] | None = None, **entry: Any
) -> Said:
    content = {"code": code, "detail": detail, "status": status, "errors": [entry] if entry else [], "request_id": "r1"}
    return Said(status, json.dumps(content).encode(), {"content-type": "application/problem+json", **(headers or {})})


class Scripted:
    """ASGI application: `answer(asked)` says what comes back; an exception in it breaks the request off."""

    def __init__(self, answer: Callable[[Asked], Said]) -> None:
        self.answer = answer
        self.asked: list[Asked] = []

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "lifespan":
            await receive()
            await send({"type": "lifespan.startup.complete"})
            await receive()
            await send({"type": "lifespan.shutdown.complete"})
            return
        body, more = b"", True
        while more:
            message = await receive()
            body += message.get("body", b"")
            more = message.get("more_body", False)
        headers = {k.decode(): v.decode() for k, v in scope["headers"]}
        asked = Asked(scope["method"], scope["path"], scope["query_string"].decode(), headers, body)
        self.asked.append(asked)
        said = self.answer(asked)
        named = [(k.encode(), v.encode()) for k, v in said.headers.items()]
        await send({"type": "http.response.start", "status": said.status, "headers": named})
        await send({"type": "http.response.body", "body": said.body})


def in_turn(*answers: Said) -> Scripted:
    """These answers one after the other, the last of them for ever."""
    left = list(answers)
    return Scripted(lambda asked: left.pop(0) if len(left) > 1 else left[0])


def grey_service(limit: int = 10**9, bad_point: int | None = None, seen: list[int] | None = None) -> Scripted:
    """One material whose value is theta_i + 2 theta_o; takes `limit` points, complains about the `bad_point`-th of
    all points sent so far."""
    counts = [] if seen is None else seen

    def answer(asked: Asked) -> Said:
        if not asked.path.endswith("/evaluate"):
            return say_json(FACTS)
        dtype = "f4" if "dtype=f4" in asked.query else "f8"
        numbers = np.frombuffer(asked.body, f"<{dtype}")
        if "input=vectors" in asked.query:  # of vectors: their z for the angle
            theta_i, theta_o = numbers.reshape(2, -1, 3)[:, :, 2]
        else:
            theta_i, theta_o, _ = numbers.reshape(3, -1)
        if theta_i.size > limit:
            return say_problem(413, "too_many_points", where="points", got=theta_i.size, limit=limit)
        before = sum(counts)
        counts.append(theta_i.size)
        if bad_point is not None and before <= bad_point < before + theta_i.size:
            k = bad_point - before
            return say_problem(
                422, "angle_outside", f"theta_i[{k}] = 1.5 is bad", where="theta_i", index=[k], got=1.5, expected="less"
            )
        values = (theta_i + 2 * theta_o).astype(f"<{dtype}")
        headers = {
            "x-brdf-dtype": dtype,
            "x-brdf-shape": f"{values.size},1",
            "content-type": "application/octet-stream",
        }
        return Said(200, values.tobytes(), headers)

    return Scripted(answer)
