"""Pages for the one browser on this machine that was given their address."""

from __future__ import annotations

import hmac
import json
import secrets
import sys
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from humanoid.support.errors import InputError

HOST = "127.0.0.1"
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class LocalServer(ThreadingHTTPServer):
    """Serves on 127.0.0.1 under a secret address.

    Other pages in the same browser can send requests here too. They do not know the token in `address`, and a name
    of theirs that resolves to this machine is refused by the Host header.

    Attributes
    ----------
    address: where the page is. hosts: the host names it accepts. token: the secret part of the address.
    silence: time [s] after which an idle connection is closed, so that it keeps no thread busy.
    """

    daemon_threads = True
    silence = 60.0

    def __init__(self, handler: type[LocalHandler], port: int = 0) -> None:
        try:
            super().__init__((HOST, port), handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or "0 to 65535 is needed"
            raise InputError("port", f"{port} cannot be used: {reason}", remedy="0 takes a free one") from None
        self.token = secrets.token_urlsafe(24)
        self.hosts = tuple(f"{name}:{self.server_address[1]}" for name in (HOST, "localhost"))
        self.address = f"http://{self.hosts[0]}/{self.token}/"

    def close_soon(self) -> None:
        """End `serve_forever` from within a request."""
        threading.Thread(target=self.shutdown, daemon=True).start()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that disconnects in the middle of an answer is not an error."""
        if not isinstance(sys.exc_info()[1], (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)


class LocalHandler(BaseHTTPRequestHandler):
    """Answers requests with the secret address; `get` has the contents."""

    server: LocalServer

    def setup(self) -> None:
        """Take the connection, with the server's patience."""
        super().setup()
        self.connection.settimeout(self.server.silence)

    def get(self, route: str) -> None:
        """Answer GET and HEAD of a route below the secret address, by `send` or `refuse`."""
        raise NotImplementedError

    def do_GET(self) -> None:
        """Answer, or refuse requests without the secret address."""
        route = self.route()
        if route is not None:
            self.get(route)
        elif self.known_host() and self.path == "/favicon.ico":  # browsers request it unprompted
            self.send(HTTPStatus.NO_CONTENT)
        else:
            self.refuse_other_pages()

    do_HEAD = do_GET  # `send` leaves the body out

    def known_host(self) -> bool:
        """The request names this machine, rather than a name that was made to resolve to it."""
        return self.headers.get("Host") in self.server.hosts

    def route(self) -> str | None:
        """The requested path, below the secret part of the address; None for requests without that part."""
        if not self.known_host():
            return None
        _, _, rest = self.path.partition("?")[0].partition("/")
        token, slash, route = rest.partition("/")
        known = hmac.compare_digest(token.encode("utf-8", "replace"), self.server.token.encode("ascii"))
        return route if known and slash else None

    def refuse_other_pages(self) -> None:
        """Answer requests without the secret address."""
        self.refuse(HTTPStatus.FORBIDDEN, "this address is not known here")

    def refuse(self, status: HTTPStatus, problem: str) -> None:
        """Answer with an error."""
        self.json(status, {"error": problem})

    def json(self, status: HTTPStatus, value: dict[str, Any]) -> None:
        """Answer with JSON."""
        self.send(status, "application/json", json.dumps(value, allow_nan=False).encode("utf-8"))

    def start_stream(self, kind: str) -> None:
        """Begin an answer of a content type that continues until this connection is closed; write it to `wfile`."""
        self.send_response(HTTPStatus.OK)
        for name, value in {"Content-Type": kind, **_HEADERS}.items():
            self.send_header(name, value)
        self.end_headers()

    def send(
        self, status: HTTPStatus, kind: str = "", body: bytes = b"", headers: dict[str, str] | None = None
    ) -> None:
        """Answer with a body of a content type; `headers` come in addition, or replace the usual ones."""
        self.send_response(status)
        content = {"Content-Type": kind, "Content-Length": str(len(body))} if kind else {}
        for name, value in {**content, **_HEADERS, **(headers or {})}.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Requests are not logged."""
