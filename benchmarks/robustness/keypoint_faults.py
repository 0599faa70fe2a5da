"""Faults of keypoints, of one camera or several, that a person is tracked by."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import kinemode as km
from benchmarks.robustness.fault_verdicts import Result, Trial
from benchmarks.robustness.floor_scenes import FPS
from benchmarks.robustness.floors import SIZE, about_origin, cameras_around
from benchmarks.robustness.place_faults import (
    Fault,
    Places,
    frozen,
    labels_permuted,
    legs_missing,
    pictures_twice,
    point_stuck,
    sides_exchanged,
    some,
    stretch,
    with_fault,
    zeros,
)
from benchmarks.support.mocap_person import DETECTOR
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.synthesis.detector import of_points
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import FORMATS

LAYOUTS = ("coco17", "body25", "halpe26")
Views = tuple[Places, ...]


def person_swapped(rng: np.random.Generator, places: Places) -> None:
    """Swapped for another person in the picture, who moves as this one did some frames before."""
    frames, later = stretch(rng, len(places.at)), int(rng.integers(5, 15))
    direction = rng.normal(size=2) * [1.0, 0.1]
    beside = direction / np.linalg.norm(direction) * rng.uniform(0.3, 1.2) * places.size
    places.at[frames] = np.roll(places.at, later, axis=0)[frames] + beside


def camera_turned(rng: np.random.Generator, places: Places) -> None:
    """By a quarter, undeclared."""
    x, y = places.at[..., 0].copy(), places.at[..., 1].copy()
    places.at[..., 0], places.at[..., 1] = (y, SIZE[0] - x) if rng.random() < 0.5 else (SIZE[1] - y, x)


def picture_mirrored(rng: np.random.Generator, places: Places) -> None:
    places.at[..., 0] = SIZE[0] - places.at[..., 0]


def another_size(rng: np.random.Generator, places: Places) -> None:
    places.at[...] *= rng.choice([0.25, 0.5, 2.0 / 3.0])


def begun_later(rng: np.random.Generator, places: Places) -> None:
    """By one to six frames, undeclared."""
    late = int(rng.integers(1, 7))
    places.at[:-late] = places.at[late:]
    places.at[-late:] = np.nan


def point_off(rng: np.random.Generator, places: Places) -> None:
    for k in some(rng, places, 0.05):
        places.at[:, k] += rng.normal(size=2) * rng.uniform(0.1, 0.4) * places.size


FAULTS: tuple[Fault, ...] = (
    zeros,
    point_stuck,
    frozen,
    pictures_twice,
    sides_exchanged,
    person_swapped,
    legs_missing,
    camera_turned,
    picture_mirrored,
    another_size,
    begun_later,
    point_off,
    labels_permuted,
)
_EVERYWHERE, _SEVERAL = (legs_missing, labels_permuted), (begun_later,)
"""Faults of all cameras instead of one, and of one among several."""


def trial(body: Body, q: np.ndarray, fault: Fault, rng: np.random.Generator) -> Trial:
    """One fault of the keypoints of q (T, nq), in one camera half of the time, else in two or three."""
    count = int(rng.integers(2, 4)) if fault in _SEVERAL or rng.random() < 0.5 else 1
    layout = LAYOUTS[int(rng.integers(len(LAYOUTS)))]
    views = _detected(body, q, layout, count, rng)
    chosen = range(count) if fault in _EVERYWHERE else [int(rng.integers(count))]
    seed = int(rng.integers(2**32))
    wrong = tuple(with_fault(v, fault, np.random.default_rng(seed)) if c in chosen else v for c, v in enumerate(views))
    return Trial(
        f"{layout} of {count}",
        lambda folder: _tracked(body, q, layout, views, folder),
        lambda folder: _tracked(body, q, layout, wrong, folder),
    )


def _detected(body: Body, q: np.ndarray, layout: str, count: int, rng: np.random.Generator) -> Views:
    """Keypoints of q (T, nq) as a detector gives them in so many cameras."""
    names = tuple(name for name in FORMATS[layout] if name is not None)
    points = about_origin(body.landmarks_of(body.placed(q)))[:, [body.landmark_names.index(name) for name in names]]
    tracks = [of_points(names, layout, points, camera, rng, DETECTOR, FPS) for camera in cameras_around()[:count]]
    return tuple(Places(track.pixels, names) for track in tracks)


def _tracked(body: Body, q: np.ndarray, layout: str, views: Views, folder: Path) -> Result:
    """As a user would, by calibrated cameras."""
    cameras = cameras_around()[: len(views)]
    write_cameras(folder / "cameras.json", cameras)
    paths = [folder / f"{camera.name}.json" for camera in cameras]
    for path, view in zip(paths, views, strict=True):
        seen = np.isfinite(view.at).all(axis=-1).astype(float)
        write_keypoints(path, KeypointTrack(layout, view.names, view.at, seen, SIZE, FPS))
    run = km.track(body.subject.source, None, keypoints=paths, cameras=folder / "cameras.json", up="z", fit="off")
    return Result.of_joints(run, q)
