"""Answers of one turn of the event loop, sent together at its end.

Who waits for an answer is woken when it is sent, which takes the sender as long as making the answer did. Sent in a
row, the first wakes the client and the others find it awake: with 16 requests under way a third of the time of each.
"""

from __future__ import annotations

import asyncio


class Outbox:
    """One for a server, used in its event loop only."""

    def __init__(self) -> None:
        self._waiting: dict[asyncio.Transport, bytes] = {}

    def put(self, loop: asyncio.AbstractEventLoop, transport: asyncio.Transport, answer: bytes) -> None:
        """Send `answer` when what the loop has in hand is done: before anything that is scheduled from now on. One for
        each connection."""
        self._waiting[transport] = answer
        if len(self._waiting) == 1:
            loop.call_soon(self.send)

    def holds(self, transport: asyncio.Transport) -> bool:
        """True if an answer waits for this connection."""
        return transport in self._waiting

    def send(self) -> None:
        """Send all that waits."""
        waiting, self._waiting = self._waiting, {}
        for transport, answer in waiting.items():
            if not transport.is_closing():
                transport.write(answer)
