"""Coverage-guided fuzzing of every registered reader: `python -m tests.benchmarks.fuzz --minutes 10 [--seed N]`.

A file is mutated, read as its format and sniffed; a mutation that reaches a new pair of successive lines in
brdfcore.formats (or the table store) joins the corpus, from which the next is drawn. Anything but a `Brdf` with finite
values or a `BrdfError` is a crash, and so are a refusal of more than 2 s of processor time and an address space past
6 GB. Readers end where measurements are checked: regridding takes a second and parses nothing.
"""

from __future__ import annotations

import argparse
import hashlib
import resource
import struct
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

import brdfcore as bc
from brdfcore.base.errors import BrdfError
from brdfcore.base.registry import FORMATS
from tests.support.format_examples import example
from tests.support.hostile import BAD_NUMBERS, BOMB, without_regridding

_WATCHED = (str(Path(bc.__file__).parent / "formats"), str(Path(bc.__file__).parent / "tables" / "store.py"))
_LIMIT_SECONDS, _ADDRESS_SPACE = 2.0, 6 * 2**30
_TOKENS = (*BAD_NUMBERS, b"[", b"]", b"{", b"}", b'"', b",", b"\n", b"\r", b"#", b"null", b"TIS", b"DataEnd", b":",
           b"\\u0000", b"\xef\xbb\xbf", b"theta_i", b"VARS", b"BTDF", b"XYZ", b'"brdf"', b"lookupTable")  # fmt: skip
_WORDS = (0, 1, 2, 3, 127, 128, 255, 256, 2**15, 2**16, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1)


class Coverage:
    """Pairs of successive lines reached within the watched files."""

    def __init__(self) -> None:
        self.edges: set[tuple[str, int, int]] = set()
        self.fresh = False

    def trace(self, frame: FrameType, event: str, arg: Any) -> Any:
        file = frame.f_code.co_filename
        if not file.startswith(_WATCHED):
            return None
        last = [0]

        def line(frame: FrameType, event: str, arg: Any) -> Any:
            if event == "line":
                edge = (file, last[0], frame.f_lineno)
                last[0] = frame.f_lineno
                if edge not in self.edges:
                    self.edges.add(edge)
                    self.fresh = True
            return line

        return line


def mutated(data: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    """One to four changes: bytes, numbers, tokens, slices copied, left out, doubled or taken from another file."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        size = len(out)
        at = int(rng.integers(size + 1)) if rng.random() < 0.7 else int(rng.integers(min(size, 200) + 1))
        span = int(min(size - at, rng.geometric(0.05)))
        kind = int(rng.integers(10))
        if kind == 0 and size:
            out[min(at, size - 1)] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            out[at : at + span] = rng.integers(0, 256, span, dtype=np.uint8).tobytes()
        elif kind == 2:
            del out[at : at + span]
        elif kind == 3:
            out[at:at] = out[at : at + span]
        elif kind == 4:
            token = _TOKENS[int(rng.integers(len(_TOKENS)))]
            out[at : at + (span if rng.random() < 0.5 else 0)] = token
        elif kind == 5:
            layout = ("<I", "<Q", "<H", ">I")[int(rng.integers(4))]
            width = struct.calcsize(layout)
            word = _WORDS[int(rng.integers(len(_WORDS)))] & (2 ** (8 * width) - 1)
            out[at : at + width] = struct.pack(layout, word)
        elif kind == 6:
            out[at : at + 8] = struct.pack("<d", float(rng.choice([np.nan, np.inf, -1.0, 1e300, 1e-320])))
        elif kind == 7 and others:
            other = others[int(rng.integers(len(others)))]
            begin = int(rng.integers(len(other) + 1))
            out[at : at + span] = other[begin : begin + int(rng.geometric(0.02))]
        elif kind == 8:
            lines = bytes(out).split(b"\n")
            k, j = (int(x) for x in rng.integers(0, len(lines), 2))
            lines[k], lines[j] = lines[j], lines[k]
            out = bytearray(b"\n".join(lines))
        else:
            out = out[:at]
    return bytes(out[:2_000_000])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--seed", type=int, default=20_261_122)
    parser.add_argument("--formats", default=",".join(FORMATS.names()))
    given = parser.parse_args()
    names = given.formats.split(",")
    rng = np.random.default_rng(given.seed)
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESS_SPACE, _ADDRESS_SPACE))
    coverage = Coverage()
    runs = dict.fromkeys(names, 0)
    read = dict.fromkeys(names, 0)
    slowest = dict.fromkeys(names, 0.0)
    crashes: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        corpus = {name: [example(name, folder).read_bytes()] for name in names}
        corpus = {name: [*files, BOMB, b""] for name, files in corpus.items()}
        for name in names:
            without_regridding(name)
        end = time.monotonic() + 60 * given.minutes
        while time.monotonic() < end:
            name = names[int(rng.integers(len(names)))]
            files = corpus[name]
            # the example itself half of the time: what grew out of it is shorter and shorter
            base = files[0] if rng.random() < 0.5 else files[int(rng.integers(len(files)))]
            data = mutated(base, corpus[names[int(rng.integers(len(names)))]], rng)
            target = folder / f"fuzz{FORMATS.load(name).EXTENSIONS[0]}"
            target.write_bytes(data)
            coverage.fresh = False
            start = time.process_time()
            sys.settrace(coverage.trace)
            try:
                b = bc.read(target, name if rng.random() < 0.7 else None)
                sys.settrace(None)
                read[name] += 1
                if not np.isfinite(b.evaluate([0.0, 0.7, 1.5], [0.2, 0.7, 1.55], 3.0)).all():
                    crashes.setdefault(f"{name}: values that are not finite", hashlib.sha256(data).hexdigest())
            except BrdfError:
                sys.settrace(None)
                seconds = time.process_time() - start
                slowest[name] = max(slowest[name], seconds)
                if seconds > _LIMIT_SECONDS:
                    crashes.setdefault(f"{name}: {seconds:.1f} s until refused", hashlib.sha256(data).hexdigest())
            except Exception:
                sys.settrace(None)
                place = traceback.format_exc().strip().splitlines()
                crashes.setdefault(f"{name}: {place[-1][:150]} | {place[-3].strip()[:150]}", repr(data[:80]))
            runs[name] += 1
            if coverage.fresh:
                files.append(data)
    print(
        f"seed {given.seed}, {given.minutes:g} minutes: {sum(runs.values())} files read, "
        f"{len(coverage.edges)} pairs of lines reached"
    )
    for name in names:
        print(f"  {name:<14} {runs[name]:>8} files, {read[name]:>7} of them accepted, corpus {len(corpus[name]):>4}, "
              f"slowest refusal {1e3 * slowest[name]:.0f} ms (traced)")  # fmt: skip
    print(f"crashes: {len(crashes)}")
    for what, where in crashes.items():
        print(f"  {what}: {where}")
    raise SystemExit(1 if crashes else 0)


if __name__ == "__main__":
    main()
