"""Learned potentials as the paper's Figure 3 shows them: samples, green at a limb's joint and red at its end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from benchmarks.support.figure_file import new_figure, write_figure
from estimator.inference.beliefs.learning import RelativePlacements
from estimator.inference.beliefs.space import PLACEMENTS, placements_of, points_of
from estimator.trackers.loose_limbed.limbs.potentials import LimbPotentials
from humanoid.kinematics.body import Body
from humanoid.limbs.limb import Cone, LimbGraph, cone_surface, limb_placements

SAMPLES = 200
STEP = 0.1  # [s] of the temporal potentials that are drawn
_AZIMUTH = np.radians(35.0)  # of the eye from the person's front
_JOINT, _END, _LIMB = "#2a9d3a", "#d62728", "#d9d9d9"


def draw_potentials(path: Path, graph: LimbGraph, body: Body, potentials: LimbPotentials, seed: int) -> None:
    """Write a picture of the potentials in space of limbs at the tree's ends, given their neighbours in the rest pose,
    and of all such limbs in time, given themselves."""
    t, R = limb_placements(graph, body, body.neutral)
    places = points_of(t, R)
    neighbours = [[i for i, j in graph.directed if j == k] for k in range(len(graph.limbs))]
    ends = [(near[0], k) for k, near in enumerate(neighbours) if len(near) == 1]
    steps = potentials.steps(STEP)
    shown = [
        ("in space: given the neighbour", [(i, k, potentials.spatial[i, k]) for i, k in ends]),
        (f"in time: {STEP:g} s later, given now", [(k, k, steps.forward[k]) for _, k in ends]),
    ]
    rng, figure = np.random.default_rng(seed), new_figure(8.0, 5.2, dpi=80)
    for column, (title, drawn) in enumerate(shown):
        axes = figure.add_subplot(1, 2, column + 1)
        _draw_body(axes, graph, t, R)
        for i, k, placements in drawn:
            _draw_samples(axes, places[i], placements, graph.limbs[k].length, rng)
        axes.set_title(title, fontsize=10)
        axes.set_aspect("equal")
        axes.axis("off")
    write_figure(path, figure)


def _flat(points: np.ndarray) -> np.ndarray:
    """Points (N, 3) seen from far away, (N, 2)."""
    across = np.array([-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0])
    return np.stack([points @ across, points[:, 2]], axis=1)


def _draw_body(axes, graph: LimbGraph, t: np.ndarray, R: np.ndarray) -> None:  # type: ignore[no-untyped-def]
    for limb, place, turn in zip(graph.limbs, t, R, strict=True):
        flat = _flat(cone_surface(Cone(limb.start, limb.end, limb.proximal, limb.distal)) @ turn.T + place)
        axes.fill(*flat[ConvexHull(flat).vertices].T, facecolor=_LIMB, edgecolor="white", linewidth=0.8)


def _draw_samples(  # type: ignore[no-untyped-def]
    axes, given: np.ndarray, placements: RelativePlacements, length: float, rng: np.random.Generator
) -> None:
    samples = PLACEMENTS.composed(given[None], placements.sample(rng, SAMPLES))[0]
    t, R = placements_of(samples)
    for points, colour in ((t + length * R[:, :, 2], _END), (t, _JOINT)):
        axes.scatter(*_flat(points).T, s=5.0, color=colour, alpha=0.5, linewidths=0.0)
