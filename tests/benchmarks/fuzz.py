"""Coverage-guided fuzzing of every registered reader: `python -m tests.benchmarks.fuzz --seconds 600 [--seed N]`.

A file is mutated, read as its format and sniffed; a mutation that reaches a new pair of successive lines in
brdfcore.formats (or the table store) joins the corpus, from which the next is drawn. Anything but a `Brdf` with finite
values or a `BrdfError` is a crash, and so are a refusal of more than 1 s of processor time, untraced, a process that
grows by 200 MB and an address space past 6 GB. Readers end where measurements are checked: regridding takes a second
and parses nothing. Options are given where a reader has some without which nothing is read.
"""

from __future__ import annotations

import argparse
import contextlib
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
_LIMIT_SECONDS, _LIMIT_MEMORY, _ADDRESS_SPACE = 1.0, 200e6, 6 * 2**30
#: Text tables of every layout, and the options that leave nothing open in them.
_LAYOUTS = (
    b"Instrument: x\n\ntheta_i;theta_o;dphi;BRDF\n10;20;0;0,1\n10;20;90;0,2\n40;20;180;--\n",
    b"theta_i = 10 deg\nTIS = 0.2\ntheta_o,f\n-40,0.1\n0,0.2\n40,0.3\ntheta_i = 50\ntheta_o,f\n-40,0.1\n40,0.4\n",
    b"theta_o,10,30,50\n-40,0.1,0.2,0.3\n0,0.2,0.3,0.4\n40,0.3,0.4,-9999\n",
    b"theta_h_deg,theta_d_deg,phi_d_deg,f_r_450nm,f_r_550nm\n0,10,0,1,2\n20,30,90,0.1,0.2\n5,60,45,0.3,0.2\n",
    b"wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,f\n0,0,1,0,0.6,0.8,0.3\n0.6,0,0.8,0,0,1,0.2\n0.8,0,0.6,-0.8,0,0.6,2\n",
    b"wavelength,theta_i,theta_o,dphi,BRDF\n0.55,0,10,0,.3\n0.65,0,10,0,.2\n0.55,30,10,0,.3\n0.65,30,10,0,.2\n",
)
_OPTIONS: dict[str, tuple[dict[str, Any], ...]] = {
    "csv": ({}, {"angles": "deg", "mirror": 180, "quantity": "f"}, {"angles": "rad", "mirror": 0, "quantity": "f_cos"},
            {"matrix": "theta_i", "angles": "deg", "quantity": "f"}),
    "bsdf_xml": ({}, {"isotropic": "mean"}),
    "zemax": ({}, {"isotropic": "mean"}),
    "speos": ({}, {"isotropic": "mean"}),
    "tracepro": ({}, {"zero": "normal"}),
}  # fmt: skip
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


def _resident() -> int:
    """The most bytes that this process ever held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _refused(path: Path, format: str | None, options: dict[str, Any]) -> float:
    """Seconds of processor time until a file is refused."""
    start = time.process_time()
    with contextlib.suppress(BrdfError):
        bc.read(path, format, **options)
    return time.process_time() - start


def _rank_4(xml: bytes) -> bytes:
    """A tensor tree of rank 4 out of any BSDF file: a cell of the square for each of 16 pairs of quarters."""
    head, _, rest = xml.partition(b"<ScatteringData>")
    grid = b"{ { 0.1 } " + b"{ 0.2 } " * 15 + b"}"
    head = head.replace(b">Columns<", b">TensorTree4<")
    return head + b"<ScatteringData>" + grid + b"</ScatteringData>" + rest.partition(b"</ScatteringData>")[2]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600, help="in all, shared by the formats")
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
        corpus["csv"] = [*_LAYOUTS, *corpus.get("csv", [])]
        if "bsdf_xml" in corpus:
            corpus["bsdf_xml"].append(_rank_4(corpus["bsdf_xml"][0]))
        for name in names:
            without_regridding(name)
        resident = _resident()
        end = time.monotonic() + given.seconds
        while time.monotonic() < end:
            name = names[int(rng.integers(len(names)))]
            files = corpus[name]
            # the example itself half of the time: what grew out of it is shorter and shorter
            first = len(_LAYOUTS) if name == "csv" else 1
            base = files[int(rng.integers(first if rng.random() < 0.5 else len(files)))]
            data = mutated(base, corpus[names[int(rng.integers(len(names)))]], rng)
            target = folder / f"fuzz{FORMATS.load(name).EXTENSIONS[0]}"
            target.write_bytes(data)
            chosen = _OPTIONS.get(name, ({},))
            options = chosen[int(rng.integers(len(chosen)))]
            asked = name if options or rng.random() < 0.7 else None
            coverage.fresh = False
            start = time.process_time()
            sys.settrace(coverage.trace)
            try:
                b = bc.read(target, asked, **options)
                sys.settrace(None)
                read[name] += 1
                if not np.isfinite(b.evaluate([0.0, 0.7, 1.5], [0.2, 0.7, 1.55], 3.0)).all():
                    crashes.setdefault(f"{name}: values that are not finite", hashlib.sha256(data).hexdigest())
            except BrdfError:
                sys.settrace(None)
                seconds = time.process_time() - start
                if seconds > _LIMIT_SECONDS:  # of which tracing is the greater part
                    seconds = _refused(target, asked, options)
                    if seconds > _LIMIT_SECONDS:
                        crashes.setdefault(f"{name}: {seconds:.1f} s until refused", hashlib.sha256(data).hexdigest())
                slowest[name] = max(slowest[name], seconds)
            except Exception:
                sys.settrace(None)
                place = traceback.format_exc().strip().splitlines()
                crashes.setdefault(f"{name}: {place[-1][:150]} | {place[-3].strip()[:150]}", repr(data[:80]))
            if (grown := _resident() - resident) > _LIMIT_MEMORY:
                crashes.setdefault(f"{name}: {grown / 1e6:.0f} MB", hashlib.sha256(data).hexdigest())
            runs[name] += 1
            if coverage.fresh:
                files.append(data)
    print(
        f"seed {given.seed}, {given.seconds:g} s: {sum(runs.values())} files read, "
        f"{len(coverage.edges)} pairs of lines reached, {(_resident() - resident) / 1e6:.0f} MB grown"
    )
    for name in names:
        print(f"  {name:<14} {runs[name]:>8} files, {read[name]:>7} of them accepted, corpus {len(corpus[name]):>4}, "
              f"slowest refusal {1e3 * slowest[name]:.0f} ms")  # fmt: skip
    print(f"crashes: {len(crashes)}")
    for what, where in crashes.items():
        print(f"  {what}: {where}")
    raise SystemExit(1 if crashes else 0)


if __name__ == "__main__":
    main()
