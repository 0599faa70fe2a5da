"""What a comparison of trackers leaves on disk: a table, all figures, a plot."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from estimator.runs.trajectory_errors import FAR
from humanoid.support.atomic import replacing
from kinemode.comparison.scores import Course, TrackerScore
from viz.pictures.plot import Curve, MeasurePanel, Plot, write_plot

UNITS = {"fps": "1/s", "residual": "px"} | dict.fromkeys(("mpjpe", "pa_mpjpe", "best_of_k", "final_mpjpe"), "m")
ENOUGH = 0.5  # share of frames with keypoints from which the distance to them is worth a plot


def write_comparison(
    folder: Path, scores: Sequence[TrackerScore], courses: Mapping[str, Course]
) -> tuple[Path, Path, Path]:
    """Write compare.csv, one row a tracker, compare.json, which also has every frame, and compare.png: their paths."""
    table, figures, plot = (folder / f"compare.{suffix}" for suffix in ("csv", "json", "png"))
    with replacing(table) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow([f"{f.name} [{UNITS[f.name]}]" if f.name in UNITS else f.name for f in fields(TrackerScore)])
        rows.writerows([["" if _unknown(v) else v for v in asdict(score).values()] for score in scores])
    every = {s.tracker: asdict(s) | {"course": asdict(courses[s.tracker])} for s in scores}
    with replacing(figures) as temporary:
        temporary.write_text(json.dumps(_plain(every), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    with replacing(plot) as temporary:
        write_plot(plotted(scores, courses), temporary)
    return table, figures, plot


def plotted(scores: Sequence[TrackerScore], courses: Mapping[str, Course]) -> Plot:
    """The errors over time by which poses are lost: in the world and in the image where reference and cameras share one
    world, else the aligned one. Without a reference the distance to the keypoints, and where few frames have them the
    energy."""
    courses = {score.tracker: courses[score.tracker] for score in scores}
    residuals = np.concatenate([course.residual for course in courses.values()])
    if any(course.placed for course in courses.values()):
        limit = min(course.pixel_limit for course in courses.values())
        panels = [
            _panel("mean error in the world [mm]", courses, lambda c: 1e3 * c.world_error, 1e3 * FAR),
            _panel("mean error in the image [px]", courses, lambda c: c.pixel_error, limit),
        ]
    elif any(np.isfinite(course.error).any() for course in courses.values()):
        aligned = next(iter(courses.values())).aligned
        panels = [_panel(f"mean error, {aligned} [mm]", courses, lambda c: 1e3 * c.error, 1e3 * FAR)]
    elif np.isfinite(residuals).mean() >= ENOUGH:
        panels = [_panel("mean distance from the keypoints [px]", courses, lambda c: c.residual)]
    else:
        panels = [_panel("energy of the pose", courses, lambda c: c.energy)]
    return Plot("best hypothesis of each frame, as it was tracked", panels)


def _panel(
    label: str, courses: Mapping[str, Course], value: Callable[[Course], np.ndarray], limit: float | None = None
) -> MeasurePanel:
    """One measure of all trackers. A frame is lost by this one where its value is beyond the limit, or where it is lost
    and has no value."""
    curves = []
    for name, course in courses.items():
        values = value(course)
        lost = np.zeros(len(values), dtype=bool) if limit is None else course.lost & ~(values <= limit)
        starts = lost & ~np.concatenate([[False], lost[:-1]])
        curves.append(Curve(name, course.time, values, tuple(course.time[starts].tolist())))
    return MeasurePanel(label, curves, limit)


def _unknown(value: object) -> bool:
    return value is None or (isinstance(value, float) and not np.isfinite(value))


def _plain(value: Any) -> Any:
    """JSON values; what is not finite becomes null."""
    if isinstance(value, dict):
        return {name: _plain(v) for name, v in value.items()}
    if isinstance(value, np.ndarray):
        return [_plain(v) for v in value.tolist()]
    return None if _unknown(value) else value
