"""The preview of what is being tracked: a page on this machine that moves with every frame.

The page is that of a run with a single instant. The server sends it each frame as an event (HTML Living Standard, 9.2
"Server-sent events"); a browser that is too slow for all of them gets the newest.
"""

from __future__ import annotations

import json
import threading
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from importlib import resources
from types import TracebackType
from typing import Any

import numpy as np

from estimator.data.cameras.camera import Camera
from humanoid.kinematics.body import Body
from viz.local_server import LocalHandler, LocalServer
from viz.preview.cameras import data_address
from viz.preview.page import joint_curves, motion, node_names, page
from viz.scene import Scene
from viz.solids.body_solids import body_solids
from viz.solids.solid import merged

_WAITING = (
    b'<!DOCTYPE html><meta charset="utf-8"><meta http-equiv="refresh" content="0.5"><title>kinemode</title>'
    b'<body style="background:#14161c;color:#eceef2;font:15px system-ui,sans-serif;margin:40px">waiting for a person'
)


@dataclass(frozen=True)
class Moment:
    """One frame to show: its number, time [s] and status, hypotheses mode_q (K, nq), best first, and their weights
    (K,); the pose q (nq,) to draw, NaN for none; each camera's picture (H, W, 3) uint8 BGR or None; a note."""

    index: int
    time: float
    status: str
    q: np.ndarray
    mode_q: np.ndarray
    weight: np.ndarray
    pictures: tuple[np.ndarray | None, ...]
    note: str = ""


class MovingPreview:
    """Serves the page on 127.0.0.1 from `__enter__` to `__exit__`, in threads of its own.

    hypotheses: how many there are at most. port: 0 takes a free one. patience [s]: how long a page waits for a frame
    before it is checked for still being connected. farewell [s]: how long open pages are given to receive the end.
    Raises InputError where the port cannot be used.

    Attributes
    ----------
    address: where the page is.
    """

    def __init__(
        self,
        body: Body,
        cameras: tuple[Camera, ...],
        hypotheses: int,
        *,
        port: int = 0,
        patience: float = 1.0,
        farewell: float = 1.0,
    ) -> None:
        self._patience, self._farewell = patience, farewell
        self._body, self._cameras, self._count = body, cameras, hypotheses
        self._names = (node_names(merged(body_solids(body))), node_names(merged(body_solids(body, coarse=True))))
        self._news = threading.Condition()
        self._newest: tuple[int, Moment] | None = None
        self._page: bytes | None = None
        self._end: str | None = None
        self._listeners = 0
        self._server = _Server(self, port)
        self.address = self._server.address

    def show(self, moment: Moment) -> None:
        """Show a frame; returns at once."""
        with self._news:
            self._newest = (0 if self._newest is None else self._newest[0] + 1, moment)
            if self._page is None and np.isfinite(moment.q).all():
                self._page = self._first_page(moment)
            self._news.notify_all()

    def end(self, note: str) -> None:
        """Notify open pages that no frame follows; they stay as they are."""
        with self._news:
            self._end = note
            self._news.notify_all()
            self._news.wait_for(lambda: self._listeners == 0, self._farewell)

    def open_browser(self) -> None:
        """Open the page in the user's browser."""
        webbrowser.open(self.address, new=2)

    def page(self) -> bytes:
        """The page for a browser that opens the address now."""
        with self._news:
            return _WAITING if self._page is None else self._page

    def follow(self, send: Callable[[str, str], None]) -> None:
        """Send every frame from now on, as (kind, text), until the end; a frame that is overtaken is left out."""
        with self._news:
            self._listeners += 1
        number = -1
        try:
            while True:
                with self._news:
                    self._news.wait_for(
                        lambda: self._end is not None or self._is_after(number),  # noqa: B023
                        self._patience,
                    )
                    newest, end = self._newest, self._end
                if newest is not None and newest[0] > number:
                    number = newest[0]
                    send("message", json.dumps(self._described(newest[1]), allow_nan=False))
                elif end is not None:
                    return send("end", end)
                else:
                    send("still", "")
        finally:
            with self._news:
                self._listeners -= 1
                self._news.notify_all()

    def __enter__(self) -> MovingPreview:
        threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.shutdown()
        self._server.server_close()

    def _is_after(self, number: int) -> bool:
        return self._newest is not None and self._newest[0] > number

    def _first_page(self, moment: Moment) -> bytes:
        """Around the first pose that there is; the ground and the lights stay where they are then."""
        script = (resources.files("viz.preview") / "moving.js").read_text(encoding="utf-8")
        return page(self._scene(moment), script).encode("utf-8")

    def _scene(self, moment: Moment) -> Scene:
        """The scene of a single instant."""
        none = np.zeros((1, len(self._cameras), len(self._body.landmark_names)))
        frames = tuple(None if p is None else (lambda p=p: iter([p])) for p in moment.pictures)
        return Scene(
            self._body, self._cameras, frames, np.zeros(1, dtype=np.int64), np.array([moment.time]), (moment.status,),
            moment.q[None], self._padded(moment.mode_q)[None], self._padded(moment.weight)[None],
            np.zeros(1, dtype=np.int64), np.full((*none.shape, 2), np.nan), none,
        )  # fmt: skip

    def _padded(self, values: np.ndarray) -> np.ndarray:
        """Values of all hypotheses (K, ...), NaN where there are fewer."""
        out = np.full((self._count, *values.shape[1:]), np.nan)
        out[: len(values)] = values[: self._count]
        return out

    def _described(self, moment: Moment) -> dict[str, Any]:
        seen = bool(np.isfinite(moment.q).all())
        weights = [float(w) if np.isfinite(w) else None for w in self._padded(moment.weight)]
        pictures = [
            None if picture is None else data_address(picture, camera)
            for picture, camera in zip(moment.pictures, self._cameras, strict=True)
        ]
        return {
            "index": moment.index, "time": moment.time, "status": moment.status, "note": moment.note,
            "best": 0 if seen else -1, "weight": weights, "pictures": pictures,
            "body": self._places(moment.q, self._names[0]) if seen else {},
            "angles": [curve["value"][0] for curve in joint_curves(self._scene(moment), [0])],
            "hypotheses": [self._places(q, self._names[1]) for q in moment.mode_q[: self._count]],
        }  # fmt: skip

    def _places(self, q: np.ndarray, names: dict[int, str]) -> dict[str, list[float]]:
        """Position [m] and quaternion xyzw of every node."""
        positions, quaternions = motion(self._body, q[None], list(names))
        places = np.concatenate([positions[0], quaternions[0]], axis=1).round(5)
        return dict(zip(names.values(), places.tolist(), strict=True))


class _Server(LocalServer):
    def __init__(self, preview: MovingPreview, port: int) -> None:
        super().__init__(_Handler, port)
        self.preview = preview


class _Handler(LocalHandler):
    server: _Server

    def get(self, route: str) -> None:
        if route == "":
            return self.send(HTTPStatus.OK, "text/html; charset=utf-8", self.server.preview.page())
        if route != "frames":
            return self.refuse(HTTPStatus.NOT_FOUND, "there is no such page")
        self.start_stream("text/event-stream")
        if self.command != "HEAD":
            self.server.preview.follow(self._event)

    def _event(self, kind: str, text: str) -> None:
        self.wfile.write(f"event: {kind}\ndata: {text}\n\n".encode())
        self.wfile.flush()
