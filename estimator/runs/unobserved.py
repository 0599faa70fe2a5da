"""Unobserved parts: stretches of a run with extrapolated poses, and joints that move nothing that was seen."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from estimator.data.observation import Observation
from humanoid.kinematics.body import Body, points_in_world
from humanoid.support.errors import first_of

_NAMED = 8  # stretches that a note names
_JOINTS = 12  # joints that a note names
_SEEN = 0.05
"""Share of the frames in which something has to be seen: a detector that guesses a leg behind a desk does so now and
then."""
_MOVES = 1e-3  # m per rad, or m
_ROOM = 1e-4  # rad or m: joints with less are as good as locked


def unseen_joints(body: Body, landmarks: np.ndarray, markers: np.ndarray) -> tuple[str, ...]:
    """Names of the joints with limits that move nothing seen, so that their angles come from the prior.

    landmarks (L,), markers (M,): which were seen.
    """
    joint = np.concatenate([body.landmark_joint[landmarks], body.marker_joint[markers]])
    local = np.concatenate([body.landmark_local[landmarks], body.marker_local[markers]])
    moves = np.any(_moved_by(body, joint, local), axis=0)
    bounded = zip(body.bounded_v.tolist(), body.bounded_q.tolist(), strict=True)
    return tuple(body.q_names[i] for v, i in bounded if not moves[v] and body.upper[i] - body.lower[i] > _ROOM)


def unseen_landmarks(body: Body, joints: Collection[str]) -> np.ndarray:
    """Which landmarks (L,) are moved by an unobserved joint: their places come from the prior, too."""
    bounded = zip(body.bounded_v.tolist(), body.bounded_q.tolist(), strict=True)
    unseen = [v for v, i in bounded if body.q_names[i] in joints]
    return np.asarray(_moved_by(body, body.landmark_joint, body.landmark_local)[:, unseen].any(axis=1))


def _moved_by(body: Body, joint: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Which degrees of freedom move points of links, (N, nv), in the middle of their limits, where limbs are bent."""
    q = body.neutral.copy()
    q[body.bounded_q] = 0.5 * (body.lower[body.bounded_q] + body.upper[body.bounded_q])
    posed = body.at(q)
    jacobians = body.point_jacobians(posed, joint, points_in_world(posed, joint, local))
    return np.asarray(np.linalg.norm(jacobians, axis=1) >= _MOVES)


def unseen_by(body: Body, observations: Iterable[Observation]) -> tuple[str, ...]:
    """The same for what a clip shows by keypoints or markers; none where it has neither."""
    shown = list(observations)
    confidence = np.array([o.confidence for o in shown]).reshape(len(shown), -1, len(body.landmark_names))
    markers = [o.markers for o in shown if o.markers is not None]
    return unseen_in(body, confidence, np.array(markers) if markers else None)


def unseen_in(body: Body, confidence: np.ndarray, markers: np.ndarray | None) -> tuple[str, ...]:
    """The same of confidence (T, C, L) and markers (T, M, 3)."""
    landmarks, measured = np.zeros(len(body.landmark_names), dtype=bool), np.zeros(len(body.marker_names), dtype=bool)
    if confidence.size:
        landmarks = (confidence > 0.0).any(axis=1).mean(axis=0) >= _SEEN
    if markers is not None and len(markers):
        measured = np.isfinite(markers).all(axis=2).mean(axis=0) >= _SEEN
    return unseen_joints(body, landmarks, measured) if landmarks.any() or measured.any() else ()


def unseen_joints_note(joints: tuple[str, ...]) -> str:
    """A line that names the joints, empty without any."""
    if not joints:
        return ""
    return f"nothing seen depends on {first_of(joints, _JOINTS)}: their angles are the prior's, within their limits"


def unobserved_note(unobserved: Sequence[tuple[float, float]], joints: tuple[str, ...]) -> str:
    """A line that names stretches of time [s], and joints, that were unobserved; empty where there are none."""
    of_joints = unseen_joints_note(joints)
    if not unobserved:
        return of_joints
    named = ", ".join(f"{a:.2f} to {b:.2f} s" for a, b in unobserved[:_NAMED])
    more = f" and {len(unobserved) - _NAMED} more" if len(unobserved) > _NAMED else ""
    of_stretches = f"nothing was observed, so poses are extrapolated: {named}{more}"
    return f"{of_stretches}; {of_joints}" if of_joints else of_stretches
