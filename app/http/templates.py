"""Pages from web/*.html: `$name` is replaced, and what is replaced is escaped unless it is `Html` already."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from html import escape
from pathlib import Path
from string import Template

_WEB = Path(__file__).parents[1] / "web"


class Html(str):
    """Text that is markup on purpose."""

    __slots__ = ()


@cache
def web_file(name: str) -> bytes:
    """A file of app/web, read once: the service needs no other to show its pages."""
    return (_WEB / name).read_bytes()


@cache
def _template(name: str) -> Template:
    return Template(web_file(name).decode("utf-8"))


def fill(template: str, **values: object) -> Html:
    """web/`template` with its `$names` replaced. A name without a value is a `KeyError`: pages are tested whole."""
    safe = {k: v if isinstance(v, Html) else escape(str(v), quote=True) for k, v in values.items()}
    return Html(_template(template).substitute(safe))


def join(parts: Iterable[Html]) -> Html:
    """Markup after markup."""
    return Html("\n".join(parts))
