"""The servers of this machine's browser, on real sockets: which requests are answered, and what remains."""

from __future__ import annotations

import http.client
import signal
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest

from humanoid.support.errors import InputError
from tests.test_viz import moving_scene
from tests.waiting import DEADLINE
from viz.local_server import LocalServer
from viz.preview import live

PAGE = b"<!DOCTYPE html>" + b"x" * 40_000_000  # more than any socket takes at once


@contextmanager
def serving(page: bytes = b"<!DOCTYPE html>") -> Iterator[LocalServer]:
    with live.PreviewServer(lambda: page) as server, answering(server):
        yield server


@contextmanager
def answering(server: LocalServer) -> Iterator[None]:
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        thread.join(DEADLINE)
        assert not thread.is_alive()


def ask(server: LocalServer, route: str, method: str = "GET", **headers: str) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection(*server.server_address[:2], timeout=DEADLINE)
    connection.request(method, route, headers=headers)
    answer = connection.getresponse()
    return answer.status, dict(answer.headers), answer.read()


def test_only_the_full_address_opens_the_page() -> None:
    with serving() as server:
        port, secret = server.server_address[1], f"/{server.token}/"
        assert server.address == f"http://127.0.0.1:{port}{secret}"
        assert ask(server, secret)[::2] == (200, b"<!DOCTYPE html>")
        assert ask(server, secret, Host=f"localhost:{port}")[0] == 200
        for route in ("/", "/index.html", secret[:-1], f"/{server.token}x/", "//", "/../"):
            assert ask(server, route)[0] == 403, route
        for host in ("elsewhere.example", f"elsewhere.example:{port}", "127.0.0.1", f"127.0.0.1:{port + 1}", ""):
            assert ask(server, secret, Host=host)[0] == 403, host
            assert ask(server, "/favicon.ico", Host=host)[0] == 403, host
        assert ask(server, f"{secret}other")[0] == 404
        assert ask(server, secret, "POST")[0] == 501


def test_head_has_no_body_and_an_icon_is_not_missed() -> None:
    with serving() as server:
        status, headers, body = ask(server, f"/{server.token}/", "HEAD")
        assert (status, headers["Content-Length"], body) == (200, "15", b"")
        assert ask(server, "/favicon.ico")[::2] == (204, b"")
        raw = socket.create_connection(server.server_address[:2], timeout=DEADLINE)
        raw.sendall(f"HEAD /{server.token}/ HTTP/1.1\r\nHost: {server.hosts[0]}\r\n\r\n".encode())
        assert b"".join(iter(lambda: raw.recv(4096), b"")).endswith(b"\r\n\r\n")


def test_silent_connections_are_closed(capfd: pytest.CaptureFixture[str]) -> None:
    with ExitStack() as stack:
        server = stack.enter_context(live.PreviewServer(lambda: b"<!DOCTYPE html>"))
        usual, server.silence = server.silence, 0.05
        silent = [socket.create_connection(server.server_address[:2], timeout=DEADLINE) for _ in range(3)]
        for connection, sent in zip(silent, (b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost"), strict=True):
            connection.sendall(sent)  # before the server listens, so that the data is there when the timeout starts
        stack.enter_context(answering(server))
        assert [connection.recv(100) for connection in silent] == [b""] * 3
        server.silence = usual
        assert ask(server, f"/{server.token}/")[0] == 200
    assert capfd.readouterr() == ("", "")


def test_a_browser_that_leaves_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    with serving(PAGE) as server:
        before = threading.active_count()
        for reset in (True, False):
            leaving = socket.create_connection(server.server_address[:2], timeout=DEADLINE)
            if reset:  # close by RST instead of FIN
                leaving.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            leaving.sendall(f"GET /{server.token}/ HTTP/1.1\r\nHost: {server.hosts[0]}\r\n\r\n".encode())
            assert leaving.recv(100).startswith(b"HTTP/1.0 200")
            leaving.close()
        for thread in threading.enumerate():
            if "process_request" in thread.name:
                thread.join(DEADLINE)
        assert threading.active_count() <= before
    assert capfd.readouterr() == ("", "")


def test_errors_are_shown_in_the_browser() -> None:
    def fail() -> bytes:
        raise InputError("walk.run", "there is no such file")

    with serving() as server:
        server.make_page = fail  # type: ignore[attr-defined]
        status, _, body = ask(server, f"/{server.token}/")
        assert status == 500
        assert b"walk.run: there is no such file" in body


@pytest.mark.usefixtures("default_signals")
def test_an_interrupt_ends_the_view_and_frees_its_port(capfd: pytest.CaptureFixture[str]) -> None:
    scene = moving_scene(1, modes=1, with_frames=False)
    places, answers = list[tuple[str, int]](), list[int]()

    def ready(server: LocalServer, address: str) -> None:
        places.append(server.server_address[:2])
        threading.Thread(target=visit, args=(server,), daemon=True).start()

    def visit(server: LocalServer) -> None:
        try:
            answers.append(ask(server, "/favicon.ico")[0])
        finally:
            signal.raise_signal(signal.SIGINT)

    live.serve(scene, open_browser=False, ready=ready)
    assert answers == [204]  # it was serving when the signal arrived
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(places[0], timeout=DEADLINE)
    assert capfd.readouterr() == ("", "")
    with pytest.raises(InputError, match="port: 70000 cannot be used"):
        live.serve(scene, open_browser=False, port=70000)
