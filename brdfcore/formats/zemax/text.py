"""The Zemax tabular BSDF text: parsed without trusting a count, and written.

Layout, one item a line, `#` begins a comment line: Source, Symmetry, SpectralContent, ScatterType; then
SampleRotation, AngleOfIncidence, ScatterAzimuth, ScatterRadial, each with its count and, on the next line, its angles
in degrees; then for each spectral section its name, DataBegin, the samples, DataEnd. Samples come in blocks of a line
`TIS x` and one row of radial samples an azimuth, a block for each angle of incidence of each sample rotation.
R. Rykowski, "BSDF Data Interchange File Format Specification" (2008), today "Zemax Tabular BSDF data file format".
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import FileFormatError

Float64Array = npt.NDArray[np.float64]

SYMMETRIES = {
    "planesymmetrical": "PlaneSymmetrical",
    "asymmetrical": "Asymmetrical",
    "asymmetrical4d": "Asymmetrical4D",
}
SECTIONS = {"Monochrome": ("Monochrome",), "XYZ": ("TristimulusX", "TristimulusY", "TristimulusZ")}
_AXES = {
    "SampleRotation": (-360.0, 360.0),
    "AngleOfIncidence": (0.0, 90.0),
    "ScatterAzimuth": (0.0, 360.0),
    "ScatterRadial": (0.0, 180.0),
}
#: Most angles along an axis: a hundredth of a degree over a turn.
_MOST_ANGLES = 36_001


@dataclass
class ZemaxFile:
    """What a file says; angles in degrees as written.

    values  (channels, rotations, incidences, azimuths, radials) BSDF in 1/sr.
    tis     (channels, rotations, incidences), NaN where the file says N/A.
    offset  byte at which the data begin.
    """

    symmetry: str
    content: str
    rotations: Float64Array
    incidences: Float64Array
    azimuths: Float64Array
    radials: Float64Array
    values: Float64Array
    tis: Float64Array
    comments: list[str] = field(default_factory=list)
    offset: int = 0


def bad(file: str, name: str, offset: int, reason: str, got: Any, expected: str) -> FileFormatError:
    """The error for one thing wrong: names file, field and byte offset."""
    return FileFormatError(
        "damaged_file",
        f"{file}: {name} at byte {offset}: {reason}; got {got}, expected {expected}",
        where=file,
        file=file,
        field=name,
        offset=offset,
        got=got,
        expected=expected,
    )


def parse(data: bytes, file: str) -> ZemaxFile:
    """The contents of a file; `FileFormatError` naming file, field and byte offset for what does not fit.

    Nothing is allocated by what the file claims: samples are counted against its length first.
    """
    return _Parser(data, file).parse()


class _Lines:
    """Lines that are not empty, with their byte offset; comments are put aside."""

    def __init__(self, data: bytes, file: str) -> None:
        self.file, self.end = file, len(data)
        self.comments: list[str] = []
        self._lines = self._split(data)
        self._kept: tuple[int, bytes] | None = None

    def _split(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        start = 0
        while start < len(data):
            end = data.find(b"\n", start)
            end = len(data) if end < 0 else end
            line = data[start:end].strip()
            if line.startswith(b"#"):
                self.comments.append(line[1:].decode("utf-8", errors="replace").strip())
            elif line:
                yield start, line
            start = end + 1

    def peek(self) -> tuple[int, bytes] | None:
        if self._kept is None:
            self._kept = next(self._lines, None)
        return self._kept

    def take(self, name: str) -> tuple[int, bytes]:
        line = self.peek()
        self._kept = None
        if line is None:
            raise bad(self.file, name, self.end, "the file ends before it", "the end of the file", name)
        return line


class _Parser:
    def __init__(self, data: bytes, file: str) -> None:
        self.file, self.size = file, len(data)
        self.binary = data.find(b"\0")
        self.lines = _Lines(data, file)

    def parse(self) -> ZemaxFile:
        if self.binary >= 0:
            raise bad(self.file, "text", self.binary, "a zero byte: this is no text", "0x00", "text")
        self._keyword("Source", {"measured": "Measured"})
        symmetry = self._keyword("Symmetry", SYMMETRIES)
        content = self._keyword("SpectralContent", {name.lower(): name for name in SECTIONS})
        self._keyword("ScatterType", {"brdf": "BRDF"})
        rotations, incidences, azimuths, radials = (self._axis(name) for name in _AXES)
        shape = (len(SECTIONS[content]), rotations.size, incidences.size, azimuths.size, radials.size)
        count = math.prod(shape)
        if 2 * count > self.size:  # a digit and a separator each
            counts = " x ".join(map(str, shape[1:]))
            raise bad(
                self.file, "samples", self.size, f"{counts} angles are declared",
                f"a file of {self.size} bytes", f"{count} samples, at least {2 * count} bytes",
            )  # fmt: skip
        values, tis = np.empty(shape), np.empty(shape[:3])
        start = self.lines.peek()
        for channel, name in enumerate(SECTIONS[content]):
            self._exactly(name)
            self._exactly("DataBegin")
            for k, aoi in np.ndindex(shape[1:3]):
                place = f"{name}, SampleRotation {rotations[k]:g}, AngleOfIncidence {incidences[aoi]:g}"
                tis[channel, k, aoi] = self._tis(place)
                values[channel, k, aoi] = self._block(place, azimuths, radials)
            self._exactly("DataEnd")
        rest = self.lines.peek()
        if rest is not None:
            raise bad(
                self.file, "end", rest[0], "more follows the last section", _shown(rest[1]), "the end of the file"
            )
        return ZemaxFile(
            symmetry, content, rotations, incidences, azimuths, radials, values, tis, self.lines.comments,
            start[0] if start else 0,
        )  # fmt: skip

    def _keyword(self, name: str, known: dict[str, str]) -> str:
        at, line = self.lines.take(name)
        words = line.split()
        if words[0] != name.encode() or len(words) != 2:
            raise bad(self.file, name, at, "another line stands in its place", _shown(line), f"{name} and one word")
        found = known.get(words[1].decode("latin-1").lower())
        if found is None:
            if words[1].lower() == b"btdf":
                raise bad(self.file, name, at, "transmission, which is no BRDF", "BTDF", "BRDF")
            raise bad(self.file, name, at, "unknown word", _shown(words[1]), " or ".join(known.values()))
        return found

    def _axis(self, name: str) -> Float64Array:
        at, line = self.lines.take(name)
        words = line.split()
        if words[0] != name.encode() or len(words) != 2 or not words[1].isdigit() or len(words[1]) > 10:
            raise bad(self.file, name, at, "another line stands in its place", _shown(line), f"{name} and a count")
        count = int(words[1])
        if not 1 <= count <= _MOST_ANGLES:
            raise bad(self.file, name, at, "impossible number of angles", count, f"1 to {_MOST_ANGLES}")
        at, line = self.lines.take(f"the angles of {name}")
        angles = self._numbers(name, at, line)
        if angles.size != count:
            raise bad(self.file, name, at, "the angles are not as many as declared", angles.size, str(count))
        low, high = _AXES[name]
        for k in np.flatnonzero(~((angles >= low) & (angles <= high)))[:1]:
            raise bad(
                self.file, name, at, f"angle {k + 1} is outside its range", f"{angles[k]:g}", f"{low:g} to {high:g}"
            )
        for k in np.flatnonzero(np.diff(angles) <= 0)[:1]:
            raise bad(self.file, name, at, "the angles do not ascend", f"{angles[k]:g}, {angles[k + 1]:g}", "ascending")
        return angles

    def _exactly(self, word: str) -> None:
        at, line = self.lines.take(word)
        if line != word.encode():
            raise bad(self.file, word, at, "another line stands in its place", _shown(line), word)

    def _tis(self, place: str) -> float:
        name = f"TIS of {place}"
        at, line = self.lines.take(name)
        words = line.split()
        if words[0] != b"TIS" or len(words) != 2:
            raise bad(self.file, name, at, "another line stands in its place", _shown(line), "TIS and a number")
        return math.nan if words[1].upper() in (b"N/A", b"NA") else float(self._numbers(name, at, words[1])[0])

    def _block(self, place: str, azimuths: Float64Array, radials: Float64Array) -> Float64Array:
        """(azimuths, radials) samples; a row may be broken into lines, but begins one."""
        rows = np.empty((azimuths.size, radials.size))
        for k in range(azimuths.size):
            name = f"samples of {place}, ScatterAzimuth {azimuths[k]:g}"
            got = 0
            while got < radials.size:
                at, line = self.lines.take(name)
                numbers = self._numbers(name, at, line)
                if got + numbers.size > radials.size:
                    raise bad(self.file, name, at, "too many samples", got + numbers.size, str(radials.size))
                rows[k, got : got + numbers.size] = numbers
                got += numbers.size
        return rows

    def _numbers(self, name: str, at: int, line: bytes) -> Float64Array:
        words = line.split()
        try:
            if b"_" in line:
                raise ValueError  # Python's float takes 1_000
            found = np.array([float(w) for w in words])
        except ValueError:
            for k, word in enumerate(words):
                if not _is_number(word):
                    raise bad(self.file, name, at, f"value {k + 1} of the line", _shown(word), "a number") from None
            raise
        for k in np.flatnonzero(~np.isfinite(found))[:1]:
            raise bad(
                self.file, name, at, f"value {k + 1} of the line is not finite", _shown(words[k]), "finite numbers"
            )
        return found


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return b"_" not in word


def _shown(raw: bytes) -> str:
    return repr(raw[:40].decode("latin-1"))


def compose(content: ZemaxFile) -> bytes:
    """The text of a file, lines ending in a line feed; numbers in the shortest form that reads back as the same."""
    lines = [f"# {c}" if c else "#" for c in content.comments]
    lines += ["Source\tMeasured", f"Symmetry\t{content.symmetry}", f"SpectralContent\t{content.content}"]
    lines += ["ScatterType\tBRDF"]
    axes = (content.rotations, content.incidences, content.azimuths, content.radials)
    for name, angles in zip(_AXES, axes, strict=True):
        lines += [f"{name}\t{angles.size}", "\t".join(_angle(a) for a in angles.tolist())]
    lines = [*lines, ""]
    for channel, name in enumerate(SECTIONS[content.content]):
        lines += [name, "DataBegin"]
        for k, aoi in np.ndindex(content.values.shape[1:3]):
            tis = float(content.tis[channel, k, aoi])
            lines.append(f"TIS\t{tis!r}" if math.isfinite(tis) else "TIS\tN/A")
            lines += ["\t".join(map(repr, row)) for row in content.values[channel, k, aoi].tolist()]
        lines.append("DataEnd")
    return ("\n".join(lines) + "\n").encode()


def _angle(degrees: float) -> str:
    return str(int(degrees)) if degrees.is_integer() else repr(degrees)
