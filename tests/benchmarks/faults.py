"""What attacks on the service find: `python -m tests.benchmarks.faults [--kills N] [--requests N] [--files N]
[--seconds N] [ROW ...]`.

Rows (default: all): `calls` every way to write with a fault at each call of the system, and small real file systems
where one can be mounted; `kills` SIGKILL at random moments; `names` many clients on one name through two services that
share a folder; `fuzz` random requests over every operation; `uploads` mutated
files of every format; `folder` a folder of many files; `bodies` clients with
bodies that never end, and analyses of 10,000 channels; `drawing` pictures that nobody asked for before; `readonly`,
`lru`, `hdf5` as in `attacks`. Each prints its figure and its goal; the exit status is 1 where one is missed.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import socket
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
from brdf_service.library.folder import Folder
from brdf_service.library.materials import Library
from brdf_service.library.writing import Condition, Writer

import brdfcore as bc
from tests.app.running import Running
from tests.benchmarks import attacks
from tests.benchmarks.attacked import client, leftovers, missed, percentile, resident, said, service, wait_ready, white
from tests.benchmarks.timing import machine
from tests.shared import FOLDER
from tests.support.faults import ERRORS, faults
from tests.support.format_examples import example

ANY = {"if-match": "*"}
#: Ends of the real files that are mutated.
REAL = (".bsdf", ".csv", ".astm", ".XML", ".mbsdf", ".dat", ".xompt", "bsdf")


# ---- rows -----------------------------------------------------------------------------------------------------


def calls(options: argparse.Namespace, folder: Path) -> None:
    table = bc.tabulate(bc.model("lambert", reflectance=[0.2, 0.4, 0.6]), "angle_grid", shape=(4, 4, 5))
    model = bc.model("ggx", roughness=0.3)
    writer = Writer(Library(Folder(folder), 10**8))
    writer.put_model("put", model, Condition())
    ways: dict[str, tuple[Path, Callable[[Path], Any]]] = {
        "save": (folder / "save.h5", table.save),
        "convert": (folder / "convert.json", lambda path: bc.convert(model, path)),
        "report": (folder / "report.json", bc.report({"white": bc.model("lambert")}, seconds=1).write),
        "put": (folder / "put.json", lambda _: writer.put_model("put", model, Condition(match=frozenset("*")))),
    }
    count = wrong = 0
    for path, call in ways.values():
        with faults(folder) as counted:
            call(path)
        old = path.read_bytes()
        for at in range(len(counted.calls)):
            for error in ERRORS:
                count += 1
                try:
                    with faults(folder, at, error):
                        call(path)
                    wrong += 1
                except bc.StorageError:
                    wrong += path.read_bytes() != old or len(leftovers(folder)) > 0
    said("calls", f"{wrong} of {count} faults lost, tore or left something, or were not told of (goal 0)", wrong == 0)
    _small_disks(table, folder)


def _small_disks(table: bc.Table, folder: Path) -> None:
    place = folder / "disk"
    place.mkdir()
    wrong = full = 0
    for size in np.linspace(8, 400, 50).astype(int):
        mounted = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={size}k", "none", str(place)], capture_output=True, check=False
        )
        if mounted.returncode:
            print("calls    no small file system can be mounted here: left out", flush=True)
            return
        try:
            for k in range(12):
                with contextlib.suppress(bc.StorageError):
                    table.save(place / f"{k}.h5")
                    continue
                full += 1
                wrong += any(bc.open_table(p).id != table.id for p in place.glob("*.h5")) or len(leftovers(place)) > 0
        finally:
            subprocess.run(["umount", str(place)], check=True)
    said("calls", f"{wrong} of {full} full disks of 50 sizes lost or left something (goal 0)", wrong == 0 and full > 0)


def kills(options: argparse.Namespace, folder: Path) -> None:
    acknowledged: dict[str, str] = {}
    lost = torn = left = stored = 0
    for _ in range(options.kills):
        with service(folder) as running, client(running) as http:
            left += len([n for n in leftovers(folder) if n.endswith(".tmp")])
            for name, id in list(acknowledged.items())[-20:]:
                answer = http.get(f"/v1/materials/{name}")
                lost += answer.status_code == 404 or (answer.status_code == 200 and answer.json()["id"] != id)
                torn += answer.status_code == 409
            until = time.monotonic() + random.uniform(0.02, 0.5)
            timer = threading.Timer(until - time.monotonic(), running.process.kill)
            timer.start()
            with contextlib.suppress(httpx2.TransportError):
                while True:
                    name = f"m{stored}"
                    answer = http.put(f"/v1/materials/{name}", json=white(random.random()))
                    if answer.status_code == 201:
                        acknowledged[name] = answer.json()["id"]
                    stored += 1
            timer.join()
    text = f"{options.kills} kills, {len(acknowledged)} acknowledged: {lost} lost, {torn} torn, {left} leftovers"
    said("kills", f"{text} (goal 0)", lost + torn + left == 0 and len(acknowledged) > 0)


def names(options: argparse.Namespace, folder: Path) -> None:
    answered: Counter[str] = Counter()
    tags: list[str] = []

    def work(running: Running, seed: int) -> None:
        rng = random.Random(seed)
        with client(running) as http:
            while time.monotonic() < until:
                value = rng.random()
                if rng.random() < 0.2:
                    code = http.delete("/v1/materials/shared", headers=ANY).status_code
                    answered[f"delete {code}"] += 1
                    continue
                answer = http.put("/v1/materials/shared", json=white(value), headers=ANY if rng.random() < 0.8 else {})
                answered[f"put {answer.status_code}"] += 1
                if answer.status_code in (200, 201):
                    tags.append(answer.headers["etag"])
                    answered["of another"] += answer.json()["metadata"]["parameters"]["reflectance"] != value

    with service(folder) as one, service(folder) as two:
        until = time.monotonic() + options.seconds
        threads = [threading.Thread(target=work, args=((one, two)[k % 2], k)) for k in range(20)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    wrong = answered["of another"] + sum(n for k, n in answered.items() if k.split()[1] in ("404", "500"))
    good = wrong == 0 and not leftovers(folder) and len(set(tags)) == len(tags) > 0
    said("names", f"20 clients, two services, {dict(answered)}: {wrong} answers for another's write (goal 0)", good)


def fuzz(options: argparse.Namespace, folder: Path) -> None:
    for name, model in (("gold", bc.model("cook_torrance", ior="gold")), ("mirror", bc.model("mirror"))):
        bc.write(model, folder / f"{name}.json", "model")
    rng = random.Random(7)
    odd = [
        "1e309",
        "-1e309",
        "nan",
        "inf",
        "",
        "0",
        "30",
        "-1",
        "90.0000001",
        "1" * 400,
        "30,60",
        "0,",
        "\ud83d",
        "%00",
    ]
    odd += ["%00", "5e-324", "1e308", "true", "[]", "{}", "' or 1", "../x", "R", "value", "polar", "64", "65", "1e2"]
    bodies = [b"", b"{", b"[]", b"\0" * 24, b'{"theta_i":1e999}', b'{"model":"lambert"}', b"[" * 5000, os.urandom(100)]
    bodies += [b'{"model":"ggx","parameters":{"roughness":1e999}}', b'{"sum":[{"model":"lambert"}]}', b'"\xff"']
    bodies += [json.dumps({"theta_i": [1e308] * 9, "theta_o": 0, "delta_phi": -1e308}).encode()]
    bodies += [json.dumps({"normals": [[0, 0, 1e308]], "views": [[0, 0, 1]], "map": [[1e308, 1e308]] * 2}).encode()]
    answered: Counter[int] = Counter()
    failed: set[str] = set()
    with service(folder) as running, client(running) as http:
        wait_ready(http)
        paths = http.get("/openapi.json").json()["paths"]
        operations = [(m, p, o) for p, by in paths.items() for m, o in by.items()]
        id = http.get("/v1/materials/gold").json()["id"]
        for _ in range(options.requests):
            method, path, declared = rng.choice(operations)
            if path.endswith(("/events", "/pareto")):
                continue
            path = path.replace("{name}", rng.choice(["gold", "gold", "mirror", "x", "%FF", "a" * 70]))
            path = path.replace("{id}", rng.choice([id, id, "0" * 64, "0" * 32, "zz"]))
            known = [p["name"] for p in declared.get("parameters", ()) if p["in"] == "query"]
            query = {n: rng.choice(odd) for n in known if rng.random() < 0.7}
            query = {k: v.encode("utf-8", "ignore").decode() for k, v in query.items()}
            headers = {"content-type": rng.choice(["application/json", "application/octet-stream", "text/plain"])}
            body = rng.choice(bodies) if method in ("post", "put") else None
            try:
                code = http.request(method, path, params=query, content=body, headers=headers).status_code
            except httpx2.TransportError as error:
                code = 0
                failed.add(f"{method} {path} {query} {type(error).__name__}")
            answered[code] += 1
            if code == 500:
                failed.add(f"{method} {path} {query}")
    bad = answered[500] + answered[0]
    for line in sorted(failed)[:10]:
        print("   ", line)
    said("fuzz", f"{sum(answered.values())} requests: {dict(sorted(answered.items()))}; {bad} bad (goal 0)", bad == 0)


def uploads(options: argparse.Namespace, data: Path) -> None:
    """Mutated files of every format, the service's own included; real ones where they lie beside the project."""
    rng = random.Random(9)
    with tempfile.TemporaryDirectory() as place:
        seeds = {n: example(n, Path(place)).read_bytes() for n in bc.formats() if n not in ("table", "model")}
    real = [path for end in REAL for path in sorted(FOLDER.glob(f"data/*/*{end}")) if path.stat().st_size < 2**21]
    seeds |= {path.name: path.read_bytes() for path in real}
    table = bc.tabulate(bc.model("lambert"), "angle_grid", shape=(4, 4, 5))
    table.save(data / ".seed.h5")
    seeds["table"] = (data / ".seed.h5").read_bytes()
    ended: Counter[str] = Counter()
    slowest, until = 0.0, time.monotonic() + options.seconds
    octet = {"content-type": "application/octet-stream"}
    with service(data, "--allow-hdf5", "--job-seconds", "60") as running, client(running) as http:
        wait_ready(http)
        number = 0
        while time.monotonic() < until:
            number += 1
            content = bytearray(seeds[rng.choice(list(seeds))])
            for _ in range(rng.randrange(1, 6)):
                place = rng.randrange(len(content))
                content[place : place + rng.choice((0, 1, 4))] = os.urandom(rng.choice((0, 1, 4)))
            begun = time.monotonic()
            answer = http.post(f"/v1/materials/u{number}/upload", content=bytes(content), headers=octet)
            if answer.status_code != 202:
                ended[str(answer.status_code)] += 1
                continue
            while (job := http.get(answer.headers["location"]).json())["finished"] is None:
                time.sleep(0.05)
            slowest = max(slowest, time.monotonic() - begun)
            ended[job["state"] if job["state"] == "done" else job["problem"]["code"]] += 1
            if job["state"] == "done" and http.get(f"/v1/materials/u{number}").status_code != 200:
                ended["stored and unreadable"] += 1
    bad = sum(n for k, n in ended.items() if k in ("500", "internal_error", "job_crashed", "job_failed"))
    bad += ended["stored and unreadable"]
    text = f"{number} mutated files of {len(seeds)} seeds: {dict(ended)}, the slowest {slowest:.1f} s"
    said("uploads", f"{text}; {bad} crashes (goal 0)", bad == 0 and slowest < 130)


def folder(options: argparse.Namespace, data: Path) -> None:
    rng = random.Random(1)
    for k in range(options.files):
        (data / f"{rng.choice(('gold', 'paint', 'steel'))}-{k:06d}.json").write_text(
            json.dumps(white(round(rng.random(), 6)))
        )
    begun = time.monotonic()
    with service(data) as running, client(running) as http:
        start = time.monotonic() - begun
        wait_ready(http)
        live: list[float] = []
        ended = threading.Event()

        def watch() -> None:
            with client(running) as own:
                while not ended.wait(0.005):
                    at = time.perf_counter()
                    own.get("/health/live")
                    live.append(time.perf_counter() - at)

        watching = threading.Thread(target=watch)
        watching.start()
        http.get("/v1/materials")
        known = [m["name"] for m in http.get("/v1/materials").json()["materials"]]
        rows = {
            "list page": (0.1, ["/v1/materials"] * 30 + [f"/v1/materials?offset={k * 97}" for k in range(30)]),
            "unknown name": (0.005, [f"/v1/materials/paint-{k}x" for k in range(200)]),
            "known name": (0.005, [f"/v1/materials/{name}" for name in known * 3]),
        }
        for what, (goal, paths) in rows.items():
            times = []
            for path in paths:
                at = time.perf_counter()
                http.get(path)
                times.append(time.perf_counter() - at)
            p50, worst = percentile(times, 0.5), percentile(times, 0.99)
            text = f"{options.files} files, {what}: median {1e3 * p50:.1f} ms, p99 {1e3 * worst:.1f} ms"
            said("folder", f"{text} (goal {1e3 * goal:g})", p50 <= goal)
        ended.set()
        watching.join()
        p999, worst = percentile(live, 0.999), max(live)
        text = f"/health/live p99.9 {1e3 * p999:.0f} ms, worst {1e3 * worst:.0f} ms (goal 50, 250)"
        said("folder", f"{text}; start {start:.1f} s (goal 3)", p999 <= 0.05 and worst <= 0.25 and start <= 3)


def bodies(options: argparse.Namespace, folder: Path) -> None:
    bc.write(bc.model("lambert", reflectance=np.linspace(0.1, 0.9, 10_000).tolist()), folder / "wide.json", "model")
    bc.write(bc.model("lambert"), folder / "white.json", "model")
    with service(folder) as running, client(running) as http:
        wait_ready(http)
        for path in ("/v1/materials/wide/checks", "/v1/materials/wide/evaluate?theta_i=3&theta_o=3&delta_phi=1"):
            http.get(path)
        before, most = resident(running.process.pid), 0.0
        until = time.monotonic() + options.seconds

        def send(_: int) -> None:
            piece = bytes(2**16)
            while time.monotonic() < until:
                with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", running.port), 5) as s:
                    s.settimeout(5)
                    head = "POST /v1/materials/white/evaluate HTTP/1.1\r\nhost: 127.0.0.1\r\n"
                    head += "content-type: application/octet-stream\r\ncontent-length: 60000000\r\n\r\n"
                    s.sendall(head.encode())
                    for _ in range(900):  # 59 of 60 MB, and then nothing
                        s.sendall(piece)
                    time.sleep(max(0.0, min(10.0, until - time.monotonic())))

        threads = [threading.Thread(target=send, args=(k,)) for k in range(200)]
        for thread in threads:
            thread.start()
        while any(thread.is_alive() for thread in threads):
            most = max(most, resident(running.process.pid))
            time.sleep(0.2)
            http.get("/v1/materials/wide/harmonics?lmax=8")
        time.sleep(3)
        after = resident(running.process.pid)
    text = (
        f"200 unfinished bodies, 10,000 channels, {options.seconds} s: {before:.0f} MB, at most {most:.0f} (goal 600)"
    )
    said("bodies", text + f", after it {after:.0f} (goal {1.15 * before:.0f})", most <= 600 and after <= 1.15 * before)


def drawing(options: argparse.Namespace, folder: Path) -> None:
    bc.write(bc.model("cook_torrance", ior="gold"), folder / "gold.json", "model")
    times: list[float] = []
    own_times: list[float] = []
    answered: Counter[int] = Counter()
    with service(folder) as running, client(running) as http:
        wait_ready(http)
        until = time.monotonic() + options.seconds

        def ask(number: int) -> None:
            with client(running) as own:
                k = 0
                while time.monotonic() < until:
                    k, at = k + 1, time.perf_counter()
                    answer = own.get(f"/v1/materials/gold/slice.svg?theta_i={number % 80}.{k:04d}{number:03d}")
                    times.append(time.perf_counter() - at)
                    own_times.append(float(answer.headers["server-timing"].partition("dur=")[2]) / 1e3)
                    answered[answer.status_code] += 1
                    if answer.status_code == 503:
                        assert int(answer.headers["retry-after"]) > 0
                        time.sleep(1)

        threads = [threading.Thread(target=ask, args=(k,)) for k in range(100)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    p99, own = percentile(times, 0.99), percentile(own_times, 0.99)
    text = f"100 clients: {dict(answered)}, p99 {p99:.2f} s (goal 3), by the service's clock {own:.2f} s"
    text += f", {answered[200] / options.seconds:.1f} pictures a second"
    said("drawing", text, p99 <= 3 and set(answered) <= {200, 503})


_ROWS = (calls, kills, names, fuzz, uploads, folder, bodies, drawing, attacks.readonly, attacks.lru, attacks.hdf5)
ROWS = {f.__name__: f for f in _ROWS}


def main() -> int:
    """Print each row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", nargs="*", metavar="ROW", choices=[[], *ROWS], default=[])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--requests", type=int, default=3000)
    parser.add_argument("--files", type=int, default=100_000)
    parser.add_argument("--seconds", type=int, default=30)
    options = parser.parse_args()
    print(machine())
    warnings.simplefilter("ignore")
    for name in options.rows or ROWS:
        with tempfile.TemporaryDirectory(prefix=f"brdf-{name}-") as place:
            begun = time.monotonic()
            ROWS[name](options, Path(place))
            print(f"{name:8s}        took {time.monotonic() - begun:.0f} s", flush=True)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
