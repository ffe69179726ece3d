"""Errors that say what, where, got, expected and what to do.

Every error of the library is a `BrdfError`; each leaf is also the built-in exception a caller would
expect (`ValueError`, `KeyError`, `OSError`, `ImportError`), so neither kind of `except` is wrong.
"""

from __future__ import annotations

from typing import Any


class BrdfError(Exception):
    """A problem with a stable `code`, a sentence `detail` and machine-readable `context`.

    Parameters
    ----------
    code : str
        Stable snake_case identifier; the same over Python, the shell and HTTP.
    detail : str
        One sentence for a person: what, where, got, expected, what to do.
    **context
        JSON-ready facts. Keys with a shared meaning: `where` (argument, field or file), `index`
        (position in the broadcast arrays), `got`, `expected`, `offset` (byte in a file), `hint`.

    >>> try:
    ...     bc.model("lambert", reflectance=2.0)
    ... except bc.BrdfError as error:
    ...     print(error.code, error.context["expected"], isinstance(error, ValueError))
    bad_parameter [0, 1] True
    """

    def __init__(self, code: str, detail: str, **context: Any) -> None:
        super().__init__(code, detail)
        self.code = code
        self.detail = detail
        self.context = context

    def __str__(self) -> str:  # KeyError would print the repr of its argument
        return self.detail

    def __reduce__(self) -> tuple[Any, ...]:  # context must survive the way back from a child process
        return (_rebuild, (type(self), self.code, self.detail, self.context))


def _rebuild(cls: type[BrdfError], code: str, detail: str, context: dict[str, Any]) -> BrdfError:
    return cls(code, detail, **context)


class InputError(BrdfError, ValueError):
    """An argument is outside its domain or has the wrong shape, type or value."""


class UnknownNameError(BrdfError, KeyError):
    """No model, representation, format, material or channel of that name."""


class FileFormatError(BrdfError, ValueError):
    """A file is damaged or holds what this library does not take; context names file, field, offset."""


class StorageError(BrdfError, OSError):
    """A file cannot be opened, read or written."""


class LimitError(BrdfError, ValueError):
    """A request is larger than a limit; context holds `got` and `limit`."""


class MissingExtraError(BrdfError, ImportError):
    """An optional package is not installed; the message names the extra that brings it."""


def missing_extra(package: str, extra: str, purpose: str) -> MissingExtraError:
    """The error for an absent optional package."""
    return MissingExtraError(
        "missing_extra",
        f"{purpose} needs {package}, which is not installed: pip install 'brdf-tables[{extra}]'",
        where=package,
        extra=extra,
    )
