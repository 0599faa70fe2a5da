"""Limbs as cones in a camera's view: of one pose over its flesh, or a run's beliefs as a layer of the overlay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np

from estimator.inference.beliefs.graph import Belief
from estimator.inference.beliefs.space import PLACEMENTS, placements_of
from estimator.runs.run_reader import Run
from estimator.tracking.registry import TRACKERS
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import Limb, LimbGraph
from humanoid.limbs.merging import Detail
from humanoid.support.errors import InputError
from viz import palette
from viz.pictures.painter import ImageProjection
from viz.solids.solid import side_of

FILLED = 0.35  # how strongly a cone covers what is behind it
LONGEST = 960  # longer side of a camera's picture [px]
_AROUND = 32  # points of an ellipse
_NEAR = 0.05  # cones that reach nearer to the eye than this are not drawn [m]
_FARTHEST = 8000.0  # px
_SHIFT = 4  # binary places of OpenCV's fixed-point coordinates
_FAINTEST = 0.08  # of a sample's outline, so that every sample is seen


def draw_limbs(
    image: np.ndarray,
    view: ImageProjection,
    graph: LimbGraph,
    t: np.ndarray,
    R: np.ndarray,
    weights: np.ndarray | None = None,
    filled: float = FILLED,
) -> None:
    """Draw limbs into an image (H, W, 3) uint8 BGR in place, nearer ones over farther ones.

    t (L, 3) [m], R (L, 3, 3): placements in the world; those of N samples (N, L, 3), (N, L, 3, 3) are outlines alone,
    as strong as their weights (N, L), for each limb relative to its largest, by default all equal; filled: opacity of
    the cones of a single pose. Blue is left, orange right. Limbs that reach behind the camera, or whose placement is
    not finite, are left out.

    Raises
    ------
    InputError: placements or weights are not those of the graph's limbs.
    """
    alone = t.ndim == 2
    t, R = (t[None], R[None]) if alone else (t, R)
    size = len(graph.limbs)
    if t.shape[1:] != (size, 3) or R.shape != (*t.shape, 3):
        remedy = f"t (N, {size}, 3) and R (N, {size}, 3, 3)"
        raise InputError("placements", f"have the shapes {t.shape} and {R.shape}", place="limbs", remedy=remedy)
    strength = np.ones(t.shape[:2]) if weights is None else np.asarray(weights, dtype=float)
    if strength.shape != t.shape[:2]:
        problem = f"have the shape {strength.shape}"
        raise InputError("weights", problem, place="limbs", remedy=f"one for each sample and limb, {t.shape[:2]}")
    strength = np.clip(strength / np.maximum(strength.max(axis=0, initial=0.0), 1e-300), _FAINTEST, 1.0)
    _, depth = view.project(t.mean(axis=0) if len(t) else np.zeros((size, 3)))
    mask = np.zeros(image.shape[:2], dtype=np.uint8)
    for k in np.argsort(-depth, kind="stable"):
        limb, colour = graph.limbs[k], palette.SIDES[side_of(graph.limbs[k].name)]
        outlines = [(s, _outline(limb, view, t[s, k], R[s, k])) for s in np.argsort(strength[:, k], kind="stable")]
        shown = [(strength[s, k], outline) for s, outline in outlines if outline is not None]
        if alone and shown and filled > 0.0:
            mask[:] = 0
            cv2.fillConvexPoly(mask, shown[0][1][0], int(255 * filled), cv2.LINE_AA, _SHIFT)
            palette.tint(image, mask, colour)
        mask[:] = 0
        for share, lines in shown:
            for line in lines if alone else lines[:1]:
                cv2.polylines(mask, [line], True, int(255 * share), 1, cv2.LINE_AA, _SHIFT)
        palette.tint(image, mask, colour)


def _outline(limb: Limb, view: ImageProjection, t: np.ndarray, R: np.ndarray) -> list[np.ndarray] | None:
    """The cone's outline and its two ends in the image, as OpenCV takes polygons; None where it is not visible."""
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rings = np.array(
        [
            np.concatenate([axes * circle, np.full((_AROUND, 1), z)], axis=1)
            for axes, z in ((limb.proximal, limb.start), (limb.distal, limb.end))
        ]
    )
    if not (np.isfinite(t).all() and np.isfinite(R).all()):
        return None
    pixels, depth = view.project(rings @ R.T + t)
    if not (depth.min() > _NEAR and np.isfinite(pixels).all() and np.abs(pixels).max() < _FARTHEST):
        return None
    fixed = np.round(pixels * 2**_SHIFT).astype(np.int32)
    return [cv2.convexHull(fixed.reshape(-1, 2)), *fixed]


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
