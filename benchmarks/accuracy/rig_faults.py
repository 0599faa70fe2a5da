"""What goes wrong with cameras, and whether it is named: one is moved during the clip, one sees another motion, or one
was moved since a calibration; random rigs around captured people."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.accuracy.rig_clips import SECONDS, RigClip, drawn_rig
from benchmarks.accuracy.rigs import RigTrial
from benchmarks.support.common import Data, Json, in_processes, save, tell
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files
from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.rigs.check import check_by_person
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.terminal import report

MOVED, TURNED, SHIFTED = (2.0, 4.0), (1.0, 2.0), 0.1  # degrees during a clip; degrees, and metres, since a calibration
FIRST_SEED, RIGS = 200, 12  # none of these was in view when thresholds were chosen
_WHEN = (0.25, 0.75)  # of the clip
STILL, STRANGER, HOLDS = "all stand still", "one sees another motion", "all hold"


@dataclass(frozen=True)
class FaultOutcome:
    """rig: its name. kind: what is wrong. named: the cameras reported; right: those truly at fault, of two cameras
    both. refused: whether nothing was calibrated."""

    rig: str
    kind: str
    named: tuple[str, ...]
    right: tuple[str, ...]
    refused: bool = False

    @property
    def verdict(self) -> str:
        """As the table counts it."""
        if self.refused:
            return "refused"
        if self.named == self.right:
            return "right"
        return "wrong" if self.named else "missed"


def turned_camera(camera: Camera, degrees: float, axis: np.ndarray) -> Camera:
    """A camera turned where it stands, about an axis (3,) in its frame."""
    R = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    return replace(camera, R_camera_world=R @ camera.R_camera_world, t_camera_world=R @ camera.t_camera_world)


def with_turn(track: KeypointTrack, camera: Camera, turned: Camera, begin: int) -> KeypointTrack:
    """The track of a camera that stands as `turned`, at the same place, from a frame on."""
    world = camera.directions(track.pixels[begin:]) @ camera.R_camera_world
    pixels = track.pixels.copy()
    pixels[begin:] = turned.project(world + turned.centre_world)
    return replace(track, pixels=pixels)


def backwards(track: KeypointTrack) -> KeypointTrack:
    """Another person's motion: the track reversed in time."""
    return replace(track, pixels=track.pixels[::-1].copy(), confidence=track.confidence[::-1].copy())


def of_seed(files: Sequence[Path], seed: int) -> list[FaultOutcome]:
    """All faults of one random rig."""
    clip, rng = drawn_rig(files, seed, seconds=SECONDS), np.random.default_rng((seed, 53))
    which, axis, way = int(rng.integers(len(clip.cameras))), rng.normal(size=3), rng.normal(size=3)
    begin = round(float(rng.uniform(*_WHEN)) * len(clip.q))
    camera, track = clip.cameras[which], clip.tracks[which]
    tracks = {STILL: track, STRANGER: backwards(track)}
    for degrees in MOVED:
        turned = turned_camera(camera, degrees, axis)
        tracks[f"one is turned by {degrees:g} degrees"] = with_turn(track, camera, turned, begin)
    cameras = {HOLDS: camera}
    for degrees in TURNED:
        cameras[f"one was turned by {degrees:g} degrees"] = turned_camera(camera, degrees, axis)
    shift = SHIFTED * way / np.linalg.norm(way)
    cameras[f"one was shifted by {SHIFTED:g} m"] = replace(camera, t_camera_world=camera.t_camera_world + shift)
    outcomes = [_calibrated(clip, which, kind, own) for kind, own in tracks.items()]
    outcomes += [_checked(clip, which, kind, own) for kind, own in cameras.items()]
    tell(f"{seed}: {clip.name}")
    return outcomes


def _calibrated(clip: RigClip, which: int, kind: str, track: KeypointTrack) -> FaultOutcome:
    tracks = (*clip.tracks[:which], track, *clip.tracks[which + 1 :])
    trial = RigTrial.of(replace(clip, tracks=tracks), clip.name, clocks_known=True)
    right = () if kind == STILL else _right(clip, which)
    try:
        rig = trial.calibrated(Body(load_subject("human34")))
    except InputError:
        return FaultOutcome(clip.name, kind, (), right, refused=True)
    return FaultOutcome(clip.name, kind, rig.doubtful, right)


def _checked(clip: RigClip, which: int, kind: str, camera: Camera) -> FaultOutcome:
    cameras = {own.name: own for own in clip.cameras} | {camera.name: camera}
    tracks, times = RigTrial.of(clip, clip.name, clocks_known=True).by_camera
    check = check_by_person(Body(load_subject("human34")), tracks, cameras, times)
    return FaultOutcome(clip.name, kind, check.moved, () if kind == HOLDS else _right(clip, which))


def _right(clip: RigClip, which: int) -> tuple[str, ...]:
    names = tuple(camera.name for camera in clip.cameras)
    return names if len(names) == 2 else (names[which],)


def show(title: str, outcomes: Iterable[FaultOutcome]) -> None:
    """A table of counts."""
    counts: dict[str, Counter[str]] = {}
    for outcome in outcomes:
        counts.setdefault(outcome.kind, Counter())[outcome.verdict] += 1
    columns = ("right", "missed", "wrong", "refused")
    table = report.table(title, "", *columns)
    for kind, own in counts.items():
        table.add_row(kind, *(str(own[column]) for column in columns))
    report.console().print(table)


def main(*, count: int = RIGS, data: Data = None, jobs: int = 1, json: Json = None) -> None:
    """Print how often a camera that was moved, or that sees another person, is named.

    Parameters
    ----------
    count
        So many random rigs of two to four cameras.
    jobs
        Rigs at a time, each in a process of its own.
    """
    if count < 1:
        raise InputError("--count", f"is {count}", remedy="1 or more")
    files = captured_files(data)
    if not files:
        print(NO_CAPTURED_FILES)
        return
    rigs = in_processes(partial(of_seed, files), range(FIRST_SEED, FIRST_SEED + count), jobs)
    outcomes = [outcome for rig in rigs for outcome in rig]
    during = {o.kind for o in outcomes} & {STILL, STRANGER} | {o.kind for o in outcomes if o.kind.startswith("one is")}
    show("found from the person", [outcome for outcome in outcomes if outcome.kind in during])
    show("calibrated before", [outcome for outcome in outcomes if outcome.kind not in during])
    rows: list[dict[str, Any]] = [{**vars(outcome), "verdict": outcome.verdict} for outcome in outcomes]
    save(json, {"measure": "rig faults", "how": {"rigs": count, "first seed": FIRST_SEED}, "outcomes": rows})
