"""How far a run is from a reference: the usual measures of three-dimensional pose estimation.

MPJPE (mean per-joint position error) with the hips aligned and its Procrustes-aligned form follow the protocols 1 and 2
of Human3.6M (Ionescu et al., IEEE TPAMI 36(7), 2014).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from estimator.formats.reference import load_reference
from humanoid.body import Body
from humanoid.clearance import Clearance
from humanoid.errors import InputError

if TYPE_CHECKING:
    from estimator.formats.run_file import Run

_PARTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
LIMB_JOINTS = tuple(f"{side}_{part}" for part in _PARTS for side in ("left", "right"))
HIPS = ("left_hip", "right_hip")
_LIMIT_TOLERANCE = 1e-9
_FEWEST_SHARED = 3  # fewer points do not fix a rotation


@dataclass(frozen=True)
class Reference:
    """Where a person's points were.

    names (L): landmark names, COCO's where COCO has one. points (T, L, 3): world frame [m], NaN where unknown.
    time (T,): seconds since the clip's start, or None where only the frame numbers count.
    """

    names: tuple[str, ...]
    points: np.ndarray
    time: np.ndarray | None = None

    @staticmethod
    def load(path: str | Path) -> Reference:
        """The reference in a file; see `estimator.formats.reference.load_reference` for kinds and errors."""
        names, points, fps = load_reference(path)
        return Reference(names, points, np.arange(len(points)) / fps)


@dataclass(frozen=True)
class Evaluation:
    """Errors of a run against a reference; lengths in metres, NaN where nothing could be compared.

    mpjpe, pa_mpjpe: of the best hypothesis, with the hips aligned and with a similarity fitted per frame.
    best_of_k_mpjpe, best_of_k_pa_mpjpe: of the hypothesis nearest to the reference in each frame.
    per_joint: mean error of every compared joint, hips aligned.
    joints: names of the joints compared.
    violations: frames in which the best hypothesis leaves a joint limit. penetration: its deepest self-intersection.
    frames_compared, frames_missing: frames of the reference that have, and have not, a counterpart with points.
    """

    mpjpe: float
    pa_mpjpe: float
    best_of_k_mpjpe: float
    best_of_k_pa_mpjpe: float
    per_joint: Mapping[str, float]
    joints: tuple[str, ...]
    violations: int
    penetration: float
    frames_compared: int
    frames_missing: int


def mpjpe(points: np.ndarray, reference: np.ndarray, root: Sequence[int] | None = None) -> np.ndarray:
    """Mean distance of joints per frame [m], (...), over the joints known in both.

    points, reference (..., L, 3) [m]. root: indices of the joints whose midpoint is moved to the origin in both
    (left and right hip); None compares absolute positions. A frame without a known joint, or root, gives NaN.
    """
    return _mean(joint_errors(points, reference, root), axis=-1)


def joint_errors(points: np.ndarray, reference: np.ndarray, root: Sequence[int] | None = None) -> np.ndarray:
    """Distance of every joint to its reference [m], (..., L), NaN where unknown; arguments as `mpjpe`."""
    if root is not None:
        points = points - points[..., list(root), :].mean(axis=-2, keepdims=True)
        reference = reference - reference[..., list(root), :].mean(axis=-2, keepdims=True)
    return cast(np.ndarray, np.linalg.norm(points - reference, axis=-1))


def pa_mpjpe(points: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Mean distance per frame [m], (...), after the best rotation, translation and scale of each frame.

    points, reference (..., L, 3) [m]; joints unknown in either are left out, frames with fewer than three give NaN.
    """
    shape = np.broadcast_shapes(points.shape, reference.shape)
    flat_points = np.broadcast_to(points, shape).reshape(-1, *shape[-2:])
    flat_reference = np.broadcast_to(reference, shape).reshape(-1, *shape[-2:])
    errors = [_aligned_error(p, r) for p, r in zip(flat_points, flat_reference, strict=True)]
    return np.array(errors).reshape(shape[:-2])


def _aligned_error(points: np.ndarray, reference: np.ndarray) -> float:
    known = np.isfinite(points).all(axis=-1) & np.isfinite(reference).all(axis=-1)
    if np.count_nonzero(known) < _FEWEST_SHARED:
        return float("nan")
    aligned = procrustes(points[known], reference[known])
    return float(np.linalg.norm(aligned - reference[known], axis=-1).mean())


def procrustes(points: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """`points` (L, 3) under the similarity that brings them nearest to `reference` (L, 3) in least squares.

    Reflections are excluded. Source: Umeyama, IEEE TPAMI 13(4), 1991, equations 39 to 43.
    """
    mean_points, mean_reference = points.mean(axis=0), reference.mean(axis=0)
    x, y = points - mean_points, reference - mean_reference
    U, singular, Vt = np.linalg.svd(y.T @ x)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    spread = float((x * x).sum())
    scale = float(singular @ sign) / spread if spread > 0.0 else 1.0
    return cast(np.ndarray, scale * x @ ((U * sign) @ Vt).T + mean_reference)


def best_of_k(
    mode_points: np.ndarray, reference: np.ndarray, metric: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """Smallest value of a metric over K hypotheses in each frame, (T,).

    mode_points (T, K, L, 3), NaN where a frame has fewer hypotheses; reference (T, L, 3).
    metric: (..., L, 3), (..., L, 3) -> (...), such as `pa_mpjpe`.
    """
    values = metric(mode_points, reference[:, None])
    smallest = np.where(np.isnan(values), np.inf, values).min(axis=1, initial=np.inf)
    return np.where(np.isinf(smallest), np.nan, smallest)


def limit_violations(body: Body, q: np.ndarray) -> int:
    """How many of the configurations q (T, nq) have a bounded joint outside its limits by more than 1e-9."""
    outside = (q < body.lower - _LIMIT_TOLERANCE) | (q > body.upper + _LIMIT_TOLERANCE)
    return int(outside.any(axis=1).sum())


def largest_penetration(body: Body, q: np.ndarray) -> float:
    """Deepest overlap of two body parts [m] over the configurations q (T, nq); NaN configurations are skipped."""
    clearance = Clearance(body)
    known = q[np.isfinite(q).all(axis=1)]
    return max((clearance.penetration(body.at(one)) for one in known), default=0.0)


def match_frames(time: np.ndarray, reference_time: np.ndarray | None, count: int) -> np.ndarray:
    """Index of the run's frame for each of the reference's `count` frames, -1 where there is none, (count,).

    time (T,) of the run, reference_time (count,) [s]: the nearest within half a frame of the slower of the two;
    without reference times, the frame of the same number.
    """
    if reference_time is None or len(time) == 0:
        index = np.arange(count)
        return np.where(index < len(time), index, -1)
    order = np.argsort(time)
    ordered = time[order]
    right = np.clip(np.searchsorted(ordered, reference_time), 0, len(time) - 1)
    left = np.maximum(right - 1, 0)
    closer = np.abs(ordered[left] - reference_time) <= np.abs(ordered[right] - reference_time)
    nearest = np.where(closer, left, right)
    # a finer reference is thinned to the run's frames: each is compared with one frame only
    half = 0.5 * max(_period(ordered), _period(np.sort(reference_time))) + 1e-6
    gap = np.abs(ordered[nearest] - reference_time)
    matched = np.where(gap <= half, nearest, -1)
    for i in np.unique(matched[matched >= 0]):
        rivals = np.flatnonzero(matched == i)
        matched[np.delete(rivals, np.argmin(gap[rivals]))] = -1
    return np.where(matched >= 0, order[matched], -1)


def _period(time: np.ndarray) -> float:
    return float(np.median(np.diff(time))) if len(time) > 1 else 0.0


def evaluate(run: Run, reference: Reference, *, joints: Sequence[str] = LIMB_JOINTS) -> Evaluation:
    """Measure a run against a reference over those of `joints` that both have.

    Raises
    ------
    InputError: run and reference share fewer than three of the joints.
    """
    scores = evaluate_points(
        tuple(run.body.landmark_names),
        run.landmarks,
        run.mode_landmarks,
        np.asarray(run.time),
        reference,
        joints=joints,
    )
    q = np.asarray(run.q)
    return Evaluation(violations=limit_violations(run.body, q), penetration=largest_penetration(run.body, q), **scores)


def evaluate_points(
    names: Sequence[str],
    landmarks: np.ndarray,
    mode_landmarks: np.ndarray,
    time: np.ndarray,
    reference: Reference,
    *,
    joints: Sequence[str] = LIMB_JOINTS,
) -> dict[str, Any]:
    """The fields of `Evaluation` that need points alone.

    landmarks (T, L, 3), mode_landmarks (T, K, L, 3) [m] of `names` (L) at `time` (T,) [s].
    """
    shared = _shared_joints(names, reference.names, joints)
    ours, theirs = ([list(have).index(j) for j in shared] for have in (names, reference.names))
    frame = match_frames(time, reference.time, len(reference.points))
    row = frame >= 0
    points, modes = landmarks[frame[row]][:, ours], mode_landmarks[frame[row]][:, :, ours]
    modes = np.concatenate([modes, points[:, None]], axis=1)  # the smoothed best is a hypothesis too
    truth = reference.points[row][:, theirs]
    root = [shared.index(hip) for hip in HIPS] if set(HIPS) <= set(shared) else list(range(len(shared)))
    errors = joint_errors(points, truth, root)
    per_frame = _mean(errors, axis=-1)
    return {
        "mpjpe": _overall(per_frame),
        "pa_mpjpe": _overall(pa_mpjpe(points, truth)),
        "best_of_k_mpjpe": _overall(best_of_k(modes, truth, lambda p, r: mpjpe(p, r, root))),
        "best_of_k_pa_mpjpe": _overall(best_of_k(modes, truth, pa_mpjpe)),
        "per_joint": dict(zip(shared, _mean(errors, axis=0).tolist(), strict=True)),
        "joints": shared,
        "frames_compared": int(np.isfinite(per_frame).sum()),
        "frames_missing": int(len(reference.points) - np.isfinite(per_frame).sum()),
    }


def _shared_joints(ours: Sequence[str], theirs: Sequence[str], joints: Sequence[str]) -> tuple[str, ...]:
    shared = tuple(j for j in joints if j in ours and j in theirs)
    if len(shared) < _FEWEST_SHARED:
        raise InputError(
            "reference",
            f"shares {len(shared)} joints with the run ({', '.join(shared) or 'none'}), {_FEWEST_SHARED} are needed",
            place="landmark_names",
            remedy=f"it has {', '.join(theirs)}; names that count: {', '.join(j for j in joints if j in ours)}",
        )
    return shared


def _mean(values: np.ndarray, axis: int) -> np.ndarray:
    """Mean of the finite entries, NaN where there are none."""
    known = np.isfinite(values)
    count = known.sum(axis=axis)
    total = np.where(known, values, 0.0).sum(axis=axis)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _overall(values: np.ndarray) -> float:
    return float(_mean(values, axis=0))
