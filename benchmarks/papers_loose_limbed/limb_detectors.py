"""How often detectors of limbs, which use no pose, have each limb among their candidates, and how many of those are
right; on rendered people, rooms and clips that the limbs' likelihood was not learned from.

A candidate is right if its proximal joint is within 100 mm of the true one, and its axis within 30 degrees. Recall is
the share of limbs with a right candidate, precision that of right candidates among a limb's, each alike or by weight.
"Either side": a limb's candidate may as well be at its mirror's place.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from benchmarks.papers_loose_limbed.limb_pictures import Shown, shown_clip
from benchmarks.support.common import Data, Json, Several, check_known, in_processes, save, tell
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files, subject_of
from benchmarks.training.limb_likelihood import FRAMES, HELD_OUT, NEVER, PAPER, person, spread
from estimator.inference.beliefs.space import placements_of
from estimator.trackers.loose_limbed.limbs.likelihood import LimbLikelihood
from estimator.trackers.loose_limbed.part_detectors.contract import AllPartProposals, PartProposals
from estimator.trackers.loose_limbed.part_detectors.hull import hull_proposals
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph
from kinemode.terminal.report import console, table

NEAR, TURNED = 0.1, np.radians(30.0)  # m, rad: as near as that is right
FIRST_SEED = 2000  # of rooms and clothes: none of them was learned from
NO_FOREGROUND = np.zeros((0, 0), np.uint8)
RATES = ("recall", "recall, either side", "precision", "precision, by weight", "candidates")


class Instant(NamedTuple):
    """The input of detectors at an instant: its views and their likelihood, the graph, and the truth of the limbs
    that the pictures show, which no detector may use."""

    shown: Shown
    graph: LimbGraph
    likelihood: LimbLikelihood


def hull(rng: np.random.Generator, instant: Instant) -> AllPartProposals:
    """`hull_proposals` with its default settings."""
    return hull_proposals(rng, instant.graph, instant.likelihood, instant.shown.views)


DETECTORS: dict[str, Callable[[np.random.Generator, Instant], AllPartProposals]] = {"hull": hull}
"""By name. One more is a function here; what it needs beyond an `Instant` (a body, keypoints, templates of a rig) is to
be made in `Instant` or by the function."""


class Clip(NamedTuple):
    """A captured motion, the seed of its room and clothes, how many cameras see it, whether the background is known,
    and names of detectors."""

    path: Path
    seed: int
    cameras: int
    foreground: bool
    detectors: tuple[str, ...]


def main(
    *,
    data: Data = None,
    detectors: Annotated[tuple[str, ...], Several] = tuple(DETECTORS),
    clips: int = 6,
    seeds: int = 3,
    cameras: int = 4,
    foreground: bool = True,
    jobs: int = 1,
    json: Json = None,
) -> None:
    """Recall and precision of detectors of limbs, by kind of limb.

    Parameters
    ----------
    detectors
        Some of those there are.
    clips
        So many captured motions of people that are not learned from.
    seeds
        So many times each, with other people, rooms, lights and clothes; deviations are between seeds.
    cameras
        1 to 4.
    foreground
        Whether the empty scene is known.
    jobs
        Clips rendered at a time, each in a process of its own.
    """
    check_known("--detectors", detectors, DETECTORS)
    files = [f for f in captured_files(data) if subject_of(f.stem) in HELD_OUT and NEVER not in f.stem]
    if not files:
        print(NO_CAPTURED_FILES)
        return
    chosen = spread(files, clips)
    seed_of = [seed for seed in range(seeds) for _ in chosen]
    tasks = [Clip(path, FIRST_SEED + k, cameras, foreground, tuple(detectors)) for k, path in enumerate(chosen * seeds)]
    by_clip = in_processes(clip_rates, tasks, jobs)
    figures = {}
    for name in detectors:
        rates = [[c[name].rates for c, s in zip(by_clip, seed_of, strict=True) if s == seed] for seed in range(seeds)]
        figures[name] = by_kind(limb_graph(person()), np.nanmean(np.array(rates), axis=(1, 2)))
        spent = float(np.mean([c[name].seconds for c in by_clip]))
        show(f"{name}, {cameras} cameras, {spent:.2f} s CPU an instant", figures[name])
        figures[name]["CPU s"] = spent
    save(json, {"measure": "limb detectors", "cameras": cameras, "foreground": foreground, "detectors": figures})


class Rated(NamedTuple):
    """rates (T, L, 5): `RATES` of a clip's instants and limbs, NaN where there are no candidates to be precise.
    seconds: of one core an instant."""

    rates: np.ndarray
    seconds: float


def clip_rates(clip: Clip) -> dict[str, Rated]:
    """The rates of each detector on a clip."""
    tell(f"{clip.path.stem}, seed {clip.seed}")
    graph = limb_graph(person())
    rates: dict[str, list[np.ndarray]] = {name: [] for name in clip.detectors}
    spent = dict.fromkeys(clip.detectors, 0.0)
    for k, shown in enumerate(shown_clip(person(), clip.path, FRAMES, clip.seed, clip.cameras)):
        views = shown.views if clip.foreground else [replace(v, foreground=NO_FOREGROUND) for v in shown.views]
        here = LimbGraph(shown.limbs[:PAPER], graph.edges, graph.mirror)
        instant = Instant(shown._replace(views=views), here, LimbLikelihood(here.limbs, views))
        for name in clip.detectors:
            if not k:
                DETECTORS[name](np.random.default_rng(0), instant)  # compiled, or read from its cache
            began = time.process_time()
            part_proposals = DETECTORS[name](np.random.default_rng((clip.seed, k)), instant)
            spent[name] += time.process_time() - began
            rates[name].append(instant_rates(part_proposals, shown.t[:PAPER], shown.R[:PAPER], graph.mirror))
    return {name: Rated(np.array(rates[name]), spent[name] / FRAMES) for name in clip.detectors}


def instant_rates(part_proposals: AllPartProposals, t: np.ndarray, R: np.ndarray, mirror: Sequence[int]) -> np.ndarray:
    """`RATES` of every limb (L, 5), for true placements t (L, 3), R (L, 3, 3)."""
    rates = np.full((len(part_proposals), len(RATES)), np.nan)
    for i, proposals in enumerate(part_proposals):
        own = right(proposals, t[i], R[i])
        either = own | right(proposals, t[mirror[i]], R[mirror[i]])
        rates[i, [0, 1, 4]] = own.any(), either.any(), len(own)
        if len(own):
            rates[i, 2:4] = either.mean(), np.average(either, weights=proposals.weights)
    return rates


def right(proposals: PartProposals, t: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Which candidates are right (K,) for one true placement t (3,), R (3, 3)."""
    at, turned = placements_of(proposals.points)
    near = np.linalg.norm(at - t, axis=1) <= NEAR
    return np.asarray(near & (turned[:, :, 2] @ R[:, 2] >= np.cos(TURNED)))


def by_kind(graph: LimbGraph, rates: np.ndarray) -> dict[str, Any]:
    """By kind of limb, both sides taken together, and of all: mean and deviation, between seeds, of rates (S, L, 5)."""
    kinds = {kind_of(graph, i): sorted({i, graph.mirror[i]}) for i in range(len(graph.limbs))}
    kinds["all"] = list(range(len(graph.limbs)))
    figures = {}
    for kind, limbs in kinds.items():
        of_seeds = np.nanmean(rates[:, limbs], axis=1)
        figures[kind] = {
            rate: {"mean": float(values.mean()), "deviation": float(values.std(ddof=1)) if len(values) > 1 else np.nan}
            for rate, values in zip(RATES, of_seeds.T, strict=True)
        }
    return figures


def kind_of(graph: LimbGraph, limb: int) -> str:
    """The common part of the names of a limb and its mirror image."""
    other = graph.names[graph.mirror[limb]].split("_")
    return "_".join(word for word in graph.names[limb].split("_") if word in other) or graph.names[limb]


def show(title: str, figures: Mapping[str, Any]) -> None:
    """A row a kind of limb."""
    rows = table(f"{title}; precision on either side", "", *RATES)
    for kind, rates in figures.items():
        cells = (
            f"{r['mean']:.{0 if name == 'candidates' else 2}f} ({r['deviation']:.2f})" for name, r in rates.items()
        )
        rows.add_row(kind, *cells)
    console().print(rows)
