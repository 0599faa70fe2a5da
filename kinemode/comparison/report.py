"""What `kinemode compare` prints."""

from __future__ import annotations

import numpy as np

from estimator.runs.trajectory_errors import FAR, FAR_PX, FAR_PX_SIZE
from kinemode.comparison.compare import Comparison
from kinemode.comparison.scores import TrackerScore
from kinemode.findings import status_meanings
from kinemode.terminal.report import console, millimetres, table

COLUMNS = ("frames/s", "hard", "unobserved", "energy", "residual [px]")
ERRORS = ("MPJPE", "PA-MPJPE", "best of K", "final MPJPE", "lost", "first lost")
LEGEND = (
    "All but best of K and final MPJPE: the best hypothesis of each frame as it was tracked.\n"
    "energy: mean of its pose by the cost of css, whichever the tracker, without the past. residual: mean distance"
    " from the keypoints."
)
LEGEND_OF_ERRORS = (
    "final: the trajectory the run ends with, which css smooths. lost: frames with the joints on average over"
    f" {1e3 * FAR:.0f} mm from the reference, or {FAR_PX:.0f} px in a picture of {FAR_PX_SIZE[0]} x {FAR_PX_SIZE[1]},"
    " as much of the diagonal of others; with a guessed camera over the former, hips aligned. best of K: the nearest of"
    " each frame's K hypotheses."
)


def print_comparison(compared: Comparison) -> None:
    """One row a tracker: how fast, how sure, how far from keypoints and reference; and where the files are."""
    known = any(np.isfinite(s.mpjpe) for s in compared.scores)
    title = f"{compared.scores[0].frames} frames" + (", errors [mm]" if known else "")
    made = table(title, "tracker", *COLUMNS, *(ERRORS if known else ()))
    for score in compared.scores:
        made.add_row(score.tracker, *_cells(score), *(_errors(score) if known else ()))
    out = console()
    out.print(made)
    out.print(LEGEND, soft_wrap=True)
    for line in status_meanings(COLUMNS):
        out.print(line, soft_wrap=True)
    if known:
        out.print(LEGEND_OF_ERRORS, soft_wrap=True)
    for path in (compared.table, compared.figures, compared.plot):
        out.print(str(path), soft_wrap=True)


def _cells(s: TrackerScore) -> list[str]:
    return [_number(s.fps), str(s.hard), str(s.unobserved), _number(s.energy), _number(s.residual)]


def _errors(s: TrackerScore) -> list[str]:
    lengths = [millimetres(e) for e in (s.mpjpe, s.pa_mpjpe, s.best_of_k, s.final_mpjpe)]
    return [*lengths, str(s.lost), "-" if s.first_lost is None else f"frame {s.first_lost}"]


def _number(value: float) -> str:
    return "-" if not np.isfinite(value) else f"{value:.1f}"
