"""pbrt-v2 measured BRDF, text (`.brdf`): a list of irregular isotropic samples, read.

Numbers separated by blanks, # begins a comment to the end of the line: how many wavelengths, the wavelengths in nm,
then for each sample theta_i, phi_i, theta_o, phi_o in radians and f in 1/sr at each wavelength. Both directions leave
the surface, so the mirror direction is phi_o - phi_i = pi. pbrt itself blends nearby samples; here every geometry is
kept. Nothing marks such a file: it is told by its first numbers.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.formats.base.format import Format
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.regrid import POLICIES, to_brdf
from brdfcore.formats.base.text_rows import MAX_NUMBERS, TextFile

#: Most wavelengths, and their range in nm: what tells a file from any other numbers.
_MOST_WAVES, _SHORTEST, _LONGEST = 2_048, 100.0, 20_000.0
_CONVENTIONS = {
    "angles": "radians, from the normal; both directions leave the surface: phi_o - phi_i = pi is the mirror direction",
    "value": "f_r in 1/sr, without the cosine, at the file's wavelengths in nm",
}


class PbrtFormat(Format):
    """pbrt-v2's irregular isotropic samples. Read to a `scattered` table."""

    name = "pbrt"
    SUMMARY = "pbrt-v2 measured BRDF, text: irregular isotropic samples at listed wavelengths"
    REFERENCE = "M. Pharr, G. Humphreys, Physically Based Rendering, 2nd edition, 2010; pbrt-v2, materials/measured.cpp"
    EXTENSIONS = (".brdf",)
    PARAMETERS = (
        Parameter(
            "invalid", "", "rows with a value that is not finite", "drop", kind="choice", choices=("drop", "error")
        ),
        *POLICIES,
    )

    def sniff(self, head: bytes) -> bool:
        """A whole number n, then n ascending wavelengths, then four angles; nothing but numbers."""
        if b"\0" in head:
            return False
        words = re.sub(rb"#[^\n]*", b"", head).split()[: _MOST_WAVES + 6]
        try:
            numbers = [float(w) for w in words]
        except ValueError:
            return False
        n = int(numbers[0]) if numbers and 1 <= numbers[0] <= _MOST_WAVES and numbers[0] == int(numbers[0]) else 0
        waves, angles = np.array(numbers[1 : n + 1]), np.array(numbers[n + 1 : n + 5])
        return bool(
            n
            and waves.size == n
            and angles.size == 4
            and ((waves >= _SHORTEST) & (waves <= _LONGEST)).all()
            and (np.diff(waves) > 0).all()
            and (np.abs(angles) <= 2 * np.pi + 1e-3).all()
        )

    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file; raises `FileFormatError` naming file, line and field, `StorageError` if it can't be opened."""
        chosen = resolve("format 'pbrt'", self.PARAMETERS, options)
        policies = {p.name: chosen[p.name] for p in POLICIES}
        return to_brdf(measurements_of(path, chosen["invalid"]), **policies)


def measurements_of(path: Path, invalid: str = "drop") -> Measurements:
    """The samples of a file; see `PbrtFormat.read`."""
    text = TextFile(path)
    words: list[str] = []
    lines: list[int] = []
    for k, line in enumerate(text.lines, 1):
        found = line.partition("#")[0].split()
        words += found
        lines += [k] * len(found)
        if len(words) > MAX_NUMBERS:
            raise text.bad(k, "numbers", f"more than {MAX_NUMBERS}", "a smaller file")
    if not words:
        raise text.bad(len(text.lines), "number of wavelengths", "nothing but comments", "numbers")
    first = text.number(words[0], lines[0], "number of wavelengths")
    if not (1 <= first <= _MOST_WAVES and first == int(first)):
        raise text.bad(lines[0], "number of wavelengths", f"{first:g}", f"a whole number from 1 to {_MOST_WAVES}")
    n = int(first)
    width = 4 + n
    rows, rest = divmod(len(words) - 1 - n, width)
    if rows < 1 or rest:
        raise text.bad(
            lines[-1], "numbers", f"{len(words)} in all",
            f"1, {n} wavelengths, and a multiple of {width}: four angles and {n} values a sample",
        )  # fmt: skip
    numbers = np.array([text.number(w, line, "number") for w, line in zip(words, lines, strict=True)])
    waves = numbers[1 : n + 1]
    if not ((waves >= _SHORTEST) & (waves <= _LONGEST)).all():
        raise text.bad(lines[1], "wavelengths", f"{waves.min():g} to {waves.max():g}", "nm, from 100 to 20,000")
    try:
        channels = Channels(waves.tolist(), "wavelength")
    except InputError as error:
        raise text.bad(lines[1], "wavelengths", error.detail[:120], "each once") from error
    table: npt.NDArray[np.float64] = numbers[n + 1 :].reshape(rows, width)
    starts = lines[n + 1 :: width]
    return Measurements.from_columns(
        table[:, 0], table[:, 1], table[:, 2], table[:, 3], table[:, 4:], channels, file=text.name, format="pbrt",
        lines=starts, degrees=False, invalid="error" if invalid == "error" else "drop", conventions=dict(_CONVENTIONS),
        found={"wavelengths": n}, source=text.source,
    )  # fmt: skip
