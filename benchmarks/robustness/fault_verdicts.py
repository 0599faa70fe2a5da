"""Whether a faulty file makes a run whose angles are right, whose frames are hard, or that is refused; whose angles are
wrong in frames called tracked is noted where a warning speaks of it, else silent."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.runs.run_reader import Run
from humanoid.support.errors import InputError

VERDICTS = ("right", "hard", "refused", "noted", "silent")
RIGHT, LEAST = 1.2, 0.2  # of the faultless run's error; degrees that do not count
_WORDS = 6  # of a warning, by which two count as equal
_OTHERWISE = (
    "rest on a limit",
    "may lean the other way",
    "bounds of the fit",
    "floor at",
    "no floor was put",
    "on no floor",
)
"""Marks of warnings about the body or its surroundings."""


class Result(NamedTuple):
    """The result of a run on a clip of T frames. errors (T, J) [degrees]: of joints or limbs, NaN without a pose.
    tracked (T,) bool: frames that are called so. shown (J,) bool: joints or limbs that the file shows. notes: its
    warnings."""

    errors: np.ndarray
    tracked: np.ndarray
    shown: np.ndarray
    notes: tuple[str, ...]

    @staticmethod
    def of(run: Run, errors: np.ndarray, shown: np.ndarray, frames: int) -> Result:
        """errors (N, J) [degrees]: in the run's N frames of a clip of so many."""
        every, tracked = np.full((frames, errors.shape[1]), np.nan), np.zeros(frames, dtype=bool)
        every[run.index], tracked[run.index] = errors, run.status == "tracked"
        notes = dict.fromkeys((*run.header.notes, *(run.header.findings or ())))
        return Result(every, tracked, shown, tuple(notes))

    @staticmethod
    def of_joints(run: Run, q: np.ndarray) -> Result:
        """Beside the true configurations q (T, nq): the joints with limits."""
        joints = run.body.bounded_q
        shown = np.array([run.body.q_names[i] not in run.unseen_joints for i in joints])
        return Result.of(run, np.degrees(np.abs(run.q - q[run.index])[:, joints]), shown, len(q))


class Trial(NamedTuple):
    """of: what the files are, in words. faultless, faulty: make a run in a folder; faulty raises InputError for a file
    that is refused."""

    of: str
    faultless: Callable[[Path], Result]
    faulty: Callable[[Path], Result]


class Outcome(NamedTuple):
    """fault, of, scene: what was wrong, with what files, of whom. error, faultless [degrees]: mean of the joints that
    something shows, in frames that the faulty run calls tracked. hard, hard_faultless: share of the frames that are
    not called so. verdict: one of `VERDICTS`. notes: warnings that the fault brings."""

    fault: str
    of: str
    scene: str
    error: float
    faultless: float
    hard: float
    hard_faultless: float
    verdict: str
    notes: tuple[str, ...]


def outcome_of(trial: Trial, fault: str, scene: str, folder: Path) -> Outcome:
    """The verdict on a fault, by name, in a scene."""
    faultless = trial.faultless(folder)
    hard_faultless = float(np.mean(~faultless.tracked))
    try:
        faulty = trial.faulty(folder)
    except InputError:
        nothing = float("nan")
        return Outcome(fault, trial.of, scene, nothing, nothing, 1.0, hard_faultless, "refused", ())
    chosen = np.ix_(faulty.tracked, faulty.shown)
    both = np.isfinite(faultless.errors[chosen]) & np.isfinite(faulty.errors[chosen])
    error, usual = (float(r.errors[chosen][both].mean()) if both.any() else 0.0 for r in (faulty, faultless))
    right = error <= max(RIGHT * usual, usual + LEAST)
    known = {_wording(note) for note in faultless.notes}
    notes = tuple(
        note for note in faulty.notes if _wording(note) not in known and not any(words in note for words in _OTHERWISE)
    )
    hard = float(np.mean(~faulty.tracked))
    verdict = ("hard" if hard > hard_faultless else "right") if right else "noted" if notes else "silent"
    return Outcome(fault, trial.of, scene, error, usual, hard, hard_faultless, verdict, notes)


def _wording(note: str) -> str:
    """The common part of two warnings with different numbers."""
    return " ".join(re.findall(r"[a-z]{2,}", note)[:_WORDS])
