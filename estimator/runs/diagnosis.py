"""Contradictions between a run and its subject or input: joints that rest on limits, landmarks far from their
keypoints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.numerics.robust import typical_distance
from estimator.runs.keypoint_residuals import KeypointResiduals, associations_of, keypoint_residuals, marker_residuals
from estimator.runs.run_reader import Run
from estimator.search.cost_terms import CostSettings
from estimator.search.hypothesis import EXCHANGED
from estimator.trackers.frame_result import TRACKED

MOST = 0.5
"""Share of the frames above which a joint rests on a limit, or the sides are exchanged, in most of them. On good runs,
beam4cam's and rendered ones, no joint does in a quarter of the frames."""
FAR = 5.0
"""Standard deviations above which the median distance of a landmark is not noise. On good runs the largest is 3.6, of
ears that the detector guesses on the far side of the head."""
_CONTRADICTED = 0.25  # of a frame's keypoints
FEWEST = 5  # fewest frames from which a clip is judged
_SAMPLE = 300  # frames of a long clip whose keypoints are used
_NARROW = 1e-3  # rad or m: joints with less room are as good as locked
_ON = 1e-6  # rad or m from a limit
_STILL = 1e-6  # m per rad: landmarks that a joint moves less do not constrain it
_PARTS = 3  # landmarks that are far: not the ears alone, which detectors guess
_NAMED = 4  # joints or landmarks that a sentence names


class JointAtLimit(NamedTuple):
    """A joint on a limit: its name, which limit ("lower", "upper"), the limit [rad or m], the share of the frames."""

    joint: str
    side: str
    limit: float
    share: float


class Far(NamedTuple):
    """A landmark far from its keypoints in a camera: medians over the frames in pixels and in standard deviations."""

    landmark: str
    camera: str
    pixels: float
    deviations: float


class FarMarker(NamedTuple):
    """A marker far from its place on the body: median over the frames in metres and in standard deviations."""

    marker: str
    apart: float
    deviations: float


@dataclass(frozen=True)
class Diagnosis:
    """Contradictions with subject or input; empty for a good run.

    frame: the one examined, None for the whole run. resting, far: worst first.
    cameras: in which most landmarks are far, with the median distance in standard deviations.
    exchanged: share of the frames whose keypoints were read with left and right exchanged, 0 unless more than half.
    far_markers: worst first.
    """

    frame: int | None
    resting: tuple[JointAtLimit, ...]
    far: tuple[Far, ...]
    cameras: tuple[tuple[str, float], ...]
    exchanged: float
    far_markers: tuple[FarMarker, ...] = ()

    @property
    def contradicts_input(self) -> bool:
        """Whether keypoints or markers do not belong to their places, in all cameras or in parts of the body."""
        return bool(self.cameras) or max(len({f.landmark for f in self.far}), len(self.far_markers)) >= _PARTS

    @property
    def sentences(self) -> tuple[str, ...]:
        """One for each kind of trouble: what it is, and what to do."""
        findings = []
        if self.resting:
            joints = [
                f"{r.joint} ({r.side} limit {r.limit:.3g}" + (")" if self.frame is not None else f", {r.share:.0%})")
                for r in self.resting
            ]
            findings.append(
                f"joints that rest on a limit {self._when}: {_few(joints)}. Limits may contradict the person: check the"
                " joints' axes and limits in the URDF"
            )
        if self.cameras:
            cameras = [f"{name} ({deviations:.1f} standard deviations)" for name, deviations in self.cameras]
            findings.append(
                f"most landmarks lie far from their keypoints {self._when} in {_few(cameras)}: check the camera's"
                " calibration, the time its keypoints begin, and which person they show"
            )
        if self.far:
            findings.append(
                f"landmarks that lie far from their keypoints {self._when}: {_few(_by_landmark(self.far))}. Check their"
                " links and places in the subject, the names of left and right, and the limits of the joints there"
            )
        if self.exchanged:
            findings.append(
                f"left and right of the keypoints are exchanged in {self.exchanged:.0%} of the frames: check which side"
                " is which in the subject's landmarks and in the keypoints"
            )
        if self.far_markers:
            markers = [f"{f.marker} ({1e3 * f.apart:.0f} mm)" for f in self.far_markers]
            findings.append(
                f"markers that lie far from their places on the body {self._when}: {_few(markers)}. Check the set of"
                " markers, and the labels of left and right"
            )
        return tuple(findings)

    @property
    def _when(self) -> str:
        return "in most frames" if self.frame is None else f"in frame {self.frame}"


def diagnose(run: Run, cost: CostSettings, frame: int | None = None, *, limited: bool = True) -> Diagnosis:
    """Contradictions of a run's trajectory (`Run.q`) with its subject or input.

    cost: of the run's settings, for the noise of keypoints. frame: that one alone; by default the whole run, of which
    fewer than five tracked frames give no findings. limited: whether the tracker keeps to the joint limits.
    """
    tracked = _tracked(run)
    rows = tracked if frame is None else tracked[tracked == frame]
    if len(rows) < (FEWEST if frame is None else 1):
        return Diagnosis(frame, (), (), (), 0.0)
    exchanged = float(np.mean(associations_of(run)[rows] == EXCHANGED)) if frame is None else 0.0
    resting = _resting(run, rows) if limited else ()
    far, cameras = _far(run, cost, rows)
    exchanged = exchanged if exchanged > MOST else 0.0
    return Diagnosis(frame, resting, far, cameras, exchanged, _far_markers(run, cost, rows))


def contradicted(run: Run, cost: CostSettings) -> tuple[int, ...]:
    """Rows of tracked frames in which a quarter of the keypoints and markers or more lie far from their places,
    ascending: the body bends until half of what does not belong to it fits."""
    rows = np.flatnonzero((run.status == TRACKED) & np.isfinite(run.q).all(axis=1))
    if not len(rows):
        return ()
    deviations = np.concatenate(_deviations(run, cost, rows), axis=1)
    seen = np.isfinite(deviations).sum(axis=1)
    far = (np.nan_to_num(deviations) > FAR).sum(axis=1)
    return tuple(int(t) for t in rows[(far > 0) & (far >= _CONTRADICTED * seen)])


def _deviations(run: Run, cost: CostSettings, rows: np.ndarray) -> list[np.ndarray]:
    """Distances of keypoints and markers from their places on the body, in standard deviations (T, N) each, NaN where
    nothing was seen."""
    keypoints, markers = keypoint_residuals(run, cost, rows), marker_residuals(run, cost.markers)
    nothing = np.full((len(rows), 1), np.nan)
    by_keypoints = nothing if keypoints is None else keypoints.deviations.reshape(len(rows), -1)
    return [by_keypoints, nothing if markers is None else markers.apart[rows] / markers.std]


def sampled_residuals(run: Run, cost: CostSettings) -> KeypointResiduals | None:
    """Distances of keypoints from their places by a run's trajectory, in observed frames, of a long clip in some; None
    for a run without such frames or without keypoints."""
    rows = _tracked(run)
    return keypoint_residuals(run, cost, _sampled(rows)) if len(rows) else None


def camera_errors(residuals: KeypointResiduals) -> dict[str, float]:
    """Root mean square distance of each camera's keypoints from their places on the body, by the camera's name, without
    outliers [px]; those without keypoints are left out."""
    errors = {name: float(typical_distance(residuals.pixels[:, c])) for c, name in enumerate(residuals.cameras)}
    return {name: error for name, error in errors.items() if np.isfinite(error)}


def _tracked(run: Run) -> np.ndarray:
    """Rows in which something was seen of a body."""
    return np.flatnonzero((run.status != "unobserved") & np.isfinite(run.q).all(axis=1))


def _sampled(rows: np.ndarray) -> np.ndarray:
    """The rows of a short clip, some of a long one."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, min(_SAMPLE, len(rows))).round().astype(int))]


def _resting(run: Run, rows: np.ndarray) -> tuple[JointAtLimit, ...]:
    """Joints that move a landmark and rest on a limit in most of the rows."""
    body = run.body
    moved = np.linalg.norm(body.landmark_jacobians(body.at(run.q[rows[len(rows) // 2]])), axis=1).max(axis=0) > _STILL
    resting = []
    for v, i in zip(body.bounded_v, body.bounded_q, strict=True):
        lower, upper = float(body.lower[i]), float(body.upper[i])
        if upper - lower < _NARROW or not moved[v]:
            continue
        q = run.q[rows, i]
        for side, limit, on in (("lower", lower, q <= lower + _ON), ("upper", upper, q >= upper - _ON)):
            if on.mean() > MOST:
                resting.append(JointAtLimit(body.q_names[i], side, limit, float(on.mean())))
    return tuple(sorted(resting, key=lambda r: -r.share))


def _far(run: Run, cost: CostSettings, rows: np.ndarray) -> tuple[tuple[Far, ...], tuple[tuple[str, float], ...]]:
    """Landmarks far from their keypoints, and cameras in which most are."""
    residuals = keypoint_residuals(run, cost, _sampled(rows))
    if residuals is None:
        return (), ()
    fewest, pixels, deviations = min(FEWEST, len(rows)), residuals.pixels, residuals.deviations
    seen = np.isfinite(pixels).sum(axis=0)
    far_landmarks: list[Far] = []
    cameras = []
    for c, camera in enumerate(run.header.cameras):
        enough = np.flatnonzero(seen[c] >= fewest)
        medians = {k: (np.nanmedian(pixels[:, c, k]), np.nanmedian(deviations[:, c, k])) for k in enough.tolist()}
        far = [k for k, (_, sd) in medians.items() if sd > FAR]
        if len(far) > MOST * len(enough):
            cameras.append((camera.name, float(np.median([sd for _, sd in medians.values()]))))
        else:
            far_landmarks += [Far(run.body.landmark_names[k], camera.name, *map(float, medians[k])) for k in far]
    return tuple(sorted(far_landmarks, key=lambda f: -f.deviations)), tuple(cameras)


def _far_markers(run: Run, cost: CostSettings, rows: np.ndarray) -> tuple[FarMarker, ...]:
    residuals = marker_residuals(run, cost.markers)
    if residuals is None:
        return ()
    own = residuals._replace(apart=residuals.apart[rows])
    far = [
        FarMarker(name, float(apart), float(apart / std))
        for name, apart, std in zip(own.names, own.median, own.std, strict=True)
        if apart > FAR * std
    ]
    return tuple(sorted(far, key=lambda f: -f.deviations))


def _by_landmark(far: Sequence[Far]) -> list[str]:
    """One text a landmark: its largest distance, and the cameras it is far in."""
    listed = []
    for name in dict.fromkeys(f.landmark for f in far):
        own = [f for f in far if f.landmark == name]
        cameras = ", ".join(f.camera for f in own[:_NAMED]) + (" and others" if len(own) > _NAMED else "")
        listed.append(f"{name} ({own[0].deviations:.1f} standard deviations, {own[0].pixels:.0f} px, in {cameras})")
    return listed


def _few(texts: Sequence[str]) -> str:
    return ", ".join(texts[:_NAMED]) + (f" and {len(texts) - _NAMED} more" if len(texts) > _NAMED else "")
