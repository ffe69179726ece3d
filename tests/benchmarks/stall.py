"""How long others wait while a large JSON body is parsed: `python -m tests.benchmarks.stall [rounds]`.

One connection asks for a value again and again; another posts bodies. Printed: the longest waits of the first, without
and with bodies of the size that the service takes by default, and of 30 MB where its limit is lifted.
"""

from __future__ import annotations

import json
import socket
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from tests.app.running import Running, running
from tests.benchmarks.service import GET_PATH, ask, message
from tests.benchmarks.timing import machine

#: Bytes of the bodies: just below the default limit, and what a million angles take.
BODIES = (2_050_000, 30_000_000)


def body_of(size: int) -> bytes:
    """An evaluate request of about so many bytes."""
    count = size // (3 * 20)
    rng = np.random.default_rng(1)
    return json.dumps({k: (90 * rng.random(count)).tolist() for k in ("theta_i", "theta_o", "delta_phi")}).encode()


def waits(made: Running, body: bytes | None, rounds: int) -> tuple[list[float], float]:
    """Seconds of each question while `rounds` bodies are sent, and the median seconds of a body."""
    done = threading.Event()
    spent: list[float] = []

    def send() -> None:
        with socket.create_connection(("127.0.0.1", made.port)) as connection:
            for _ in range(rounds):
                if body is None:
                    time.sleep(0.2)
                    continue
                begun = time.perf_counter()
                ask(connection, message(GET_PATH.partition("?")[0], body))
                spent.append(time.perf_counter() - begun)
        done.set()

    sender = threading.Thread(target=send)
    found = []
    with socket.create_connection(("127.0.0.1", made.port)) as connection:
        request = message(GET_PATH)
        ask(connection, request)
        sender.start()
        while not done.is_set():
            begun = time.perf_counter()
            ask(connection, request)
            found.append(time.perf_counter() - begun)
            time.sleep(0.001)
    sender.join()
    return found, float(np.median(spent)) if spent else 0.0


def main() -> None:
    """Measure and print."""
    import brdfcore as bc

    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    print(machine())
    with tempfile.TemporaryDirectory() as folder:
        gold = bc.model("cook_torrance", roughness=0.3, ior="gold")
        bc.tabulate(gold, "angle_grid", shape=(46, 46, 91)).save(Path(folder) / "gold.h5")
        lifted = ("--max-json-bytes", "64MiB")
        for size, flags in ((None, ()), (BODIES[0], ()), (BODIES[1], lifted)):
            with running(Path(folder), "--log-level", "error", *flags) as made:
                while made.ask("/health/ready").status != 200:
                    time.sleep(0.1)
                body = None if size is None else body_of(size)
                found, each = waits(made, body, rounds)
            what = "no bodies" if body is None else f"{len(body) / 1e6:.1f} MB bodies, {1000 * each:.0f} ms each"
            p50, p99, worst = 1000 * np.percentile(found, [50, 99, 100])
            print(f"{what:32s} {len(found):6d} questions: p50 {p50:6.1f} ms  p99 {p99:6.1f} ms  worst {worst:6.1f} ms")


if __name__ == "__main__":
    main()
