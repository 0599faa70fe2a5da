"""The preview over HTTP on this machine; follows a run that is still being written."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Lock

from estimator.formats.run_file import Run
from viz.preview import page
from viz.scene import Scene

HOST = "127.0.0.1"


def serve(
    run: Run | Scene,
    *,
    port: int = 0,
    open_browser: bool = True,
    ready: Callable[[ThreadingHTTPServer, str], None] | None = None,
) -> None:
    """Serve the preview on 127.0.0.1 until Ctrl-C; all of it in this process, so nothing outlives it.

    A run that is still being written is read again for every load of the page: reload to see what it holds by then.
    port: 0 takes a free one. ready: called with the server and its address before serving; the address is printed
    unless it is given.
    """
    with ThreadingHTTPServer((HOST, port), _handler(_pages(run))) as server:
        server.daemon_threads = True
        address = f"http://{HOST}:{server.server_address[1]}/"
        with suppress(KeyboardInterrupt):
            if ready is not None:
                ready(server, address)
            else:
                print(f"{address} shows the run; Ctrl-C ends it", flush=True)
            if open_browser:
                webbrowser.open(address, new=2)
            server.serve_forever(poll_interval=0.1)


def _pages(run: Run | Scene) -> Callable[[], str]:
    """Makes the page on each call, or only once where it cannot change any more."""
    kept: list[tuple[bool, int, str]] = []
    lock = Lock()

    def make() -> str:
        with lock:
            current = run if isinstance(run, Scene) else Run.open(run.file)
            complete = isinstance(current, Scene) or current.complete
            if not kept or kept[-1][:2] != (complete, len(current)):
                kept[:] = [(complete, len(current), page(current))]
            return kept[-1][2]

    make()  # what is wrong with a run is said before a server is up
    return make


def _handler(make_page: Callable[[], str]) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path.split("?")[0] != "/":
                self.send_error(HTTPStatus.NOT_FOUND)
                return
            body = make_page().encode("utf-8")
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Requests are nobody's news."""

    return Handler
