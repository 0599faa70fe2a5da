"""Keypoint files of several people, as the detectors write them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.formats.keypoints_reading import Person
from humanoid.subject.landmarks import FORMATS

Frames = Sequence[Sequence[Person]]


def random_crowd(layout: str, count: int, frames: int, seed: int) -> list[list[Person]]:
    """People of a layout who drift through a picture of 1920 x 1080, in random order in each frame."""
    rng, points = np.random.default_rng(seed), len(FORMATS[layout])
    shape = rng.uniform(-1.0, 1.0, (count, points, 2)) * [25.0, 60.0]
    place, speed = rng.uniform(0.0, 1.0, (count, 1, 2)) * [1920.0, 1080.0], rng.normal(0.0, 2.0, (count, 1, 2))
    made = []
    for t in range(frames):
        xy = rng.normal(place + speed * t + shape, 1.0)
        seen = np.concatenate([xy, rng.uniform(0.3, 1.0, (count, points, 1))], axis=-1).round(3)
        made.append([Person(seen[k]) for k in rng.permutation(count)])
    return made


def write_openpose(path: Path, frames: Frames) -> Path:
    """A folder with a file a frame."""
    path.mkdir()
    for t, people in enumerate(frames):
        listed = [{"person_id": [-1], "pose_keypoints_2d": _flat(p)} for p in people]
        (path / f"clip_{t:012d}_keypoints.json").write_text(json.dumps({"version": 1.3, "people": listed}))
    return path


def write_alphapose(path: Path, frames: Frames) -> Path:
    """A list of detections, without ids."""
    return _json(
        path, [{"image_id": f"{t}.jpg", "keypoints": _flat(p), "score": 2.5} for t, f in enumerate(frames) for p in f]
    )


def write_alphapose_open(path: Path, frames: Frames) -> Path:
    """An object of frames, as AlphaPose writes with its option `open`."""
    return _json(
        path, {f"{t}.jpg": {"people": [{"pose_keypoints_2d": _flat(p)} for p in f]} for t, f in enumerate(frames)}
    )


def write_mmpose(path: Path, frames: Frames) -> Path:
    """A list of frames with instances."""
    return _json(path, [{"frame_id": t, "instances": [_instance(p) for p in f]} for t, f in enumerate(frames)])


WRITERS: dict[str, Callable[[Path, Frames], Path]] = {
    "OpenPose": write_openpose,
    "AlphaPose": write_alphapose,
    "AlphaPose, open": write_alphapose_open,
    "MMPose": write_mmpose,
}


def _flat(person: Person) -> list[float]:
    return [float(v) for v in np.nan_to_num(person.points).ravel()]


def _instance(person: Person) -> dict[str, Any]:
    points = np.nan_to_num(person.points)
    return {"keypoints": points[:, :2].tolist(), "keypoint_scores": points[:, 2].tolist()}


def _json(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content))
    return path
