"""Clips of several people in four cameras, tracked from keypoints that are chosen in several ways."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.accuracy.crowd_files import write_alphapose
from benchmarks.support.tracking import timed_track
from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import load_keypoints, load_people, write_keypoints
from estimator.data.formats.keypoints_reading import Person
from estimator.data.media.clip import DEFAULT_FPS as FPS
from estimator.data.people.across_cameras import subject_tracks
from estimator.runs.evaluation import evaluate
from estimator.runs.reference_motion import Reference
from estimator.runs.run_reader import Run
from estimator.synthesis.detector import crowd, placed
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.motion_keys import PIVOT, REACH, TURN_REACH
from estimator.synthesis.settings import ViewSettings
from estimator.synthesis.views import framing_cameras
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject

NEAREST = 0.7  # the people keep that far from each other [m]
ROOM = 1.4  # half the side of the square they stand and walk in [m]
WAYS = ("the person alone", "each camera for itself", "across cameras")


@dataclass(frozen=True)
class Clip:
    """One clip: so many people and frames, seen by four cameras."""

    people: int
    frames: int
    seed: int
    work: Path


@dataclass(frozen=True)
class Outcome:
    """MPJPE [mm], frames marked hard and share of the frames in which cameras show different people, each way."""

    mpjpe: tuple[float, ...]
    hard: tuple[int, ...]
    mixed: tuple[float, ...]


def room_cameras(side: float, image_size: tuple[int, int] = (1920, 1080)) -> tuple[Camera, ...]:
    """Four cameras that see a room of half side `side` [m]."""
    corners = np.array([[x, y, z] for x in (-side, side) for y in (-side, side) for z in (0.0, 1.9)])
    return framing_cameras(corners[None], ViewSettings(image_size=image_size, count=4, elevation=12.0))


def written(people: Mapping[str, Sequence[Sequence[tuple[int, Person]]]], work: Path) -> dict[str, Path]:
    """Files of what each camera's detector saw."""
    return {
        name: write_alphapose(work / f"{name}.json", [[p for _, p in f] for f in frames])
        for name, frames in people.items()
    }


def outcome(task: Clip) -> Outcome:
    """Track one clip in all ways."""
    rng, body = np.random.default_rng((task.people, task.seed)), Body(load_subject("human34"))
    motions = scene(body, task, rng)
    cameras = room_cameras(ROOM + 0.3)
    people = crowd(body, motions, cameras, rng, noise_px=4.0)
    files, by_name = written(people, task.work), {c.name: c for c in cameras}
    write_cameras(task.work / "cameras.json", cameras)
    chosen, _ = subject_tracks({name: load_people(path) for name, path in files.items()}, by_name, {})
    who = most(owners(people, {n: t.pixels for n, t in chosen.items()}))
    lone = written(
        {n: [[x for x in f if x[0] == who] for f in frames] for n, frames in people.items()}, made(task.work / "lone")
    )
    each = {}
    for name, path in files.items():
        each[name] = task.work / f"each_{name}.json"
        write_keypoints(each[name], load_keypoints(path))
    runs = [
        timed_track(given, task.work / "cameras.json", task.work / f"{k}.run", fit="off", seed=task.seed)[0]
        for k, given in enumerate((lone, each, files))
    ]
    taken = [{n: load_keypoints(p).pixels for n, p in given.items()} for given in (lone, each)]
    taken.append({n: t.pixels for n, t in chosen.items()})
    return Outcome(
        tuple(min(error(run, body, q) for q in motions) for run in runs),
        tuple(int(np.sum(run.status == "hard")) for run in runs),
        tuple(mixed(owners(people, pixels)) for pixels in taken),
    )


def made(folder: Path) -> Path:
    """The folder, made."""
    folder.mkdir()
    return folder


def motions_of(body: Body, clip: Clip) -> list[np.ndarray]:
    """The motions of the people (T, nq), each in place."""
    times = np.arange(clip.frames) / FPS
    return [authored_motion(body, times, m) for m in (REACH, PIVOT, TURN_REACH)]


def scene(body: Body, task: Clip, rng: np.random.Generator) -> list[np.ndarray]:
    """People who walk about and keep their distance."""
    share = np.linspace(0.0, 1.0, task.frames)[:, None]
    while True:
        ends = rng.uniform(-ROOM, ROOM, (task.people, 2, 1, 2))
        paths = [(1.0 - share) * a + share * b for a, b in ends]
        gaps = [np.linalg.norm(a - b, axis=1).min() for k, a in enumerate(paths) for b in paths[:k]]
        if min(gaps, default=NEAREST) >= NEAREST:
            break
    motions = motions_of(body, task)
    return [placed(motions[k % 3], path, rng.uniform(0.0, 2.0 * np.pi)) for k, path in enumerate(paths)]


def owners(
    people: Mapping[str, Sequence[Sequence[tuple[int, Person]]]], pixels: Mapping[str, np.ndarray]
) -> np.ndarray:
    """The person whose keypoints each camera shows in each frame (C, T), -1 for none."""
    whose = np.full((len(people), len(next(iter(people.values())))), -1)
    for c, (name, frames) in enumerate(people.items()):
        for t, frame in enumerate(frames[: len(pixels[name])]):
            for number, person in frame:
                if np.array_equal(person.points[:, :2], pixels[name][t], equal_nan=True):
                    whose[c, t] = number
    return whose


def most(whose: np.ndarray) -> int:
    """Who is there most often."""
    return int(np.bincount(whose[whose >= 0]).argmax())


def mixed(whose: np.ndarray) -> float:
    """Share of the frames in which cameras show different people."""
    return float(np.mean([len(set(column[column >= 0].tolist())) > 1 for column in whose.T]))


def error(run: Run, body: Body, q: np.ndarray) -> float:
    """MPJPE [mm] of a run as if q (T, nq) were the truth."""
    points = np.array([body.landmarks(body.at(pose)) for pose in q])
    return 1e3 * evaluate(run, Reference(body.landmark_names, points, np.arange(len(q)) / FPS)).mpjpe
