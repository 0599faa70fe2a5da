"""Clips with known truth as files: videos, cameras, keypoints, the true motion, the body."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator import synthesis
from estimator.data.cameras.camera import Camera
from estimator.synthesis import DetectorSettings, SceneSettings, ViewSettings
from estimator.synthesis.keyed_motion import KeyedMotion
from estimator.synthesis.motion_keys import motion_named
from estimator.synthesis.plate import MotionArea, place_of
from estimator.synthesis.settings import in_range
from humanoid.kinematics.body import Body, points_in_world
from humanoid.shape.surface import surface_of
from humanoid.subject.subject import Subject, load_subject
from humanoid.subject.urdf_flesh import limb_capsule
from humanoid.subject.urdf_reshape import mirror_parts
from kinemode.notices import InputWarning
from kinemode.progress import Reporter, unreported
from kinemode.rendering.files import RenderedClip, WantedFiles
from kinemode.rendering.motions import configurations, is_authored
from kinemode.rendering.shot import FilmedMotion, RandomSources, write_shot

_FIXED_FLOOR = -1.1  # [m] of the floor under a body with a fixed trunk
_GIRTHS = (0.5, 1.6)
_FRAMING_STEP = 0.1  # [s] between the poses that the cameras are placed by


def render_clip(
    folder: str | Path,
    motion: str | Path = "reach",
    *,
    subject: str | Path | Subject | None = None,
    proportions: Mapping[str, float] | None = None,
    shape: Mapping[int | str, Sequence[float]] | None = None,
    girth: float = 1.0,
    scene: SceneSettings | None = None,
    view: ViewSettings | None = None,
    detector: DetectorSettings | None = None,
    fps: float = 30.0,
    seconds: float | None = None,
    unit: float | None = None,
    up: str | None = None,
    seed: int = 0,
    videos: bool = True,
    masks: bool = False,
    depths: bool = False,
    progress: Reporter = unreported,
) -> RenderedClip:
    """What `kinemode.render` does once its arguments are known to be of the right kinds."""
    in_range("fps", fps, 1.0, 1000.0)
    in_range("girth", girth, *_GIRTHS)
    keyed = motion_named(str(motion)) if is_authored(motion) else None
    body = Body(_with_girth(_subject(subject, keyed, proportions, shape), girth))
    q, times = configurations(body, motion, fps, seconds, seed, unit, up)
    scene, view = scene or SceneSettings(), view or ViewSettings()
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
        folder,
        shot,
        draws,
        detector or DetectorSettings(),
        wanted=WantedFiles(videos, masks, depths),
        progress=progress,
    )


def _background_of(motion: str | Path) -> str:
    """The background that a motion is rendered before unless another is asked for; raises InputError."""
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
            warnings.warn(note, InputWarning, stacklevel=4)
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
    return synthesis.framing_cameras(points, view), place_of(points, floor)
