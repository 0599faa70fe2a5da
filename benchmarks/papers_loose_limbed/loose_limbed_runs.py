"""One run of a tracker on a clip of the loose-limbed measures, kept when it is done."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np

from benchmarks.papers_loose_limbed.loose_limbed_clips import LimbClip, Markers
from benchmarks.papers_loose_limbed.loose_limbed_rival import AnnealedOnLimbs
from benchmarks.support.result_store import Figures, ResultStore
from estimator.data.observation import Observation
from estimator.inference.annealing import normalised
from estimator.inference.beliefs.graph import Belief
from estimator.inference.beliefs.mixture import mixture_of
from estimator.inference.beliefs.space import PLACEMENTS, placements_of, points_of
from estimator.inference.mixture import Mode, mixture_of as mixture_of_modes
from estimator.numerics.newton import CONVERGED
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.loose_limbed.limbs.likelihood import LimbLikelihood
from estimator.trackers.loose_limbed.limbs.window import LimbLogRatio, limb_views, shows_person
from estimator.trackers.loose_limbed.state import LimbState
from estimator.trackers.loose_limbed.tracker import LooseLimbed
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.runner import FrameByFrame
from humanoid.limbs.limb import limb_placements

LOOSE = "loose-limbed"
_SURE = 0.005, 0.02  # m, rad: how well the first pose is known
_NEVER = -1e6  # log likelihood of the impossible


@dataclass(frozen=True)
class LimbRun:
    """A tracker through frames begin to end of a clip.

    start: "pose", the true one of the frame before, or "nothing". blank: frames without the person in the pictures.
    detected: with keypoints. settings: of the group `loose_limbed`. noise: file of `learned_noise` for the annealed
    filter, "" for the loose-limbed tracker; particles: of it. templates: file of part detectors, "" without.
    """

    motion: str
    begin: int
    end: int
    seed: int
    label: str
    start: str = "pose"
    clip_seed: int = 7
    low_contrast: bool = False
    cameras: int = 4
    blank: tuple[int, ...] = ()
    detected: bool = False
    settings: str = "{}"
    noise: str = ""
    particles: int = 0
    templates: str = ""

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"{Path(self.motion).stem}_{self.label.replace(' ', '_')}_{self.seed}"

    @property
    def what(self) -> Mapping[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return {**asdict(self), "motion": Path(self.motion).name, "noise": bool(self.noise),
                "templates": bool(self.templates)}  # fmt: skip

    def work(self, store: ResultStore) -> Figures:
        """Errors of every frame [mm]: `beliefs`, expected over the samples; `likely`, the same weighed by each sample's
        normalised likelihood, as the paper does; `assembled`, of the best pose, and `expected`, over the hypotheses or
        particles; seconds of processor time; `sides`: whether left is left."""
        return _annealed(self) if self.noise else _loose(self)


@lru_cache(maxsize=2)  # a room takes 180 MB
def clip_of(motion: str, seed: int, end: int, low_contrast: bool, cameras: int) -> LimbClip:
    """A clip, its scene made once in a process."""
    return LimbClip(Path(motion), seed, 0, end, low_contrast, cameras)


def _clip(run: LimbRun) -> LimbClip:
    return clip_of(run.motion, run.clip_seed, run.end + 2, run.low_contrast, run.cameras)


def _loose(run: LimbRun) -> Figures:
    clip = _clip(run)
    changes = json.loads(run.settings)
    if run.templates:
        changes["part_detectors"] = {**changes.get("part_detectors", {}), "templates": run.templates}
    settings = settings_for(LOOSE, changes={"loose_limbed": changes})
    tracker = cast(LooseLimbed, make_tracker(LOOSE, clip.body, settings))
    state = true_state(clip, run.begin - 1, settings.own.propagation.samples) if run.start == "pose" else None
    frames = FrameByFrame(tracker, run.seed, state=state)
    rows: dict[str, list[Any]] = {}
    shown: dict[int, Observation] = {}
    for frame in range(run.begin, run.end + 2):  # the last is only used as a frame ahead
        shown[frame] = _observation(run, clip, frame)
        began = time.process_time()
        result = frames.push(shown[frame])
        if result is not None:
            spent = time.process_time() - began
            _append_row(rows, clip, result, spent, tracker.instants.log_ratio(shown.pop(result.index)))
    return rows


def _observation(run: LimbRun, clip: LimbClip, frame: int) -> Observation:
    return clip.observation(frame, blank=frame in run.blank, detected=run.detected)


def _append_row(
    rows: dict[str, list[Any]], clip: LimbClip, result: FrameResult, seconds: float, log_ratio: LimbLogRatio | None
) -> None:
    markers, graph, body = Markers.of(clip.graph), clip.graph, clip.body
    true = markers.of_poses(graph, body, clip.q[result.index])
    row: dict[str, Any] = {"frame": result.index, "status": result.status, "seconds": seconds}
    if "limb_points" in result.extra:
        points, weights = result.extra["limb_points"], result.extra["limb_weights"]
        placed = [placements_of(p) for p in points]
        t, R = (np.stack([p[k] for p in placed], axis=1) for k in (0, 1))
        row["beliefs"] = markers.expected_error(true, t, R, weights.T)
        if log_ratio is not None:
            seen = [normalised(np.maximum(log_ratio(k, t[:, k], R[:, k]), _NEVER))[0] for k in range(len(points))]
            row["likely"] = markers.expected_error(true, t, R, np.stack(seen, axis=1))
    if len(result.q):
        away = np.linalg.norm(markers.of_poses(graph, body, result.q) - true, axis=2).mean(axis=1)
        exchanged = markers.places(*(a[list(graph.mirror)] for a in limb_placements(graph, body, clip.q[result.index])))
        other = np.linalg.norm(markers.of_poses(graph, body, result.q[0]) - exchanged, axis=1).mean()
        row |= {
            "assembled": float(1e3 * away[0]),
            "expected": float(1e3 * result.weight @ away),
            "nearest": float(1e3 * away.min()),
            "sides": bool(away[0] <= other),
            "penetration": float(result.penetration[0]),
            "beyond": float(_beyond_limits(clip, result.q)),
        }
    for key in ("frame", "status", "seconds", "beliefs", "likely", "assembled", "expected", "nearest", "sides",
                "penetration", "beyond"):  # fmt: skip
        rows.setdefault(key, []).append(row.get(key))


def _beyond_limits(clip: LimbClip, q: np.ndarray) -> float:
    """The largest excess of hypotheses (K, nq) over joint limits [rad]."""
    index = clip.body.bounded_q
    return float(np.maximum(clip.body.lower[index] - q[:, index], q[:, index] - clip.body.upper[index]).max())


def _annealed(run: LimbRun) -> Figures:
    clip = _clip(run)
    markers, graph, body = Markers.of(clip.graph), clip.graph, clip.body
    rival = AnnealedOnLimbs(body, graph, np.load(run.noise), clip.q[run.begin - 1], run.particles)
    rows: dict[str, list[Any]] = {"frame": [], "seconds": [], "assembled": [], "expected": []}
    for frame in range(run.begin, run.end + 1):
        seen = _observation(run, clip, frame)
        began = time.process_time()
        views = limb_views(seen)
        likelihood = LimbLikelihood(graph.limbs, views) if shows_person(views) else None
        particles = rival.step(np.random.default_rng((run.seed, frame)), likelihood)
        rows["seconds"].append(time.process_time() - began)
        true = markers.of_poses(graph, body, clip.q[frame])
        away = np.linalg.norm(markers.of_poses(graph, body, particles.states) - true, axis=2).mean(axis=1)
        rows["frame"].append(frame)
        rows["assembled"].append(float(1e3 * away[int(np.argmax(particles.weights))]))
        rows["expected"].append(float(1e3 * rival.likely @ away))
    return rows


def true_state(clip: LimbClip, frame: int, samples: int) -> LimbState:
    """As if a frame's true pose had been found."""
    rng = np.random.default_rng((clip.seed, 4))
    metres, radians = _SURE
    variance = np.square([[metres] * 3 + [radians] * 3])
    beliefs = []
    for point in points_of(*limb_placements(clip.graph, clip.body, clip.q[frame])):
        points = mixture_of(PLACEMENTS, point[None], variance).sample(rng, samples)
        beliefs.append(Belief(PLACEMENTS, points, np.full(samples, 1.0 / samples)))
    nv = clip.body.nv
    mode = Mode(
        q=clip.q[frame],
        covariance=np.eye(nv) * radians**2,
        energy=0.0,
        status=CONVERGED,
        velocity=np.zeros(nv),
    )
    when = frame / 30.0
    return LimbState(tuple(beliefs), mixture_of_modes((mode,), np.zeros(1)), when, when, when)
