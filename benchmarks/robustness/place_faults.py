"""Faults of places over time, in space or in a picture, as exporters, detectors and the people who use them make."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from humanoid.subject.landmarks import mirror_index

_LEGS = ("knee", "ankle", "heel", "toe")


class Places(NamedTuple):
    """at (T, L, D) [m or px], NaN where missing: a fault changes it in place. names (L): of landmarks, "" of others."""

    at: np.ndarray
    names: tuple[str, ...]

    @property
    def size(self) -> float:
        """The extent of a body along its longest axis, the median of all frames."""
        return float(np.nanmedian(np.nanmax(self.at, axis=1) - np.nanmin(self.at, axis=1), axis=0).max())


Fault = Callable[[np.random.Generator, Places], None]


def name_of(fault: Fault) -> str:
    """As tables have it."""
    return fault.__name__.replace("_", " ")


def with_fault(places: Places, fault: Fault, rng: np.random.Generator) -> Places:
    """The same with a fault."""
    wrong = Places(places.at.copy(), places.names)
    fault(rng, wrong)
    return wrong


def gap_filled(rng: np.random.Generator, places: Places) -> None:
    """Fill gaps with the last known place."""
    frames = stretch(rng, len(places.at))
    for k in some(rng, places, rng.uniform(0.02, 0.3)):
        places.at[frames, k] = places.at[frames.start, k]


def zeros(rng: np.random.Generator, places: Places) -> None:
    places.at[stretch(rng, len(places.at)), some(rng, places, rng.uniform(0.1, 1.0))[:, None]] = 0.0


def elsewhere_at_first(rng: np.random.Generator, places: Places) -> None:
    direction = rng.normal(size=places.at.shape[2])
    places.at[: int(rng.integers(1, 4))] += direction * rng.uniform(0.4, 1.5) * places.size


def labels_jump(rng: np.random.Generator, places: Places) -> None:
    frames, chosen = stretch(rng, len(places.at)), some(rng, places, rng.uniform(0.3, 0.7))
    places.at[frames, chosen[:, None]] = places.at[frames, rng.permutation(chosen)[:, None]]


def labels_permuted(rng: np.random.Generator, places: Places) -> None:
    chosen = some(rng, places, rng.uniform(0.2, 1.0))
    places.at[:, chosen] = places.at[:, rng.permutation(chosen)]


def pictures_twice(rng: np.random.Generator, places: Places) -> None:
    every = int(rng.integers(2, 6))
    places.at[every::every] = places.at[every - 1 : -1 : every][: len(places.at[every::every])]


def frozen(rng: np.random.Generator, places: Places) -> None:
    frames = stretch(rng, len(places.at))
    places.at[frames] = places.at[frames.start]


def legs_missing(rng: np.random.Generator, places: Places) -> None:
    places.at[:, [i for i, name in enumerate(places.names) if name.endswith(_LEGS)]] = np.nan


def sides_exchanged(rng: np.random.Generator, places: Places) -> None:
    frames = stretch(rng, len(places.at))
    places.at[frames] = places.at[frames][:, mirror_index(places.names)]


def point_stuck(rng: np.random.Generator, places: Places) -> None:
    for k in some(rng, places, 0.05):
        places.at[:, k] = places.at[0, k]


def turned_over(rng: np.random.Generator, places: Places) -> None:
    axes = places.at.shape[2]
    places.at[...] = places.at[..., rng.permutation(axes)] * rng.choice([-1.0, 1.0], size=axes)


def stretch(rng: np.random.Generator, count: int) -> slice:
    """Four to half of so many frames."""
    length = int(rng.integers(4, count // 2))
    first = int(rng.integers(0, count - length))
    return slice(first, first + length)


def some(rng: np.random.Generator, places: Places, share: float) -> np.ndarray:
    """Indices of a share of the landmarks, one at least."""
    return rng.permutation(len(places.names))[: max(1, round(share * len(places.names)))]
