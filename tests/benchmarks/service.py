"""The service against what bounds it, in one run: `python -m tests.benchmarks.service [--quick] [--against CHECKOUT]`.

Servers of the same kind (same uvicorn, same parser, same event loop, one process each), asked in turn by a client that
does next to nothing itself: a GET of one value and of 30, a POST of 1,000 points as JSON, a POST of a million points as
plain numbers.

- the service, and with --against that of another checkout of this project (an older commit);
- bare ASGI: it reads the body and sends as many bytes as the service would, and does nothing else;
- FastAPI as its tutorial shows it: lists of a typed query, pydantic lists in and out, a body of numbers into numpy and
  out of it; the same look-ups inside.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
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
from typing import Annotated, Any, NamedTuple

import anyio.to_thread
import fastapi
import numpy as np
import pydantic

from tests.benchmarks.timing import machine

PATH = "/v1/materials/gold/evaluate"
ONE = f"{PATH}?theta_i=30&theta_o=40&delta_phi=170"
POINTS, MANY, CONCURRENT = 1_000, 1_000_000, 16
BINARY = "application/octet-stream"


# ---- the servers, each in a process of its own ---------------------------------------------------------------


def _serve(make: Callable[[str, dict[str, int]], Any], folder: str, sizes: dict[str, int], pipe: Any) -> None:
    import uvicorn

    # its protocol spelt out, or asyncio leaves Nagle's delay on: 40 ms an answer
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.bind(("127.0.0.1", 0))
    listener.listen(256)
    pipe.send(listener.getsockname()[1])
    made = make(folder, sizes)
    # the services as `brdf serve` runs them, the others as uvicorn does
    app, options = made if isinstance(made, tuple) else (made, {})
    config = uvicorn.Config(app, log_level="error", access_log=False, lifespan="on", **options)
    with contextlib.suppress(KeyboardInterrupt):
        uvicorn.Server(config).run(sockets=[listener])


def our_app(folder: str, sizes: dict[str, int]) -> Any:
    """The service, its log line for each request included (written to nowhere)."""
    from brdf_service.main import create_app
    from brdf_service.server.process import server_options
    from brdf_service.server.request_log import RequestLog
    from brdf_service.settings import Settings

    nowhere = RequestLog(open(os.devnull, "w", buffering=1).write)  # noqa: SIM115
    settings = Settings(data=Path(folder))
    return create_app(settings, request_log=nowhere), server_options(settings)


class Before:
    """The service of another checkout, whose folder app/ may still be imported under that name."""

    def __init__(self, checkout: Path) -> None:
        self.checkout = checkout

    def __call__(self, folder: str, sizes: dict[str, int]) -> Any:
        for name in [n for n in sys.modules if n.partition(".")[0] in ("brdfcore", "brdf_service")]:
            del sys.modules[name]
        sys.path.insert(0, str(self.checkout))
        app, process, settings, log = (
            importlib.import_module(f"app.{name}") for name in ("main", "process", "settings", "access_log")
        )
        made = app.create_app(settings.Settings(data=Path(folder)))
        made.state.brdf.access_log = log.AccessLog(open(os.devnull, "w", buffering=1).write)  # noqa: SIM115
        return made, process.server_options(made.state.brdf)


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
        more = scope["method"] == "POST"
        while more:
            more = (await receive())["more_body"]
        answer = answers[dict(scope["headers"]).get(b"x-wanted", b"").decode()]
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
    import brdfcore as bc

    table = bc.open_table(Path(folder) / "gold.h5")
    app = fastapi.FastAPI()

    @app.get("/lists")
    async def get_lists(
        theta_i: Annotated[list[float], fastapi.Query()],
        theta_o: Annotated[list[float], fastapi.Query()],
        delta_phi: Annotated[list[float], fastapi.Query()],
    ) -> Answer:
        return Answer(values=table.evaluate(*(np.radians(x) for x in (theta_i, theta_o, delta_phi))).tolist())

    @app.post("/v1/materials/{name}/evaluate")
    async def post(name: str, asked: Question) -> Answer:
        angles = (np.radians(np.array(x)) for x in (asked.theta_i, asked.theta_o, asked.delta_phi))
        return Answer(values=table.evaluate(*angles).tolist())

    @app.post("/binary")
    async def binary(request: fastapi.Request, dtype: str) -> fastapi.Response:
        angles = np.frombuffer(await request.body(), dtype).reshape(3, -1)
        values = await anyio.to_thread.run_sync(lambda: table.evaluate(*angles))
        return fastapi.Response(values.tobytes(), media_type="application/octet-stream")

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
    head += f"X-Wanted: {len(path)} {len(body)}\r\n"  # what the echo looks its answer's length up by
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

    arguments = argparse.ArgumentParser()
    arguments.add_argument("--quick", action="store_true")
    arguments.add_argument("--against", type=Path, help="a checkout of an older commit")
    given = arguments.parse_args()
    rounds, seconds = (3, 1.0) if given.quick else (5, 3.0)
    table = bc.tabulate(bc.model("cook_torrance", roughness=0.3, ior="gold"), "angle_grid", shape=(46, 46, 91))
    rng = np.random.default_rng(1)
    many = {d: (rng.random((3, MANY)) * 1.5).astype(d) for d in ("f8", "f4")}
    listed = {k: (90 * rng.random(POINTS)).tolist() for k in ("theta_i", "theta_o", "delta_phi")}
    thirty = {k: [round(x, 4) for x in v[:30]] for k, v in listed.items()}
    commas = "&".join(f"{k}={','.join(map(str, v))}" for k, v in thirty.items())
    repeated = "&".join(f"{k}={x}" for k, v in thirty.items() for x in v)
    gets = {
        "one value": (message(ONE), message("/lists?theta_i=30&theta_o=40&delta_phi=170")),
        "30 values": (message(f"{PATH}?{commas}"), message(f"/lists?{repeated}")),
    }
    post = message(PATH, json.dumps(listed).encode())
    parts = {name: importlib.util.find_spec(name) is not None for name in ("uvloop", "httptools")}
    print(f"{machine()}; " + ", ".join(f"{k} {'used' if v else 'not used'}" for k, v in parts.items()))
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        table.save(Path(folder) / "gold.h5")
        ours = stack.enter_context(server(our_app, folder, {}))
        before = stack.enter_context(server(Before(given.against), folder, {})) if given.against else None
        for each in filter(None, (ours, before)):
            _wait(each.port)
        asked = {"service": ours} | ({"before": before} if before else {})
        with socket.create_connection(("127.0.0.1", ours.port)) as connection:
            answers = {_wanted(m): len(ask(connection, m)) for m in (*(get for get, _ in gets.values()), post)}
        echoes = {d: message(f"{PATH}?dtype={d}&angles=rad", a.tobytes(), BINARY) for d, a in many.items()}
        answers |= {_wanted(m): MANY * int(d[1]) for d, m in echoes.items()}
        echo = stack.enter_context(server(echo_app, folder, answers))
        stock = stack.enter_context(server(stock_app, folder, {}))

        for what, (get, get_lists) in gets.items():
            rates: dict[str, list[Rate]] = {name: [] for name in (*asked, "bare ASGI", "stock FastAPI")}
            for _ in range(rounds):
                for name, each in asked.items():
                    rates[name].append(rate_of(each, get, seconds))
                rates["bare ASGI"].append(rate_of(echo, get, seconds))
                rates["stock FastAPI"].append(rate_of(stock, get_lists, seconds))
            _show(f"GET of {what}, concurrency {CONCURRENT}", rates)
            _ratio("service / stock FastAPI", rates["service"], rates["stock FastAPI"], ">= 1.6")
            for other in (*(("before",) if before else ()), "bare ASGI"):
                _ratio(f"service / {other}", rates["service"], rates[other])

        rates = {name: [] for name in (*asked, "stock FastAPI")}
        for _ in range(rounds):
            for name, each in (*asked.items(), ("stock FastAPI", stock)):
                rates[name].append(rate_of(each, post, seconds, concurrent=4))
        _show(f"POST of {POINTS} points as JSON", rates)
        _ratio("JSON: service / stock FastAPI", rates["service"], rates["stock FastAPI"], ">= 3")
        if before:
            _ratio("JSON: service / before", rates["service"], rates["before"], ">= .95")

        for dtype, array in many.items():
            stock_binary = message(f"/binary?dtype={dtype}", array.tobytes(), BINARY)
            spent: dict[str, list[float]] = {name: [] for name in (*asked, "stock FastAPI", "bare ASGI")}
            for _ in range(rounds):
                for name, each in asked.items():
                    spent[name] += seconds_of(each.port, echoes[dtype], 5)
                spent["stock FastAPI"] += seconds_of(stock.port, stock_binary, 5)
                spent["bare ASGI"] += seconds_of(echo.port, echoes[dtype], 5)
            middle = {name: float(np.median(v)) for name, v in spent.items()}
            for name, value in middle.items():
                print(f"{MANY} look-ups, {dtype}: {name:14s} {1000 * value:7.1f} ms")
            for name, goal in (("stock FastAPI", ">= 1"), *((("before", ">= .95"),) if before else ())):
                print(f"  -> binary {dtype}: {name} / service = {middle[name] / middle['service']:.2f}  (goal {goal})")

        for name, each in (*asked.items(), ("bare ASGI", echo)):
            get = gets["one value"][0]
            medians = [float(np.median(seconds_of(each.port, get, 100 if given.quick else 500))) for _ in range(5)]
            print(f"one GET, idle: {name:14s} p50 {1e6 * np.median(medians):.0f} us (5 medians: ", end="")
            print(", ".join(f"{1e6 * m:.0f}" for m in medians) + ")")


def _wanted(request: bytes) -> str:
    return request.partition(b"X-Wanted: ")[2].split(b"\r\n")[0].decode()


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


if __name__ == "__main__":
    main()
