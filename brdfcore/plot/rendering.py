"""A matplotlib Figure as PNG or SVG bytes: the same figure gives the same bytes, from any thread."""

from __future__ import annotations

import io
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from brdfcore.base.errors import InputError
from brdfcore.names import PictureFormat, choices
from brdfcore.plot.style import RC

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: matplotlib's settings and its font cache are global: one drawing at a time in a process.
_LOCK = threading.RLock()

MEDIA_TYPES = {"png": "image/png", "svg": "image/svg+xml"}


@contextmanager
def drawing() -> Iterator[None]:
    """Matplotlib's own defaults and `style.RC` for the time of one drawing, whatever matplotlibrc says."""
    import matplotlib.style

    with _LOCK, warnings.catch_warnings(), matplotlib.style.context(["default", RC]):
        # a name may hold letters the font lacks: they are drawn as boxes, which needs no warning on a terminal
        warnings.filterwarnings("ignore", message=".*[Gg]lyph.*missing.*")
        yield


def render(figure: Figure, format: PictureFormat = "png") -> bytes:
    """`figure` as a file's bytes; no date, no random ids, so equal figures are equal bytes.

    Raises `InputError` for another format.
    """
    if format not in choices(PictureFormat):
        raise InputError(
            "bad_option",
            f"format={format!r}: expected 'png' or 'svg'",
            where="format",
            got=str(format)[:40],
            expected="'png' or 'svg'",
        )
    # a program's version in the file would change the bytes with every upgrade
    metadata = {"Software": "brdf-tables"} if format == "png" else {"Date": None, "Creator": "brdf-tables"}
    buffer = io.BytesIO()
    with drawing():
        figure.savefig(buffer, format=format, metadata=metadata)
    return buffer.getvalue()
