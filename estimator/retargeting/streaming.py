"""A motion that is followed while it comes in, a short while behind."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimator.retargeting.contacts import source_contacts
from estimator.retargeting.correspondence import Correspondence
from estimator.retargeting.following import best_start, follow_frame
from estimator.retargeting.motion import stands_of
from estimator.retargeting.problem import MotionProblem, Obstacles, RetargetSettings
from estimator.retargeting.source import SourceMotion, filled
from estimator.retargeting.stances import LIFT, FootStances, stances_at
from estimator.retargeting.targets import Targets, targets_of
from humanoid.kinematics.body import SHORTEST_STEP, Body, points_in_world
from humanoid.support.errors import InputError

_PAST = 0.4  # s that are kept behind the frame that is given out: contacts depend on earlier frames too


class LiveFrame(NamedTuple):
    """q (nq,) at time [s] of the source. keeps: whether the frame keeps to all it has to."""

    time: float
    q: np.ndarray
    keeps: bool


class MotionStream:
    """Follows landmarks (L, 3) as they come; each frame is given out `look_ahead` [s] later.

    names (L): of the landmarks. scale: lengths of the body over those of the source, from the first frames unless
    the correspondence has it; so is the floor [m] unless it is given. What stands is held where the body has it.
    """

    def __init__(
        self,
        body: Body,
        names: tuple[str, ...],
        match: Correspondence,
        settings: RetargetSettings,
        *,
        look_ahead: float,
        floor: float | None = None,
        seed: int = 0,
    ) -> None:
        self.body, self._names, self._match, self._settings = body, names, match, settings
        self._look_ahead, self._floor, self._seed = look_ahead, floor, seed
        self._obstacles: Obstacles | None = None
        self._times: list[float] = []
        self._points: list[np.ndarray] = []
        self._next = 0  # number of the frame in the buffer that is given out next
        self._before: tuple[float, np.ndarray, np.ndarray] | None = None  # time, q, what it moved by
        self._stood = np.zeros((0, 2), dtype=bool)

    def step(self, time: float, points: np.ndarray) -> LiveFrame | None:
        """Take landmarks (L, 3) [m], NaN where missing, at a time [s] after all before; the frame that can be given out
        now, None while no frame is ready."""
        self._times.append(time)
        self._points.append(points)
        if time - self._times[self._next] < self._look_ahead - 1e-9:
            return None
        return self._emit()

    def rest(self) -> list[LiveFrame]:
        """The frames that are left when nothing more comes."""
        left = []
        while self._next < len(self._times):
            left.append(self._emit())
        return left

    def _emit(self) -> LiveFrame:
        problem = self._problem()
        t, time = self._next, self._times[self._next]
        if self._before is not None:
            earlier, before, moved = self._before
            dt = max(time - earlier, SHORTEST_STEP)
            q, _, _ = follow_frame(problem, t, before, moved * dt, dt)
            self._before = time, q, self.body.difference(before, q) / dt
        elif (problem.targets.weight[t] > 0.0).any():
            q = best_start(problem, np.random.default_rng(self._seed), self._settings.starts)
            self._before = time, q, np.zeros(self.body.nv)
        else:  # anywhere: where nothing leads the body, a search ends as its roundings have it
            q = self.body.neutral.copy()
        self._stood = problem.stances.stands[t]
        kept = problem.keeps(t, q)
        self._forget()
        return LiveFrame(time, q, kept)

    def _problem(self) -> MotionProblem:
        """The problem of the kept frames."""
        source = filled(SourceMotion(self._names, np.array(self._points), np.array(self._times), "stream"), _PAST)
        contacts = source_contacts(source, self._floor)
        if self._floor is None:
            self._floor = contacts.floor
        stands = stands_of(contacts, len(source.times))
        targets = self._targets(source, np.asarray(stands.all(axis=2)))
        stances = stances_at(
            targets.feet, targets.place, stands[:, [foot.number for foot in targets.feet]], source.times
        )
        stances = self._held(targets, stances)
        on_floor = bool(targets.feet)
        if self._obstacles is None or (self._obstacles.floor is not None) != on_floor:
            self._obstacles = Obstacles(self.body, self._settings, floor=on_floor)
        return MotionProblem(self.body, targets, stances, source.times, self._settings, self._obstacles)

    def _targets(self, source: SourceMotion, flat: np.ndarray) -> Targets:
        """The targets of the kept frames; of the size of the body while the source's is unknown."""
        floor = self._floor
        try:
            targets = targets_of(self.body, source, self._match, floor, flat)
        except InputError:
            return targets_of(self.body, source, replace(self._match, scale=1.0), floor, flat)
        self._match = replace(self._match, scale=targets.scale)
        return targets

    def _held(self, targets: Targets, stances: FootStances) -> FootStances:
        """Stances whose points, where they stood a frame before, stay where the body has them."""
        if self._before is None or len(self._stood) != len(targets.feet):
            return stances
        place, t = stances.place.copy(), self._next
        posed = self.body.at(self._before[1])
        for f, foot in enumerate(targets.feet):
            still = self._stood[f] & stances.stands[t, f]
            if still.any():
                points = points_in_world(posed, np.full(3, foot.joint), foot.local)
                on = int(np.argmax(still))
                turned = points if still.all() else place[t, f] + (points[on] - place[t, f, on])
                place[t, f] = turned - np.array([0.0, 0.0, turned[on, 2] - LIFT])
        return stances._replace(place=place)

    def _forget(self) -> None:
        """Frames that are too long ago; all that were given out, as long as none has shown anything: the motion begins
        with the first of the kept frames."""
        self._next += 1
        last = self._times[self._next - 1]
        old = sum(time < last - _PAST for time in self._times[: self._next - 1])
        old = self._next if self._before is None else old
        del self._times[:old], self._points[:old]
        self._next -= old
