"""What a batch shows of a run, from the run file."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.runs.run_file import Run
from estimator.trackers.statuses import HARD, TRACKED


class RunFacts(NamedTuple):
    """Facts of a run, by the names of `BatchEntry`'s fields.

    frames: those that are tracked so far. hard, unobserved: how many have that status (`Run.status`, where frames that
    contradict the findings are hard; for the meanings see `STATUS_MEANINGS`). doubtful: the share of frames, 0 to 1,
    that plots and the report mark as not to be trusted: their status is not "tracked"; None of no frame. message: the
    first of the findings that were stored when it was finished, "" where it has none.
    """

    subject: str
    tracker: str
    frames: int
    hard: int
    unobserved: int
    doubtful: float | None
    message: str


def run_facts(run: Run) -> RunFacts:
    """What a batch shows of a run: `BatchEntry(name, "done", **run_facts(run)._asdict())`."""
    status, count = run.status, len(run)
    hard, unobserved, tracked = (int(np.count_nonzero(status == name)) for name in (HARD, "unobserved", TRACKED))
    doubtful = 1.0 - tracked / count if count else None
    message = next(iter(run.header.findings or ()), "")
    return RunFacts(run.subject.name, run.header.tracker, count, hard, unobserved, doubtful, message)
