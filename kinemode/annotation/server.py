"""The annotation page over HTTP on this machine, for the one browser that was given its address."""

from __future__ import annotations

import json
import re
import secrets
from http import HTTPStatus
from importlib import resources
from typing import Any, Protocol

from humanoid.support.errors import InputError
from viz.local_server import LocalHandler, LocalServer

_FRAME = re.compile(r"frame/([0-9]{1,9})\.png")


class AnnotationSession(Protocol):
    """The served session: all that the page shows and saves."""

    largest_post: int
    """Bytes a saving page can send at most."""

    def state(self) -> dict[str, Any]:
        """Everything the page needs at its start, for JSON."""

    def picture(self, index: int) -> bytes:
        """A frame as PNG; raises IndexError where the clip has none."""

    def save(self, posted: Any) -> dict[str, Any]:
        """Write what the page sent, return the answer; raises InputError for an invalid one."""


class AnnotationServer(LocalServer):
    """Serves a session until the page closes it; `closed`: whether the page did."""

    def __init__(self, session: AnnotationSession, port: int = 0) -> None:
        super().__init__(_Handler, port)
        self.session = session
        self.closed = False


class _Handler(LocalHandler):
    server: AnnotationServer

    def get(self, route: str) -> None:
        frame = _FRAME.fullmatch(route)
        if route == "":
            self._page()
        elif route == "state.json":
            self.json(HTTPStatus.OK, self.server.session.state())
        elif frame:
            self._picture(int(frame[1]))
        else:
            self.refuse(HTTPStatus.NOT_FOUND, "there is no such page")

    def do_POST(self) -> None:
        route = self.route()
        origin = self.headers.get("Origin")
        if route is None or (origin is not None and origin.removeprefix("http://") not in self.server.hosts):
            self.refuse_other_pages()
        elif route != "save":
            self.refuse(HTTPStatus.NOT_FOUND, "there is no such page")
        elif self.headers.get_content_type() != "application/json":
            self.refuse(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "application/json is needed")
        else:
            self._save()

    def _save(self) -> None:
        declared = self.headers.get("Content-Length", "")
        if not (declared.isascii() and declared.isdecimal()):
            return self.refuse(HTTPStatus.LENGTH_REQUIRED, "Content-Length is needed")
        if len(declared) > 12 or int(declared) > self.server.session.largest_post:
            return self.refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too much for this clip")
        try:
            posted = json.loads(self.rfile.read(int(declared)))
        except (ValueError, RecursionError):
            return self.refuse(HTTPStatus.BAD_REQUEST, "the request is not JSON")
        try:
            answer = self.server.session.save(posted)
        except InputError as error:
            return self.refuse(HTTPStatus.BAD_REQUEST, str(error))
        self.json(HTTPStatus.OK, answer)
        if posted.get("close") is True:
            self.server.closed = True
            self.server.close_soon()

    def _page(self) -> None:
        nonce = secrets.token_urlsafe(16)
        template = (resources.files("kinemode.annotation") / "annotate.html").read_text(encoding="utf-8")
        # nothing but this page's own script and style, and nothing from anywhere else
        policy = (
            f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src 'self' data:; "
            "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        body = template.replace("__NONCE__", nonce).encode("utf-8")
        self.send(HTTPStatus.OK, "text/html; charset=utf-8", body, {"Content-Security-Policy": policy})

    def _picture(self, index: int) -> None:
        try:
            self.send(HTTPStatus.OK, "image/png", self.server.session.picture(index))
        except IndexError:
            self.refuse(HTTPStatus.NOT_FOUND, f"the clip has no frame {index}")
        except InputError as error:
            self.refuse(HTTPStatus.INTERNAL_SERVER_ERROR, str(error))
