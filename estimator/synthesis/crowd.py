"""Several people in one world, as a detector gives them: a frame's people in any order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints_people import Person
from estimator.synthesis.detector import keypoints
from estimator.synthesis.settings import DetectorSettings
from humanoid.kinematics.body import ROOT_Q, Body


def placed(q: np.ndarray, place: np.ndarray, turn: float) -> np.ndarray:
    """A free body's motion q (T, nq) turned by `turn` [rad] about the vertical z axis and moved to `place`, x and y
    [m], one (2,) for all frames or one (T, 2) for each."""
    moved = q.copy()
    path = np.broadcast_to(place, (len(q), 2))
    R = pin.rpy.rpyToMatrix(0.0, 0.0, turn)
    for t, pose in enumerate(q):
        T_world_motion = pin.SE3(R, np.append(path[t], 0.0))
        moved[t, ROOT_Q] = pin.SE3ToXYZQUAT(T_world_motion * pin.XYZQUATToSE3(pose[ROOT_Q]))
    return moved


def crowd(
    body: Body,
    people: Sequence[np.ndarray],
    cameras: Sequence[Camera],
    rng: np.random.Generator,
    *,
    noise_px: float = 2.5,
    hidden: Mapping[str, Sequence[int]] | None = None,
) -> dict[str, list[list[tuple[int, Person]]]]:
    """People detected in each frame of each camera, in random order: by camera name T lists of (number, detection).

    people (N): configurations (T, nq) of each. hidden: numbers of the people a camera does not see at all. Noise,
    outliers and missing points are those of `detector.keypoints`; a person without a point in the image is not
    detected.
    """
    detections: dict[str, list[list[tuple[int, Person]]]] = {c.name: [[] for _ in people[0]] for c in cameras}
    for number, q in enumerate(people):
        for track in keypoints(body, q, cameras, rng, DetectorSettings(noise_px)):
            if number in (hidden or {}).get(track.source, ()):
                continue
            points = np.concatenate([track.pixels, track.confidence[..., None]], axis=-1)
            for t in np.flatnonzero((track.confidence > 0.0).sum(axis=1) > 1).tolist():
                detections[track.source][t].append((number, Person(points[t])))
    for frames in detections.values():
        for t, frame in enumerate(frames):
            frames[t] = [frame[k] for k in rng.permutation(len(frame))]
    return detections
