"""The XML of a BSDF file: a small tree of elements, made without trusting it.

No document type, no entities of its own, no processing beyond elements and text; size, depth and number of elements are
bounded, so that nothing expands.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import FileFormatError
from brdfcore.formats.base.text_rows import printable

#: Deepest nesting and most elements: real files have 7 levels and a few hundred.
_DEEPEST, _MOST_ELEMENTS = 32, 20_000
#: Most numbers of one ScatteringData: a tensor tree of 128 x 128 x 128 has 2 million, a full Klems matrix 21,025.
MAX_NUMBERS = 2_200_000
_MOST_IN_MATRIX = 1_000_000


@dataclass
class Element:
    """An element: its name without a prefix, its own text, the line that it begins at."""

    name: str
    line: int
    attributes: dict[str, str] = field(default_factory=dict)
    text: str = ""
    children: list[Element] = field(default_factory=list)

    def all(self, name: str) -> list[Element]:
        return [c for c in self.children if c.name == name]

    def first(self, *names: str) -> Element | None:
        """The first child of the first child ... by these names; None where one is missing."""
        here: Element | None = self
        for name in names:
            here = next((c for c in here.children if c.name == name), None) if here is not None else None
        return here

    def words(self, *names: str) -> str:
        """The text of a descendant by its path, blanks stripped; "" where there is none."""
        found = self.first(*names)
        return " ".join(found.text.split()) if found is not None else ""


def bad(file: str, field: str, line: int, got: Any, expected: str) -> FileFormatError:
    """The error for one thing wrong: names file, field and line."""
    got, expected = printable(str(got))[:80], printable(expected)
    return FileFormatError(
        "damaged_file",
        f"{file}: line {line}, {field}: {got}; expected {expected}",
        where=field,
        file=file,
        line=line,
        field=field,
        got=got,
        expected=expected,
    )


class _Builder:
    """What the parser calls; every limit is checked before anything grows."""

    def __init__(self, parser: Any, file: str) -> None:
        self.parser, self.file = parser, file
        self.root: Element | None = None
        self.stack: list[Element] = []
        self.parts: list[list[str]] = []
        self.count = 0

    def start(self, name: str, attributes: dict[str, str]) -> None:
        self.count += 1
        line = self.parser.CurrentLineNumber
        deep = len(self.stack) >= _DEEPEST
        if deep or self.count > _MOST_ELEMENTS:
            what = f"more than {_DEEPEST} levels" if deep else f"more than {_MOST_ELEMENTS} elements"
            raise bad(self.file, "elements", line, what, "a BSDF file of WINDOW or Radiance")
        made = Element(name.rpartition(":")[2], line, attributes)
        if self.stack:
            self.stack[-1].children.append(made)
        else:
            self.root = made
        self.stack.append(made)
        self.parts.append([])

    def end(self, _: str) -> None:
        self.stack.pop().text = "".join(self.parts.pop())

    def text(self, data: str) -> None:
        if self.parts:
            self.parts[-1].append(data)

    def refuse(self, *_: Any) -> None:
        raise bad(
            self.file, "document type", self.parser.CurrentLineNumber, "a document type or entities of its own",
            "none: a BSDF file needs neither, and entities can be made to expand without end",
        )  # fmt: skip


def parse(data: bytes, file: str) -> Element:
    """The root element of a document; `FileFormatError` naming file and line for what is not well formed, or has a
    document type."""
    parser = expat.ParserCreate()
    parser.buffer_text = True
    builder = _Builder(parser, file)
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.text
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = builder.refuse
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise bad(file, "XML", error.lineno, expat.ErrorString(error.code), "well-formed XML") from error
    except (ValueError, LookupError) as error:  # an encoding that is not known
        raise bad(file, "XML", 1, str(error), "UTF-8, UTF-16 or Latin-1") from error
    if builder.root is None:
        raise bad(file, "XML", 1, "no element", "WindowElement")
    return builder.root


def numbers(element: Element, file: str, count: int) -> npt.NDArray[np.float64]:
    """The `count` finite numbers of an element's text, separated by commas or blanks."""
    # counted before they are made: a word takes far more memory than its letters
    found = words_of(element.text)
    if found != count or count > _MOST_IN_MATRIX:
        raise bad(file, element.name, element.line, f"{found} numbers", f"{count}, of at most {_MOST_IN_MATRIX}")
    return floats(element.text, element, file)


def words_of(text: str) -> int:
    """How many words a text has, separated by commas or blanks."""
    letters = np.frombuffer(text.encode("latin-1", "replace"), np.uint8)
    blank = (letters <= 32) | (letters == ord(","))
    return int((blank[:-1] & ~blank[1:]).sum() + (letters.size > 0 and not blank[0]))


def floats(text: str, element: Element, file: str) -> npt.NDArray[np.float64]:
    """The finite numbers of a text that belongs to `element`."""
    words = text.encode("latin-1", "replace").replace(b",", b" ").split()  # blanks of ASCII, as `words_of` has them
    found = np.empty(len(words))
    for k, word in enumerate(words):
        try:
            found[k] = float(word) if b"_" not in word else np.nan
        except ValueError:
            got = f"value {k + 1}, {word[:20].decode('latin-1')!r}, is no number"
            raise bad(file, element.name, element.line, got, "numbers") from None
    if not np.isfinite(found).all():
        k = int(np.flatnonzero(~np.isfinite(found))[0])
        got = f"value {k + 1}, {words[k][:20].decode('latin-1')!r}, is not a finite number"
        raise bad(file, element.name, element.line, got, "finite numbers")
    return found
