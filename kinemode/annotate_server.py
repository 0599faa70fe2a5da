"""The annotation page over HTTP on this machine, for the one browser that was given its address."""

from __future__ import annotations

import hmac
import json
import re
import secrets
import sys
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any, Protocol

from humanoid.errors import InputError

HOST = "127.0.0.1"
_FRAME = re.compile(r"frame/([0-9]{1,9})\.png")


class Session(Protocol):
    """What is served: all that the page shows, and what it saves."""

    largest_post: int
    """Bytes a saving page can send at most."""

    def state(self) -> dict[str, Any]:
        """Everything the page needs at its start, for JSON."""

    def picture(self, index: int) -> bytes:
        """A frame as PNG; raises IndexError where the clip has none."""

    def save(self, posted: Any) -> dict[str, Any]:
        """Write what the page sent, return what it is told; raises InputError where it cannot be."""


class AnnotationServer(ThreadingHTTPServer):
    """Serves a session on 127.0.0.1 under a secret address until the page closes it.

    Other pages in the same browser can send requests here too. They do not know the token in `address`, and a name
    of theirs that resolves to this machine is refused by the Host header.

    Attributes
    ----------
    address: where the page is; closed: whether the page ended the session.
    """

    daemon_threads = True

    def __init__(self, session: Session, port: int = 0) -> None:
        try:
            super().__init__((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or "0 to 65535 is needed"
            raise InputError("port", f"{port} cannot be used: {reason}", remedy="0 takes a free one") from None
        self.session = session
        self.token = secrets.token_urlsafe(24)
        self.hosts = tuple(f"{name}:{self.server_address[1]}" for name in (HOST, "localhost"))
        self.address = f"http://{self.hosts[0]}/{self.token}/"
        self.closed = False

    def close_soon(self) -> None:
        """End `serve_forever` from within a request."""
        self.closed = True
        threading.Thread(target=self.shutdown, daemon=True).start()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that leaves in the middle of an answer is nobody's news."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: AnnotationServer
    timeout = 60.0  # a connection that says nothing does not keep its thread for ever

    def do_GET(self) -> None:
        route = self._route()
        frame = _FRAME.fullmatch(route) if route is not None else None
        if route is None:
            self._refuse(HTTPStatus.FORBIDDEN, "this address is not known here")
        elif route == "":
            self._page()
        elif route == "state.json":
            self._json(HTTPStatus.OK, self.server.session.state())
        elif frame:
            self._picture(int(frame[1]))
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "there is no such page")

    def do_POST(self) -> None:
        route = self._route()
        origin = self.headers.get("Origin")
        if route is None or (origin is not None and origin.removeprefix("http://") not in self.server.hosts):
            self._refuse(HTTPStatus.FORBIDDEN, "this address is not known here")
        elif route != "save":
            self._refuse(HTTPStatus.NOT_FOUND, "there is no such page")
        elif self.headers.get_content_type() != "application/json":
            self._refuse(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "application/json is needed")
        else:
            self._save()

    def _route(self) -> str | None:
        """What is asked for, below the secret part of the address; None where the asker does not know that."""
        if self.headers.get("Host") not in self.server.hosts:
            return None
        _, _, rest = self.path.partition("?")[0].partition("/")
        token, slash, route = rest.partition("/")
        known = hmac.compare_digest(token.encode("utf-8", "replace"), self.server.token.encode("ascii"))
        return route if known and slash else None

    def _save(self) -> None:
        declared = self.headers.get("Content-Length", "")
        if not (declared.isascii() and declared.isdecimal()):
            return self._refuse(HTTPStatus.LENGTH_REQUIRED, "Content-Length is needed")
        if len(declared) > 12 or int(declared) > self.server.session.largest_post:
            return self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too much for this clip")
        try:
            posted = json.loads(self.rfile.read(int(declared)))
        except (ValueError, RecursionError):
            return self._refuse(HTTPStatus.BAD_REQUEST, "what was sent is not JSON")
        try:
            answer = self.server.session.save(posted)
        except InputError as error:
            return self._refuse(HTTPStatus.BAD_REQUEST, str(error))
        self._json(HTTPStatus.OK, answer)
        if posted.get("close") is True:
            self.server.close_soon()

    def _page(self) -> None:
        nonce = secrets.token_urlsafe(16)
        template = (resources.files("kinemode") / "annotate.html").read_text(encoding="utf-8")
        # nothing but this page's own script and style, and nothing from anywhere else
        policy = (
            f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src 'self' data:; "
            "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        body = template.replace("__NONCE__", nonce).encode("utf-8")
        self._send(HTTPStatus.OK, "text/html; charset=utf-8", body, {"Content-Security-Policy": policy})

    def _picture(self, index: int) -> None:
        try:
            self._send(HTTPStatus.OK, "image/png", self.server.session.picture(index))
        except IndexError:
            self._refuse(HTTPStatus.NOT_FOUND, f"the clip has no frame {index}")
        except InputError as error:
            self._refuse(HTTPStatus.INTERNAL_SERVER_ERROR, str(error))

    def _refuse(self, status: HTTPStatus, problem: str) -> None:
        self._json(status, {"error": problem})

    def _json(self, status: HTTPStatus, value: dict[str, Any]) -> None:
        self._send(status, "application/json", json.dumps(value, allow_nan=False).encode("utf-8"))

    def _send(self, status: HTTPStatus, kind: str, body: bytes, headers: dict[str, str] | None = None) -> None:
        self.send_response(status)
        fixed = {"Cache-Control": "no-store", "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff"}
        for name, value in {"Content-Type": kind, "Content-Length": str(len(body)), **fixed, **(headers or {})}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Requests are nobody's news."""
