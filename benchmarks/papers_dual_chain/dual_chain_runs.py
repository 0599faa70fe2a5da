"""One run of a dual-chain tracker on a clip of an upper body, kept when it is done."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import kinemode as km
from benchmarks.support.result_store import Figures, ResultStore, cached_clip
from estimator.data.formats.cameras import load_cameras
from estimator.data.formats.keypoints import load_keypoints
from estimator.data.observation import Observation
from estimator.inference.annealing import systematic
from estimator.trackers.dual_chain.tracker import DualChain, DualState
from estimator.tracking.registry import make_tracker, settings_for
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.shot import RenderedClip

FPS = 25.0
ARMS = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow", "wrist"))
DRAWN = 40  # poses of the posterior, as in the paper's figures
APART = 10.0  # mm, of arm joints: poses that differ to the eye
_TRACKER = "dual-chain"
_CUES = ("edges", "silhouette")


@dataclass(frozen=True)
class UpperClip:
    """A rendered clip of upper13 in long sleeves before a parallel camera, boards in the colour of skin on the wall."""

    motion: str
    seed: int
    boards: int = 5

    def files(self, folder: Path) -> RenderedClip:
        """Rendered into a folder unless it is there."""
        scene = km.SceneSettings(sleeves="long", boards=self.boards)
        view = km.ViewSettings(parallel=True)
        return cached_clip(
            folder / "clips" / f"{self.motion}_{self.seed}_{self.boards}",
            lambda to: km.render(to, self.motion, fps=FPS, seed=self.seed, scene=scene, view=view),
        )


@dataclass(frozen=True)
class Film:
    """A clip as a tracker sees it: keypoints in its first frame and none after it."""

    files: RenderedClip
    body: Body = field(default_factory=lambda: Body(load_subject("upper13")))

    @property
    def q(self) -> np.ndarray:
        """The true poses (T, nq)."""
        return np.asarray(np.load(self.files.truth, allow_pickle=False)["q"])

    def observations(self, frames: int) -> Iterator[tuple[Observation, float]]:
        """Observations of the first frames, with the processor time [s] that reading took."""
        ((name, video),) = self.files.videos.items()
        camera = load_cameras(self.files.cameras)[name]
        track = load_keypoints(self.files.first_frame[name])
        first = np.array([track.pixels[0][track.names.index(mark)] for mark in self.body.landmark_names])
        plates = [self.files.plates[name]]
        with closing(CueReader([video], [camera], cue_settings(_CUES), plates=plates)) as reader:
            for i in range(frames):
                began = time.process_time()
                cues = reader.at(i)
                pixels = first if i == 0 else np.full_like(first, np.nan)
                confidence = np.isfinite(pixels).all(axis=1).astype(float)
                seen = Observation(i, i / FPS, (camera,), pixels[None], confidence[None], (), True, cues)
                yield seen, time.process_time() - began

    def arms(self, q: np.ndarray) -> np.ndarray:
        """Arm joints (N, 6, 3) [mm] in the world, of poses (N, nq)."""
        index = [self.body.landmark_names.index(name) for name in ARMS]
        return 1e3 * self.body.landmarks_of(self.body.placed(q))[:, index]


def tracker_of(film: Film, changes: Mapping[str, Any]) -> DualChain:
    """The tracker with changes to its own settings."""
    settings = settings_for(_TRACKER, changes={"dual_chain": changes})
    tracker = make_tracker(_TRACKER, film.body, replace(settings, cues=cue_settings(_CUES)))
    assert isinstance(tracker, DualChain)
    return tracker


@dataclass(frozen=True)
class ChainRun:
    """A tracker through the first frames of a clip. settings: of the group `dual_chain`, as JSON."""

    clip: UpperClip
    frames: int
    seed: int
    label: str
    settings: str = "{}"

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"{self.clip.motion}_{self.clip.seed}_{self.label.replace(' ', '_')}_{self.seed}"

    @property
    def what(self) -> Mapping[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return asdict(self)

    def work(self, store: ResultStore) -> Figures:
        """The figures of every frame but the first: see `frame_figures`, and `seconds` of processor time, with reading
        the picture."""
        film = Film(self.clip.files(store.folder))
        true, rows = film.arms(film.q), []
        for state, result, seconds in tracked(film, json.loads(self.settings), self.frames, self.seed):
            if result.index > 0:
                rows.append({**frame_figures(film, state, result, true[result.index], self.seed), "seconds": seconds})
        return {name: [row[name] for row in rows] for name in rows[0]}


def tracked(
    film: Film, changes: Mapping[str, Any], frames: int, seed: int
) -> Iterator[tuple[DualState, km.FrameResult, float]]:
    """States and results of the first frames, with the processor time [s] of each."""
    tracker, state = tracker_of(film, changes), None
    for seen, reading in film.observations(frames):
        began, rng = time.process_time(), np.random.default_rng([seed, seen.index])
        state, result = tracker.init(rng, seen) if state is None else tracker.step(rng, state, seen)
        yield state, result, reading + time.process_time() - began


def frame_figures(
    film: Film, state: DualState, result: km.FrameResult, true: np.ndarray, seed: int
) -> dict[str, float]:
    """Figures of one frame, true (6, 3) [mm].

    expected, of_mean [mm]: mean distance of the arm joints, expected over the poses, and of the joints' mean places.
    samples: poses that could be. distinct: how many of 40 poses drawn evenly differ at all; apart: how many of them
    are farther than 10 mm from each other, one after the other.
    """
    arms = film.arms(state.q)
    rng = np.random.default_rng([seed, result.index, 1])
    drawn = systematic(rng, np.full(len(arms), 1.0 / len(arms)), DRAWN)
    return {
        "expected": float(np.linalg.norm(arms - true, axis=2).mean()),
        "of_mean": float(np.linalg.norm(arms.mean(axis=0) - true, axis=1).mean()),
        "samples": float(result.extra["samples"]),
        "distinct": float(len(np.unique(np.round(state.q[drawn], 9), axis=0))),
        "apart": float(apart_count(arms[drawn], APART)),
    }


def apart_count(places: np.ndarray, distance: float) -> int:
    """The number of places (N, J, 3) that remain if each in turn is left out that is, on average over J, within a
    distance of one kept before it."""
    distinct: list[np.ndarray] = []
    for place in places:
        if all(np.linalg.norm(place - other, axis=1).mean() > distance for other in distinct):
            distinct.append(place)
    return len(distinct)
