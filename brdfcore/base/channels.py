"""Channels: what the last axis of every value array means."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

import numpy as np

from brdfcore.base.errors import InputError, LimitError, UnknownNameError

ChannelKind = Literal["name", "wavelength"]

#: Largest wavelength a channel may have, nm: a kilometre.
LONGEST_WAVE = 1e12
#: Channels that a material may have: what is written has room for them wherever it is read.
MAX_CHANNELS = 16_384


class Channels(tuple[Any, ...]):
    """Immutable tuple of channel names ("R", "G", "B"; "value") or wavelengths in nm, with its kind.

    >>> bc.Channels(["R", "G", "B"]).kind, bc.Channels([450.0, 550.0]).kind
    ('name', 'wavelength')
    """

    kind: ChannelKind

    def __new__(cls, items: Iterable[str | float], kind: ChannelKind | None = None) -> Channels:
        listed = list(items)
        if len(listed) > MAX_CHANNELS:
            said = f"channels: {len(listed)}; the limit is {MAX_CHANNELS}; split the material"
            raise LimitError("too_many_channels", said, where="channels", got=len(listed), limit=MAX_CHANNELS)
        found: ChannelKind = "name" if all(isinstance(x, str) for x in listed) else "wavelength"
        kind = kind or found
        if not listed or kind not in ("name", "wavelength") or (kind == "name") != (found == "name"):
            raise InputError(
                "bad_channels",
                f"channels: expected names, or wavelengths in nm, at least one; got {listed!r} as {kind}",
                where="channels",
            )
        if kind == "wavelength":
            numbers = [x for x in listed if isinstance(x, (int, float, np.number)) and not isinstance(x, bool)]
            # compared before it is converted: a whole number may be too large for any float
            if len(numbers) < len(listed) or not all(0 < x <= LONGEST_WAVE for x in numbers):
                raise InputError("bad_channels", "channels: a wavelength is a positive number of nm", where="channels")
            listed = [float(x) for x in numbers]
        if len(set(listed)) != len(listed):
            raise InputError("bad_channels", f"channels: each only once; got {listed!r}", where="channels")
        self = super().__new__(cls, listed)
        self.kind = kind
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return (Channels, (tuple(self), self.kind))

    def find(self, name: str | float) -> int:
        """Index of a channel by name, wavelength (also as text) or position "0", "1", ..."""
        text = str(name)
        for i, channel in enumerate(self):
            if channel == name or text in (str(channel), f"{channel:g}" if self.kind == "wavelength" else channel):
                return i
        # isdigit alone is true of "²", which is no number to int
        if text.isascii() and text.isdigit() and len(text) < 10 and int(text) < len(self):
            return int(text)
        listed = ", ".join(str(c) for c in self)
        raise UnknownNameError(
            "unknown_channel",
            f"no channel {text[:40]!r}; this material has: {listed}",
            where="channel",
            got=text[:40],
            expected=listed,
        )

    def labels(self) -> list[str]:
        """What a legend prints: "R", or "550 nm"."""
        return [f"{c:g} nm" if self.kind == "wavelength" else str(c) for c in self]

    def to_json(self) -> list[Any]:
        return list(self)

    @staticmethod
    def common(a: Channels, b: Channels) -> Channels:
        """Channels of a combination: one channel broadcasts against many, otherwise they must be equal."""
        if a == b and a.kind == b.kind:
            return a
        if len(a) == 1 or len(b) == 1:
            return b if len(a) == 1 else a
        raise InputError(
            "channels_differ",
            f"channels differ: {list(a)} and {list(b)}; "
            "combine materials with equal channels, or one of them with a single channel",
            where="channels",
            got=list(b),
            expected=list(a),
        )


VALUE = Channels(("value",))
RGB = Channels(("R", "G", "B"))
