"""Short clips of several people for a batch, single runs of them, and whether two sets of runs are equal."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import kinemode as km
from benchmarks.robustness.resume import differences, first_difference
from benchmarks.support.common import tell
from kinemode.batches.manifest import BatchRow, rows_of

FPS = 30.0
MOTIONS = ("reach", "turn_reach", "random")
PEOPLE: tuple[dict[str, float], ...] = (
    {},
    {"left_knee_flexion": 1.06, "left_ankle_dorsiflexion": 1.06},
    {"left_elbow_flexion": 0.94, "left_wrist": 0.95},
    {"left_knee_flexion": 0.96, "skull": 1.04},
)
"""Proportions, as `kinemode.render` takes them."""

Mappings = list[dict[str, Any]]
"""Rows as `kinemode.batch` takes them."""


def short_clips(folder: Path, count: int, frames: int, settings: Path | None = None) -> Mappings:
    """Rows of so many clips of keypoints: people, motions and seeds in turn. settings: of the tracker, a TOML file."""
    rows: Mappings = []
    for i in range(count):
        clip = km.render(
            folder / f"clip{i:03d}", MOTIONS[i % len(MOTIONS)], proportions=PEOPLE[i % len(PEOPLE)] or None,
            fps=FPS, seconds=frames / FPS, seed=i, videos=False,
        )  # fmt: skip
        (keypoints,) = clip.keypoints.values()
        row = {"name": f"clip{i:03d}", "keypoints": str(keypoints), "cameras": str(clip.cameras)}
        rows.append(row | ({} if settings is None else {"settings": str(settings.absolute())}))
    tell(f"{count} clips of {frames} frames are made")
    return rows


def write_csv(path: Path, rows: Mappings) -> Path:
    """A manifest of the rows."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows({name: f'"{value}"' if " " in value else value for name, value in row.items()} for row in rows)
    return path


def single_runs(mappings: Mappings, folder: Path) -> dict[str, Path]:
    """Each clip tracked by one call of `kinemode.track` in this process, with the options of its row."""
    folder.mkdir(parents=True, exist_ok=True)
    return {row.name: _tracked_alone(row, folder / f"{row.name}.run") for row in rows_of(mappings)}


def _tracked_alone(row: BatchRow, out: Path) -> Path:
    km.track(row.subject, row.clips, **row.options, out=out, overwrite=True)
    tell(f"{row.name} alone")
    return out


def batch_run(root: Path, name: str) -> Path:
    """Where a batch keeps the run of a clip."""
    return root / "clips" / name / f"{name}.run"


def unequal_runs(single: Mapping[str, Path], root: Path, names: Sequence[str] | None = None) -> list[str]:
    """Differences of a batch's runs of clips, all unless named, to the single runs, to the last bit."""
    wrong = []
    for name in single if names is None else names:
        file = batch_run(root, name)
        if not file.is_file():
            wrong.append(f"{name}: there is no run")
            continue
        alone, ours = km.open_run(single[name]), km.open_run(file)
        if different := differences(alone, ours):
            wrong.append(f"{name}: different {first_difference(alone, ours)}: {', '.join(different)}")
    return wrong
