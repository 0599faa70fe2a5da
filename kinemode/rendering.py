"""Clips with known truth as files: videos, cameras, keypoints, the body and its motion, of whatever kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.angle_files import read_motion_table
from estimator.synthesis.keyed_motion import KeyedMotion
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.motion import authored_motion, random_motion
from estimator.synthesis.motion_file import motion_of
from estimator.synthesis.motion_keys import MOTIONS, motion_named
from estimator.synthesis.plate import MotionArea, place_of
from estimator.synthesis.retarget import retarget
from estimator.synthesis.settings import DetectorSettings, SceneSettings, ViewSettings, in_range
from estimator.synthesis.views import framing_cameras
from humanoid.kinematics.body import ROOT_PLACE_Q, Body, points_in_world
from humanoid.shape.surface import surface_of
from humanoid.subject.joint_names import ROOT_POSITION
from humanoid.subject.subject import Subject, load_subject
from humanoid.subject.urdf_flesh import limb_capsule, mirror_parts
from kinemode.making_requests import RenderRequest
from kinemode.notices import warn
from kinemode.shot import FilmedMotion, RandomSources, RenderedClip, WantedFiles, write_shot

RANDOM = "random"
TABLES = (".csv", ".npz")
FILES = (".bvh", *TABLES)
_RANDOM_SECONDS = 4.0
_LONGEST = 3600.0  # [s]
_NODES = 500
_STREAM = 3  # of random numbers, beside those of the clip


def is_authored(motion: str | Path) -> bool:
    """Whether a motion is one of ours; a file never has such a name. Raises InputError for an unknown name."""
    name = str(motion)
    if name == RANDOM or (name not in MOTIONS and (Path(motion).suffix.lower() in FILES or Path(motion).exists())):
        return False
    return motion_named(name) is not None


def configurations(
    body: Body,
    motion: str | Path,
    fps: float,
    seconds: float | None,
    seed: int,
    unit: float | None = None,
    up: str | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """q (T, nq) and its times (T,) [s]; raises InputError, see `kinemode.render`."""
    if str(motion) == RANDOM:
        times = _times(fps, seconds, _LONGEST, _RANDOM_SECONDS)
        q = random_motion(body, times, np.random.default_rng((seed, _STREAM)))
        return _on_the_floor(body, q), times
    if is_authored(motion):
        keyed = motion_named(str(motion))
        times = _times(fps, seconds, keyed.seconds)
        return authored_motion(body, times, keyed), times
    if Path(motion).suffix.lower() in TABLES:
        table = read_motion_table(Path(motion))
        times = _times(fps, seconds, float(table.time[-1] - table.time[0]) + 1.0 / fps)
        q = motion_of(body, table, times)
        return (q if any(name.startswith(ROOT_POSITION) for name in table.names) else _on_the_floor(body, q)), times
    mocap = load_mocap(motion, unit=unit, up=up)
    times = _times(fps, seconds, mocap.seconds)
    return retarget(body, mocap, times).q, times


def _times(fps: float, seconds: float | None, longest: float, usual: float | None = None) -> np.ndarray:
    """Times (T,) [s] of the frames of a motion of this length, or of the requested part."""
    if seconds is not None:
        in_range("seconds", seconds, 1.0 / fps, longest)
    return np.arange(max(1, round(fps * (seconds or usual or longest)))) / fps


def _on_the_floor(body: Body, q: np.ndarray) -> np.ndarray:
    """The same motion (T, nq), a free root moved up or down so that its lowest point of all is at z = 0."""
    if not body.has_free_root:
        return q
    surface = surface_of(body, nodes=_NODES)
    lowest = min(float(points_in_world(body.at(pose), surface.joint, surface.local)[:, 2].min()) for pose in q)
    lifted = q.copy()
    lifted[:, ROOT_PLACE_Q.stop - 1] -= lowest
    return lifted


_FIXED_FLOOR = -1.1  # [m] of the floor under a body with a fixed trunk
_FRAMING_STEP = 0.1  # [s] between the poses that the cameras are placed by


def render_clip(request: RenderRequest) -> RenderedClip:
    """The work of `kinemode.render` after its options are checked."""
    motion, fps, seed, view = request.motion, request.fps, request.seed, request.view or ViewSettings()
    keyed = motion_named(str(motion)) if is_authored(motion) else None
    subject = _subject(request.subject, keyed, request.proportions, request.shape)
    body = Body(_with_girth(subject, request.girth))
    q, times = configurations(body, motion, fps, request.seconds, seed, request.unit, request.up)
    scene = request.scene or SceneSettings()
    scene = replace(scene, background=scene.background or _background_of(motion))
    if keyed and view.azimuth is None:
        view = replace(view, azimuth=keyed.azimuth)
    cameras, place = _framed(body, q, fps, view)
    draws = RandomSources(
        np.random.default_rng((seed, 0)),
        np.random.default_rng((seed, 1)),
        [np.random.default_rng((seed, 2, c)) for c in range(len(cameras))],
    )
    shot = FilmedMotion(body, q, times, fps, cameras, scene, place)
    return write_shot(
        request.folder,
        shot,
        draws,
        request.detector or DetectorSettings(),
        wanted=WantedFiles(request.videos, request.masks, request.depths),
        progress=request.reporter,
    )


def _background_of(motion: str | Path) -> str:
    """The background that a motion is rendered before by default; raises InputError."""
    return motion_named(str(motion)).background if is_authored(motion) else "room"


def _subject(
    given: str | Path | Subject | None,
    keyed: KeyedMotion | None,
    proportions: Mapping[str, float] | None,
    shape: Mapping[int | str, Sequence[float]] | None,
) -> Subject:
    if isinstance(given, Subject):
        subject = given
    elif given is None:
        subject = load_subject(keyed.subject if keyed else "human34")
    else:
        subject = load_subject(given)
        for note in subject.notes:
            warn(note)
    subject = subject.scaled(proportions) if proportions else subject
    return subject.reshaped(shape) if shape else subject


def _with_girth(subject: Subject, girth: float) -> Subject:
    """The subject with thicker or thinner limbs: parts with a capsule for their solid that come in pairs."""
    mirror = mirror_parts([f.link for f in subject.flesh])
    limbs = [k for k, f in enumerate(subject.flesh) if mirror[k] != k and limb_capsule(f) is not None]
    if girth == 1.0:
        return subject
    return subject.reshaped({k: subject.flesh[k].widened(girth) for k in limbs})


def _framed(body: Body, q: np.ndarray, fps: float, view: ViewSettings) -> tuple[tuple[Camera, ...], MotionArea]:
    """Cameras that see all of the motion, and the place it needs."""
    surface = surface_of(body, nodes=500)
    shown = q[:: max(1, round(_FRAMING_STEP * fps))]
    points = np.array([points_in_world(body.at(pose), surface.joint, surface.local) for pose in shown])
    floor = 0.0 if body.has_free_root else _FIXED_FLOOR
    return framing_cameras(points, view), place_of(points, floor)
