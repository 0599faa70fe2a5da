"""People of 0.9 to 2.05 m with proportions of their own, simulated: how well several cameras, or one and a height, fit
and track them beside an adult of average height, whose motion and cameras are the same but for their size.

Keypoints are those of the body's own landmarks, exact or with noise. Proportions are drawn around the adult's; the
heads of children are relatively larger and their legs shorter.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from cyclopts import Parameter

from benchmarks.support.common import Json, save
from estimator.data.cameras.camera import Camera, guessed_camera
from estimator.data.observation import Observation
from estimator.fitting.fit import bound_note, stature
from estimator.fitting.person import fit_person
from estimator.fitting.settings import FitSettings
from estimator.synthesis.motion import authored_motion
from estimator.tracking.registry import make_tracker
from estimator.tracking.runner import run
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Subject, load_subject
from kinemode.terminal import report

HEIGHTS = (0.9, 2.05)  # m
FRAMES, SECONDS = 12, 2.0
AROUND = (20.0, 140.0, 260.0)  # degrees, of the cameras
NOISES = (0.0, 5.0)  # px
ALLOWED = 1.3  # times the average adult's error
_SPREAD = 0.05  # logarithm of a proportion
_CHILD, _HEAD, _LEGS = 0.85, 0.15, 0.08  # size below which heads grow and legs shrink, by how much at the smallest


Known = Literal["nothing", "height", "floor"]


class Outcome(NamedTuple):
    """Mean error of the joint angles [deg], fitted over true height, whether lengths on their bounds were reported."""

    height: float
    error: float
    ratio: float
    bound: bool


def person_of(adult: Subject, height: float, rng: np.random.Generator) -> Subject:
    """Somebody of a height [m]."""
    size = height / stature(adult)
    scales = {p.joint: np.exp(_SPREAD * rng.normal()) for p in adult.proportions}
    young = max(0.0, (_CHILD - size) / (_CHILD - HEIGHTS[0] / stature(adult)))
    scales["skull"] *= 1.0 + _HEAD * young
    for name in ("left_knee_flexion", "left_ankle_dorsiflexion"):
        scales[name] *= 1.0 - _LEGS * young
    within = {p.joint: float(np.clip(scales[p.joint], p.scale_min, p.scale_max)) for p in adult.proportions}
    made = adult.scaled(within)
    return made.resized(height / stature(made))


def cameras_for(height: float) -> tuple[Camera, ...]:
    """Cameras around a person, at distances in proportion."""
    away, middle = 2.1 * height, np.array([0.0, 0.0, 0.56 * height])
    cameras = []
    for k, angle in enumerate(np.radians(AROUND)):
        centre = np.array([away * np.cos(angle), away * np.sin(angle), 0.7 * height])
        forward = (middle - centre) / np.linalg.norm(middle - centre)
        right = np.cross(forward, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(forward, [0.0, 0.0, 1.0]))
        R = np.stack([right, np.cross(forward, right), forward])
        cameras.append(replace(guessed_camera(f"c{k}", (640, 480)), R_camera_world=R, t_camera_world=-R @ centre))
    return tuple(cameras)


def seen(
    body: Body, q: np.ndarray, cameras: tuple[Camera, ...], noise: float, rng: np.random.Generator
) -> list[Observation]:
    """The landmarks of a motion as the cameras detect them."""
    frames = []
    for index, pose in enumerate(q):
        points = body.landmarks(body.at(pose))
        pixels = np.array([camera.project(points) for camera in cameras])
        pixels = pixels + noise * rng.normal(size=pixels.shape)
        confidence = np.isfinite(pixels).all(axis=2).astype(float)
        frames.append(Observation(index, index * SECONDS / FRAMES, cameras, pixels, confidence))
    return frames


def outcome(adult: Subject, height: float, noise: float, seed: int, known: Known) -> Outcome:
    """One person by all cameras, or by the first and the height or the floor."""
    rng = np.random.default_rng((seed, 41))
    subject = person_of(adult, height, rng)
    body, cameras = Body(subject), cameras_for(height)
    q = authored_motion(body, np.linspace(0.3, 0.3 + SECONDS, FRAMES))
    observations = seen(body, q, cameras if known == "nothing" else cameras[:1], noise, rng)
    floor = None
    if known == "floor":
        distances = FloorDistances(body, np.array([0.0, 0.0, 1.0]), 0.0)
        floor = float(np.median(distances.lowest(body.placed(q))))
    told = height if known == "height" else None
    fit = fit_person(adult, observations, settings=FitSettings(frames=8), height=told, floor=floor)
    tracked = [result.q[0] for result, _ in run(make_tracker("css", Body(fit.subject)), observations, seed)]
    error = float(np.degrees(np.abs(np.array(tracked)[:, 7:] - q[:, 7:])).mean())
    return Outcome(height, error, stature(fit.subject) / stature(subject), bool(bound_note(fit.subject)))


def main(
    *,
    people: int = 24,
    one_camera: Annotated[bool, Parameter(negative=())] = False,
    floor: Annotated[bool, Parameter(negative=())] = False,
    seed: int = 0,
    out: Json = None,
) -> None:
    """Print errors of people of all heights over the average adult's.

    Parameters
    ----------
    people
        How many, evenly spread over the heights.
    one_camera
        By one camera and the height given, instead of by three.
    floor
        By one camera and the height of the floor.
    seed
        Of proportions, noise and tracking.
    out
        A file for the figures.
    """
    known: Known = "floor" if floor else "height" if one_camera else "nothing"
    adult, figures = load_subject("human34"), dict[str, Any]()
    columns = "noise [px]", "adult [deg]", "median", "95 %", f"within {ALLOWED}", "height off"
    made = report.table("errors over the average adult's", *columns)
    for noise in NOISES:
        average = outcome(adult, stature(adult), noise, seed, known).error
        heights = np.linspace(*HEIGHTS, people)
        all_ = [outcome(adult, float(h), noise, seed + 1 + k, known) for k, h in enumerate(heights)]
        ratios = np.array([o.error for o in all_]) / average
        off = np.abs(np.array([o.ratio for o in all_]) - 1.0)
        made.add_row(
            f"{noise:g}", f"{average:.2f}", f"{np.median(ratios):.2f}", f"{np.percentile(ratios, 95):.2f}",
            f"{np.mean(ratios <= ALLOWED):.0%}", f"{off.max():.1%}",
        )  # fmt: skip
        figures[f"{noise:g}"] = {"adult": average, "people": [o._asdict() for o in all_]}
        print(f"noise {noise:g} px: of {sum(o.bound for o in all_)} lengths on a bound are reported")
    report.console().print(made)
    save(out, figures)
