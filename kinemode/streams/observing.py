"""A program's input for one frame, checked and made into an observation."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack, Layout, keypoint_points, keypoint_track, named_layout
from estimator.data.observation import Observation
from estimator.data.sequence import assemble, keypoint_jitter
from estimator.data.standing import StandingPoints
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError, misplaced

REMEMBERED = 150  # frames in which the trembling of keypoints is measured


class Observer:
    """Makes the observations of a stream, in order.

    layout: see `estimator.data.formats.keypoints`. jitter [px]: how much keypoints tremble, of each camera or
    of all (`Observation.jitter`); None measures it in the last frames, `REMEMBERED` at most.
    """

    def __init__(
        self, body: Body, cameras: tuple[Camera, ...], layout: Layout, jitter: float | Mapping[str, float] | None
    ) -> None:
        self._body, self._layout = body, layout
        self._cameras = {camera.name: camera for camera in cameras}
        self._given = _jitters(jitter, self._cameras)
        self._before: deque[np.ndarray] = deque(maxlen=REMEMBERED)
        self._standing = StandingPoints(body.landmark_names)
        self._count, self._time = 0, -np.inf
        self._pending: Observation | None = None
        if not isinstance(layout, str) or layout != "auto":
            self._check_layout()

    def at(self, keypoints: Any, time: float) -> Observation:
        """The next frame's; it counts once it is accepted. Raises InputError where it is invalid."""
        if not np.isfinite(time) or time <= self._time:
            raise InputError("time", f"{time:g} s does not follow {self._time:g} s", remedy="frames come in order")
        given = self._by_camera(keypoints, "keypoints")
        tracks = {name: self._track(name, given.get(name)) for name in self._cameras}
        (seen,) = assemble(self._body, tracks, self._cameras, np.array([float(time)]))
        seen = replace(seen, index=self._count, jitter=self._jitter(seen.pixels))
        self._pending = self._standing.with_rest(seen)
        return self._pending

    def accept(self) -> None:
        """Go on to the frame after the last."""
        assert self._pending is not None
        self._before.append(self._pending.pixels)
        self._standing.add(self._pending)
        self._count, self._time = self._count + 1, self._pending.time

    def pictures(self, given: Any) -> list[np.ndarray]:
        """A picture (H, W, 3) uint8 BGR of each camera; raises InputError where there is none or it does not fit."""
        by_camera = self._by_camera(given, "picture")
        return [self._picture(camera, by_camera.get(name)) for name, camera in self._cameras.items()]

    def _by_camera(self, given: Any, argument: str) -> Mapping[str, Any]:
        if given is None:
            return {}
        if not isinstance(given, Mapping):
            if len(self._cameras) > 1:
                problem = f"is for one of {len(self._cameras)} cameras"
                raise InputError(argument, problem, remedy=f"a mapping by camera: {', '.join(self._cameras)}")
            return dict.fromkeys(self._cameras, given)
        for name in given:
            if name not in self._cameras:
                raise InputError(
                    argument, f"there is no camera {name!r}", remedy=f"cameras: {', '.join(self._cameras)}"
                )
        return given

    def _track(self, name: str, values: Any) -> KeypointTrack:
        """One frame's; a camera without a person has a track without names."""
        size = self._cameras[name].image_size
        if values is None:
            return KeypointTrack("none", (), np.zeros((1, 0, 2)), np.zeros((1, 0)), size)
        argument = "keypoints" if len(self._cameras) == 1 else f"keypoints of {name}"
        points = keypoint_points(values, 2, "(K, 2) or (K, 3)", argument)
        return replace(keypoint_track(points[None], self._layout, argument=argument), image_size=size)

    def _picture(self, camera: Camera, picture: Any) -> np.ndarray:
        argument = "picture" if len(self._cameras) == 1 else f"picture of {camera.name}"
        width, height = camera.image_size
        if not isinstance(picture, np.ndarray):
            raise misplaced(argument, picture, f"an array ({height}, {width}, 3) of uint8, BGR")
        if picture.shape != (height, width, 3) or picture.dtype != np.uint8:
            problem = f"has the shape {picture.shape} and type {picture.dtype}"
            raise InputError(argument, problem, remedy=f"({height}, {width}, 3) uint8, BGR, is needed")
        return picture

    def _jitter(self, pixels: np.ndarray) -> tuple[float, ...]:
        if self._given is not None:
            return self._given
        recent = np.array([*self._before, pixels])
        return tuple(keypoint_jitter(recent[:, c]) for c in range(len(self._cameras)))

    def _check_layout(self) -> None:
        """Before the first frame: a layout that is unknown or has too little in common with the body."""
        count = len(self._layout) if not isinstance(self._layout, str) else None
        name, names = named_layout(self._layout, count)
        track = KeypointTrack(name, names, np.full((1, len(names), 2), np.nan), np.zeros((1, len(names))))
        assemble(self._body, dict.fromkeys(self._cameras, track), self._cameras, np.zeros(1))


def _jitters(given: float | Mapping[str, float] | None, cameras: Mapping[str, Camera]) -> tuple[float, ...] | None:
    if given is None:
        return None
    values = given if isinstance(given, Mapping) else dict.fromkeys(cameras, given)
    if set(values) != set(cameras):
        raise InputError("jitter", f"is of {', '.join(map(str, values))}", remedy=f"cameras: {', '.join(cameras)}")
    jitter = tuple(float(values[name]) for name in cameras)
    if not all(np.isfinite(value) and value >= 0.0 for value in jitter):
        raise InputError("jitter", f"must be 0 px or more, got {jitter}")
    return jitter
