"""Many clients at once for a while: `python -m tests.benchmarks.soak [seconds] [clients]`; default 60 s, 200 clients.

GET, JSON, plain numbers and slices, mixed, each client waiting for its answer before it asks again.
Prints requests, errors, p50 and p99 by kind, and the memory of the service over time: it must not grow.
"""

from __future__ import annotations

import asyncio
import json
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

from tests.app.running import running
from tests.benchmarks.timing import machine

KEEP = b"Host: localhost\r\n"


Kinds = dict[str, tuple[float, list[bytes]]]


def kinds(rng: np.random.Generator) -> Kinds:
    """Share of each kind of request, and its variants as they go over the wire."""
    listed = {k: (90 * rng.random(1000)).tolist() for k in ("theta_i", "theta_o", "delta_phi")}
    text = json.dumps(listed).encode()
    binary = (1.5 * rng.random((3, 10_000))).astype("f4").tobytes()

    def post(query: str, kind: str, body: bytes) -> bytes:
        head = f"POST /v1/materials/gold/evaluate{query} HTTP/1.1\r\nContent-Type: {kind}\r\n"
        return head.encode() + KEEP + b"Content-Length: %d\r\n\r\n" % len(body) + body

    def get(path: str) -> bytes:
        return f"GET {path} HTTP/1.1\r\n".encode() + KEEP + b"\r\n"

    one = "/v1/materials/gold/evaluate?theta_i={:.4f}&theta_o=40&delta_phi=170"
    angles = 80 * rng.random(1000)

    return {
        "GET": (0.60, [get(one.format(a)) for a in angles]),
        "list": (0.05, [get("/v1/materials")]),
        "JSON, 1,000 points": (0.15, [post("", "application/json", text)]),
        "binary, 10,000 points": (0.15, [post("?dtype=f4&angles=rad", "application/octet-stream", binary)]),
        "slice as JSON": (0.04, [get(f"/v1/materials/satin/slice.json?theta_i={a:.4f},60") for a in angles]),
        "slice as SVG, drawn": (0.005, [get(f"/v1/materials/gold/slice.svg?theta_i={a:.4f}") for a in angles]),
        "slice as SVG, held": (0.005, [get("/v1/materials/gold/slice.svg?theta_i=30")]),
    }


async def client(
    port: int,
    until: float,
    seed: int,
    asked: Kinds,
    spent: dict[str, list[float]],
    wrong: list[str],
) -> None:
    """Ask and wait, until the time is over."""
    rng = np.random.default_rng(seed)
    names = list(asked)
    shares = np.array([asked[n][0] for n in names])
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=2**20)
    while time.perf_counter() < until:
        name = names[int(rng.choice(len(names), p=shares / shares.sum()))]
        begun = time.perf_counter()
        try:
            variants = asked[name][1]
            writer.write(variants[int(rng.integers(len(variants)))])
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), 60)
            length = int(head.lower().partition(b"content-length:")[2].split(b"\r\n")[0])
            await asyncio.wait_for(reader.readexactly(length), 60)
        except (OSError, asyncio.IncompleteReadError, TimeoutError) as error:
            wrong.append(f"{name}: {error!r}")
            reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=2**20)
            continue
        if b" 200 " not in head[:16]:
            wrong.append(f"{name}: {head[:200]!r}")
        spent[name].append(time.perf_counter() - begun)
    writer.close()


def resident(pid: int) -> tuple[float, float]:
    """MiB that the process holds, and those of the process that draws for it."""
    children = [c for each in Path(f"/proc/{pid}/task").glob("*/children") for c in each.read_text().split()]
    own, *others = (int(Path(f"/proc/{each}/statm").read_text().split()[1]) * 4096 / 2**20 for each in (pid, *children))
    return own, sum(others)


async def soak(port: int, pid: int, seconds: float, clients: int) -> None:
    """Ask, watch and print."""
    spent: dict[str, list[float]] = defaultdict(list)
    wrong: list[str] = []
    memory: list[tuple[float, float]] = []
    asked = kinds(np.random.default_rng(1))
    until = time.perf_counter() + seconds

    async def watch() -> None:
        while time.perf_counter() < until:
            memory.append(resident(pid))
            await asyncio.sleep(max(seconds / 12, 0.5))

    await asyncio.gather(watch(), *(client(port, until, k, asked, spent, wrong) for k in range(clients)))
    total = sum(map(len, spent.values()))
    print(f"{clients} clients, {seconds:.0f} s: {total} requests, {total / seconds:.0f}/s, {len(wrong)} errors")
    for line in wrong[:5]:
        print(f"  {line}")
    for name, values in spent.items():
        p50, p99, worst = 1000 * np.percentile(values, [50, 99, 100])
        print(f"  {name:22s} {len(values):7d}  p50 {p50:6.0f} ms  p99 {p99:6.0f} ms  worst {worst:6.0f} ms")
    p50, p99 = 1000 * np.percentile(np.concatenate([np.array(v) for v in spent.values()]), [50, 99])
    print(f"  {'all':22s} {total:7d}  p50 {p50:6.0f} ms  p99 {p99:6.0f} ms")
    print("memory over time, MiB: " + " ".join(f"{own:.0f}" for own, _ in memory))
    print("the process that draws: " + " ".join(f"{other:.0f}" for _, other in memory))


def main() -> None:
    """A service in a process of its own, and the clients here."""
    import brdfcore as bc

    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    clients = int(sys.argv[2]) if len(sys.argv) > 2 else 200
    print(machine())
    with tempfile.TemporaryDirectory() as folder:
        gold = bc.model("cook_torrance", roughness=0.3, ior="gold")
        bc.tabulate(gold, "angle_grid", shape=(46, 46, 91)).save(Path(folder) / "gold.h5")
        bc.write(bc.model("cook_torrance", roughness=0.2, ior="gold"), Path(folder) / "satin.json")
        with running(Path(folder)) as made:
            while made.ask("/health/ready").status != 200:
                time.sleep(0.1)
            asyncio.run(soak(made.port, made.process.pid, seconds, clients))
            code, _ = made.stop()
            print(f"ended with {code}")


if __name__ == "__main__":
    main()
