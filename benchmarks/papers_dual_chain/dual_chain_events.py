"""Whether the dual-chain tracker keeps hands apart when blobs do not: hands cross, one comes before the face, a blob is
not found, hands meet and the chain of points has them exchanged.

    python -m benchmarks dual_chain_events [--seeds 0 1 ... 19] [--jobs 2] [--work FOLDER] [--json FILE]

Every seed draws another motion, other clothes, boards and noise. All ways see the same and begin alike. The truth is
used to take a blob away and to measure, by no tracker. In the last event the hands of the chain of points are exchanged
in the first frame in which they are apart again, as a wrong association would; a tracker without that chain has nothing
to exchange.
"""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

import numpy as np

from benchmarks.papers_dual_chain.dual_chain_event_clips import (
    EVENTS,
    LOST,
    SWAPPED,
    TOUCH,
    EventClip,
    event_frames,
    hands_of,
)
from benchmarks.papers_dual_chain.dual_chain_runs import Film, tracker_of
from benchmarks.support import standard_errors
from benchmarks.support.common import Json, Several, Work, check_known, in_processes, save, work_folder
from benchmarks.support.result_store import Figures, ResultStore, all_done
from estimator.data.observation import Observation
from estimator.inference.chains.evidence import Detections
from estimator.trackers.dual_chain.faces import IN_BOX, Faces
from estimator.trackers.dual_chain.seen_features import SeenFeatures, all_of, fused, of_faces
from estimator.trackers.dual_chain.skin import SkinModel
from estimator.trackers.dual_chain.tracker import DualState
from kinemode.terminal import report

FULL, ALONE, ONE_WAY, PRINTED = "dual-chain", "no chain of points", "one-way", "printed"
ANEW = "shared detections anew in every frame"
FACES, FACES_APART = "with detected faces", "with detected faces, apart from blobs"
WAYS: dict[str, dict[str, Any]] = {
    FULL: {},
    ALONE: {"chain": False},
    ONE_WAY: {"exchange": "one-way"},
    PRINTED: {"exchange": "printed"},
    ANEW: {"evidence": {"inside": 0.0}},
    FACES: {},
    FACES_APART: {},
}
FIRST = 3  # frame from which the time before an event is counted
LATER = 5  # frames after an event
LEFT, RIGHT = 1, 2  # of the features
_TAKEN = 0.12  # [m] about a hand, of blobs that are taken away
_FACE = 0.09  # [m] radius of a face


@dataclass(frozen=True)
class EventRun:
    """One way through an event. settings: of the group `dual_chain`, as JSON."""

    clip: EventClip
    label: str
    settings: str = "{}"

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"{self.clip.event.replace(' ', '_')}_{self.clip.seed}_{self.label.replace(' ', '_')}"

    @property
    def what(self) -> Mapping[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return asdict(self)

    def work(self, store: ResultStore) -> Figures:
        """By frame: error [mm] of the arm joints, expected over the posterior; on, whether the event is; right, whether
        each hand is nearer to where it is than to the other and to the head; levels (2), credible levels of the places
        of both hands in the image, and levels_world, in the world."""
        film = Film(self.clip.files(store.folder))
        on = event_frames(self.clip.event, film.q)
        tracker = tracker_of(film, json_module.loads(self.settings))
        if self.clip.event == LOST:
            tracker.seen = _Missing(tracker.seen, film, self.clip.seed % 2 + LEFT)
        if self.label in (FACES, FACES_APART):
            tracker.seen = _WithFaces(tracker.seen, film, self.clip.seed, self.label == FACES)
        true, hands, rows = film.arms(film.q), hands_of(film.q), []
        state: DualState | None = None
        for seen, _ in film.observations(len(film.q)):
            rng = np.random.default_rng([self.clip.seed, seen.index])
            if self.clip.event == SWAPPED and seen.index == parted(film.q, on) and state is not None:
                state = exchanged(state)
            state = (tracker.init(rng, seen) if state is None else tracker.step(rng, state, seen))[0]
            row = frame_figures(state, hands[seen.index], seen, np.random.default_rng([self.clip.seed, seen.index, 1]))
            off = np.linalg.norm(film.arms(state.q) - true[seen.index], axis=2).mean()
            rows.append({**row, "error": float(off), "on": bool(on[seen.index])})
        return {name: [row[name] for row in rows] for name in rows[0]}


@dataclass(frozen=True)
class _Missing:
    """The observations without the blob of a hand in the frames of `GONE`."""

    inner: SeenFeatures
    film: Film
    hand: int

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def detected(self, observation: Observation, skin: SkinModel | None) -> Detections:
        """See `SeenFeatures`."""
        seen = self.inner.detected(observation, skin)
        if not event_frames(LOST, self.film.q)[observation.index]:
            return seen
        place = hands_of(self.film.q[observation.index][None])[0, self.hand]
        beside = np.array([place, place + np.array([0.0, 0.0, _TAKEN])])
        middle, edge = observation.cameras[0].project(beside)
        outside = np.linalg.norm(seen.mean - middle, axis=1) > np.linalg.norm(edge - middle)
        return seen.of(outside)


@dataclass(frozen=True)
class _WithFaces:
    """The observations with the faces of a detector, which is made up: OpenCV's needs a model file.

    It is within a tenth of the face of where the face is, misses a face with a hand before it and one in ten others,
    and finds one in every twentieth frame where none is. joint: a face and the blob that it is in are one detection.
    """

    inner: SeenFeatures
    film: Film
    seed: int
    joint: bool

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def detected(self, observation: Observation, skin: SkinModel | None) -> Detections:
        """See `SeenFeatures`."""
        names, blobs = self.inner.features.names, self.inner.detected(observation, skin)
        faces = of_faces(names, self._faces(observation))
        return fused(blobs, faces) if self.joint else all_of([blobs, faces])

    def _faces(self, observation: Observation) -> Faces:
        rng = np.random.default_rng([self.seed, observation.index, 4])
        places = hands_of(self.film.q[observation.index][None])[0]
        middle, edge = observation.cameras[0].project(places[:1] + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, _FACE]]))
        radius, centres = float(np.linalg.norm(edge - middle)), []
        hand = np.linalg.norm((places[1:] - places[0])[:, 1:], axis=1).min()
        if hand > TOUCH and rng.random() > 0.1:
            centres.append(middle + 0.1 * radius * rng.normal(size=2))
        if rng.random() < 0.05:
            centres.append(rng.uniform(0.0, observation.cameras[0].image_size))
        spread = np.square(IN_BOX * 2.0 * radius) * np.eye(2)
        return Faces(
            np.array(centres).reshape(-1, 2), np.tile(spread, (len(centres), 1, 1)), np.full(len(centres), 0.9)
        )


def parted(q: np.ndarray, on: np.ndarray) -> int:
    """The first frame after the hands of q (T, nq) last touched; on (T,): the event."""
    hands = hands_of(q)
    near = np.linalg.norm((hands[:, LEFT] - hands[:, RIGHT])[:, 1:], axis=1) < TOUCH
    return int(np.flatnonzero(near & on).max()) + 1


def exchanged(state: DualState) -> DualState:
    """The state with the hands of the chain of points exchanged."""
    order = [0, RIGHT, LEFT]
    entries = np.concatenate([4 * k + np.arange(4) for k in order])
    points = replace(
        state.points, mean=state.points.mean[order], covariance=state.points.covariance[np.ix_(entries, entries)]
    )
    return replace(state, points=points)


def frame_figures(state: DualState, true: np.ndarray, seen: Observation, rng: np.random.Generator) -> dict[str, Any]:
    """The figures of one frame, see `EventRun.work`; true (3, 3) [m]: head and hands."""
    camera, places = seen.cameras[0], hands_of(state.q)
    pixels, true_pixels = camera.project(places), camera.project(true)
    middle = pixels.mean(axis=0)
    apart = np.linalg.norm(middle[:, None] - true_pixels, axis=2)
    right = [int(apart[k].argmin()) == k for k in (LEFT, RIGHT)]
    levels = [level(pixels[:, k], true_pixels[k], rng) for k in (LEFT, RIGHT)]
    in_world = [level(places[:, k], true[k], rng) for k in (LEFT, RIGHT)]
    return {"right": all(right), "levels": levels, "levels_world": in_world}


def level(samples: np.ndarray, point: np.ndarray, rng: np.random.Generator) -> float:
    """Probability of the smallest region that contains a point (d,), of a density given by equal samples (N, d) through
    kernels as wide as Silverman's rule has it (B. Silverman, Density Estimation, 1986, section 4.3)."""
    count, dimension = samples.shape
    width = (4.0 / (count * (dimension + 2.0))) ** (1.0 / (dimension + 4.0))
    covariance = np.cov(samples.T) + 1e-9 * np.eye(dimension) * max(1.0, float(np.var(samples)))
    factor = np.linalg.cholesky(width**2 * covariance)
    drawn = samples[rng.integers(count, size=300)] + rng.normal(size=(300, dimension)) @ factor.T
    white = np.linalg.solve(factor, samples.T).T
    at = np.linalg.solve(factor, np.vstack([point, drawn]).T).T
    density = np.exp(-0.5 * ((at[:, None] - white[None]) ** 2).sum(axis=2)).mean(axis=1)
    return float(np.mean(density[1:] > density[0]))


def main(
    *,
    seeds: Annotated[tuple[int, ...], Several] = tuple(range(20)),
    events: Annotated[tuple[str, ...], Several] = EVENTS,
    ways: Annotated[tuple[str, ...], Several] = tuple(WAYS),
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Render, track, compare.

    Parameters
    ----------
    seeds
        Of the clips and of the trackers.
    events
        What happens.
    ways
        What is compared.
    jobs
        So many runs at a time.
    """
    check_known("--events", events, EVENTS)
    check_known("--ways", ways, WAYS)
    with work_folder(work) as folder:
        store = ResultStore(folder)
        clips = [EventClip(event, seed) for seed in seeds for event in events]
        in_processes(_render, [(clip, folder) for clip in clips], jobs)
        runs = [EventRun(clip, way, json_module.dumps(WAYS[way], sort_keys=True)) for clip in clips for way in ways]
        results = all_done("events", store, runs, jobs)
    save(json, {"measure": "dual_chain_events", "seeds": seeds, "rows": show(runs, results, events, ways)})


def _render(task: tuple[EventClip, Any]) -> None:
    clip, folder = task
    clip.files(folder)


def figures(result: Figures) -> dict[str, float]:
    """The figures of one run: error before and in the event, shares of truths within the 90 % regions in it, whether
    the hands are right some frames after it."""
    on, error = np.array(result["on"]), np.array(result["error"])
    frames = np.flatnonzero(on)
    after = min(frames[-1] + LATER, len(on) - 1)
    return {
        "before": float(error[FIRST : frames[0]].mean()),
        "during": float(error[on].mean()),
        "after": float(error[frames[-1] + 1 : after + 1].mean()),
        "right": float(result["right"][after]),
        "covers": float(np.mean(np.array(result["levels"])[on] <= 0.9)),
        "covers_world": float(np.mean(np.array(result["levels_world"])[on] <= 0.9)),
    }


def show(
    runs: Sequence[EventRun], results: Sequence[Figures], events: Sequence[str], ways: Sequence[str]
) -> list[dict[str, Any]]:
    """A row an event and way; deviations are over seeds. Standard errors: of the ratio of the means in the event and
    before, and of the difference in the event to the first way on the same clips."""
    table = report.table(
        "hands in trouble: arm joints in the world [mm], expected; ±: standard deviation over seeds, of ratios and"
        " differences standard errors", "event", "way", "before", "in the event", "5 frames after", "ratio",
        "in the event, less first way", f"right hands {LATER} frames after",
        "90 % regions: in the image", "in the world",
    )  # fmt: skip
    rows = []
    for event in events:
        first = np.array([])
        for way in ways:
            pairs = zip(runs, results, strict=True)
            each = [figures(r) for run, r in pairs if run.clip.event == event and run.label == way]
            before, during = (np.array([f[name] for f in each]) for name in ("before", "during"))
            first = during if way == ways[0] else first
            row: dict[str, Any] = {"event": event, "way": way}
            row |= {name: float(np.mean([f[name] for f in each])) for name in each[0]}
            row |= {f"{name}_std": float(np.std([f[name] for f in each])) for name in ("before", "during", "after")}
            row |= {"ratio": row["during"] / row["before"], "ratio_error": standard_errors.of_ratio(during, before)}
            row |= {"less": float((during - first).mean()), "less_error": standard_errors.of_mean(during - first)}
            rows.append(row)
            table.add_row(
                event if way == ways[0] else "", way,
                *(f"{row[name]:.1f} ± {row[name + '_std']:.1f}" for name in ("before", "during", "after")),
                f"{row['ratio']:.2f} ± {row['ratio_error']:.2f}",
                "" if way == ways[0] else f"{row['less']:+.1f} ± {row['less_error']:.1f}",
                f"{row['right']:.0%}", f"{row['covers']:.0%}", f"{row['covers_world']:.0%}",
            )  # fmt: skip
    report.console().print(table)
    return rows
