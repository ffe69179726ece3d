"""Rows of `faults`: a service that others can reach and nobody may write to, more tables than it may hold, table files
from outside."""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import brdfcore as bc
from tests.benchmarks.attacked import client, said, service, wait_ready, white

OCTET = {"content-type": "application/octet-stream"}
_LOOKUP = "evaluate?theta_i=30&theta_o=40&delta_phi=170"


def readonly(options: argparse.Namespace, data: Path) -> None:
    """Every operation that is no GET, with every header that might pass for a permission, without a key."""
    bc.write(bc.model("lambert"), data / "white.json", "model")
    bc.tabulate(bc.model("lambert"), "angle_grid", shape=(3, 3, 3)).save(data / "table.h5")
    guises: list[dict[str, str]] = [{}, {"x-api-key": ""}, {"x-api-key": "none"}, {"authorization": "Bearer none"}]
    guises += [{name: "127.0.0.1"} for name in ("x-forwarded-for", "x-real-ip", "forwarded", "x-forwarded-host")]
    guises += [{"host": "localhost"}, {"origin": "http://127.0.0.1"}, {"x-http-method-override": "PUT"}]
    bodies: list[bytes] = [b"", json.dumps(white(0.3)).encode(), (data / "table.h5").read_bytes(), bytes(24)]
    answered: Counter[int] = Counter()
    with service(data, "--host", "0.0.0.0", "--allow-hdf5") as running, client(running) as http:
        wait_ready(http)
        before = _files(data)
        reading = ("/evaluate", "/relight")  # a POST that only asks
        for path, by in http.get("/openapi.json").json()["paths"].items():
            for method in {*by, "put", "post", "delete", "patch"} - {"get"}:
                if path.endswith(reading):
                    continue
                at = path.replace("{name}", random.choice(["white", "table", "new"])).replace("{id}", "0" * 32)
                for guise in guises:
                    for body in bodies:
                        sent = {**OCTET, "if-match": "*", **guise}
                        answered[http.request(method, at, content=body, headers=sent).status_code] += 1
        good = http.get(f"/v1/materials/white/{_LOOKUP}").status_code == 200
        changed = _files(data) != before
    refused = set(answered) <= {401, 403, 404, 405}
    text = (
        f"{sum(answered.values())} requests to change something: {dict(answered)}, changed: {changed} (goal: nothing)"
    )
    said("readonly", text, refused and good and not changed)


def _files(data: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in data.iterdir() if p.is_file()}


def lru(options: argparse.Namespace, data: Path) -> None:
    """Sixty tables of which eight fit, asked for at random by name and by id, a few replaced meanwhile."""
    rng = np.random.default_rng(3)
    expected: dict[str, Any] = {}
    for k in range(60):
        table = bc.tabulate(bc.model("lambert", reflectance=float(rng.random())), "angle_grid", shape=(40, 40, 61))
        table.save(data / f"t{k:02d}.h5")
        expected[f"t{k:02d}"] = table.evaluate(*np.radians([30.0, 40.0, 170.0])).tolist(), table.id
    size, room = table.nbytes, 8 * table.nbytes + table.nbytes // 2
    answered: Counter[str] = Counter()
    most = 0.0
    until = time.monotonic() + options.seconds
    with service(data, "--cache-bytes", str(room)) as running, client(running) as http:
        wait_ready(http)

        def ask(seed: int) -> None:
            own = random.Random(seed)
            with client(running) as http:
                while time.monotonic() < until:
                    name = own.choice(list(expected))
                    values, id = expected[name]
                    place = f"materials/{name}" if own.random() < 0.5 else f"tables/{id}"
                    if own.random() < 0.02:
                        (data / f"{name}.h5").touch()  # another state of the same table
                    answer = http.get(f"/v1/{place}/{_LOOKUP}")
                    right = answer.status_code == 200 and answer.json()["values"] == [values]
                    answered["right" if right else f"wrong {answer.status_code}"] += 1

        threads = [threading.Thread(target=ask, args=(k,)) for k in range(16)]
        for thread in threads:
            thread.start()
        while any(t.is_alive() for t in threads):
            text = http.get("/metrics").text
            most = max(most, float(text.split("\nbrdf_table_bytes ")[1].split("\n")[0]))
            time.sleep(0.2)
    wrong = sum(n for k, n in answered.items() if k.startswith("wrong 5") or k == "wrong 200")
    text = f"{dict(answered)}; of {60 * size / 1e6:.0f} MB held at most {most / 1e6:.1f}"
    said("lru", f"{text} (goal: none wrong, {room / 1e6:.1f})", wrong == 0 and most <= room)


def hdf5(options: argparse.Namespace, data: Path) -> None:
    """Table files that say more than they hold, or point elsewhere, where such uploads are allowed."""
    secret = data / "secret.txt"
    secret.write_bytes(bytes(range(256)) * 64)
    table = bc.tabulate(bc.model("lambert"), "angle_grid", shape=(4, 4, 5))
    seed = data / ".seed.h5"

    def made(change: Callable[[h5py.File], None]) -> bytes:
        table.save(seed)
        with h5py.File(seed, "r+") as file:
            change(file)
        content = seed.read_bytes()
        seed.unlink()
        return content

    def array(file: h5py.File) -> str:
        return next(f"arrays/{name}" for name in file["arrays"])

    def replaced(**how: Any) -> Callable[[h5py.File], None]:
        def change(file: h5py.File) -> None:
            name = array(file)
            del file[name]
            file.create_dataset(name, **how)

        return change

    def linked(link: Any) -> Callable[[h5py.File], None]:
        def change(file: h5py.File) -> None:
            name = array(file)
            del file[name]
            file[name] = link

        return change

    def virtual(file: h5py.File) -> None:
        layout = h5py.VirtualLayout((4, 4, 5, 1), "<f4")
        layout[...] = h5py.VirtualSource(str(secret), "x", (4, 4, 5, 1))
        name = array(file)
        del file[name]
        file.create_virtual_dataset(name, layout)

    def header(text: bytes) -> Callable[[h5py.File], None]:
        def change(file: h5py.File) -> None:
            del file["header"]
            file["header"] = np.frombuffer(text, np.uint8)

        return change

    huge = 2**40
    changes = {
        "bomb": replaced(shape=(huge,), dtype="<f4", chunks=(2**20,), compression="gzip"),
        "unwritten": replaced(shape=(4, 4, 5, 1), dtype="<f4", chunks=(4, 4, 5, 1)),
        "external": replaced(shape=(80,), dtype="<f4", external=[(str(secret), 0, 320)]),
        "external link": linked(h5py.ExternalLink(str(secret), "/")),
        "soft link": linked(h5py.SoftLink("/header")),
        "virtual": virtual,
        "text": replaced(data=[b"x" * 10] * 80),
        "compound": replaced(shape=(80,), dtype=[("a", "<f4"), ("b", "<i8")]),
        "references": replaced(shape=(80,), dtype=h5py.ref_dtype),
        "variable": replaced(shape=(80,), dtype=h5py.vlen_dtype(np.float32)),
        "nothing": replaced(data=h5py.Empty("<f4")),
        "nan": replaced(data=np.full((4, 4, 5, 1), np.nan, "<f4")),
        "negative": replaced(data=np.full((4, 4, 5, 1), -1e38, "<f4")),
        "no header": header(b""),
        "deep header": header(b"[" * 200_000),
        "long header": header(b'{"x": "' + b"x" * 5_000_000 + b'"}'),
        "many groups": lambda file: [file.create_group(f"arrays/g{k}") for k in range(2000)] and None,
        "loop": lambda file: file.__setitem__("arrays/self", file["arrays"]),
    }
    ended: dict[str, str] = {}
    slowest = 0.0
    with service(data, "--allow-hdf5", "--job-seconds", "30") as running, client(running) as http:
        wait_ready(http)
        for what, change in changes.items():
            begun, name = time.monotonic(), what.replace(" ", "-")
            answer = http.post(f"/v1/materials/{name}/upload", content=made(change), headers=OCTET)
            assert answer.status_code == 202, answer.text
            while (job := http.get(answer.headers["location"]).json())["finished"] is None:
                time.sleep(0.05)
            slowest = max(slowest, time.monotonic() - begun)
            ended[what] = job["state"] if job["state"] == "done" else job["problem"]["code"]
        alive = http.get("/health/live").status_code == 200
    bad = [k for k, v in ended.items() if v in ("done", "internal_error", "job_crashed", "job_failed", "job_killed")]
    text = f"{len(ended)} files: {dict(Counter(ended.values()))}, the slowest {slowest:.1f} s; taken or crashed: {bad}"
    said("hdf5", f"{text} (goal: none)", not bad and alive and slowest < 35)
