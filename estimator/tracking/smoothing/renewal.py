"""Smoothing with image terms at the smoothed poses, instead of at those of the filter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.energy.term import Term
from estimator.inference.motion import MotionPrior
from estimator.search.mode_search import ModeSearch
from estimator.tracking.smoothing.chain import REACH, FrameChain
from estimator.tracking.smoothing.frames import flow_ties, renewed_cost, renewed_terms, standing_ties
from estimator.tracking.smoothing.settings import SmoothSettings
from estimator.tracking.smoothing.ties import Ties
from estimator.tracking.smoothing.window_energy import WindowEnergy
from humanoid.support.spilled import MadeList, SpilledList

See = Callable[[int], Observation]
"""A frame of the track, by its place in it, with what its pictures show."""


@dataclass
class Trajectory:
    """Poses q (T, nq) of the frames of a track, the association (T) that each frame is read in, the energy (T) of each
    frame by itself, what ties each frame to the one before (T), the motion prior with the pace of each frame, and the
    pull (T) of each frame towards its filtered mode, which is in its energy too."""

    q: np.ndarray
    association: Sequence[str]
    costs: SpilledList[Cost]
    ties: SpilledList[Ties]
    motion: MotionPrior
    pulls: Sequence[Sequence[Term]]


class _Renewed(NamedTuple):
    """Energies (T) and ties (T) of a window's frames with features as they are at some poses, and the images' part."""

    costs: list[Cost]
    ties: list[Ties]
    images: WindowEnergy


class Renewal:
    """Smooths trajectories again, window by window: features are assigned and flow is followed again at their poses,
    which are then smoothed with these, as long as that lowers the energy and the images' part of it is not above that
    of the start: features that are assigned to a pose always fit it somewhat, and the motion prior must not buy this.

    see: returns the frames; each is read once, in order. frames (T,): number of each in the clip. times (T,) [s].
    """

    def __init__(
        self,
        search: ModeSearch,
        see: See,
        frames: Sequence[int],
        times: np.ndarray,
        motion: MotionPrior,
        settings: SmoothSettings,
    ) -> None:
        self._search, self._see, self._frames, self._times = search, see, frames, times
        self._motion, self._settings = motion, settings
        self._unseen = search.model.cost(None)

    def __call__(self, trajectories: Sequence[Trajectory]) -> None:
        """Smooth trajectories in place. Every frame's pictures are read once for all of them."""
        count, half = len(self._frames), max(1, self._settings.renewed // 2)
        seen: dict[int, Observation] = {}
        for first in range(0, max(1, count - half), half):
            last = min(count, first + 2 * half)
            seen = {i: o for i, o in seen.items() if i >= first}
            for i in range(first, min(last + 1, count)):
                if i not in seen:
                    seen[i] = self._see(i)
            for trajectory in trajectories:
                self._window(trajectory, seen, first, last)

    def energy(self, trajectory: Trajectory) -> float:
        """Energy of all frames, of their ties and of their motion at equal pace, so that trajectories can be
        compared."""
        costs, ties = trajectory.costs, trajectory.ties
        return self._chain(costs, MadeList(len(ties) - 1, lambda i: ties[i + 1]), self._motion, 0).energy(trajectory.q)

    def _window(self, trajectory: Trajectory, seen: dict[int, Observation], first: int, last: int) -> None:
        low, high = max(0, first - REACH), min(len(trajectory.q), last + REACH)
        held = np.ones(high - low, dtype=bool)
        held[first - low : last - low] = False
        q, least, start = trajectory.q[low:high].copy(), np.inf, np.inf
        for left in reversed(range(self._settings.rounds + 1)):
            renewed = self._renewed(trajectory, seen, q, low, first, last)
            chain = self._chain(renewed.costs, renewed.ties[1:], trajectory.motion.frames(low, high), low)
            energy, images = chain.energy(q), sum(float(part.sum()) for part in renewed.images.values(q))
            enough = energy > least - self._settings.round_gain or images > start
            if energy < least and images <= start:
                trajectory.q[low:high] = q
                for i in range(first, last):
                    trajectory.costs[i] = renewed.costs[i - low]
                for i in range(first, min(last + 1, high)):
                    trajectory.ties[i] = renewed.ties[i - low]
                least, start = energy, images if left == self._settings.rounds else start
            if enough:
                break
            if left:
                q = chain.descend(q, held, self._settings.iterations)

    def _renewed(
        self, trajectory: Trajectory, seen: dict[int, Observation], q: np.ndarray, low: int, first: int, last: int
    ) -> _Renewed:
        """Energies and ties of a window's frames and those it hangs on to, at poses q from frame `low` on; of the
        latter, which are held, only the ties to the window's."""
        costs, ties = [self._unseen] * len(q), list[Ties]([()] * len(q))
        images, flows = [list[Term]() for _ in q], list[Ties]([()] * len(q))
        posed = [self._search.body.at(each) for each in q]
        for i in range(first, min(last + 1, low + len(q))):
            k, association = i - low, trajectory.association[i]
            if i < last:
                images[k] = renewed_terms(self._search, seen[i], posed[k])
                costs[k] = renewed_cost(self._search, seen[i], association, images[k]).plus(trajectory.pulls[i])
            if k and self._frames[i] - self._frames[i - 1] == 1:  # flow is known from one frame to the next
                flows[k], others = flow_ties(self._search, seen[i], posed[k - 1], posed[k])
                dt = self._times[i] - self._times[i - 1]
                ties[k] = [*flows[k], *standing_ties(self._search, seen[i], association, dt)]
                costs[k] = costs[k].plus(others)
                images[k] += others
        body = self._search.body
        return _Renewed(costs, ties, WindowEnergy(body, [Cost(body, terms) for terms in images], flows[1:]))

    def _chain(self, costs: Sequence[Cost], ties: Sequence[Ties], motion: MotionPrior, low: int) -> FrameChain:
        """Chain of frames from `low` on; ties: of each but the first to the one before."""
        times, tolerance = self._times[low : low + len(costs)], self._settings.tolerance
        return FrameChain(self._search.body, costs, times, motion, tolerance, ties)
