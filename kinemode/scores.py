"""Scores of several trackers' runs on one clip, frame by frame and over all of it, and how long each took."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from estimator.data.observation import Observation
from estimator.runs.evaluation import evaluate_points, far_px, trajectory_errors
from estimator.runs.pairs import paired
from estimator.runs.reference_motion import Reference
from estimator.runs.run_reader import Run
from estimator.search.mode_search import ModeSearch
from estimator.trackers.spec import mode_search
from estimator.tracking.registry import Settings
from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from kinemode.explain import reopened_cues, run_settings
from kinemode.progress import Progress, Reporter


@dataclass(frozen=True)
class TrackTime:
    """Wall-clock time of tracking one clip [s].

    frames, seconds: frames that were timed and what they took together, over all sessions; the first frame of a session
    is left out, because files, fit and start come before it. smoothing: what followed the last frame.
    """

    frames: int = 0
    seconds: float = 0.0
    smoothing: float = 0.0

    def rate(self, count: int) -> float:
        """Frames per second of tracking and smoothing `count` frames; NaN where too few were timed."""
        if self.frames == 0 or count == 0:
            return float("nan")
        return 1.0 / (self.seconds / self.frames + self.smoothing / count)


class TimeFile:
    """The times of several trackers in a JSON file, written again whenever a stage of one ends or is interrupted.

    Raises
    ------
    InputError: the file is there and does not hold times of trackers.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._times = _read(path) if path.exists() else {}
        self._live: set[str] = set()  # trackers with frames in this session

    def of(self, tracker: str) -> TrackTime:
        """The times of a tracker, all zero where it has not run."""
        return self._times.get(tracker, TrackTime())

    def clear(self, tracker: str) -> None:
        """Forget a tracker whose run starts again."""
        self._times.pop(tracker, None)

    def clocked(self, tracker: str, reporter: Reporter) -> Reporter:
        """A progress reporter that names the tracker, passes on to `reporter`, and keeps the times of its stages."""

        @contextmanager
        def reported(stage: str) -> Iterator[Progress]:
            marks: list[float] = []
            start = time.perf_counter()
            with reporter(f"{tracker}: {stage}") as progress:

                def marked(done: int, total: int) -> None:
                    marks.append(time.perf_counter())
                    progress(done, total)

                try:
                    yield marked
                finally:
                    self._add(tracker, stage, start, marks)

        return reported

    def _add(self, tracker: str, stage: str, start: float, marks: list[float]) -> None:
        known = self.of(tracker)
        if stage == "tracking" and marks:
            self._live.add(tracker)
        if stage == "smoothing" and (tracker in self._live or known.smoothing == 0.0):  # else a finished run's, again
            self._times[tracker] = replace(known, smoothing=time.perf_counter() - start)
        elif stage == "tracking" and len(marks) > 1:
            frames, seconds = known.frames + len(marks) - 1, known.seconds + marks[-1] - marks[0]
            self._times[tracker] = replace(known, frames=frames, seconds=seconds)
        with replacing(self.path) as temporary:
            temporary.write_text(json.dumps({name: asdict(t) for name, t in self._times.items()}, indent=1) + "\n")


def _read(path: Path) -> dict[str, TrackTime]:
    try:
        return {
            str(name): TrackTime(int(t["frames"]), float(t["seconds"]), float(t["smoothing"]))
            for name, t in json.loads(path.read_text(encoding="utf-8")).items()
        }
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(path, f"contains no times of trackers: {error}", remedy="remove it") from None


_NO_ERRORS = dict.fromkeys(("mpjpe", "pa_mpjpe", "best_of_k_mpjpe"), float("nan"))


@dataclass(frozen=True)
class Course:
    """One tracker along the clip: the best hypothesis of each of the T frames as it was tracked, without looking back.

    time (T,) [s]. energy (T,): of its pose alone, under the one cost by which all trackers are compared; NaN where
    nothing was observed. residual (T,): mean distance of its landmarks from the keypoints [px], NaN without keypoints.
    error (T,): mean error of the compared landmarks, aligned as by `estimator.runs.evaluation.shared_landmarks`
    [m]. world_error (T,): the same with nothing aligned [m], pixel_error (T,): their mean distance in the image, in the
    camera where it is largest [px]; NaN unless reference and cameras share one world.
    lost (T,) bool: see `estimator.runs.evaluation.TrajectoryErrors`. Without a reference, or where it knows
    nothing, all errors are NaN and no frame is lost. aligned: what is, in words. pixel_limit: pixel_error from which a
    frame is lost, in the smallest picture.
    """

    time: np.ndarray
    energy: np.ndarray
    residual: np.ndarray
    error: np.ndarray
    world_error: np.ndarray
    pixel_error: np.ndarray
    lost: np.ndarray
    aligned: str = ""
    pixel_limit: float = float("nan")

    @property
    def placed(self) -> bool:
        """Whether a pose can be lost in the world and in the image, not only once aligned."""
        return bool(np.isfinite(self.world_error).any())


@dataclass(frozen=True)
class TrackerScore:
    """One tracker over the whole clip; NaN where there is nothing.

    frames: of the clip. fps: frames per second of tracking and smoothing. hard, unobserved: frames of that status.
    energy, residual [px]: means of the `Course`. mpjpe, pa_mpjpe: of the best hypothesis of each frame as it was
    tracked. best_of_k: MPJPE of that of a frame's K hypotheses nearest to the reference. final_mpjpe: of the trajectory
    that the run ends with, the best path smoothed; the path alone where the tracker does not smooth. All errors in
    metres.
    first_lost: the first lost frame, None where none is. lost: how many are.
    """

    tracker: str
    frames: int
    fps: float
    hard: int
    unobserved: int
    energy: float
    residual: float
    mpjpe: float
    pa_mpjpe: float
    best_of_k: float
    final_mpjpe: float
    first_lost: int | None
    lost: int


def scored(name: str, run: Run, course: Course, time: TrackTime, reference: Reference | None) -> TrackerScore:
    """Sum a tracker up. Raises InputError where run and reference share too few joints."""
    final, tracked = _NO_ERRORS, _NO_ERRORS
    if reference is not None:
        names, modes = run.body.landmark_names, run.mode_landmarks
        final = evaluate_points(names, run.landmarks, modes, run.time, reference)
        tracked = evaluate_points(names, modes[:, 0], modes, run.time, reference)
    return TrackerScore(
        tracker=name,
        frames=len(run),
        fps=time.rate(len(run)),
        hard=int(np.sum(run.status == "hard")),
        unobserved=int(np.sum(run.status == "unobserved")),
        energy=_mean(course.energy),
        residual=_mean(course.residual),
        mpjpe=tracked["mpjpe"],
        pa_mpjpe=tracked["pa_mpjpe"],
        best_of_k=tracked["best_of_k_mpjpe"],
        final_mpjpe=final["mpjpe"],
        first_lost=int(run.index[course.lost.argmax()]) if course.lost.any() else None,
        lost=int(course.lost.sum()),
    )


def courses(
    runs: Mapping[str, Run], settings: Settings, reference: Reference | None, placed: bool, progress: Progress
) -> dict[str, Course]:
    """The course of every tracker; all have tracked one subject through the same frames.

    settings: whose cost is compared. placed: whether reference and cameras share one world, so that a pose can be lost
    in it and in the image; otherwise only with the hips aligned. progress: called after each frame.
    """
    energies = _energies(runs, settings, progress)
    return {name: _course(run, energies[name], reference, placed) for name, run in runs.items()}


def _course(run: Run, energy: np.ndarray, reference: Reference | None, placed: bool) -> Course:
    if reference is None:
        nothing, never = np.full(len(run), np.nan), np.zeros(len(run), dtype=bool)
        return Course(run.time, energy, _residual(run), nothing, nothing, nothing, never)
    pairs = paired(run.body.landmark_names, run.time, reference)
    points, truth = run.mode_landmarks[:, 0][:, pairs.shared.ours], pairs.truth_of_frames(len(run))
    errors = trajectory_errors(points, truth, pairs.shared.root, run.header.cameras if placed else None)
    limit = min(far_px(camera.image_size) for camera in run.header.cameras)
    return Course(
        run.time, energy, _residual(run), errors.aligned, errors.world, errors.pixels, errors.lost,
        pairs.shared.aligned, limit,
    )  # fmt: skip


def _residual(run: Run) -> np.ndarray:
    """Mean distance (T,) of the landmarks from the keypoints as they were detected [px]."""
    pixels, seen = run.pixels[run.index], run.confidence[run.index] > 0.0
    places = np.stack([camera.project(run.mode_landmarks[:, 0]) for camera in run.header.cameras], axis=1)
    distance = np.linalg.norm(places - pixels, axis=-1)
    counted = seen & np.isfinite(distance)
    total, count = np.where(counted, distance, 0.0).sum(axis=(1, 2)), counted.sum(axis=(1, 2))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _energies(runs: Mapping[str, Run], settings: Settings, progress: Progress) -> dict[str, np.ndarray]:
    """Energy (T,) of each run's best hypotheses, frame by frame and without a past: trackers that
    penalise change have no penalty of it here."""
    run = next(iter(runs.values()))
    search = mode_search(run.body, settings)
    energies = {name: np.full(len(run), np.nan) for name in runs}
    with reopened_cues(run, run_settings(run)) as reader:
        for t in range(len(run)):
            observation = run.observation(t)
            if reader is not None:
                observation = replace(observation, cues=reader.at(t))
            for name, tracked in runs.items():
                if observation.is_observed and np.isfinite(tracked.mode_q[t, 0]).all():
                    energies[name][t] = _energy(search, observation, tracked.mode_q[t, 0])
            progress(t + 1, len(run))
    return energies


def _energy(search: ModeSearch, observation: Observation, q: np.ndarray) -> float:
    """Energy of q (nq,) in the better association of a frame's keypoints: keypoints, edges, outlines and priors."""
    posed = search.body.at(q)
    assigned = search.likelihood(observation, q).assigned(posed)
    return min(
        search.model.cost(a.term, image_terms=assigned).of(posed).value + a.penalty
        for a in search.associations(observation)
    )


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")
