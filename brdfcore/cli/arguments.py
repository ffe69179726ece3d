"""What the shell's arguments mean: a SOURCE, a list of numbers, angles in a unit, a number of bytes."""

from __future__ import annotations

import math
import os
import re
import signal
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
import typer

from brdfcore.base.brdf import Brdf
from brdfcore.base.catalogue import model, model_from_json
from brdfcore.base.conventions import ANGLE_NAMES, FloatArray, to_radians
from brdfcore.base.errors import FileFormatError, InputError, LimitError, StorageError
from brdfcore.base.parameters import Parameter
from brdfcore.base.registry import MODELS
from brdfcore.cli.output import warn
from brdfcore.names import AngleUnit

#: Ranges of what a scene sees, FROM,TO (`angle_range`).
Light = Annotated[
    str | None,
    typer.Option("--light", metavar="FROM,TO", help="Only for light from these theta_i, degrees.", show_default=False),
]
View = Annotated[
    str | None,
    typer.Option("--view", metavar="FROM,TO", help="Only for views at these theta_o, degrees.", show_default=False),
]
Unit = Annotated[AngleUnit, typer.Option("--angles", help="Unit of the angles given and printed.")]

GRAMMAR = """A SOURCE is a file (a measured file or a table, told apart by its content) or a model with parameters:

\b
  NAME                              cook_torrance
  NAME:parameter=value,...          cook_torrance:roughness=0.1,ior=gold
  a list, one value per channel     lambert:reflectance=[0.8,0.2,0.1]
  a sum of models                   lambert:reflectance=0.3+ggx:roughness=0.2,ior=1.5
  n + ik                            cook_torrance:ior=(0.37,2.82)
  FILE:option=value,...             paint.csv:angles=deg,value=[R,G,B]

A file's options are those of its format (brdf models --all).
A model's name wins over a file of that name: write ./NAME for the file. Quote brackets for the shell."""

#: Variable that bounds the reading of one SOURCE, seconds.
READ_SECONDS = "BRDF_READ_SECONDS"
_DEEPEST = 8
_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "ki": 2**10, "mi": 2**20, "gi": 2**30}


def load(source: str, format: str | None = None, say: bool = True) -> Brdf:
    """The `Brdf` that a SOURCE names; see `GRAMMAR`. `say`: a measured file's warnings go to stderr."""
    terms = _terms(source) if format is None else [source]
    if len(terms) > 1:
        return model_from_json({"sum": [_term(term) for term in terms]})
    name, colon, rest = source.partition(":")
    if format is None and name in MODELS:
        return model(name, **_parameters(source, rest))
    path, options = file_of(source)
    if path.exists():
        from brdfcore.formats.io import files as io

        if path.is_dir():
            raise StorageError("cannot_open", f"{source}: is a folder, not a file", where=source)
        with _bounded(source):
            if options:
                format = format or io.sniff(path, [item.partition("=")[0].strip() for item in _split(source, options)])
            format = format or io.sniff(path)
            b = io.read(path, format, **(given(source, options, io.read_options(format)) if options else {}))
        for text in b.report.get("warnings", ()) if say and format != "table" else ():
            warn(text)
        return b
    if colon and re.fullmatch(r"\w+", name) and "=" in rest:
        MODELS.load(name)  # raises, with the close names
    if format is not None or "/" in source or "\\" in source or path.suffix:
        raise StorageError("cannot_open", f"{source}: no such file", where=source)
    MODELS.load(source if not colon else name)  # raises, with the close names
    raise StorageError("cannot_open", f"{source}: no such file or model", where=source)


@contextmanager
def _bounded(source: str) -> Iterator[None]:
    """`LimitError` if the block takes longer than BRDF_READ_SECONDS: a slip in a file may turn seconds into minutes."""
    text = os.environ.get(READ_SECONDS) or "900"
    try:
        seconds = float(text)
        if not 0 < seconds < 1e9:
            raise ValueError
    except ValueError:
        expected = "seconds > 0"
        said = f"{READ_SECONDS} = {text[:80]!r}: expected {expected}"
        raise InputError("bad_setting", said, where=READ_SECONDS, got=text[:80], expected=expected) from None

    def over(*_: Any) -> None:
        said = f"{source}: not read within {seconds:g} s; the variable {READ_SECONDS} allows more"
        raise LimitError("read_too_long", said, where=source, limit=seconds)

    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGALRM, over)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _terms(source: str) -> list[str]:
    """The models of NAME:...+NAME:..., in their order; one where there is no sum of models."""
    parts = re.split(r"\+(?=[A-Za-z_]\w*(?:[:+]|$))", source)
    return parts if all(part.partition(":")[0] in MODELS for part in parts) else [source]


def _term(term: str) -> dict[str, Any]:
    name, _, rest = term.partition(":")
    return {"model": name, "parameters": _parameters(term, rest)}


def file_of(source: str) -> tuple[Path, str]:
    """(path, options) of a SOURCE that is a file: FILE, or FILE:option=value,... where the file's name has no colon."""
    path = Path(source)
    if not path.exists():
        for k, character in enumerate(source):
            if character == ":" and "=" in source[k:] and Path(source[:k]).is_file():
                return Path(source[:k]), source[k + 1 :]
    return path, ""


def label(source: str) -> str:
    """What a picture calls a SOURCE: a model as it was written, a file by its name."""
    return source if source.partition(":")[0] in MODELS else file_of(source)[0].name


def _parameters(source: str, text: str) -> dict[str, Any]:
    return given(source, text, MODELS.load(source.partition(":")[0]).PARAMETERS)


def given(source: str, text: str, parameters: Iterable[Parameter]) -> dict[str, Any]:
    """`text`, parameter=value,..., as the values that a model, a reader or a writer takes and checks itself."""
    kinds = {key: p.kind for p in parameters for key in (p.name, *p.aliases)}
    found: dict[str, Any] = {}
    for item in _split(source, text):
        key, equals, value = item.partition("=")
        key = key.strip()
        if not equals or not key:
            raise _bad_source(source, f"{item.strip()!r} is no parameter=value")
        if key in found:
            raise _bad_source(source, f"{key} is given twice")
        value = value.strip()
        literal = kinds.get(key) in ("choice", "text")  # "1" stays text where text is asked for
        found[key] = value if literal else _value(source, value)
    return found


def _split(source: str, text: str) -> list[str]:
    """`text` at the commas outside brackets."""
    parts, depth, start = [], 0, 0
    for k, character in enumerate(text):
        depth += (character in "([") - (character in ")]")
        if depth < 0 or depth > _DEEPEST:
            raise _bad_source(source, "the brackets don't match")
        if character == "," and depth == 0:
            parts.append(text[start:k])
            start = k + 1
    if depth:
        raise _bad_source(source, "the brackets don't match")
    if text.strip():
        parts.append(text[start:])
    return parts


def _value(source: str, text: str) -> Any:
    """A number, complex number, true, false, [list], (n,k) or a name."""
    text = text.strip()
    if len(text) >= 2 and text[0] + text[-1] in ("[]", "()"):
        items = [_value(source, part) for part in _split(source, text[1:-1])]
        return items if text[0] == "[" else tuple(items)
    if text in ("true", "false"):
        return text == "true"
    for kind in (float, complex):
        try:
            return kind(text.replace("i", "j") if kind is complex else text)
        except ValueError:
            continue
    if not text or any(c in text for c in "[]()="):
        raise _bad_source(source, f"{text!r} is no value")
    return text


def _bad_source(source: str, why: str) -> InputError:
    return InputError(
        "bad_source",
        f"{source}: {why}; expected e.g. cook_torrance:roughness=0.1,ior=gold",
        where="SOURCE",
        got=source[:200],
        expected="NAME:parameter=value,...",
    )


def numbers(name: str, text: str) -> npt.NDArray[np.float64]:
    """A comma-separated list, 1-D; one number is a list of one."""
    try:
        return np.array([float(part) for part in text.split(",")], dtype=np.float64)
    except ValueError:
        raise InputError(
            "not_numbers", f"{name} = {text!r}: expected numbers separated by commas, e.g. 30,45", where=name, got=text
        ) from None


def angle_range(name: str, text: str) -> tuple[float, float]:
    """FROM,TO of a polar angle in degrees, as radians."""
    values = numbers(name, text)
    if values.size != 2 or not 0 <= values[0] < values[1] <= 90:
        raise InputError(
            "bad_option", f"{name} = {text!r}: expected FROM,TO in degrees, 0 <= FROM < TO <= 90, e.g. 0,70", where=name
        )
    low, high = np.radians(values).tolist()
    return low, high


def whole_numbers(name: str, text: str) -> tuple[int, ...]:
    """A comma-separated list of whole numbers, e.g. a table's shape."""
    values = numbers(name, text)
    if not (np.isfinite(values).all() and (values == np.rint(values)).all()):
        raise InputError("not_numbers", f"{name} = {text!r}: expected whole numbers, e.g. 90,90,180", where=name)
    return tuple(int(x) for x in values)


def byte_count(name: str, text: str) -> int:
    """Bytes as 4500000, 4.5MB (10**6) or 4.5MiB (2**20)."""
    found = re.fullmatch(r"\s*([0-9.]+(?:e[0-9]+)?)\s*([kmg]i?)?b?\s*", text, re.IGNORECASE)
    try:
        if found is None:
            raise ValueError
        amount = float(found[1]) * _UNITS[(found[2] or "").lower()]
    except ValueError:
        raise InputError(
            "bad_bytes", f"{name} = {text!r}: expected bytes, e.g. 4500000, 4.5MB or 4MiB", where=name, got=text
        ) from None
    return int(amount)


def angle(name: str, values: npt.NDArray[np.float64], unit: str) -> FloatArray:
    """Angles of the shell in radians, checked in the unit they were typed in.

    A theta past the horizon would be refused later as well, but in radians, which nobody typed.
    """
    polar = name != "delta_phi"
    limit = 90.0 if unit == "deg" else math.pi / 2
    with np.errstate(invalid="ignore"):
        bad = ~((values >= 0) & (values <= limit)) if polar else ~np.isfinite(values)
    if bad.any():
        first = int(np.flatnonzero(bad)[0])
        expected = f"0 to {'90' if unit == 'deg' else 'pi/2'}" if polar else "a finite number"
        raise InputError(
            "angle_outside",
            f"{name}[{first}] = {float(values[first])!r} is outside {expected} "
            f"({'degrees' if unit == 'deg' else 'radians; see --angles'}); {int(bad.sum())} such value(s)",
            where=name,
            index=[first],
            got=str(values[first]),
            expected=expected,
        )
    return to_radians(values) if unit == "deg" else values


def read_directions(path: str, unit: str) -> list[npt.NDArray[np.float64]]:
    """theta_i, theta_o and delta_phi, each (n,), from a file of three columns ("-" is stdin), not converted.

    Columns are separated by commas, semicolons or blanks; # begins a comment. A header naming theta_i, theta_o and
    delta_phi (perhaps with _deg or _rad) may put them in any order among others; without one there are three.
    """
    try:
        text = sys.stdin.read() if path == "-" else Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise StorageError("cannot_open", f"{path}: {error.strerror or error}", where=path) from error
    except UnicodeDecodeError as error:
        raise FileFormatError("not_text", f"{path}: is no text (byte {error.start})", where=path) from error
    columns: Sequence[int] = (0, 1, 2)
    rows: list[list[float]] = []
    width = 3
    for number, line in enumerate(text.splitlines(), 1):
        cells = [c.strip().strip('"') for c in re.split(r"[,;]|\s+", line.partition("#")[0].strip())]
        if cells == [""]:
            continue
        if not rows and width == 3 and cells[0][:1].isalpha() and cells[0].lower() not in ("nan", "inf"):
            columns, width = _header(path, cells, unit), len(cells)
            continue
        try:
            if len(cells) != width:
                raise ValueError
            rows.append([float(cells[c]) for c in columns])
        except ValueError:
            raise FileFormatError(
                "bad_row",
                f"{path}, line {number}: expected {width} numbers, got {line.strip()[:80]!r}",
                where=path,
                line=number,
                got=line.strip()[:80],
            ) from None
    if not rows:
        raise FileFormatError("no_rows", f"{path}: holds no directions", where=path)
    return list(np.array(rows, dtype=np.float64).T)


def _header(path: str, cells: Iterable[str], unit: str) -> list[int]:
    names = [c.lower() for c in cells]
    columns = []
    for wanted in ANGLE_NAMES:
        found = [k for k, n in enumerate(names) if n in (wanted, f"{wanted}_deg", f"{wanted}_rad")]
        if len(found) != 1:
            raise FileFormatError(
                "bad_header", f"{path}: the header {','.join(names)[:120]!r} has no single column {wanted}", where=path
            )
        stated = names[found[0]].removeprefix(wanted).lstrip("_")
        if stated and stated != unit:
            raise InputError(
                "unit_mismatch",
                f"{path}: the header says {names[found[0]]}; pass --angles {stated}",
                where="--angles",
                got=unit,
                expected=stated,
            )
        columns.append(found[0])
    return columns
