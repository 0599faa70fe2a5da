"""Stretches of a run that nobody saw: poses there are carried on, and exports say so."""

from __future__ import annotations

import numpy as np

from estimator.runs.run_reader import Run

_NAMED = 8  # stretches that a note names


def unobserved_stretches(run: Run) -> tuple[tuple[float, float], ...]:
    """First and last time [s] of every stretch of frames with a pose in which nothing was seen."""
    there = (run.status == "unobserved") & np.isfinite(run.q).all(axis=1)
    steps = np.diff(np.concatenate([[0], there.astype(int), [0]]))
    first, after = np.flatnonzero(steps > 0), np.flatnonzero(steps < 0)
    return tuple((float(run.time[a]), float(run.time[b - 1])) for a, b in zip(first, after, strict=True))


def unobserved_note(run: Run) -> str:
    """A line that names the stretches; empty where there is none."""
    stretches = unobserved_stretches(run)
    if not stretches:
        return ""
    named = ", ".join(f"{a:.2f} to {b:.2f} s" for a, b in stretches[:_NAMED])
    more = f" and {len(stretches) - _NAMED} more" if len(stretches) > _NAMED else ""
    return f"nothing was seen, and poses are carried on: {named}{more}"
