"""How well a trajectory keeps to its floor: whether it goes through it, whether what stands on it stays, and whether
what ought to stand is near it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.runs.contact import Contact
from estimator.runs.run_reader import Run
from humanoid.collision.floor import FloorDistances

SKATES = 0.01
"""[m] along the floor within `PER`: what stands and moves more, skates."""
PER = 1.0 / 30.0
"""[s] A frame of most films; of a faster one several."""
NEAR = 0.02
"""[m] above or below where it would stand: what ought to stand and is farther off, does not keep contact."""
_TOUCHES = 1e-4  # m: what is not deeper rests on the floor
_TINY = 1e-6  # s


class Footing(NamedTuple):
    """Figures as retargeting is judged by (OmniRetarget, Yang et al. 2025), NaN where there is nothing to judge.

    penetrating: share of the frames in which any part of the body is below the floor, deepest [m]: the most of all.
    skating: share of what stands, points and frames, that has moved over `SKATES`. near: share of what ought to stand
    that is within `NEAR` of the floor.
    """

    penetrating: float
    deepest: float
    skating: float
    near: float


def footing_of(run: Run, contact: Contact, standing: np.ndarray | None = None) -> Footing:
    """Of a run's drawn trajectory and its contact, see `footing_by_depth`."""
    depth = np.full(1, np.nan)
    if contact.floor is not None and len(run.q):
        floor = FloorDistances(run.body, contact.floor.normal, contact.floor.height)
        depth = np.maximum(0.0, -floor.lowest(run.body.placed(run.q)))
    return footing_by_depth(depth, contact, standing)


def footing_by_depth(depth: np.ndarray, contact: Contact, standing: np.ndarray | None = None) -> Footing:
    """Of how deep the lowest part is below the floor (T,) [m] and of contact; standing (T, P) bool: which points ought
    to stand, those that do by contact unless given."""
    stands = contact.standing > 0.5
    off = np.abs(contact.heights[stands if standing is None else standing])
    moved = _moved(contact)[stands]
    return Footing(
        _share(depth > _TOUCHES, depth), float(depth.max()), _share(moved > SKATES, moved), _share(off <= NEAR, off)
    )


def _moved(contact: Contact) -> np.ndarray:
    """How far each point that stands, and stood `PER` before or in the last older frame, is from there along the
    floor [m], (T, P); NaN of others."""
    before = np.searchsorted(contact.time, contact.time - PER + _TINY, side="right") - 1
    places = contact.places
    way = places - places[before]
    up = np.array([0.0, 0.0, 1.0]) if contact.floor is None else contact.floor.normal
    moved = np.linalg.norm(way - (way @ up)[..., None] * up, axis=2)
    return np.where((contact.standing[before] > 0.5) & (before >= 0)[:, None], moved, np.nan)


def _share(holds: np.ndarray, of: np.ndarray) -> float:
    """How many of the known values hold."""
    known = np.isfinite(of)
    return float(holds[known].mean()) if known.any() else float("nan")
