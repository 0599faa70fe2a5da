"""The preview over HTTP on this machine; follows a run that is still being written."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

HOST = "127.0.0.1"


def serve(
    make_page: Callable[[], str],
    *,
    port: int = 0,
    open_browser: bool = True,
    ready: Callable[[ThreadingHTTPServer, str], None] | None = None,
) -> None:
    """Serve a page on 127.0.0.1 until Ctrl-C; all of it in this process, so nothing outlives it.

    make_page: called for every load of the page, so that reloading shows what a growing run holds by then.
    port: 0 takes a free one. ready: called with the server and its address before serving (for a message, or a test
    that calls `server.shutdown()`).
    """
    with ThreadingHTTPServer((HOST, port), _handler(make_page)) as server:
        server.daemon_threads = True
        address = f"http://{HOST}:{server.server_address[1]}/"
        if ready is not None:
            ready(server, address)
        if open_browser:
            webbrowser.open(address, new=2)
        try:
            server.serve_forever(poll_interval=0.1)
        except KeyboardInterrupt:
            pass


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
