"""Smoothing some frames behind a live track."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.data.floor import KnownFloor
from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.energy.interpenetration import AboveFloor
from estimator.inference.best_path import best_path
from estimator.inference.contacts import floor_of, height_above, is_believed
from estimator.search.mode_search import ModeSearch
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.smoothing.chain import REACH, FrameChain
from estimator.tracking.smoothing.frames import frame_costs, frame_energies, frame_shifts, standing_ties
from estimator.tracking.smoothing.settings import SmoothSettings
from estimator.tracking.smoothing.stances import SUNK
from estimator.tracking.smoothing.ties import Ties
from humanoid.collision.floor import FloorDistances


@dataclass
class _Frame:
    """A frame of the window as it was observed: its modes q (K, nq) with their costs, energies (K,) and ties to the
    frame before, and the pose it has now."""

    observation: Observation
    modes: np.ndarray
    costs: list[Cost]
    energy: np.ndarray
    ties: list[Ties]
    chosen: int = -1
    q: np.ndarray | None = None

    def keep(self, k: int) -> None:
        """Choose mode k; a pose that was smoothed as that mode stays."""
        if k != self.chosen:
            self.chosen, self.q = k, self.modes[k]


class FixedLag:
    """Takes the frames of a track as they arrive and returns each smoothed, `SmoothSettings.lag` frames later.

    Returned frames do not change. With every new frame the best trajectory through the frames since is chosen again and
    smoothed. Nothing is below a known floor, `floor`. To find a floor, or standing feet, takes more of a clip than the
    window has.
    """

    def __init__(self, search: ModeSearch, settings: SmoothSettings | None = None, floor: KnownFloor = None) -> None:
        self._search, self._floor = search, floor
        self._settings = settings or SmoothSettings()
        self._motion = self._settings.plain_motion(search.model)
        self._distances: FloorDistances | None = None  # to the floor, once the cameras are known
        self._output_frames: list[_Frame] = []
        self._window: list[_Frame] = []

    def push(self, observation: Observation, result: FrameResult) -> list[tuple[int, np.ndarray]]:
        """Take a frame as it was searched, with its pictures' cues where there are any; the frames that are now old
        enough, as (index, configuration (nq,)). A frame without hypotheses is left out."""
        if not len(result.weight):
            return []
        costs = frame_costs(self._search, observation, result)
        energy = frame_energies(self._search, costs, result)
        energy = energy + frame_shifts(self._search, observation, energy, result)
        ties = self._ties(observation, result)
        self._window.append(_Frame(observation, result.q, costs, energy, ties))
        self._smooth()
        return [self._give()] if len(self._window) > self._settings.lag else []

    def _ties(self, observation: Observation, result: FrameResult) -> list[Ties]:
        """Ties of each mode of a frame to the one before."""
        before = [*self._output_frames, *self._window][-1:]
        if not before or result.index - before[0].observation.index != 1:
            return [()] * len(result.weight)
        dt = result.time - before[0].observation.time
        return [standing_ties(self._search, observation, association, dt) for association in result.association]

    def flush(self) -> list[tuple[int, np.ndarray]]:
        """The frames that are still held back, at the end of a clip."""
        return [self._give() for _ in range(len(self._window))]

    def _smooth(self) -> None:
        frames = [*self._output_frames, *self._window]
        times = np.array([f.observation.time for f in frames])
        q = [f.q[None] if f.q is not None else f.modes for f in self._output_frames] + [f.modes for f in self._window]
        energy = [np.zeros(1)] * len(self._output_frames) + [f.energy for f in self._window]
        path = best_path(self._search.body, q, energy, times, self._motion)
        for frame, k in zip(self._window, path[len(self._output_frames) :].tolist(), strict=True):
            frame.keep(k)
        costs = self._above(frames, [f.costs[f.chosen] for f in frames])
        held = np.arange(len(frames)) < len(self._output_frames)
        ties = [f.ties[f.chosen] for f in frames[1:]]
        chain = FrameChain(self._search.body, costs, times, self._motion, self._settings.tolerance, ties)
        poses = chain.descend(np.array([f.q for f in frames]), held, self._settings.lag_iterations)
        for frame, pose in zip(frames, poses, strict=True):
            frame.q = pose

    def _give(self) -> tuple[int, np.ndarray]:
        frame = self._window.pop(0)
        self._output_frames = [*self._output_frames, frame][-REACH:]
        assert frame.q is not None
        return frame.observation.index, frame.q

    def _above(self, frames: list[_Frame], costs: list[Cost]) -> list[Cost]:
        """Costs that keep poses above a known floor, if these are near it."""
        if self._floor is None:
            return costs
        if self._distances is None:
            self._distances = floor_of(self._search.body, frames[0].observation.cameras, self._floor)
        distances, q = self._distances, np.array([f.q for f in frames])
        if distances is None or not is_believed(height_above(distances, self._search.body, q)):
            return costs
        return [cost.plus([AboveFloor(distances, SUNK, None)]) for cost in costs]
