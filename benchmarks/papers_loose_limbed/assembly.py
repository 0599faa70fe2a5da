"""Limbs put together: beliefs of single limbs, off by themselves, and the poses assembled from them.

Captured poses, rendered in four views. In the first case each limb is believed 30 mm and 0.2 rad (standard deviation of
each coordinate) from where it is, and as uncertain, and nothing is seen. In the second, 40 mm and 0.25 rad, and 100
places about there are weighed by the root of the limb's likelihood ratio; poses are assembled from them without using
the pictures again, and with.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from cyclopts import Parameter

from benchmarks.papers_loose_limbed.limb_pictures import Shown, shown_clip
from benchmarks.support.common import check_known, save, tell
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files, trial_of
from estimator.data.observation import Observation
from estimator.inference.beliefs.graph import Belief
from estimator.inference.beliefs.space import PLACEMENTS, placements_of, points_of
from estimator.search.cost_model import CostModel
from estimator.search.mode_search import ModeSearch
from estimator.trackers.loose_limbed.assembly import assembled
from estimator.trackers.loose_limbed.limbs.likelihood import LimbLikelihood
from humanoid.collision.self_collision import SelfCollision
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph, limb_placements
from humanoid.subject.subject import load_subject
from kinemode.terminal.report import console, table

SUBJECT = "human34"
CLIPS = ("02_06", "16_01", "02_03", "05_12")
SEED = 1000  # of the first clip's room and clothes
PLACES = 100  # of a belief
BLIND, SEEN = (0.03, 0.2), (0.04, 0.25)  # m, rad
ROOT = 0.5  # power of the likelihood ratio


class Put(NamedTuple):
    """Figures of one instant: errors [m] of limbs' ends as believed and as put together, of the landmarks, deepest
    overlap [m] and farthest beyond a limit [rad] of all modes, and time [s]."""

    believed: float
    ends: float
    landmarks: float
    overlap: float
    beyond: float
    seconds: float


def main(
    *,
    data: Path | None = None,
    clips: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = CLIPS,
    frames: int = 6,
    seed: int = 0,
    json: Annotated[Path | None, Parameter(name="--json")] = None,
) -> None:
    """Measure how near assembled poses are to the true ones of the believed limbs, and what they cost.

    Parameters
    ----------
    data
        Folder with mocap and mocap_more in it; KINEMODE_DATA, or ../shared/data next to the checkout, by default.
    clips
        Trials that poses are from, as in 02_06.
    frames
        Poses of each.
    seed
        Of the beliefs.
    json
        Also write the figures here.
    """
    files = {trial_of(path.stem): path for path in captured_files(data)}
    if not files:
        print(NO_CAPTURED_FILES)
        return
    check_known("clip", clips, tuple(files))
    rng, put = np.random.default_rng(seed), dict[str, list[Put]]()
    for k, clip in enumerate(clips):
        tell(clip)
        search, graph = None, None
        for shown in shown_clip(load_subject(SUBJECT), files[clip], frames, SEED + k):
            if search is None or graph is None:
                search = ModeSearch(CostModel(shown.body, self_collision=SelfCollision(shown.body)))
                graph = limb_graph(shown.body)
            for case, measured in instant(rng, search, graph, shown).items():
                put.setdefault(case, []).append(measured)
    show(put)
    save(json, {"measure": "assembly", **{case: [p._asdict() for p in each] for case, each in put.items()}})


def instant(rng: np.random.Generator, search: ModeSearch, graph: LimbGraph, shown: Shown) -> dict[str, Put]:
    """The assembled poses for each kind of belief."""
    likelihood = LimbLikelihood(graph.limbs, shown.views)
    blind = beliefs(rng, graph, shown, *BLIND, None)
    seen = beliefs(rng, graph, shown, *SEEN, likelihood)
    return {
        "blind": made(search, graph, shown, blind, None, None),
        "seen in beliefs": made(search, graph, shown, seen, None, None),
        "seen again": made(search, graph, shown, seen, likelihood, rng),
    }


def beliefs(
    rng: np.random.Generator, graph: LimbGraph, shown: Shown, metres: float, radians: float, seen: LimbLikelihood | None
) -> list[Belief]:
    """Places about one that is off by as much as they are spread, weighed by the pictures if these are seen."""
    std = np.repeat([metres, radians], 3)
    made = []
    for i, point in enumerate(points_of(*limb_placements(graph, shown.body, shown.q))):
        (centre,) = PLACEMENTS.moved(point, std * rng.standard_normal(6))
        points = PLACEMENTS.moved(centre, std * rng.standard_normal((PLACES, 6)))
        ratio = np.zeros(PLACES) if seen is None else ROOT * seen.log_ratio(i, *placements_of(points))
        weights = np.exp(np.fmax(ratio, -1e3) - max(float(ratio.max()), -1e3))
        made.append(Belief(PLACEMENTS, points, weights / weights.sum()))
    return made


def made(
    search: ModeSearch,
    graph: LimbGraph,
    shown: Shown,
    believed: list[Belief],
    likelihood: LimbLikelihood | None,
    rng: np.random.Generator | None,
) -> Put:
    """Five poses of beliefs; the errors are those of the likeliest."""
    body, cameras = search.body, tuple(view.camera for view in shown.views)
    shape = len(cameras), len(body.landmark_names)
    unseen = Observation(0, 0.0, cameras, np.full((*shape, 2), np.nan), np.zeros(shape))
    began = time.perf_counter()
    modes = assembled(search, graph, believed, unseen, likelihood, rng=rng).modes
    seconds, true = time.perf_counter() - began, limb_placements(graph, body, shown.q)
    raw = placements_of(np.array([belief.moments()[0] for belief in believed]))
    best = limb_placements(graph, body, modes[0].q)
    landmarks = body.landmarks(body.at(modes[0].q)) - body.landmarks(body.at(shown.q))
    i, q = body.bounded_q, np.array([m.q for m in modes])
    beyond = np.maximum(body.lower[i] - q[:, i], q[:, i] - body.upper[i]).max(initial=0.0)
    return Put(
        mean_error(graph, raw, true), mean_error(graph, best, true), float(np.linalg.norm(landmarks, axis=1).mean()),
        max(m.penetration for m in modes), float(beyond), seconds,
    )  # fmt: skip


def mean_error(graph: LimbGraph, placed: tuple[np.ndarray, np.ndarray], true: tuple[np.ndarray, np.ndarray]) -> float:
    """Mean distance [m] of both ends of all limbs, at t (L, 3), R (L, 3, 3), from those of others."""
    length = np.array([[limb.length] for limb in graph.limbs])
    off = placed[0] - true[0], placed[0] + length * placed[1][:, :, 2] - true[0] - length * true[1][:, :, 2]
    return float(np.linalg.norm(np.concatenate(off), axis=1).mean())


def show(put: dict[str, list[Put]]) -> None:
    """The table."""
    errors = ("believed", "ends", "landmarks")
    heads = (f"{n}, mm (worst)" for n in ("ends believed", "ends put together", "landmarks"))
    rows = table("limbs put together", "", *heads, "beyond limits", "over 1 cm in each other", "ms (median)")
    for case, each in put.items():
        of = {name: np.array([getattr(p, name) for p in each]) for name in Put._fields}
        row = [f"{1000 * of[n].mean():.1f} ({1000 * of[n].max():.0f})" for n in errors]
        wrong = np.count_nonzero(of["beyond"] > 0.0), np.count_nonzero(of["overlap"] > 0.01)
        rows.add_row(case, *row, *map(str, wrong), f"{1000 * np.median(of['seconds']):.0f}")
    console().print(rows)
