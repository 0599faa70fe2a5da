"""Captured motions seen by three cameras in arbitrarily turned worlds: whether the export stands upright, or a line
asks for the up direction; and strides against those of the same clip in a world whose z points up. The same of people
who walk on a treadmill, lie, sit and hang, by three cameras and by points whose file does not declare which axis points
up.

Rotations are uniform over all; some worlds are turned so that an axis points up exactly, as calibrations have it.
"""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import kinemode as km
from benchmarks.accuracy.sizes import cameras_for
from benchmarks.robustness.floor_scenes import made_scenes
from benchmarks.support.common import Json, captured_folder, save
from benchmarks.support.mocap_person import DETECTOR, FPS
from estimator.data.cameras.camera import UPS, Camera, axis_of, in_world, world_with_up
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.numerics.alignment import rotation_onto
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.retarget import retarget
from estimator.vision.resolution import resized_camera
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.terminal import report

CLIPS = ("walk_straight_07_01", "walk_turn_26_01", "bend_scoop_lift_02_06", "dance_05_10", "jump_16_01")
HEIGHT, SECONDS = 2.8, 5.0  # m: that the cameras see well; s: of each clip at most
SIZE = (1920, 1440)
UPRIGHT = 2.0  # degrees
STILL = ("treadmill", "supine", "prone", "on one side", "on a chair", "on the floor", "from a bar", "handstand")


class World(NamedTuple):
    """off [deg]: the export's up from the true one. notes: notes about it. stride [m]: median length, NaN where
    there is none."""

    off: float
    notes: tuple[str, ...]
    stride: float


def filmed() -> tuple[Camera, ...]:
    """The cameras in a world whose z points up."""
    return tuple(resized_camera(camera, SIZE) for camera in cameras_for(HEIGHT))


def tracked(points: np.ndarray, names: tuple[str, ...], cameras: tuple[Camera, ...], seed: int) -> World:
    """The clip tracked as a user would; points (T, L, 3) in the world of z up, the cameras in one that is turned."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        rng = np.random.default_rng((seed, 7))
        paths = []
        for camera, upright in zip(cameras, filmed(), strict=True):
            pixels = np.array([upright.project(p) for p in points])
            pixels = pixels + DETECTOR.noise_px * rng.normal(size=pixels.shape)
            size = camera.image_size
            there = ((pixels > 0.0) & (pixels < np.array(size))).all(axis=-1)
            paths.append(Path(folder) / f"{camera.name}.json")
            track = KeypointTrack("landmarks", names, pixels, there.astype(float), size, FPS)
            write_keypoints(paths[-1], track)
        write_cameras(Path(folder) / "cameras.json", cameras)
        run = km.track(
            "human34", (), keypoints=paths, cameras=Path(folder) / "cameras.json", fit="off", modes=1, seed=seed
        )
        shared = [run.body.landmark_names.index(n) for n in names]
        off = float(np.degrees(np.arccos(np.clip(_turn(points, run.landmarks[:, shared])[2, 2], -1.0, 1.0))))
        lengths = [stride.length for stride in km.gait(run).strides]
    notes = tuple(str(w.message) for w in said if "--up" in str(w.message))
    return World(off, notes, float(np.median(lengths)) if lengths else float("nan"))


def tracked_points(points: np.ndarray, names: tuple[str, ...], up: str) -> World:
    """From points (T, L, 3) of a z-up world, in a file where they stand along `up`, undeclared."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        path = Path(folder) / "points.npz"
        turned = (points + axis_of("z")) @ world_with_up(axis_of(up))
        np.savez(path, points=turned, names=np.array(names), fps=FPS, unit="m")
        try:
            run = km.track("human34", points=path, fit="off")
        except InputError as error:  # a refusal asks for up too
            return World(180.0, (str(error),) if "--up" in str(error) else (), float("nan"))
        off = float(np.degrees(np.arccos(np.clip(_turn(points, run.landmarks)[2, 2], -1.0, 1.0))))
    return World(off, tuple(str(w.message) for w in said if "--up" in str(w.message)), float("nan"))


def _turn(points: np.ndarray, run: np.ndarray) -> np.ndarray:
    """R_run_true (3, 3): the least-squares turn of a whole clip's points onto a run's."""
    known = np.isfinite(run).all(axis=2)
    return rotation_onto(points[known] - points[known].mean(axis=0), run[known] - run[known].mean(axis=0))


def main(*, worlds: int = 100, turned: int = 100, data: Path | None = None, seed: int = 0, out: Json = None) -> None:
    """Print how upright exports are in worlds turned anyhow.

    Parameters
    ----------
    worlds
        How many rotations, over all clips.
    turned
        Number of the people not standing on a floor who are also filmed.
    data
        The evaluation data with `mocap`.
    seed
        Of rotations, noise and tracking.
    out
        A file for the figures.
    """
    folder = captured_folder(data)
    if folder is None:
        return
    rng, body, figures = np.random.default_rng((seed, 3)), Body(load_subject("human34")), dict[str, Any]()
    columns = "clip", "worlds", "upright", "asked", "neither", "worst [deg]", "strides off"
    made = report.table("captured motion in turned worlds", *columns)
    for k, clip in enumerate(CLIPS):
        mocap = load_mocap(folder / "mocap" / f"{clip}.bvh")
        q = retarget(body, mocap, np.arange(0.0, min(mocap.seconds, SECONDS), 1.0 / FPS)).q
        points = np.array([body.landmarks(body.at(pose)) for pose in q])
        points[..., :2] -= points[..., :2].reshape(-1, 2).mean(axis=0)
        count = len(range(k, worlds, len(CLIPS)))
        turns = [np.eye(3), *(world_with_up(axis_of(up)).T for up in UPS if up != "z")]
        turns += [Rotation.from_quat(rng.normal(size=4)).as_matrix() for _ in range(count)]
        results = [tracked(points, body.landmark_names, tuple(in_world(c, R) for c in filmed()), seed) for R in turns]
        upright = [r.off <= UPRIGHT for r in results]
        asked = [not u and bool(r.notes) for u, r in zip(upright, results, strict=True)]
        strides = np.array([r.stride / results[0].stride - 1.0 for u, r in zip(upright, results, strict=True) if u])
        neither = len(results) - sum(upright) - sum(asked)
        strides_off = "-" if np.isnan(strides).all() else f"{np.nanmax(np.abs(strides)):.1%}"
        made.add_row(
            clip, str(len(results)), str(sum(upright)), str(sum(asked)), str(neither),
            f"{max(r.off for r in results):.1f}", strides_off,
        )  # fmt: skip
        figures[clip] = [r._asdict() for r in results]
    report.console().print(made)
    figures |= _made_people(body, turned, seed)
    save(out, figures)


def _made_people(body: Body, count: int, seed: int) -> dict[str, Any]:
    """People who do not stand on a floor, in worlds with each axis up; of `count` of them by cameras too."""
    figures, axes = dict[str, Any](), [up for up in UPS if up != "z"]
    table = report.table("people who do not stand on a floor", "scene", "kind", "worlds", "upright", "asked", "neither")
    for k, scene in enumerate(s for s in made_scenes(body) if any(word in s.name for word in STILL)):
        points = body.landmarks_of(body.placed(scene.q))
        points[..., :2] -= points[..., :2].reshape(-1, 2).mean(axis=0)
        worlds = {"points": [tracked_points(points, body.landmark_names, up) for up in UPS]}
        if k < count:
            turns = [np.eye(3), *(world_with_up(axis_of(up)).T for up in axes)]
            seen = [tuple(in_world(c, R) for c in filmed()) for R in turns]
            worlds["cameras"] = [tracked(points, body.landmark_names, cameras, seed) for cameras in seen]
        for kind, results in worlds.items():
            upright = [r.off <= UPRIGHT for r in results]
            asked = [not u and bool(r.notes) for u, r in zip(upright, results, strict=True)]
            neither = len(results) - sum(upright) - sum(asked)
            table.add_row(scene.name, kind, *map(str, (len(results), sum(upright), sum(asked), neither)))
            figures[f"{scene.name}, {kind}"] = [r._asdict() for r in results]
    report.console().print(table)
    return figures
