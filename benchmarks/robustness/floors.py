"""Joint angles with the floor that is found from feet, beside those without a floor: people who stand, climb, sit, lie
and hang, by points in space and by keypoints of three cameras or one."""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

import kinemode as km
from benchmarks.accuracy.sizes import cameras_for
from benchmarks.robustness.floor_scenes import FPS, Scene, scenes
from benchmarks.support.common import Json, Several, captured_folder, save
from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.runs.run_reader import Run
from estimator.vision.resolution import resized_camera
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

Kind = Literal["points", "three", "one"]
Kinds = Annotated[tuple[Kind, ...], Several]
KINDS: tuple[Kind, ...] = ("points", "three", "one")
SUBJECT, HEIGHT, SIZE = "human34", 3.2, (1920, 1440)  # m: that the cameras see well; px
POINT_NOISE, PIXEL_NOISE = 0.003, 3.0  # m, px
WORSE = 0.5  # degrees


class Figures(NamedTuple):
    """without, with_floor [degrees]: mean error of all joint angles. floor: whether there is one. note: whether a
    warning names it. hard: frames that are not called tracked, with the floor found."""

    without: float
    with_floor: float
    floor: bool
    note: bool
    hard: int


def main(*, kinds: Kinds = KINDS, every: int = 1, data: Path | None = None, seed: int = 0, out: Json = None) -> None:
    """Print errors of joint angles with the floor found and with `--floor off`.

    Parameters
    ----------
    kinds
        What people are tracked by: points, three cameras, one.
    every
        So many-th scenes alone.
    data
        The evaluation data with `mocap` and `mocap_more`; scenes that are made alone without it.
    seed
        Of noise and tracking.
    out
        A file for the figures.
    """
    body, figures = Body(load_subject(SUBJECT)), dict[str, Any]()
    chosen = list(scenes(body, captured_folder(data)))[::every]
    for kind in kinds:
        columns = "scene", "without [deg]", "found [deg]", "floor", "note", "hard"
        made = report.table(f"joint angles with the floor that is found, by {kind}", *columns)
        own = {}
        for scene in chosen:
            with tempfile.TemporaryDirectory() as folder:
                row = own[scene.name] = tracked(body, scene, kind, Path(folder), seed)
            made.add_row(scene.name, f"{row.without:.2f}", f"{row.with_floor:.2f}", *map(str, row[2:]))
        report.console().print(made)
        worse = [name for name, row in own.items() if row.with_floor > row.without + WORSE]
        most = max(row.with_floor - row.without for row in own.values())
        print(
            f"{kind}: {len(own)} scenes, at most {most:+.2f} degrees; worse by {WORSE:g}: {', '.join(worse) or 'none'}"
        )
        figures[kind] = {name: row._asdict() for name, row in own.items()}
    save(out, figures)


def tracked(body: Body, scene: Scene, kind: Kind, folder: Path, seed: int) -> Figures:
    """The scene tracked as a user would, twice."""
    points = body.landmarks_of(body.placed(scene.q))
    rng = np.random.default_rng((seed, 5))
    given = _points(body, points, folder, rng) if kind == "points" else _keypoints(body, points, kind, folder, rng)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        without, with_floor = (
            km.track(SUBJECT, None, floor=floor, up="z", fit="off", seed=seed, **given) for floor in _BOTH
        )
    note = any("no floor was put" in str(warning.message) for warning in caught)
    return Figures(
        _error(without, scene), _error(with_floor, scene), with_floor.floor is not None, note,
        int(np.sum(with_floor.status != "tracked")),
    )  # fmt: skip


_BOTH: tuple[Literal["off", "auto"], ...] = ("off", "auto")


def _points(body: Body, points: np.ndarray, folder: Path, rng: np.random.Generator) -> dict[str, Any]:
    path, noise = folder / "points.npz", POINT_NOISE * rng.normal(size=points.shape)
    np.savez(path, points=points + noise, names=np.array(body.landmark_names), fps=FPS)
    return {"points": path, "unit": "m"}


def _keypoints(body: Body, points: np.ndarray, kind: Kind, folder: Path, rng: np.random.Generator) -> dict[str, Any]:
    cameras, points = cameras_around()[: 1 if kind == "one" else 3], about_origin(points)
    write_cameras(folder / "cameras.json", cameras)
    for camera in cameras:
        pixels = np.array([camera.project(p) for p in points])
        pixels = pixels + PIXEL_NOISE * rng.normal(size=pixels.shape)
        track = KeypointTrack("landmarks", body.landmark_names, pixels, np.ones(pixels.shape[:2]), SIZE, FPS)
        write_keypoints(folder / f"{camera.name}.json", track)
    paths = [folder / f"{camera.name}.json" for camera in cameras]
    return {"keypoints": paths, "cameras": folder / "cameras.json"}


def cameras_around() -> tuple[Camera, ...]:
    """Three cameras around a person at the origin."""
    return tuple(resized_camera(camera, SIZE) for camera in cameras_for(HEIGHT))


def about_origin(points: np.ndarray) -> np.ndarray:
    """Points (T, L, 3) of a person moved to the origin, at the same height."""
    return points - np.append(points[..., :2].reshape(-1, 2).mean(axis=0), 0.0)


def _error(run: Run, scene: Scene) -> float:
    """Mean over frames and joints [degrees]."""
    joints = run.body.bounded_q
    return float(np.degrees(np.nanmean(np.abs(run.q[:, joints] - scene.q[run.index][:, joints]))))
