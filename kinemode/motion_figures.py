"""The figures of a motion that was made another body's, for its users."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.retargeting.metrics import BELOW, OVERLAP, RetargetMeter, RetargetMetrics
from estimator.retargeting.run_of import source_of
from estimator.runs.run_reader import Run
from humanoid.support.atomic import replacing
from humanoid.support.errors import InputError


class MotionFigures(NamedTuple):
    """metrics: see `RetargetMetrics`. hard: share of the frames that do not keep to all they have to."""

    metrics: RetargetMetrics
    hard: float

    def rows(self) -> list[tuple[str, str]]:
        """Names and values with their units, as they are printed; without those that do not exist, as those of a floor
        for a body without feet."""
        m = self.metrics
        rows = [
            ("frames", m.frames, f"{m.frames}, {self.hard:.1%} of them hard"),
            ("joints over their limits", m.over_limits, f"{m.over_limits:.1%} of the frames"),
            ("joints too fast", m.too_fast, f"{m.too_fast:.1%} of the steps; at most {m.speed_ratio:.2f} of a limit"),
            ("parts that overlap", m.colliding, f"{m.colliding:.1%} of the frames by over {1e3 * OVERLAP:g} mm"),
            (
                "below the floor", m.deepest,
                f"{m.below_floor:.1%} by over {1e3 * BELOW:g} mm; at most {1e3 * m.deepest:.1f} mm",
            ),
            ("slip of what stands", m.slip, f"at most {1e3 * m.slip:.1f} mm a stance"),
            ("limbs off", m.limb_angle, f"{m.limb_angle:.1f} degrees in the mean, at most {m.worst_limb_angle:.0f}"),
            ("hips off the scaled path", m.root_rms, f"{100 * m.root_rms:.1f} cm RMS"),
            ("acceleration of joints", m.acceleration, f"{m.acceleration:.1f} rad/s^2 RMS"),
        ]  # fmt: skip
        return [(name, text) for name, value, text in rows if not np.isnan(value)]


def motion_figures(run: Run) -> MotionFigures:
    """Of a run that `kinemode.retarget` made; raises InputError for another."""
    if not run.header.retargeted:
        raise InputError(run.file, "was tracked, not made from another motion", remedy="kinemode retarget makes one")
    source, contacts = source_of(run)
    floor = 0.0 if run.header.floor is not None else None
    metrics = RetargetMeter(run.body).metrics(
        run.q, run.time, source=source, contacts=contacts if floor is not None else None, floor=floor,
        scale=1.0,
    )  # fmt: skip
    return MotionFigures(metrics, float(np.mean(run.status == "hard")))


def write_figures(figures: MotionFigures, path: Path) -> Path:
    """Write a csv of two columns, every figure by its name in `RetargetMetrics`; returns its path."""
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["figure", "value"])
        rows.writerow(["hard", f"{figures.hard:.6g}"])
        rows.writerows([name, "" if np.isnan(v) else f"{v:.6g}"] for name, v in figures.metrics._asdict().items())
    return path
