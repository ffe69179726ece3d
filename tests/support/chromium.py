"""A shader's function over given vectors in headless Chromium: WebGL2 (a texture of float32, read back) or WebGPU."""

from __future__ import annotations

import http.server
import json
import shutil
import subprocess
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np

#: Where the browser may be.
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
_FLAGS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader",
]  # fmt: skip
_PAGE = Path(__file__).with_name("chromium.html")
_SECONDS = 120


def run(language: str, name: str, source: str, arrays: bytes, wi: Any, wo: Any) -> Any:
    """NAME_f(wi, wo) of `source`, whose nodes are the safetensors file `arrays`; (n, 3) float32, -> (n, 3) float32.

    Raises `RuntimeError` with what the browser said.
    """
    assert BROWSER is not None
    answer: dict[str, bytes] = {}
    done = threading.Event()
    given = np.ascontiguousarray(np.concatenate([wi, wo], axis=1), "<f4").tobytes()
    task = json.dumps({"language": language, "name": name, "source": source, "count": len(wi)})
    files = {"/": (_PAGE.read_bytes(), "text/html"), "/task": (task.encode(), "application/json")}
    files |= {"/arrays": (arrays, "application/octet-stream"), "/vectors": (given, "application/octet-stream")}

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            body, kind = files.get(self.path, (b"", "text/plain"))
            self.send_response(200 if self.path in files else 404)
            self.send_header("content-type", kind)
            self.send_header("content-length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def do_POST(self) -> None:
            answer[self.path] = self.rfile.read(int(self.headers["content-length"]))
            self.send_response(204)
            self.end_headers()
            done.set()

        def log_message(self, format: str, *arguments: Any) -> None:
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        address = f"http://127.0.0.1:{server.server_address[1]}/"
        command = [BROWSER, *_FLAGS, f"--user-data-dir={profile}", "--remote-debugging-port=0", address]
        browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            in_time = done.wait(_SECONDS)
        finally:
            browser.terminate()
            try:
                browser.wait(10)
            except subprocess.TimeoutExpired:
                browser.kill()
                browser.wait(10)
            server.shutdown()
            server.server_close()
    if not in_time:
        raise RuntimeError(f"no answer of the browser in {_SECONDS} s")
    if "/values" not in answer:
        raise RuntimeError(answer["/error"].decode()[:4_000])
    return np.frombuffer(answer["/values"], "<f4").reshape(-1, 4)[: len(wi), :3]
