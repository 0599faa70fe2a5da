"""`--person all`: people who cross each other's way in front of four cameras. Is no one swapped, and is each tracked as
well as alone? Detections are simulated, in any order and without ids; no person is detected where another hides most of
them. Each person is also tracked from the same detections without the others: the errors' ratio is the measure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

import kinemode as km
from benchmarks.accuracy.crowd_clips import Clip, error, made, motions_of, owners, room_cameras, written
from benchmarks.support.common import Json, Several, in_processes, save, work_folder
from benchmarks.support.tracking import timed_track
from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import load_people
from estimator.data.formats.keypoints_reading import Person
from estimator.data.people.everybody import everybody
from estimator.synthesis.detector import crowd, placed
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

NOISE = 4.0  # px
REACHED = 1.4  # half of the way that each goes [m]
ASIDE = (0.2, 0.5)  # how far from the middle each way leads [m]
NEAREST = 0.5  # between the middles of two people: they do not walk through each other [m]
HIDDEN = 0.4  # of a person's box covered by one who is nearer: not detected
LIMIT = 1.1

Detections = Mapping[str, Sequence[Sequence[tuple[int, Person]]]]


@dataclass(frozen=True)
class Task(Clip):
    """One clip. track: whether its people are tracked too, or only put together."""

    track: bool


@dataclass(frozen=True)
class Outcome:
    """Of one clip: the numbers of people present and found; the share of their detections that were assigned to them,
    and how many belonged to others; MPJPE of each among the others and alone [mm], empty where not tracked."""

    people: int
    out: int
    taken: float
    swapped: int
    among: tuple[float, ...]
    alone: tuple[float, ...]


def crossing(body: Body, clip: Clip, rng: np.random.Generator) -> list[np.ndarray]:
    """People (N) whose ways lead through the middle of the room at the same time, and pass each other near it."""
    motions, way = motions_of(body, clip), np.linspace(-REACHED, REACHED, clip.frames)[:, None]
    while True:
        # two meet head on, or nearly: they are beside each other for longest
        angles = np.arange(clip.people) * 2.0 * np.pi / clip.people + rng.uniform(-0.4, 0.4, clip.people)
        angles += rng.uniform(0.0, 2.0 * np.pi)
        along = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1) * rng.uniform(*ASIDE, (clip.people, 1))
        paths = way * along[:, None] + across[:, None]
        gaps = [np.linalg.norm(a - b, axis=1).min() for k, a in enumerate(paths) for b in paths[:k]]
        if min(gaps, default=NEAREST) >= NEAREST:
            break
    turns = angles + rng.uniform(-0.5, 0.5, clip.people)
    return [
        placed(motions[(k + clip.seed) % 3], p, float(a)) for k, (p, a) in enumerate(zip(paths, turns, strict=True))
    ]


def unhidden(people: Detections, motions: Sequence[np.ndarray], cameras: Sequence[Camera]) -> Detections:
    """Without the detections of those who are hidden, for the most part, by a person nearer to the camera."""
    visible: dict[str, list[list[tuple[int, Person]]]] = {}
    for camera in cameras:
        frames = []
        for t, frame in enumerate(people[camera.name]):
            boxes = {n: _box(person) for n, person in frame}
            depth = {n: float(camera.R_camera_world[2] @ motions[n][t, :3] + camera.t_camera_world[2]) for n in boxes}
            frames.append([
                (n, person)
                for n, person in frame
                if not any(depth[m] < depth[n] and _covered(boxes[n], boxes[m]) > HIDDEN for m in boxes)
            ])  # fmt: skip
        visible[camera.name] = frames
    return visible


def _box(person: Person) -> np.ndarray:
    xy = person.points[:, :2]
    return np.concatenate([np.nanmin(xy, axis=0), np.nanmax(xy, axis=0)])


def _covered(box: np.ndarray, by: np.ndarray) -> float:
    """Share of a box that another covers."""
    sides = np.minimum(box[2:], by[2:]) - np.maximum(box[:2], by[:2])
    return float(np.prod(np.maximum(sides, 0.0)) / max(np.prod(box[2:] - box[:2]), 1e-9))


def outcome(task: Task) -> Outcome:
    """Put the people of one clip together, and track them among each other and alone."""
    rng, body = np.random.default_rng((task.people, task.seed, 13)), Body(load_subject("human34"))
    motions, cameras = crossing(body, task, rng), room_cameras(REACHED + 0.6)
    people = unhidden(crowd(body, motions, cameras, rng, noise_px=NOISE), motions, cameras)
    files, by_name = written(people, task.work), {c.name: c for c in cameras}
    write_cameras(task.work / "cameras.json", cameras)
    tracks_of_people, _ = everybody({name: load_people(path) for name, path in files.items()}, by_name)
    whose = [owners(people, {name: track.pixels for name, track in tracks.items()}) for tracks in tracks_of_people]
    who = [int(np.bincount(of[of >= 0], minlength=task.people).argmax()) for of in whose]
    there = sum(len(frame) for frames in people.values() for frame in frames)
    right = sum(int((of == n).sum()) for of, n in zip(whose, who, strict=True))
    swapped = sum(int(((of >= 0) & (of != n)).sum()) for of, n in zip(whose, who, strict=True))
    among: list[float] = []
    alone: list[float] = []
    if task.track:
        among, alone = _tracked(task, body, motions, people, files, who)
    return Outcome(task.people, len(tracks_of_people), right / there, swapped, tuple(among), tuple(alone))


def _tracked(
    task: Task,
    body: Body,
    motions: Sequence[np.ndarray],
    people: Detections,
    files: Mapping[str, Path],
    who: Sequence[int],
) -> tuple[list[float], list[float]]:
    """MPJPE [mm] of each person among the others, and alone, in the order of `who`."""
    cameras = task.work / "cameras.json"
    runs = km.track(
        "human34", None, keypoints=files, cameras=cameras, person="all", seed=task.seed, out=task.work / "all.run"
    )
    assert isinstance(runs, dict)
    among = [error(run, body, motions[n]) for run, n in zip(runs.values(), who, strict=True)]
    alone = []
    for n in who:
        own = {name: [[x for x in f if x[0] == n] for f in frames] for name, frames in people.items()}
        lone = written(own, made(task.work / f"lone{n}"))
        run, _ = timed_track(lone, cameras, task.work / f"lone{n}.run", seed=task.seed)
        alone.append(error(run, body, motions[n]))
    return among, alone


def main(
    *,
    people: Annotated[tuple[int, ...], Several] = (2, 3),
    frames: int = 60,
    seeds: int = 5,
    tracked: int = 3,
    jobs: int = 1,
    json: Json = None,
) -> None:
    """Print which people were confused, and the errors among others and alone.

    Parameters
    ----------
    people: how many the clips have. frames: of a clip. seeds: clips of each kind. tracked: as many of these are tracked
    too. jobs: processes.
    """
    with work_folder(None) as work:
        tasks = [
            Task(n, frames, seed, made(work / f"{n}_{seed}"), seed < tracked) for n in people for seed in range(seeds)
        ]
        outcomes = in_processes(outcome, tasks, jobs)
    table = report.table(
        f"four cameras, {seeds} clips of {frames} frames, {tracked} of them tracked", "people",
        "clips with as many out", "detections taken", "swapped", "MPJPE among others [mm]", "alone [mm]",
        f"largest ratio, target {LIMIT:g}",
    )  # fmt: skip
    for n in people:
        of = [o for task, o in zip(tasks, outcomes, strict=True) if task.people == n]
        among, alone = ([e for o in of for e in getattr(o, which)] for which in ("among", "alone"))
        ratio = max((a / b for a, b in zip(among, alone, strict=True)), default=float("nan"))
        table.add_row(
            str(n), f"{sum(o.out == n for o in of)} of {len(of)}", f"{np.mean([o.taken for o in of]):.1%}",
            str(sum(o.swapped for o in of)), *(f"{np.mean(e):.1f}" if e else "-" for e in (among, alone)),
            f"{ratio:.3f}",
        )  # fmt: skip
    report.console().print(table)
    save(json, {"clips": [asdict(o) for o in outcomes]})
