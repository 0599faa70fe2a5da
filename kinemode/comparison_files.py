"""What a comparison of trackers leaves on disk: a table, all figures, a plot."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from humanoid.atomic import replacing
from kinemode.comparison_scores import FAR, Course, TrackerScore
from viz.comparison import Curve, Plot, write_plot

UNITS = {"fps": "1/s", "residual": "px"} | dict.fromkeys(("mpjpe", "pa_mpjpe", "best_of_k", "final_mpjpe"), "m")
ENOUGH = 0.5  # share of frames with keypoints from which the distance to them is worth a plot


def write_comparison(
    folder: Path, scores: Sequence[TrackerScore], found: Mapping[str, Course]
) -> tuple[Path, Path, Path]:
    """Write compare.csv, one row a tracker, compare.json, which also has every frame, and compare.png: their paths."""
    table, figures, plot = (folder / f"compare.{suffix}" for suffix in ("csv", "json", "png"))
    with replacing(table) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow([f"{f.name} [{UNITS[f.name]}]" if f.name in UNITS else f.name for f in fields(TrackerScore)])
        rows.writerows([["" if _unknown(v) else v for v in asdict(score).values()] for score in scores])
    every = {s.tracker: asdict(s) | {"course": asdict(found[s.tracker])} for s in scores}
    with replacing(figures) as temporary:
        temporary.write_text(json.dumps(_plain(every), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    with replacing(plot) as temporary:
        write_plot(plotted(scores, found), temporary)
    return table, figures, plot


def plotted(scores: Sequence[TrackerScore], found: Mapping[str, Course]) -> Plot:
    """The errors over time; without a reference the distance to the keypoints, and where few frames have them the
    energy."""
    residuals = np.concatenate([course.residual for course in found.values()])
    if any(np.isfinite(course.error).any() for course in found.values()):
        values = {name: 1e3 * course.error for name, course in found.items()}
        label, limit = "mean joint error, hips aligned [mm]", 1e3 * FAR
    elif np.isfinite(residuals).mean() >= ENOUGH:
        values, limit = {name: course.residual for name, course in found.items()}, None
        label = "mean distance from the keypoints [px]"
    else:
        values, limit = {name: course.energy for name, course in found.items()}, None
        label = "energy of the pose"
    curves = []
    for score in scores:
        course = found[score.tracker]
        lost = float(course.time[course.lost.argmax()]) if course.lost.any() else None
        curves.append(Curve(score.tracker, course.time, values[score.tracker], lost))
    return Plot("best hypothesis of each frame, as it was tracked", label, curves, limit)


def _unknown(value: object) -> bool:
    return value is None or (isinstance(value, float) and not np.isfinite(value))


def _plain(value: Any) -> Any:
    """JSON values; what is not finite becomes null."""
    if isinstance(value, dict):
        return {name: _plain(v) for name, v in value.items()}
    if isinstance(value, np.ndarray):
        return [_plain(v) for v in value.tolist()]
    return None if _unknown(value) else value
