"""Obstacles of a body: its own parts, a floor, or several of these together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from humanoid.kinematics.body import PosedBody


class SignedDistances(Protocol):
    """distance (M,) [m], negative in overlap; gradient (M, nv): its derivative in the tangent space [m per unit of
    v]."""

    @property
    def distance(self) -> np.ndarray:
        """See `SignedDistances`."""
        ...

    @property
    def gradient(self) -> np.ndarray:
        """See `SignedDistances`."""
        ...


class Clearance(Protocol):
    """Something with signed distances from a body."""

    def near(self, posed: PosedBody, margin: float | None = None) -> SignedDistances:
        """All that are below a margin [m], by default its own."""
        ...

    def penetration(self, posed: PosedBody) -> float:
        """The deepest overlap [m], 0 if none."""
        ...


class Distances(NamedTuple):
    """See `SignedDistances`."""

    distance: np.ndarray
    gradient: np.ndarray


class Clearances:
    """Several of them as one."""

    def __init__(self, parts: Sequence[Clearance]) -> None:
        self._parts = tuple(parts)

    def near(self, posed: PosedBody, margin: float | None = None) -> Distances:
        """See `Clearance`."""
        near = [part.near(posed, margin) for part in self._parts]
        return Distances(np.concatenate([n.distance for n in near]), np.concatenate([n.gradient for n in near]))

    def penetration(self, posed: PosedBody) -> float:
        """See `Clearance`."""
        return max((part.penetration(posed) for part in self._parts), default=0.0)
