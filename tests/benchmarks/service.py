"""The service against what bounds it, in one run: `python -m tests.benchmarks.service [--quick]`.

Three servers of the same kind (same uvicorn, same parser, same event loop, one process each), asked in turn by a client
that does next to nothing itself:

- the service: a GET of one value, a POST of 1,000 points as JSON, a POST of a million points as plain numbers;
- bare ASGI: it reads the body and sends as many bytes as the service would, and does nothing else;
- FastAPI as its tutorial shows it: typed query, pydantic lists in and out, the same look-ups inside.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import selectors
import socket
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pydantic

from tests.benchmarks.timing import machine

GET_PATH = "/v1/materials/gold/evaluate?theta_i=30&theta_o=40&delta_phi=170"
POINTS, MANY, CONCURRENT = 1_000, 1_000_000, 16
#: f8 angles in, f4 ones, and the values out.
BYTES_OUT = MANY * 8


# ---- the servers, each in a process of its own ---------------------------------------------------------------


def _serve(make: Callable[[str, dict[str, int]], Any], folder: str, sizes: dict[str, int], pipe: Any) -> None:
    import uvicorn
    from brdf_service.server.process import server_options

    # its protocol spelt out, or asyncio leaves Nagle's delay on: 40 ms an answer
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.bind(("127.0.0.1", 0))
    listener.listen(256)
    pipe.send(listener.getsockname()[1])
    # ours as `brdf serve` runs it, the others as uvicorn does
    app = make(folder, sizes)
    options = server_options(app.state.brdf.settings) if make is our_app else {}
    config = uvicorn.Config(app, log_level="error", access_log=False, lifespan="on", **options)
    with contextlib.suppress(KeyboardInterrupt):
        uvicorn.Server(config).run(sockets=[listener])


def our_app(folder: str, sizes: dict[str, int]) -> Any:
    """The service, its log line for each request included (written to nowhere)."""
    from brdf_service.main import create_app
    from brdf_service.server.request_log import RequestLog
    from brdf_service.settings import Settings

    nowhere = RequestLog(open(os.devnull, "w", buffering=1).write)  # noqa: SIM115
    return create_app(Settings(data=Path(folder)), request_log=nowhere)


def echo_app(folder: str, sizes: dict[str, int]) -> Any:
    """As many bytes as the service answers to a body of this length; what is received is counted and thrown away."""
    answers = {path: b"x" * size for path, size in sizes.items()}

    async def app(scope: Any, receive: Callable[[], Awaitable[Any]], send: Callable[[Any], Awaitable[None]]) -> None:
        if scope["type"] != "http":
            await receive()
            await send({"type": "lifespan.startup.complete"})
            await receive()
            await send({"type": "lifespan.shutdown.complete"})
            return
        length, more = 0, scope["method"] == "POST"
        while more:
            message = await receive()
            length += len(message["body"])
            more = message["more_body"]
        answer = answers[f"{scope['method']} {length}"]
        headers = [(b"content-length", b"%d" % len(answer)), (b"content-type", b"application/octet-stream")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await send({"type": "http.response.body", "body": answer})

    return app


class Question(pydantic.BaseModel):
    """What the framework's own route takes."""

    theta_i: list[float]
    theta_o: list[float]
    delta_phi: list[float]


class Answer(pydantic.BaseModel):
    """What it answers."""

    values: list[list[float]]


def stock_app(folder: str, sizes: dict[str, int]) -> Any:
    """The same look-ups by the framework's own means."""
    import fastapi

    import brdfcore as bc

    table = bc.open_table(Path(folder) / "gold.h5")
    app = fastapi.FastAPI()

    @app.get("/v1/materials/{name}/evaluate")
    async def get(name: str, theta_i: float, theta_o: float, delta_phi: float) -> Answer:
        values = table.evaluate(*np.radians((theta_i, theta_o, delta_phi)))
        return Answer(values=[values.tolist()])

    @app.post("/v1/materials/{name}/evaluate")
    async def post(name: str, asked: Question) -> Answer:
        angles = (np.radians(np.array(x)) for x in (asked.theta_i, asked.theta_o, asked.delta_phi))
        return Answer(values=table.evaluate(*angles).tolist())

    return app


class Server(NamedTuple):
    """Where it listens, and which process it is."""

    port: int
    pid: int

    def cpu(self) -> float:
        """Processor seconds that it has used: what other programs on the machine do not change."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Rate(NamedTuple):
    """Answers a second, and processor seconds of the server for each."""

    per_second: float
    cpu: float


@contextlib.contextmanager
def server(make: Callable[[str, dict[str, int]], Any], folder: str, sizes: dict[str, int]) -> Iterator[Server]:
    """A server process."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(make, folder, sizes, there), daemon=True)
    process.start()
    port = here.recv()
    for _ in range(300):
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=5):
            break
    try:
        assert process.pid is not None
        yield Server(port, process.pid)
    finally:
        process.terminate()
        process.join(15)


# ---- a client that does next to nothing ----------------------------------------------------------------------


def message(path: str, body: bytes = b"", kind: str = "application/json") -> bytes:
    """A request as it goes over the wire."""
    head = f"{'POST' if body else 'GET'} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    if body:
        head += f"Content-Type: {kind}\r\nContent-Length: {len(body)}\r\n"
    return head.encode() + b"\r\n" + body


def ask(connection: socket.socket, request: bytes) -> bytes:
    """One request and its whole answer."""
    connection.sendall(request)
    buffer = bytearray()
    while (end := buffer.find(b"\r\n\r\n")) < 0:
        buffer += connection.recv(65_536)
    head = bytes(buffer[:end]).lower()
    assert b" 200 " in head[:16], buffer[:2000]
    length = int(head.partition(b"content-length:")[2].split(b"\r\n")[0])
    body = bytearray(length)
    view, got = memoryview(body), len(buffer) - end - 4
    view[:got] = buffer[end + 4 :]
    while got < length:
        got += connection.recv_into(view[got:])
    return bytes(body) if length < 1_000_000 else b""


def rate_of(asked: Server, request: bytes, seconds: float, concurrent: int = CONCURRENT) -> Rate:
    """Of `concurrent` connections, each with one request under way."""
    connections = [socket.create_connection(("127.0.0.1", asked.port)) for _ in range(concurrent)]
    for connection in connections:
        size = _answer_size(connection, request)
    selector = selectors.DefaultSelector()
    got = dict.fromkeys(connections, 0)
    for connection in connections:
        connection.setblocking(True)
        selector.register(connection, selectors.EVENT_READ)
        connection.sendall(request)
    count, begun, used = 0, time.perf_counter(), asked.cpu()
    until = begun + seconds
    while time.perf_counter() < until:
        for key, _ in selector.select(1):
            connection = key.fileobj
            assert isinstance(connection, socket.socket)
            got[connection] += len(connection.recv(262_144))
            if got[connection] >= size - 8:  # a time in a header may have a digit more or less
                count += 1
                got[connection] = 0
                connection.sendall(request)
    spent, used = time.perf_counter() - begun, asked.cpu() - used
    for connection in connections:
        connection.close()
    return Rate(count / spent, used / count)


def _answer_size(connection: socket.socket, request: bytes) -> int:
    connection.sendall(request)
    connection.settimeout(5)
    buffer = connection.recv(262_144)
    while b"\r\n\r\n" not in buffer:
        buffer += connection.recv(262_144)
    head, _, body = buffer.partition(b"\r\n\r\n")
    assert b" 200 " in head[:16], buffer[:2000]
    length = int(head.lower().partition(b"content-length:")[2].split(b"\r\n")[0])
    got = len(body)
    while got < length:
        got += len(connection.recv(262_144))
    connection.settimeout(None)
    return len(head) + 4 + length


def seconds_of(port: int, request: bytes, rounds: int) -> list[float]:
    """Seconds of single requests, one after another over one connection."""
    spent = []
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        ask(connection, request)
        for _ in range(rounds):
            begun = time.perf_counter()
            ask(connection, request)
            spent.append(time.perf_counter() - begun)
    return spent


# ---- what is measured -----------------------------------------------------------------------------------------


def main() -> None:
    """Measure and print."""
    import brdfcore as bc

    quick = "--quick" in sys.argv
    rounds, seconds = (3, 1.0) if quick else (5, 3.0)
    table = bc.tabulate(bc.model("cook_torrance", roughness=0.3, ior="gold"), "angle_grid", shape=(46, 46, 91))
    rng = np.random.default_rng(1)
    many = {d: (rng.random((3, MANY)) * 1.5).astype(d) for d in ("f8", "f4")}
    listed = {k: (90 * rng.random(POINTS)).tolist() for k in ("theta_i", "theta_o", "delta_phi")}
    get, post = message(GET_PATH), message(GET_PATH.partition("?")[0], json.dumps(listed).encode())
    binary = {
        d: message(f"{GET_PATH.partition('?')[0]}?dtype={d}&angles=rad", a.tobytes(), "application/octet-stream")
        for d, a in many.items()
    }
    parts = {name: _installed(name) for name in ("uvloop", "httptools")}
    print(f"{machine()}; " + ", ".join(f"{k} {'used' if v else 'not used'}" for k, v in parts.items()))
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        table.save(Path(folder) / "gold.h5")
        ours = stack.enter_context(server(our_app, folder, {}))
        _wait(ours.port)
        with socket.create_connection(("127.0.0.1", ours.port)) as connection:
            small, middle = len(ask(connection, get)), len(ask(connection, post))
        sizes = _sizes(small, middle, post)
        for dtype, array in many.items():
            sizes[f"POST {array.nbytes}"] = MANY * int(dtype[1])
        echo = stack.enter_context(server(echo_app, folder, sizes))
        stock = stack.enter_context(server(stock_app, folder, {}))

        rates: dict[str, list[Rate]] = {"service": [], "bare ASGI": [], "stock FastAPI": []}
        for _ in range(rounds):
            for name, asked in (("service", ours), ("bare ASGI", echo), ("stock FastAPI", stock)):
                rates[name].append(rate_of(asked, get, seconds))
        _show(f"GET evaluate, concurrency {CONCURRENT}", rates)
        _ratio("GET: service / bare ASGI", rates["service"], rates["bare ASGI"], ">= .5")
        _ratio("GET: stock FastAPI / bare ASGI", rates["stock FastAPI"], rates["bare ASGI"])

        rates = {"service": [], "pydantic lists": []}
        for _ in range(rounds):
            for name, asked in (("service", ours), ("pydantic lists", stock)):
                rates[name].append(rate_of(asked, post, seconds, concurrent=4))
        _show(f"POST of {POINTS} points as JSON", rates)
        _ratio("JSON: service / pydantic lists", rates["service"], rates["pydantic lists"], ">= 5")

        for dtype, array in many.items():
            out = np.empty((MANY, 1), array.dtype)
            spent: dict[str, list[float]] = {"service": [], "bare ASGI": [], "in process": []}
            for _ in range(rounds):
                spent["service"] += seconds_of(ours.port, binary[dtype], 5)
                spent["bare ASGI"] += seconds_of(echo.port, binary[dtype], 5)
                for _ in range(5):
                    begun = time.perf_counter()
                    table.evaluate(*array, out=out)
                    spent["in process"].append(time.perf_counter() - begun)
            middle_of = {k: float(np.median(v)) for k, v in spent.items()}
            for name, value in middle_of.items():
                print(f"{MANY} look-ups, {dtype}: {name:10s} {1000 * value:7.1f} ms")
            ratio = middle_of["service"] / (middle_of["bare ASGI"] + middle_of["in process"])
            print(f"  -> binary {dtype}: service / (bare ASGI + in process) = {ratio:.2f}  (goal <= 1.5)")

        medians = [float(np.median(seconds_of(ours.port, get, 100 if quick else 500))) for _ in range(5)]
        bare = [float(np.median(seconds_of(echo.port, get, 100 if quick else 500))) for _ in range(5)]
        print(f"one GET, idle: p50 {1e6 * np.median(medians):.0f} us (median of 5 medians: ", end="")
        print(", ".join(f"{1e6 * m:.0f}" for m in medians) + f"); bare ASGI {1e6 * np.median(bare):.0f} us")


def _sizes(small: int, middle: int, post: bytes) -> dict[str, int]:
    return {"GET 0": small, f"POST {len(post) - post.find(bytes([13, 10, 13, 10])) - 4}": middle}


def _show(what: str, rates: dict[str, list[Rate]]) -> None:
    for name, found in rates.items():
        per_second, cpu = (float(np.median(x)) for x in zip(*found, strict=True))
        print(f"{what}: {name:14s} {per_second:8.0f} requests/s, {1e6 * cpu:6.0f} us of processor time each")


def _ratio(name: str, a: list[Rate], b: list[Rate], goal: str = "") -> None:
    each = np.array([x.per_second / y.per_second for x, y in zip(a, b, strict=True)])
    cpu = float(np.median([y.cpu / x.cpu for x, y in zip(a, b, strict=True)]))
    spread = f"rounds {each.min():.2f} to {each.max():.2f}; by processor time {cpu:.2f}"
    print(f"  -> {name} = {np.median(each):.2f} ({spread}{f'; goal {goal}' if goal else ''})")


def _wait(port: int) -> None:
    ready = b"GET /health/ready HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"
    for _ in range(600):
        with socket.create_connection(("127.0.0.1", port)) as connection:
            connection.sendall(ready)
            if b" 200 " in connection.recv(1000)[:16]:
                return
        time.sleep(0.1)
    raise SystemExit("the service did not become ready")


def _installed(name: str) -> bool:
    from importlib.util import find_spec

    return find_spec(name) is not None


if __name__ == "__main__":
    main()
