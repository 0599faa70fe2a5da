"""The preview over HTTP on this machine; follows a run that is still being written."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from threading import Lock

from estimator.runs.run_reader import Run
from humanoid.support.errors import InputError
from viz.local_server import LocalHandler, LocalServer
from viz.preview.page import page
from viz.scene import Scene


class PreviewServer(LocalServer):
    """Serves the page that `make_page` makes for every load; it raises InputError where it cannot."""

    def __init__(self, make_page: Callable[[], bytes], port: int = 0) -> None:
        super().__init__(_Handler, port)
        self.make_page = make_page


class _Handler(LocalHandler):
    server: PreviewServer

    def get(self, route: str) -> None:
        if route != "":
            return self.refuse(HTTPStatus.NOT_FOUND, "there is no such page")
        try:
            body = self.server.make_page()
        except InputError as error:  # for example, the run file was moved away
            return self.refuse(HTTPStatus.INTERNAL_SERVER_ERROR, str(error))
        self.send(HTTPStatus.OK, "text/html; charset=utf-8", body)


def serve(
    run: Run | Scene,
    *,
    port: int = 0,
    open_browser: bool = True,
    ready: Callable[[LocalServer, str], None] | None = None,
) -> None:
    """Serve the preview on 127.0.0.1 until Ctrl-C; all of it in this process, so nothing outlives it.

    A run that is still being written is read again for every load of the page: reload to see its latest content. port:
    0 takes a free one. ready: called with the server and its address before serving; the address is printed unless it
    is given.

    Raises
    ------
    InputError: the port cannot be used, or the run cannot be shown.
    """
    with PreviewServer(_pages(run), port) as server, suppress(KeyboardInterrupt):
        if ready is not None:
            ready(server, server.address)
        else:
            print(f"{server.address} shows the run; Ctrl-C ends it", flush=True)
        if open_browser:
            webbrowser.open(server.address, new=2)
        server.serve_forever(poll_interval=0.1)


def _pages(run: Run | Scene) -> Callable[[], bytes]:
    """Makes the page on each call, or only once where it cannot change any more."""
    kept: list[tuple[bool, int, bytes]] = []
    lock = Lock()

    def make() -> bytes:
        with lock:
            current = run if isinstance(run, Scene) else Run.open(run.file)
            complete = isinstance(current, Scene) or current.complete
            if not kept or kept[-1][:2] != (complete, len(current)):
                kept[:] = [(complete, len(current), page(current).encode("utf-8"))]
            return kept[-1][2]

    make()  # errors of a run are reported before a server is up
    return make
