"""Short clips of an upper body in which something happens to the hands, drawn at random: they cross, one comes before
the face, one is not found, they meet and part again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import kinemode as km
from benchmarks.papers_dual_chain.dual_chain_runs import FPS
from benchmarks.support.result_store import cached_clip
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.point_features import PointFeatures, skin_features
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.shot import RenderedClip

CROSSING, FACE, LOST, SWAPPED = "hands crossing", "hand before face", "blob lost", "blobs swapped"
EVENTS = (CROSSING, FACE, LOST, SWAPPED)
KEYS = (0, 18, 23, 41, 46)  # frames of key poses: apart, the event begins, it lasts, apart again, the end
GONE = range(14, 29)  # frames without the blob, where it is lost
TOUCH = 0.15  # [m] in the image plane: nearer than this, blobs run into each other
_SET = 4000  # poses drawn at once
_TRIES = 1000
_FASTEST = 2.0  # m/s, of hands
_DEEP = 0.005  # [m] of overlap that is let pass
_HAND_RANGE = np.array([[0.22, -0.45, -0.10], [0.60, 0.45, 0.62]])  # [m], of hands, in front of the middle of the trunk


@dataclass(frozen=True)
class EventClip:
    """One event of a seed, rendered as `benchmarks.papers_dual_chain.dual_chain_runs.UpperClip`."""

    event: str
    seed: int

    def files(self, folder: Path) -> RenderedClip:
        """Rendered into a folder unless it is there."""
        return cached_clip(folder / "events" / f"{self.event.replace(' ', '_')}_{self.seed}", self._render)

    def _render(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        body, table = upper_body(), folder / "motion.csv"
        times = np.arange(KEYS[-1] + 1) / FPS
        rows = np.column_stack([times, event_motion(self.event, np.random.default_rng((self.seed, 17)))])
        header = ",".join(("time", *body.q_names))
        np.savetxt(table, rows, delimiter=",", header=header, comments="", fmt="%.9f")
        km.render(
            folder, table, subject="upper13", fps=FPS, seed=self.seed,
            scene=km.SceneSettings(sleeves="long", boards=3, background="room"),
            view=km.ViewSettings(parallel=True, azimuth=0.0),
        )  # fmt: skip


@cache
def upper_body() -> Body:
    """The body of all events."""
    return Body(load_subject("upper13"))


@cache
def _hands() -> PointFeatures:
    return skin_features(upper_body(), anatomy_of(upper_body()))


def hands_of(q: np.ndarray) -> np.ndarray:
    """Head, left and right hand (N, 3, 3) [m] of poses (N, nq)."""
    return _hands().points(upper_body().placed(q))


def event_motion(event: str, rng: np.random.Generator) -> np.ndarray:
    """q (T, nq) of the frames up to the last of `KEYS`: from a pose with the hands apart into the event and out of it
    by ways of least jerk, on which no parts overlap and hands are no faster than 2 m/s; otherwise another is drawn."""
    collision = SelfCollision(upper_body())
    for _ in range(_TRIES):
        apart, after = (_random_pose(rng, _are_apart) for _ in range(2))
        during = _random_pose(rng, _DURING[event])
        lasts = _limited(during + rng.normal(0.0, 0.05, during.shape))
        q = _along([apart, during, lasts, after, _limited(after + rng.normal(0.0, 0.05, after.shape))])
        speed = FPS * np.linalg.norm(np.diff(hands_of(q), axis=0), axis=2).max()
        if speed > _FASTEST or not _happens(event, q):
            continue
        if max(collision.penetration(upper_body().at(pose)) for pose in q) < _DEEP:
            return q
    raise RuntimeError(f"no motion for {event}")  # the tries are many: nothing that a user could cause


def event_frames(event: str, q: np.ndarray) -> np.ndarray:
    """In which frames (T,) bool the event is on."""
    if event == LOST:
        return np.isin(np.arange(len(q)), list(GONE))
    head, left, right = np.moveaxis(hands_of(q), 1, 0)
    if event == FACE:
        on = np.minimum(*(np.linalg.norm((hand - head)[:, 1:], axis=1) for hand in (left, right))) < TOUCH
    else:
        on = (np.linalg.norm((left - right)[:, 1:], axis=1) < TOUCH) | (left[:, 1] < right[:, 1])
    frames = np.flatnonzero(on)
    return np.isin(np.arange(len(q)), np.arange(frames.min(), frames.max() + 1) if len(frames) else [])


def _happens(event: str, q: np.ndarray) -> bool:
    """Whether there are frames to compare with, before and after."""
    frames = np.flatnonzero(event_frames(event, q))
    return len(frames) >= 3 and frames[0] >= 6 and frames[-1] <= KEYS[-1] - 6


def _random_pose(rng: np.random.Generator, fits: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """A pose (nq,) with both hands before the trunk that fits; fits: hands (N, 3, 3) -> (N,) bool."""
    body = upper_body()
    while True:
        share = rng.uniform(0.02, 0.98, (_SET, body.nq))
        q = body.lower + share * (body.upper - body.lower)
        q[:, :2] = rng.normal(0.0, 0.02, (_SET, 2))
        q[:, 6:9] = rng.normal(0.0, 0.08, (_SET, 3))
        hands = hands_of(q)
        low, high = _HAND_RANGE
        before = ((hands[:, 1:] > low) & (hands[:, 1:] < high)).all(axis=(1, 2))
        chosen = np.flatnonzero(before & fits(hands))
        if len(chosen):
            return np.asarray(q[chosen[0]])


def _are_apart(hands: np.ndarray) -> np.ndarray:
    head, left, right = np.moveaxis(hands, 1, 0)
    return (left[:, 1] > right[:, 1] + 0.25) & (np.minimum(_flat(left, head), _flat(right, head)) > 0.3)


def _have_crossed(hands: np.ndarray) -> np.ndarray:
    head, left, right = np.moveaxis(hands, 1, 0)
    apart = np.minimum(_flat(left, head), _flat(right, head)) > 0.25
    return apart & (left[:, 1] < right[:, 1] - 0.1) & (np.abs(left[:, 2] - right[:, 2]) < 0.12)


def _is_before_face(hands: np.ndarray) -> np.ndarray:
    head, left, right = np.moveaxis(hands, 1, 0)
    near, far = np.sort([_flat(left, head), _flat(right, head)], axis=0)
    return (near < 0.07) & (far > 0.3)


def _have_met(hands: np.ndarray) -> np.ndarray:
    head, left, right = np.moveaxis(hands, 1, 0)
    beside = (left[:, 1] > right[:, 1] + 0.01) & (np.minimum(_flat(left, head), _flat(right, head)) > 0.25)
    return beside & (_flat(left, right) < 0.09)


_DURING = {CROSSING: _have_crossed, FACE: _is_before_face, LOST: _are_apart, SWAPPED: _have_met}


def _flat(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distances (N,) [m] in the image plane."""
    return np.asarray(np.linalg.norm((a - b)[:, 1:], axis=1))


def _along(poses: list[np.ndarray]) -> np.ndarray:
    """q (T, nq) from key to key, by ways of least jerk (Flash and Hogan 1985)."""
    t = np.arange(KEYS[-1] + 1)
    k = np.clip(np.searchsorted(KEYS, t, side="right") - 1, 0, len(KEYS) - 2)
    begin, end = np.array(KEYS)[k], np.array(KEYS)[k + 1]
    s = (t - begin) / (end - begin)
    share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    pose = np.array(poses)
    return np.asarray(pose[k] + share[:, None] * (pose[k + 1] - pose[k]))


def _limited(q: np.ndarray) -> np.ndarray:
    body = upper_body()
    return np.clip(q, body.lower, body.upper)
