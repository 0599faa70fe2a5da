"""Captured clips of people left out of learning, tracked from the keypoints of one of two detectors, frame by frame."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.support.mocap_person import FPS
from benchmarks.support.pose_prior_clips import cut_motion, render_captured, subject_of, trial_of
from benchmarks.support.result_store import Figures, ResultStore, cached_clip, removed
from benchmarks.support.scores import FAR_MM, trajectories
from benchmarks.support.tracking import timed_track
from estimator.data.formats.cameras import load_cameras
from estimator.data.formats.keypoints import write_keypoints
from estimator.runs.evaluation import LIMB_JOINTS, mpjpe, pa_mpjpe
from estimator.runs.joint_angle import joint_entry, joint_value
from estimator.runs.pairs import match_frames, paired
from estimator.runs.reference_motion import Reference
from estimator.runs.run_reader import Run
from estimator.synthesis.detector import of_points
from estimator.synthesis.settings import DetectorSettings
from estimator.trackers.spec import together
from humanoid.kinematics.body import ROOT_TURN_Q
from kinemode.shot import RenderedClip

KINDS = ("detector", "joints")
"""COCO's 17 keypoints with the errors of `benchmarks.support.mocap_person.DETECTOR`; the 12 limb joints alone with
`JOINTS_NOISE`."""
JOINTS_NOISE = DetectorSettings(3.0, 0.0, 0.0)
_LEAVES, _STAYS = 0.12, 0.04  # m
_STREAM = 4  # of random numbers, beside those of the clip
GROUPS = {
    "hips": ("left_hip_flexion", "right_hip_flexion"),
    "knees": ("left_knee_flexion", "right_knee_flexion"),
    "elbows": ("left_elbow_flexion", "right_elbow_flexion"),
}
"""Joints whose angle the captured skeleton determines: it has the ends of the limbs and no turns about them, so that
knees and elbows are determined alone, and a hip's flexion with hips and shoulders, which place the pelvis."""
ANGLES = tuple(name for names in GROUPS.values() for name in names)
TURNS = ("0 to 30", "30 to 90", "over 90")
_TURN_EDGES = (30.0, 90.0)  # [deg/s]

# what is done in the trials of the CMU database that file names do not give
_OF_TRIAL = {"02_03": "run", "02_05": "punch", "02_06": "bend", "02_08": "swordplay", "05_01": "walk"}
_OF_TRIAL |= {f"35_{trial}": "run" for trial in range(17, 27)}
_OF_SUBJECT = {"05": "dance", "16": "jump", "49": "acrobatics"}
_OF_SUBJECT |= dict.fromkeys(("02", "06", "07", "08", "10", "12", "26", "35"), "walk")


def action_of(name: str) -> str:
    """The action in a clip, by the numbers that its name ends with, else by its first word."""
    known = _OF_TRIAL.get(trial_of(name)) or _OF_SUBJECT.get(subject_of(name))
    return known or name.split("_")[0]


def heading_rate(quaternion: np.ndarray, fps: float) -> np.ndarray:
    """The rate of the pelvis about the vertical [deg/s], (T,), without a sign: central differences of the heading of
    its left side, which stays level when a person bends. quaternion (T, 4): xyzw, world with z up."""
    if len(quaternion) < 2:
        return np.zeros(len(quaternion))
    left = Rotation.from_quat(quaternion).as_matrix()[:, :, 1]
    heading = np.unwrap(np.arctan2(-left[:, 0], left[:, 1]))
    return np.abs(np.rad2deg(np.gradient(heading))) * fps


def turn_bins(rate: np.ndarray) -> np.ndarray:
    """Place in `TURNS` of rates [deg/s]; an edge belongs to the faster one."""
    return np.digitize(rate, _TURN_EDGES)


def spikes_of(points: np.ndarray, truth: np.ndarray, root: Sequence[int] | None) -> np.ndarray:
    """The number of joints of points (T, J, 3) [m] leave for a frame, (T,): over 12 cm off the mean of the frames
    before and after, with the hips aligned where they are known (`root`), where the truth's is under 4 cm off. None in
    the first and last frame, nor beside one without a pose."""
    left = [np.zeros(points.shape[:2]) for _ in range(2)]
    for off, track in zip(left, (points, truth), strict=True):
        aligned = track if root is None else track - track[:, list(root)].mean(axis=1, keepdims=True)
        off[1:-1] = np.linalg.norm(aligned[1:-1] - 0.5 * (aligned[:-2] + aligned[2:]), axis=2)
    return np.sum((left[0] > _LEAVES) & (left[1] < _STAYS), axis=1).astype(float)


class FrameErrors(NamedTuple):
    """A smoothed trajectory against the truth, NaN in frames without a pose.

    aligned, pa (T,): mean error of the limb joints with the hips aligned and after the best similarity [mm]. degrees
    (T, A): absolute errors of `ANGLES`. rate (T,): of the true pelvis, see `heading_rate`. spikes (T,): see
    `spikes_of`.
    """

    aligned: np.ndarray
    pa: np.ndarray
    degrees: np.ndarray
    rate: np.ndarray
    spikes: np.ndarray

    @staticmethod
    def of(run: Run, truth: Reference) -> FrameErrors:
        """The errors of a run whose body is that of the truth, a rendered clip's, up to its lengths."""
        assert truth.coordinates is not None  # a clip's truth has them
        pairs = paired(run.body.landmark_names, run.time, truth)
        points = pairs.of(run.landmarks)
        known = match_frames(run.time, truth.time, len(truth.points)) >= 0
        q, columns = truth.coordinates.values[known], [truth.coordinates.names.index(name) for name in ANGLES]
        ours = np.stack([joint_value(joint_entry(run.body, name), run.q[pairs.frame]) for name in ANGLES], axis=1)
        return FrameErrors(
            1e3 * mpjpe(points, pairs.truth, pairs.shared.root),
            1e3 * pa_mpjpe(points, pairs.truth),
            np.abs(np.rad2deg(ours - q[:, columns])),
            heading_rate(q[:, ROOT_TURN_Q], FPS),
            spikes_of(points, pairs.truth, pairs.shared.root),
        )

    @staticmethod
    def joined(several: Sequence[FrameErrors]) -> FrameErrors:
        """The errors of several clips, one after the other."""
        return FrameErrors(*(np.concatenate(arrays) for arrays in zip(*several, strict=True)))

    def at(self, frames: np.ndarray) -> FrameErrors:
        """The errors of some frames, (T,) bool."""
        return FrameErrors(*(array[frames] for array in self))

    def means(self) -> dict[str, float]:
        """Mean errors of frames with a pose: `aligned`, `pa` [mm]; `angles`, `hips`, `knees`, `elbows` [deg]. `far`:
        share of frames over 250 mm with the hips aligned, or without a pose. `spikes`: how many there are."""
        joints = np.nanmean(self.degrees, axis=0)
        groups = {name: joints[[ANGLES.index(j) for j in of]].mean() for name, of in GROUPS.items()}
        all_ = {
            "aligned": np.nanmean(self.aligned),
            "pa": np.nanmean(self.pa),
            "far": np.mean(~(self.aligned <= FAR_MM)),
            "spikes": np.sum(self.spikes),
        }
        return {name: float(value) for name, value in {**all_, "angles": joints.mean(), **groups}.items()}


@dataclass(frozen=True)
class UnseenRun:
    """A piece of work: a captured clip tracked from one kind of keypoints.

    motion: BVH file. seconds: at most so much of it. seed: of noise and tracker. kind: one of `KINDS`. changes: to the
    settings, as JSON. prior: file of the mixture learned without the person. folder: of all rendered clips. start [s]:
    where in the file the clip begins.
    """

    motion: Path
    seconds: float
    seed: int
    kind: str
    changes: str
    prior: Path
    folder: Path
    start: float = 0.0

    @property
    def clip(self) -> str:
        """The clip's name: its file, and its start unless at the beginning."""
        return f"{self.motion.stem}{f' from {self.start:g} s' if self.start else ''}"

    @property
    def _stem(self) -> str:
        return f"{self.motion.stem}{f'_from_{self.start:g}s' if self.start else ''}"

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"{self._stem}_{self.kind}_{self.seed}"

    @property
    def what(self) -> Mapping[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return {
            "unseen": self.motion.stem, "seconds": self.seconds, "seed": self.seed, "kind": self.kind,
            "settings": self.changes, **({"start": self.start} if self.start else {}),
        }  # fmt: skip

    def prepare(self) -> RenderedClip:
        """Render the clip unless it is there."""
        return cached_clip(self.folder / f"{self._stem}_{self.seed}_{self.seconds:g}s", self._render)

    def _render(self, folder: Path) -> RenderedClip:
        motion = cut_motion(self.motion, self.start, folder / self.motion.name) if self.start else self.motion
        return render_captured(motion, self.seconds, self.seed, folder)

    def settings(self) -> dict[str, Any]:
        """The changes with the prior's file, which has no effect, and is refused, where they turn the prior off."""
        changes = json.loads(self.changes)
        off = changes.get("cost", {}).get("pose_prior_weight") == 0.0
        return together({} if off else {"cost": {"pose_prior_file": str(self.prior)}}, changes)

    def work(self, store: ResultStore) -> Figures:
        """The arrays of `FrameErrors`; and `tracks`, `TrackErrors` by trajectory."""
        clip, out, joints = self.prepare(), store.scratch(self, ".run"), store.scratch(self, ".json")
        keypoints = clip.keypoints if self.kind == "detector" else write_joints(clip, joints, self.seed)
        run, _ = timed_track(keypoints, clip.cameras, out, seed=self.seed, settings=self.settings())
        truth = Reference.load(clip.truth)
        arrays = {name: array.tolist() for name, array in FrameErrors.of(run, truth)._asdict().items()}
        tracks = {name: asdict(errors) for name, errors in trajectories(run, truth).items()}
        for path in (out, joints):
            removed(path)
        return {**arrays, "tracks": tracks}


def write_joints(clip: RenderedClip, path: Path, seed: int) -> dict[str, Path]:
    """Write the limb joints of a clip as its camera sees them, with `JOINTS_NOISE`; the file by the camera's name."""
    truth, (camera,) = Reference.load(clip.truth), load_cameras(clip.cameras).values()
    points = truth.points[:, [truth.names.index(name) for name in LIMB_JOINTS]]
    rng = np.random.default_rng((seed, _STREAM))
    write_keypoints(path, of_points(LIMB_JOINTS, "landmarks", points, camera, rng, JOINTS_NOISE, FPS))
    return {camera.name: path}
