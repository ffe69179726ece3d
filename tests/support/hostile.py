"""Damaged and malicious files made from a valid one, whatever its format; and a reader of many of them in a process
whose memory is watched: `python -m tests.support.hostile FORMAT[,FORMAT ...] FOLDER COUNT SEED` prints what happened, a
line of JSON for each format."""

from __future__ import annotations

import json
import re
import resource
import struct
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
#: What stands in place of a number.
BAD_NUMBERS = (b"", b"nan", b"inf", b"-1", b"0", b"1e999", b"2147483648", b"9223372036854775808", b"9" * 400, b"1_0",
               b"0x10", b"abc", b"-0.0", b"1e-320", b"1 2", b"\xff")  # fmt: skip
_WORDS = (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1)
BOMB = (
    b'<?xml version="1.0"?><!DOCTYPE z [<!ENTITY a "aaaaaaaaaa">'
    + b"".join(b'<!ENTITY %c "%s">' % (98 + k, b"&%c;" % (97 + k) * 10) for k in range(8))
    + b"]><z>&i;</z>"
)


def hostile(data: bytes, seed: int = 1) -> Iterator[tuple[str, bytes]]:
    """(label, bytes) of damaged files; deterministic."""
    rng = np.random.default_rng(seed)
    text = b"\0" not in data
    yield "empty", b""
    yield "blank", b" \n\t\n"
    yield "mark", b"\xef\xbb\xbf"
    yield "bomb", BOMB
    yield "nested [", b"[" * 200_000
    yield "nested {", b'{"a":' * 100_000
    yield "nested after the start", data[: len(data) // 2] + b"[" * 100_000
    yield "zeros", bytes(100_000)
    yield "one long line", b"1" * 2_000_000
    yield "many short lines", b"1\n" * 200_000
    yield "many commas", b"," * 1_000_000
    yield "noise", rng.integers(0, 256, 50_000, dtype=np.uint8).tobytes()
    yield "twice", data + data
    yield "start and noise", data[: len(data) // 3] + rng.integers(0, 256, 2_000, dtype=np.uint8).tobytes()
    yield "text in the middle", data[: len(data) // 2] + b"This is text, no data. \n" * 40 + data[len(data) // 2 :]
    yield "zero bytes in the middle", data[: len(data) // 2] + bytes(64) + data[len(data) // 2 :]
    cuts = {int(c) for c in rng.integers(1, len(data), 40)}
    if text:
        lines = data.splitlines(keepends=True)
        at = 0
        for k, line in enumerate(lines[:60]):
            cuts |= {at, at + len(line.rstrip())}
            at += len(line)
            yield f"line {k} left out", b"".join(lines[:k] + lines[k + 1 :])
            yield f"line {k} twice", b"".join(lines[: k + 1] + lines[k:])
        found = list(_NUMBER.finditer(data))
        picked = [*range(min(24, len(found))), *(int(k) for k in rng.integers(0, max(len(found), 1), 24))]
        for k in sorted({k for k in picked if k < len(found)}):
            begin, end = found[k].span()
            cuts |= {begin, end}
            for bad in BAD_NUMBERS:
                yield f"number {k} is {bad[:12]!r}", data[:begin] + bad + data[end:]
        for old, new in ((b"\n", b"\r\n"), (b"\n", b"\r"), (b"\t", b" "), (b",", b";"), (b".", b",")):
            yield f"{old!r} is {new!r}", data.replace(old, new)
    else:
        for at in [*range(0, min(len(data), 320), 2), *(int(k) for k in rng.integers(0, len(data), 60))]:
            word = _WORDS[int(rng.integers(len(_WORDS)))]
            for layout, size in (("<I", 4), ("<Q", 8)):
                put = struct.pack(layout, word & (2 ** (8 * size) - 1))
                yield f"{word} at byte {at}", data[:at] + put + data[at + size :]
        for at in (int(k) for k in rng.integers(0, len(data), 40)):
            for put in (np.float32(np.nan).tobytes(), np.float64(np.inf).tobytes(), np.float64(1e300).tobytes()):
                yield f"not a number at byte {at}", data[:at] + put + data[at + len(put) :]
        cuts |= set(range(0, min(len(data), 256), 3))
    for cut in sorted(cuts):
        yield f"cut at byte {cut}", data[:cut]


def _megabytes(key: str) -> float:
    return (
        next(int(line.split()[1]) for line in Path("/proc/self/status").read_text().splitlines() if key in line) / 1e3
    )


def without_regridding(name: str) -> None:
    """Let the reader of a format end where its measurements are checked: seconds of regridding are not under test."""
    import brdfcore as bc
    from brdfcore.base.registry import FORMATS

    def stand_in(measurements: Any, **_: Any) -> bc.Brdf:
        b = bc.model("lambert")
        b.report = {"done": list(measurements.done), "warnings": list(measurements.warnings), "found": {}}
        return b

    module = sys.modules[FORMATS.load(name).__module__]
    if hasattr(module, "to_brdf"):
        module.to_brdf = stand_in  # type: ignore[attr-defined]


def attack(name: str, folder: Path, count: int, seed: int) -> dict[str, Any]:
    """Read `count` hostile files (0: all) as `name`, and sniffed; what was not as it should be, and the extremes."""
    import brdfcore as bc
    from brdfcore.base.errors import BrdfError, FileFormatError
    from brdfcore.base.registry import FORMATS
    from tests.support.format_examples import example

    warnings.simplefilter("ignore")
    path = next(folder.glob(f"example-{name}.*"), None) or example(name, folder)
    without_regridding(name)
    data = path.read_bytes()
    good = bc.read(path)
    good.evaluate(0.5, 0.5, 3.0)
    variants = list(hostile(data, seed))
    if count and len(variants) > count:
        rng = np.random.default_rng(seed)
        chosen = {*range(16), *(int(k) for k in rng.choice(len(variants), count, replace=False))}
        variants = [v for k, v in enumerate(variants) if k in chosen]
    limit = int(_megabytes("VmSize") * 1e3 * 1024) + 2**30
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))
    wrong: list[str] = []
    slowest, largest, refused, read = (0.0, ""), (0.0, ""), 0, 0
    entry = FORMATS.load(name)()
    target = folder / f"hostile{path.suffix}"
    for k, (label, variant) in enumerate(variants):
        target.write_bytes(variant)
        for way in ("named", "sniffed") if not count else ("named", "sniffed")[k % 2 : k % 2 + 1]:
            Path("/proc/self/clear_refs").write_text("5")
            before, start = _megabytes("VmRSS"), time.process_time()
            try:
                b = entry.read(target) if way == "named" else bc.read(target)
                seconds = 0.0  # only a refusal has to be quick
                read += 1
                if not np.isfinite(b.evaluate([0.0, 0.5, 1.5], [0.3, 0.5, 1.5], 3.0)).all():
                    wrong.append(f"{label} ({way}): read, and its values are not finite")
            except BrdfError as error:
                seconds = time.process_time() - start
                refused += 1
                if not isinstance(error, FileFormatError):
                    wrong.append(f"{label} ({way}): {type(error).__name__}: {error.detail[:120]}")
                elif target.name not in error.detail:
                    wrong.append(f"{label} ({way}): does not name the file: {error.detail[:120]}")
                elif not {"offset", "line", "field", "where"} & set(error.context):
                    wrong.append(f"{label} ({way}): names neither field nor place: {error.detail[:120]}")
                elif len(error.detail) > 1_500:
                    wrong.append(f"{label} ({way}): an error of {len(error.detail)} characters")
            except BaseException as error:
                seconds = time.process_time() - start
                wrong.append(f"{label} ({way}): {type(error).__name__}: {error!s:.160}")
            used = _megabytes("VmHWM") - before
            slowest, largest = max(slowest, (seconds, label)), max(largest, (used, label))
    return {"wrong": wrong, "slowest": slowest, "largest": largest, "refused": refused, "read": read}


if __name__ == "__main__":
    for format_name in sys.argv[1].split(","):
        print(json.dumps(attack(format_name, Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))))
