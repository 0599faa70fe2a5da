"""Who follows a motion: this package, a peer's published motion, inverse kinematics by pink."""

from __future__ import annotations

from collections.abc import Callable
from time import process_time
from typing import NamedTuple

import numpy as np

import kinemode as km
from benchmarks.retargeting.pink_following import pink_motion
from benchmarks.retargeting.rebuilt import rebuilt_targets
from benchmarks.retargeting.trials import G1, RetargetTrial, peer_motion
from estimator.retargeting.contacts import SourceContacts
from estimator.retargeting.source import SourceMotion
from humanoid.kinematics.body import Body

OURS, ASAP_PEER, PINK = "ours", "asap", "pink"
_LOWER = 0.1  # share of what stands that may be under a floor


class FollowedMotion(NamedTuple):
    """q (T, nq) at the source's frames. seconds: processor time of a frame, NaN where unknown. floor [m]: that the
    method has the feet on, None where not given. scale: of the root's path, None for the ratio of the legs'
    lengths. note: what went wrong."""

    q: np.ndarray
    seconds: float = float("nan")
    floor: float | None = None
    scale: float | None = None
    note: str = ""


def follow(source: SourceMotion, subject: str) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Configurations (T, nq), their times (T,) [s] and the scale of lengths by `kinemode.retarget`; None where this
    version has none."""
    retarget = getattr(km, "retarget", None)
    if retarget is None:
        return None
    run = retarget(source, subject=subject)
    return run.q, run.time, float(run.header.settings["scale"])


def by_ours(body: Body, subject: str, trial: RetargetTrial) -> FollowedMotion | None:
    """This package's."""
    begun = process_time()
    followed = follow(trial.source, subject)
    if followed is None:
        return None
    return FollowedMotion(followed[0], (process_time() - begun) / len(followed[0]), floor=0.0, scale=followed[2])


def by_asap(body: Body, subject: str, trial: RetargetTrial) -> FollowedMotion | None:
    """The motion of G1 that comes with some trials, whose persons were scaled to the robot before."""
    return FollowedMotion(peer_motion(body, trial), scale=1.0) if trial.own and subject == G1 else None


def by_pink(body: Body, subject: str, trial: RetargetTrial) -> FollowedMotion | None:
    """Position tasks, frame by frame."""
    targets = rebuilt_targets(body, trial.source, trial.contacts)
    motion = pink_motion(body, targets, trial.source.times)
    note = f"{motion.failed} steps without a solution" if motion.failed else ""
    return FollowedMotion(motion.q, motion.seconds, note=note)


METHODS: dict[str, Callable[[Body, str, RetargetTrial], FollowedMotion | None]] = {
    OURS: by_ours, ASAP_PEER: by_asap, PINK: by_pink,
}  # fmt: skip


def standing_floor(body: Body, q: np.ndarray, contacts: SourceContacts) -> float:
    """Height [m] of the floor that suits a motion best: under nine tenths of what is to stand on it; 0 where nothing
    is."""
    names = [name for name in contacts.names if name in body.landmark_names]
    chosen = [body.landmark_names.index(name) for name in names]
    heights = np.array([body.landmarks(body.at(pose))[chosen, 2] for pose in q])
    stands = contacts.standing[:, [contacts.names.index(name) for name in names]]
    return float(np.quantile(heights[stands], _LOWER)) if stands.any() else 0.0
