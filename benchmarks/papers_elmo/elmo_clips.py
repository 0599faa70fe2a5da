"""Sequences for the measures of ELMO: captured motion there and back, turning slowly, before a stereo pair."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from benchmarks.support.common import tell
from benchmarks.support.mocap_person import person
from benchmarks.support.result_store import cached_clip
from estimator.data.cameras.camera import Camera
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.plate import place_of
from estimator.synthesis.retarget import retarget
from estimator.synthesis.settings import DetectorSettings, SceneSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from humanoid.kinematics.body import ROOT_Q, Body, points_in_world
from humanoid.shape.surface import surface_of
from humanoid.subject.subject import Subject
from kinemode.shot import FilmedMotion, RandomSources, RenderedClip, WantedFiles, write_shot

JOINTS = (
    "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist", "neck", "head_top",
)  # fmt: skip
"""The joints over which errors are averaged: shoulders, elbows, wrists, neck and head top."""
LEGS = ("left_knee", "right_knee", "left_ankle", "right_ankle")
FPS = 30.0
DRIFT = 40.0  # degrees to either side that the heading drifts
_DRIFT_SECONDS = 20.0  # of a swing to both sides
_SEED = 7  # of room, clothes and noise, of the first clip of each
_VIDEOS = WantedFiles()
_CLOSE = 1.35  # how much longer the lens of the sequence is from which arms leave the picture


@dataclass(frozen=True)
class Sequence:
    """A captured motion and how it is filmed. azimuth [degrees]: of the camera, from the front. close: so near that
    arms leave the picture."""

    motion: str
    azimuth: float = 0.0
    close: bool = False


SEQUENCES = {
    "wave": Sequence("wave_hello_fair1"),
    "punch": Sequence("punch_02_05"),
    "arms_high": Sequence("arms_high_05_12", close=True),
    "dance": Sequence("dance_05_10", azimuth=45.0),
    "bend": Sequence("bend_scoop_lift_02_06"),
    "walk_turn": Sequence("walk_turn_26_01"),
}


@dataclass(frozen=True)
class Filmed:
    """A rendered sequence: frames at `fps`, the distance between the cameras [m], the size of the pictures,
    where clips are kept, from when until when [s] a screen hides the person, which clip of it: 0, or another with
    another room, clothes and noise, and whether there is exact depth beside it."""

    name: str
    frames: int
    data: Path
    folder: Path
    fps: float = FPS
    baseline: float = 0.12
    size: tuple[int, int] = (320, 240)
    hidden: tuple[tuple[float, float], ...] = ()
    clip: int = 0
    depths: bool = False

    @property
    def clip_folder(self) -> Path:
        """Where its clip is."""
        how = f"{self.frames}_{self.fps:g}_{self.baseline:g}_{self.size[0]}"
        when = "".join(f"_{begin:.2f}-{end:.2f}" for begin, end in self.hidden)
        which = f"_clip{self.clip}" if self.clip else ""
        depths = "_depths" if self.depths else ""
        return self.folder / f"{self.name}_{how}{when}{which}{depths}"


def filmed(task: Filmed, subject: Subject | None = None) -> RenderedClip:
    """The sequence's clip, rendered unless it is there; the person has other lengths, girth and clothes than any of the
    examples."""

    def render(folder: Path) -> None:
        sequence = SEQUENCES[task.name]
        body = Body(subject or person())
        q = there_and_back(body, task.data / "mocap" / f"{sequence.motion}.bvh", task.frames, task.fps)
        view = ViewSettings(azimuth=sequence.azimuth, image_size=task.size, baseline=task.baseline, fill=0.85)
        wanted, seed = WantedFiles(depths=task.depths), _SEED + task.clip
        _write(folder, body, q, task.fps, view, close=sequence.close, hidden=task.hidden, seed=seed, wanted=wanted)
        tell(f"{task.name}: rendered")

    return cached_clip(task.clip_folder, render)


def filmed_poses(folder: Path, body: Body, q: np.ndarray, baseline: float) -> RenderedClip:
    """Poses (T, nq) that face against x, one a frame, turned to the camera and rendered unless they are there."""
    view = ViewSettings(azimuth=0.0, image_size=(320, 240), baseline=baseline, fill=0.85)
    turned, half_turn = q.copy(), pin.SE3(pin.utils.rotate("z", np.pi), np.zeros(3))
    for pose in turned:
        pose[ROOT_Q] = pin.SE3ToXYZQUAT(half_turn * pin.XYZQUATToSE3(pose[ROOT_Q]))
    return cached_clip(folder, lambda path: _write(path, body, turned, FPS, view))


def _write(
    folder: Path,
    body: Body,
    q: np.ndarray,
    fps: float,
    view: ViewSettings,
    *,
    close: bool = False,
    hidden: tuple[tuple[float, float], ...] = (),
    seed: int = _SEED,
    wanted: WantedFiles = _VIDEOS,
) -> RenderedClip:
    """Render a motion (T, nq) before a textured room."""
    surface = surface_of(body, nodes=500)
    points = np.array([points_in_world(body.at(pose), surface.joint, surface.local) for pose in q[::3]])
    cameras = framing_cameras(points, view)
    cameras = tuple(_nearer(camera) for camera in cameras) if close else cameras
    keypoints, room, *sensors = [np.random.default_rng((seed, k)) for k in range(2 + len(cameras))]
    shot = FilmedMotion(
        body, q, np.arange(len(q)) / fps, fps, cameras, SceneSettings(background="textured", hidden=hidden),
        place_of(points, float(points[..., 2].min())),
    )  # fmt: skip
    return write_shot(folder, shot, RandomSources(keypoints, room, sensors), DetectorSettings(), wanted=wanted)


def there_and_back(body: Body, motion: Path, frames: int, fps: float) -> np.ndarray:
    """q (frames, nq) of a captured motion, forwards, backwards and so on, its heading drifting to either side."""
    mocap = load_mocap(motion)
    own = retarget(body, mocap, np.arange(int(mocap.seconds * fps)) / fps).q
    last = len(own) - 1
    at = np.abs((np.arange(frames) + last) % (2 * last) - last)
    q = own[at].copy()
    heading = np.radians(DRIFT) * np.sin(2.0 * np.pi * np.arange(frames) / fps / _DRIFT_SECONDS)
    centre = np.array([*own[:, :2].mean(axis=0), 0.0])
    for pose, angle in zip(q, heading, strict=True):
        turn = pin.SE3(pin.utils.rotate("z", angle), np.zeros(3))
        turned = pin.SE3(np.eye(3), centre) * turn * pin.SE3(np.eye(3), -centre) * pin.XYZQUATToSE3(pose[ROOT_Q])
        pose[ROOT_Q] = pin.SE3ToXYZQUAT(turned)
    return q


def _nearer(camera: Camera) -> Camera:
    K = camera.K.copy()
    K[0, 0] *= _CLOSE
    K[1, 1] *= _CLOSE
    return replace(camera, K=K)
