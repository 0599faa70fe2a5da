"""From the nodes that should be seen to the points that are, and back: the closest pairs (ELMO eq. 1; ICP)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.numerics.closest import closest
from estimator.vision.depth_map import DepthPoints

BACK = 400  # points that look for a node, at most


class NodePointPairs(NamedTuple):
    """Nodes (P,) int, and the points (P,) int that they are paired with."""

    node: np.ndarray
    point: np.ndarray


def spread_over(count: int, most: int) -> np.ndarray:
    """At most a number of the integers below `count`, evenly spread."""
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).astype(np.int64)


def closest_points(points: DepthPoints, places: np.ndarray, nodes: np.ndarray) -> NodePointPairs:
    """For each of some nodes (N,) int, at places (N, 3) [m], the closest of the points."""
    return NodePointPairs(nodes, closest(places, points.places)[0])


def closest_nodes(points: DepthPoints, places: np.ndarray, nodes: np.ndarray) -> NodePointPairs:
    """For some of the points the closest of the nodes (N,) int at places (N, 3) [m]: what is seen must be explained, or
    an arm could hide in the trunk."""
    chosen = spread_over(len(points), BACK)
    return NodePointPairs(nodes[closest(points.places[chosen], places)[0]], chosen)


def surface_precision(points: DepthPoints, normals: np.ndarray, noise: float, slide: float) -> np.ndarray:
    """Precision (P, 3, 3) [1/m^2] of the difference between a node and the point (P) that it is paired with: across the
    surface, whose normals are (P, 3), that of the point and of the body's shape, `noise` [m]; along it `slide` [m],
    since the point may be a neighbour's (point to plane)."""
    facing = np.einsum("pi,pi->p", normals, points.rays)
    across, along = np.square(points.across), np.square(points.along)
    variance = across + (along - across) * np.square(facing) + noise**2
    rest = 1.0 / slide**2
    outer = normals[:, :, None] * normals[:, None, :]
    return np.asarray((np.maximum(1.0 / variance, rest) - rest)[:, None, None] * outer + rest * np.eye(3))
