"""Frames in which nothing that is seen would keep the body from falling over."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from estimator.data.observation import Observation
from estimator.data.standing import StandingPoints
from estimator.energy.balance import BalanceSettings, balance_terms
from estimator.numerics.stretches import stretches
from estimator.runs.run_file import Run
from estimator.trackers.statuses import TRACKED

_FAR = 5.7
"""Standard deviations from over the feet that one in a hundred captured instants on both feet exceeds, sitting,
acrobatics and jumps among them (`python -m benchmarks balance`)."""
_STAYS = 0.5  # s
_HELD = 0.5  # probability of sitting from which somebody is held


def out_of_balance(run: Run, settings: BalanceSettings) -> tuple[int, ...]:
    """Rows of tracked frames of `Run.q`, ascending, in which both feet stand and the centre of mass stays far from
    above them for half a second, while the person does not seem to sit."""
    if not run.has_keypoints or settings.weight <= 0.0:
        return ()
    far = np.zeros(len(run), dtype=bool)
    for t, observation in enumerate(_resting(run)):
        if run.status[t] == TRACKED and observation.seated < _HELD and np.isfinite(run.q[t]).all():
            terms = balance_terms(run.body, observation, settings)
            far[t] = any(b.stance.feet == 2 and b.deviations(run.body.at(run.q[t])) > _FAR for b in terms)
    rows = [np.arange(*s) for s in stretches(far) if run.time[s[1] - 1] - run.time[s[0]] >= _STAYS]
    return tuple(int(t) for t in np.concatenate(rows)) if rows else ()


def _resting(run: Run) -> Iterator[Observation]:
    """What was seen in each frame, with what rests in it."""
    points = StandingPoints(run.body.landmark_names)
    for t in range(len(run)):
        observation = run.observation(t)
        yield points.with_rest(observation)
        points.add(observation)
