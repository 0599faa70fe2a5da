"""A run's beliefs of limbs, as a layer of the overlay: samples as outlines, their means as cones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from estimator.inference.beliefs.graph import Belief
from estimator.inference.beliefs.space import PLACEMENTS, placements_of
from estimator.runs.run_reader import Run
from estimator.tracking.registry import TRACKERS
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph
from humanoid.limbs.merging import Detail
from humanoid.support.errors import InputError
from viz.pictures.limb_picture import draw_limbs
from viz.pictures.painter import ImageProjection

_GROUP = "loose_limbed"  # settings of trackers that believe something of limbs
_ARRAYS = "limb_names", "limb_points", "limb_weights"


@dataclass(frozen=True, eq=False)
class LimbLayer:
    """For each instant (T) the samples' points (L, N, 7) (`estimator.inference.beliefs.space.PLACEMENTS`) and weights
    (L, N), None where nothing was searched."""

    graph: LimbGraph
    beliefs: tuple[tuple[np.ndarray, np.ndarray] | None, ...]

    def draw(self, image: np.ndarray, view: ImageProjection, t: int) -> None:
        """Draw the beliefs at instant t into an image (H, W, 3) uint8 BGR in place."""
        told = self.beliefs[t]
        if told is not None:
            draw_beliefs(image, view, self.graph, *told)


def draw_beliefs(
    image: np.ndarray, view: ImageProjection, graph: LimbGraph, points: np.ndarray, weights: np.ndarray
) -> None:
    """Draw samples of limbs into an image (H, W, 3) uint8 BGR in place, and their means over them.

    points (L, N, 7), weights (L, N), which sum to 1 for each limb.
    """
    t, R = placements_of(points.reshape(-1, PLACEMENTS.size))
    shape = points.shape[:2]
    samples = t.reshape(*shape, 3).swapaxes(0, 1), R.reshape(*shape, 3, 3).swapaxes(0, 1)
    draw_limbs(image, view, graph, *samples, weights.T)
    means = [Belief(PLACEMENTS, p, w).moments()[0] for p, w in zip(points, weights, strict=True)]
    draw_limbs(image, view, graph, *placements_of(np.array(means)))


def limb_layer(run: Run) -> LimbLayer:
    """A run's beliefs of limbs; their graph is made again from the run's settings.

    Raises
    ------
    InputError: the run's tracker has no limb estimates, or they are not of the limbs of its subject.
    """
    told = [run.result(k).extra for k in range(len(run))]
    if not any(set(_ARRAYS) <= set(extra) for extra in told):
        able = " or ".join(name for name, spec in TRACKERS.items() if spec.group == _GROUP)
        problem = f"has no limb estimates, its tracker is {run.header.tracker}"
        raise InputError(run.file, problem, remedy=f"leave limbs out, or track with {able}")
    settings = run.header.settings.get(_GROUP, {})
    detail = cast(Detail, settings.get("detail", "paper"))
    graph = limb_graph(run.body, detail, settings.get("limbs") or None)
    return LimbLayer(graph, tuple(_of_frame(run, graph, k, extra) for k, extra in enumerate(told)))


def _of_frame(run: Run, graph: LimbGraph, k: int, extra: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray] | None:
    if not set(_ARRAYS) <= set(extra):
        return None
    names, points, weights = (np.asarray(extra[name]) for name in _ARRAYS)
    place = f"frame {run.index[k]}"
    if tuple(names.ravel().tolist()) != graph.names:
        problem = f"has the limbs {', '.join(map(str, names.ravel()))}, its subject {', '.join(graph.names)}"
        raise InputError(run.file, problem, place=place, remedy="give the limbs' TOML as it was, or track again")
    numbers = points.dtype.kind == weights.dtype.kind == "f"
    if not numbers or points.shape != (*weights.shape, PLACEMENTS.size) or points.shape[:1] != (len(names),):
        problem = f"has limb_points of the shape {points.shape} and limb_weights of {weights.shape}"
        raise InputError(run.file, problem, place=place, remedy="track again")
    lengths = np.linalg.norm(points[..., 3:], axis=2)
    if not (np.allclose(lengths, 1.0) and (weights >= 0.0).all() and np.allclose(weights.sum(axis=1), 1.0)):
        problem = "has limb_points that are not placements, or limb_weights that are not shares"
        raise InputError(run.file, problem, place=place, remedy="track again")
    return points, weights
