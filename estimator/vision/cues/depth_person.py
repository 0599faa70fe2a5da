"""Which of the places that a depth picture shows are the person's: the nearest thing as large as one."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from estimator.vision.stereo import DepthPoints

LEAST_AREA, LEAST_HEIGHT = 0.08, 0.35  # m^2 and m of a person that can be seen, who may be cut off by the picture
LEAST_MOVING_AREA = 0.04  # m^2, of a person seen from the side, in pieces, where scenery is out of the question
MOVING = 0.15  # share of a thing that has moved, from which it does not belong to the scene
LARGEST = 2.7  # m, of anything that is one person, arms spread
FILLS = 0.6  # share of the picture that no person takes up: what does is a wall or a screen, however near
_TOUCHING = np.ones((3, 3, 3), bool)


def nearest_thing(
    points: DepthPoints,
    area: np.ndarray,
    up: np.ndarray,
    gap: float,
    between: np.ndarray | None = None,
    moved: np.ndarray | None = None,
    pixels: int | None = None,
) -> np.ndarray:
    """Mask (N,) of the points of the nearest thing that is as large as a person; all False where there is none.

    points (N), without the floor's. area (N,): of the surface, seen from the camera, that each stands for [m^2]. up
    (3,). gap [m]: points nearer than that are one thing; a smaller thing within two gaps, as a hand before the body,
    belongs to it, and one that moves within four, as a leg below a raised one that hides the hip. between (N,) bool:
    points at jumps of the depth, which may lie between two things: they connect none, and belong to the thing that they
    touch. moved (N,) bool: points where the clip shows something farther away at other times: a thing with many of them
    goes before others, and may be smaller. pixels: number of pixels of the picture that were sampled, including those
    without a point; None where unknown.
    """
    mine = np.zeros(len(points), dtype=bool)
    if not len(points):
        return mine
    cell = np.floor((points.places - points.places.min(axis=0)) / gap).astype(int) + 3
    sure = np.ones(len(points), dtype=bool) if between is None else ~between
    taken = np.zeros(tuple(cell.max(axis=0) + 4), dtype=bool)
    taken[tuple(cell[sure].T)] = True
    labels, count = ndimage.label(taken, _TOUCHING)
    thing = np.where(sure, labels[tuple(cell.T)], 0)
    areas = np.bincount(thing, area, count + 1)
    moving = np.zeros(count + 1) if moved is None else np.bincount(thing, area * moved, count + 1)
    areas[np.bincount(thing, minlength=count + 1) > FILLS * (pixels or np.inf)] = 0.0
    moves = moving >= MOVING * areas
    best = _nearest(points, thing, areas, moves, up)
    if best == 0:
        return mine
    beside, near = _beside(labels, best, 2), _beside(labels, best, 4)
    smaller = [k for k in near if areas[k] < areas[best] and (k in beside or moves[k])]
    parts = [best, *smaller]
    touched = ndimage.binary_dilation(np.isin(labels, parts), _TOUCHING)[tuple(cell.T)]
    return np.asarray(np.where(sure, np.isin(thing, parts), touched))


def _beside(labels: np.ndarray, thing: int, cells: int) -> list[int]:
    """The numbers of the things within a number of cells from one thing, including itself."""
    around = ndimage.binary_dilation(labels == thing, _TOUCHING, iterations=cells)
    numbers: list[int] = np.unique(labels[around & (labels > 0)]).tolist()
    return numbers


def _nearest(points: DepthPoints, thing: np.ndarray, areas: np.ndarray, moves: np.ndarray, up: np.ndarray) -> int:
    """Number of the nearest thing that can be a person and moves, or of the nearest if none does, 0 for none. thing
    (N,): each point's, from 1. areas [m^2], moves (bool): of each thing."""
    nearest, best = (True, np.inf), 0
    enough = areas >= np.where(moves, LEAST_MOVING_AREA, LEAST_AREA)
    for k in (1 + np.flatnonzero(enough[1:])).tolist():
        own = points.places[thing == k]
        extent = np.ptp(np.percentile(own, [1.0, 99.0], axis=0), axis=0)
        tall = float(np.ptp(np.percentile(own @ up, [1.0, 99.0])))
        if extent.max() > LARGEST or tall < LEAST_HEIGHT:
            continue
        distance = float(np.median(points.across[thing == k]))  # in proportion to the depth
        rank = not moves[k], distance
        if rank < nearest:
            nearest, best = rank, k
    return best
