"""Entries of clips in a batch, and which clips to review first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

WIDTH, HEIGHT = 160, 120  # px, of thumbnails
DONE, FAILED, WAITING = "done", "failed", "waiting"
STATUSES = (DONE, FAILED, WAITING)
"""Statuses of a clip; an interrupted one waits."""


@dataclass(frozen=True)
class BatchEntry:
    """One clip of a batch as the table and the page show it.

    status: one of `STATUSES`. message: the error of a failed one, else a finding. frames, hard, unobserved, doubtful:
    as `run_facts` counts them. error [m]: mean joint error against the row's reference. seconds: of wall-clock
    time. processor_seconds: of all its threads. thumbnail, report, run: paths relative to the page, "" where there is
    none.

    Raises
    ------
    ValueError: another status.
    """

    name: str
    status: str
    person: str = ""
    message: str = ""
    subject: str = ""
    tracker: str = ""
    frames: int | None = None
    hard: int | None = None
    unobserved: int | None = None
    doubtful: float | None = None
    error: float | None = None
    seconds: float | None = None
    processor_seconds: float | None = None
    thumbnail: str = ""
    report: str = ""
    run: str = ""

    def __post_init__(self) -> None:
        if self.status not in STATUSES:
            raise ValueError(f"status must be one of {', '.join(STATUSES)}, got {self.status!r}")


def known(value: float | None) -> bool:
    """Whether there is such a number: neither None nor NaN or infinite."""
    return value is not None and math.isfinite(value)


def look_ranks(entries: Sequence[BatchEntry]) -> tuple[int | None, ...]:
    """Rank of each clip to be reviewed: 1, 2, ...; None for those without a problem.

    Failed ones come first, then by the share of untrustworthy frames, by the share of hard ones, and among equal ones
    those with a finding; otherwise in the given order.
    """
    doubted = [i for i, entry in enumerate(entries) if _is_doubted(entry)]
    ranks = {i: rank for rank, i in enumerate(sorted(doubted, key=lambda i: _sureness(entries[i])), 1)}
    return tuple(ranks.get(i) for i in range(len(entries)))


def _is_doubted(entry: BatchEntry) -> bool:
    if entry.status != DONE:
        return entry.status == FAILED
    return bool(entry.message) or any(map(_positive, (entry.doubtful, entry.hard)))


def _sureness(entry: BatchEntry) -> tuple[bool, float, float, bool]:
    """Sort key that rises from the clip to be reviewed first."""
    if entry.status == FAILED:
        return False, 0.0, 0.0, False
    hard = _number(entry.hard) / max(1.0, _number(entry.frames))
    return True, -_number(entry.doubtful), -hard, not entry.message


def _number(value: float | None) -> float:
    return float(value) if value is not None and known(value) else 0.0


def _positive(value: float | None) -> bool:
    return _number(value) > 0.0
