"""Errors of a run against a reference: the usual measures of three-dimensional pose estimation.

MPJPE (mean per-joint position error) with the hips aligned and its Procrustes-aligned form follow the protocols 1 and 2
of Human3.6M (Ionescu et al., IEEE TPAMI 36(7), 2014).

Errors of a trajectory, frame by frame, and the frames in which it has lost the body.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.numerics.alignment import similarity_onto
from estimator.runs.coordinate_errors import GROUPS, JointScore, coordinate_errors
from estimator.runs.pairs import (
    FEWEST,
    HIPS,
    HIPS_ALIGNED,
    LIMB_JOINTS,
    ComparedFrames,
    SharedLandmarks,
    check_markers,
    listed,
    marker_notes,
    match_frames,
    paired,
    shared_landmarks,
)
from estimator.runs.reference_motion import Reference
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError
from humanoid.support.summary import Facts, Summarised, table_html

if TYPE_CHECKING:
    from estimator.runs.run_reader import Run


__all__ = ["HIPS", "LIMB_JOINTS", "Evaluation", "Reference", "SharedLandmarks", "best_of_k", "evaluate",
    "evaluate_points", "joint_errors", "largest_penetration", "limit_violations", "match_frames", "mpjpe",
    "nothing_shared", "pa_mpjpe", "procrustes", "shared_landmarks"]  # fmt: skip

_LIMIT_TOLERANCE = 1e-9


@dataclass(frozen=True, repr=False)
class Evaluation(Summarised):
    """Errors of a run against a reference; lengths in metres, NaN where nothing could be compared.

    mpjpe, pa_mpjpe: of the best hypothesis, aligned as in `aligned`, and with a similarity fitted per frame.
    best_of_k_mpjpe, best_of_k_pa_mpjpe: of that of the K hypotheses which is nearest to the reference in each frame.
        The smoothed best hypothesis is not one of them, so these can be larger than mpjpe and pa_mpjpe.
    per_joint: mean error of every compared landmark, aligned likewise.
    joints: names of the landmarks compared, see `shared_landmarks`. aligned: "hips aligned"; "centred", on the mean of
        the landmarks, where hips are not shared; "nothing aligned" where fewer than three landmarks are.
    joint_scores: of every joint whose angle or length both sides have by name, of the best hypothesis: of our joints,
        a free root not among them, and of the coordinates of OpenSim's gait models, the pelvis' among them.
    violations: frames in which the best hypothesis leaves a joint limit. penetration: its deepest self-intersection.
    frames_compared, frames_missing: frames of the reference that have, and have not, a counterpart with something to
        compare; without landmarks, of the run or the reference, whichever is the coarser.
    notes: remarks on the reference, on the compared markers and on joints that only one side has.
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
    aligned: str = HIPS_ALIGNED
    joint_scores: Mapping[str, JointScore] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def angle_errors(self) -> dict[str, float]:
        """Mean absolute error of every turning joint that was compared [deg]."""
        return {name: s.mean_absolute for name, s in self.joint_scores.items() if s.unit == "deg"}

    @property
    def group_scores(self) -> dict[str, JointScore]:
        """Means over the flexion of a person's "hips", "knees", "ankles", all three ("legs"), and over "all" turning
        joints [deg], but a gait model's pelvis, whose turns are those of the two worlds too; of groups with at least
        two joints that were compared."""
        known = {name: s for name, s in self.joint_scores.items() if s.unit == "deg" and s.frames}
        members = {group: [known[n] for n in names if n in known] for group, names in GROUPS.items()}
        members["all"] = [score for name, score in known.items() if not name.startswith("pelvis_")]
        return {group: JointScore.mean(scores) for group, scores in members.items() if len(scores) > 1}

    @property
    def slide_errors(self) -> dict[str, float]:
        """Mean absolute error of every sliding joint that was compared [m]."""
        return {name: s.mean_absolute for name, s in self.joint_scores.items() if s.unit == "m"}

    def _facts(self) -> Facts:
        facts = [("frames", f"{self.frames_compared}")]
        if self.joints:
            facts.append((f"MPJPE ({self.aligned})", f"{1e3 * self.mpjpe:.1f} mm"))
            facts.append(("PA-MPJPE", f"{1e3 * self.pa_mpjpe:.1f} mm"))
        angles = [error for error in self.angle_errors.values() if np.isfinite(error)]
        if angles:
            facts.append((f"mean error of {len(angles)} joint angles", f"{np.mean(angles):.2f} deg"))
        return [*facts, ("frames beyond a limit", f"{self.violations}")]

    def _repr_html_(self) -> str:
        rows = [
            (
                name,
                s.unit,
                *(
                    f"{x:.{2 if s.unit == 'deg' else 4}f}"
                    for x in (s.mean_absolute, s.rms, s.bias, s.mean_absolute_without_bias, s.rms_without_bias)
                ),
                s.frames,
            )
            for name, s in self.joint_scores.items()
        ]
        head = ("joint", "unit", "mean absolute", "RMSE", "bias", "without bias", "RMSE without bias", "frames")
        return super()._repr_html_() + (table_html("joints", head, rows) if rows else "")


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
    count = math.prod(shape[:-2])
    flat_points = np.broadcast_to(points, shape).reshape(count, *shape[-2:])
    flat_reference = np.broadcast_to(reference, shape).reshape(count, *shape[-2:])
    errors = [_aligned_error(p, r) for p, r in zip(flat_points, flat_reference, strict=True)]
    return np.array(errors).reshape(shape[:-2])


def _aligned_error(points: np.ndarray, reference: np.ndarray) -> float:
    known = np.isfinite(points).all(axis=-1) & np.isfinite(reference).all(axis=-1)
    if np.count_nonzero(known) < FEWEST:
        return float("nan")
    aligned = procrustes(points[known], reference[known])
    return float(np.linalg.norm(aligned - reference[known], axis=-1).mean())


def procrustes(points: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """`points` (L, 3) under the similarity that brings them nearest to `reference` (L, 3) in least squares.

    See `estimator.numerics.alignment.similarity_onto`.
    """
    return similarity_onto(points, reference, scaled=True).of(points)


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
    """Number of configurations q (T, nq) with a bounded joint outside its limits by more than 1e-9."""
    outside = (q < body.lower - _LIMIT_TOLERANCE) | (q > body.upper + _LIMIT_TOLERANCE)
    return int(outside.any(axis=1).sum())


def largest_penetration(body: Body, q: np.ndarray) -> float:
    """Deepest overlap of two body parts [m] over the configurations q (T, nq); NaN configurations are skipped."""
    self_collision = SelfCollision(body)
    known = q[np.isfinite(q).all(axis=1)]
    return max((self_collision.penetration(body.at(pose)) for pose in known), default=0.0)


def evaluate(run: Run, reference: Reference, *, joints: Sequence[str] | None = None) -> Evaluation:
    """Measure a run against a reference: the landmarks and the joint coordinates that both have by name.

    joints: the landmarks to compare; by default those of `shared_landmarks`.

    Raises
    ------
    InputError: neither a landmark nor a joint coordinate is shared; fewer than three of a file's markers are.
    """
    body, time, q = run.body, np.asarray(run.time), np.asarray(run.q)
    angles = reference.coordinates
    compared = None if angles is None else coordinate_errors(body, q, time, angles, reference.time)
    scores_of_joints = {} if compared is None else compared.scores
    names = tuple(body.landmark_names)
    pairs = paired(names, time, reference, joints)
    if not pairs.shared.names and not scores_of_joints:
        raise nothing_shared(names, reference, () if compared is None else compared.names)
    check_markers(pairs.shared, names, reference)
    scores = _point_scores(pairs, run.landmarks, run.mode_landmarks, reference)
    notes = marker_notes(pairs, names, run.landmarks, reference)
    if compared is not None:
        notes = (*reference.notes, *compared.notes)
        if not pairs.shared.names:
            scores |= {"frames_compared": compared.compared, "frames_missing": compared.missing}
    return Evaluation(
        violations=limit_violations(body, q), penetration=largest_penetration(body, q), joint_scores=scores_of_joints,
        notes=notes, **scores,
    )  # fmt: skip


def evaluate_points(
    names: Sequence[str],
    landmarks: np.ndarray,
    mode_landmarks: np.ndarray,
    time: np.ndarray,
    reference: Reference,
    *,
    joints: Sequence[str] | None = None,
) -> dict[str, Any]:
    """The fields of `Evaluation` that need points alone.

    landmarks (T, L, 3), mode_landmarks (T, K, L, 3) [m] of `names` (L) at `time` (T,) [s]. Raises InputError where no
    landmark is shared.
    """
    pairs = paired(names, time, reference, joints)
    if not pairs.shared.names:
        raise nothing_shared(names, reference)
    check_markers(pairs.shared, names, reference)
    return _point_scores(pairs, landmarks, mode_landmarks, reference)


def _point_scores(
    pairs: ComparedFrames, landmarks: np.ndarray, mode_landmarks: np.ndarray, reference: Reference
) -> dict[str, Any]:
    shared, truth = pairs.shared, pairs.truth
    root, points, modes = shared.root, pairs.of(landmarks), pairs.of(mode_landmarks)
    errors = joint_errors(points, truth, root)
    per_frame = _mean(errors, axis=-1)
    return {
        "mpjpe": _overall(per_frame),
        "pa_mpjpe": _overall(pa_mpjpe(points, truth)),
        "best_of_k_mpjpe": _overall(best_of_k(modes, truth, lambda p, r: mpjpe(p, r, root))),
        "best_of_k_pa_mpjpe": _overall(best_of_k(modes, truth, pa_mpjpe)),
        "per_joint": dict(zip(shared.names, _mean(errors, axis=0).tolist(), strict=True)),
        "joints": shared.names,
        "aligned": shared.aligned,
        "frames_compared": int(np.isfinite(per_frame).sum()),
        "frames_missing": int(len(reference.points) - np.isfinite(per_frame).sum()),
    }


def nothing_shared(names: Sequence[str], reference: Reference, coordinates: Sequence[str] = ()) -> InputError:
    """That run and reference have nothing in common, and what each has."""
    have: list[tuple[str, Sequence[str], Sequence[str]]] = [("landmarks", names, reference.names)]
    if reference.coordinates is not None:
        have.append(("joint angles", coordinates, reference.coordinates.names))
    kinds = " and no ".join(what for what, _, _ in have)
    each = "; ".join(f"{what} of the run: {listed(a)}; of the reference: {listed(b)}" for what, a, b in have)
    return InputError("reference", f"shares no {kinds} with the run", place="names", remedy=each)


def _mean(values: np.ndarray, axis: int) -> np.ndarray:
    """Mean of the finite entries, NaN where there are none."""
    known = np.isfinite(values)
    count = known.sum(axis=axis)
    total = np.where(known, values, 0.0).sum(axis=axis)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _overall(values: np.ndarray) -> float:
    return float(_mean(values, axis=0))


FAR = 0.25
"""Mean error of a frame's landmarks from which it is lost [m]."""
FAR_PX, FAR_PX_SIZE = 15.0, (640, 480)
"""The same for their images [px], in a picture of this size; in others the same share of the diagonal. CSS reports when
its sequences are lost, but neither by which measure nor how large the pictures are."""


def far_px(image_size: tuple[int, int]) -> float:
    """Mean distance in a picture of this size (width, height) from which a frame is lost [px]."""
    return FAR_PX * float(np.hypot(*image_size) / np.hypot(*FAR_PX_SIZE))


class TrajectoryErrors(NamedTuple):
    """Mean error of the landmarks in each of T frames, NaN where pose or truth is unknown.

    aligned (T,): with the roots of both at one place [m]. world (T,): with nothing aligned [m]. pixels (T,): in the
    image, in the camera where it is largest [px]. world and pixels are NaN where trajectory and truth share no world.
    of_limits (T,): the largest error in terms of its limit, of `FAR` in the world and of `far_px` in every camera, or
    where no world is shared of `FAR` once aligned. lost (T,) bool: frames whose truth is known and where that is above
    1, or the pose unknown.
    """

    aligned: np.ndarray
    world: np.ndarray
    pixels: np.ndarray
    of_limits: np.ndarray
    lost: np.ndarray


def trajectory_errors(
    points: np.ndarray, truth: np.ndarray, root: Sequence[int] | None, cameras: Sequence[Camera] | None
) -> TrajectoryErrors:
    """Errors of landmarks points (T, L, 3) against truth (T, L, 3) [m].

    root: see `mpjpe`. cameras: of the world that both are in, None where they share none.
    """
    aligned = mpjpe(points, truth, root)
    known = np.isfinite(truth).all(axis=(1, 2))
    if cameras is None:
        unknown, of_limits = np.full(len(points), np.nan), aligned / FAR
        return TrajectoryErrors(aligned, unknown, unknown, of_limits, known & ~(of_limits <= 1.0))
    world = np.asarray(np.linalg.norm(points - truth, axis=-1).mean(axis=-1))
    images = [_image_error(points, truth, camera) for camera in cameras]  # (T,) each
    in_images = [error / far_px(camera.image_size) for error, camera in zip(images, cameras, strict=True)]
    of_limits = np.max([world / FAR, *in_images], axis=0)
    return TrajectoryErrors(aligned, world, np.max(images, axis=0), of_limits, known & ~(of_limits <= 1.0))


def _image_error(points: np.ndarray, truth: np.ndarray, camera: Camera) -> np.ndarray:
    return np.asarray(np.linalg.norm(camera.project(points) - camera.project(truth), axis=-1).mean(axis=-1))
