"""Which way a trunk leans in one phone's view: people bending, from all sides.

From the front and from behind a trunk that leans towards the camera and one that leans away look alike. The people
are the joint centres of two films by markers (OpenCap) or captured motion (CMU, ASAP); the views are virtual
(`benchmarks.accuracy.trunk_view_clips`).
"""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from benchmarks.accuracy.trunk_view_clips import KINDS, ViewRun, lean_of, seen_person
from benchmarks.support.common import (
    Changes,
    Data,
    Json,
    Several,
    Work,
    check_known,
    data_folder,
    nested,
    save,
    work_folder,
)
from benchmarks.support.pose_prior_clips import captured_files, subject_of
from benchmarks.support.result_store import Figures, ResultStore, all_done
from kinemode.terminal import report

FILMS, CAPTURED = SOURCES = ("films", "captured")
AZIMUTHS = {FILMS: (0.0, 10.0, 20.0, 45.0, 90.0, 135.0, 180.0), CAPTURED: (0.0, 180.0)}
SECONDS = {"walk": 1.2, "squat": 4.0}
COLUMNS = {
    "lean": "lean [deg]", "trunk": "trunk [deg]", "hips": "hips [deg]", "knees": "knees [deg]", "wrong": "wrong [s]",
    "among": "among", "best": "reported", "online": "online", "hard": "hard", "bands": "in 90 %",
}  # fmt: skip
LEGEND = (
    "lean, trunk, hips, knees: mean absolute errors of the smoothed trajectory, of joint centres. wrong: longest time"
    " in which the trunk leans over 15 degrees to the wrong side.",
    "among, reported, online: share of frames whose right reading is among the hypotheses, is the smoothed one, is that"
    " of the hypothesis of most weight when the frame was tracked.",
)
_LEANS, _APART, _EACH, _CLIPS = 20.0, 3.0, 5, 20  # deg, s, windows of a person, of all


class Window(NamedTuple):
    """A bend: a source, and where in it a window of so many seconds starts."""

    source: Path
    start: float
    seconds: float


def main(
    *,
    data: Data = None,
    sources: Annotated[tuple[str, ...], Several] = SOURCES,
    azimuths: Annotated[tuple[float, ...], Several] = (),
    kinds: Annotated[tuple[str, ...], Several] = KINDS,
    seeds: Annotated[tuple[int, ...], Several] = (0,),
    changes: Changes = (),
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Track bending people as seen by a virtual phone, and print how their trunks were read.

    Parameters
    ----------
    sources
        films: the squat and the walk of two phone films, by their markers. captured: windows of captured motion in
        which the trunk leans most, at most five of a person.
    azimuths
        Where the phone is [deg], 0 before the person, 90 at the left; all of a source's unless given.
    kinds
        Of keypoints: exact, noise (3 px), detector (constant, lasting and frame's errors).
    seeds
        Of the keypoints' errors and of the tracker.
    changes
        Changes to the settings: group.name=value.
    jobs
        Views tracked at a time, each in a process of its own.
    """
    check_known("--sources", sources, SOURCES)
    check_known("--kinds", kinds, KINDS)
    folder = data_folder(data)
    if folder is None or not (folder / "opencap").is_dir():
        print("the data has no folder opencap: nothing is measured")
        return
    changed = json_module.dumps(nested(changes), sort_keys=True)
    figures: dict[str, Any] = {}
    with work_folder(work) as place:
        store = ResultStore(place)
        for source in sources:
            windows = film_windows(folder) if source == FILMS else captured_windows(data)
            views = azimuths or AZIMUTHS[source]
            runs = [
                ViewRun(*window, azimuth, kind, seed, changed)
                for window in windows for kind in kinds for azimuth in views for seed in seeds
            ]  # fmt: skip
            results = list(zip(runs, all_done(f"trunk views, {source}", store, runs, jobs), strict=True))
            figures[source] = [{**run.what, **result} for run, result in results]
            show(source, results)
    report.print_lines(LEGEND)
    save(json, {"measure": "trunk views", "settings": nested(changes), **figures})


def film_windows(folder: Path) -> list[Window]:
    """The beginnings of the films."""
    return [Window(folder / "opencap" / name, 0.0, seconds) for name, seconds in SECONDS.items()]


def captured_windows(data: Path | None) -> list[Window]:
    """Windows of captured clips around where the trunk leans most, at least `_LEANS`, those of largest lean first."""
    leaning: list[tuple[float, Window]] = []
    folder = data_folder(data)
    others = sorted((folder / "asap").glob("*.npz")) if folder is not None else []
    for path in (*captured_files(data), *others):
        seen = seen_person(path)
        lean = np.abs(lean_of(seen))
        while (k := int(np.argmax(lean))) >= 0 and lean[k] > _LEANS:
            start = max(0.0, round(float(seen.time[k]) - 0.5 * _APART, 2))
            leaning.append((float(lean[k]), Window(path, start, _APART)))
            lean[np.abs(seen.time - seen.time[k]) < _APART] = 0.0
    chosen: list[Window] = []
    for _, window in sorted(leaning, key=lambda entry: -entry[0]):
        own = [w for w in chosen if person_of(w.source) == person_of(window.source)]
        if len(own) < _EACH and len(chosen) < _CLIPS:
            chosen.append(window)
    return chosen


def person_of(path: Path) -> str:
    """The captured person: those in the films of SMPL's joints are unknown."""
    return subject_of(path.stem) if path.suffix == ".bvh" else path.stem


def show(source: str, results: Sequence[tuple[ViewRun, Figures]]) -> None:
    """Tables: by clip and azimuth over kinds and seeds, then by kind."""
    made = report.table(f"{source}: means over keypoints and seeds, `wrong` the longest", "", *COLUMNS.values())
    groups: dict[str, list[Figures]] = {}
    for run, result in results:
        name = run.source.stem if source == FILMS else f"{run.source.stem} from {run.start:g} s"
        groups.setdefault(f"{name}, {run.azimuth:g} deg", []).append(result)
    for name, own in groups.items():
        made.add_row(name, *cells(own))
    made.add_section()
    for kind in KINDS:
        own = [result for run, result in results if run.kind == kind]
        if own:
            made.add_row(f"all, {kind}", *cells(own))
    report.console().print(made)


def cells(own: Sequence[Mapping[str, float]]) -> list[str]:
    """One row."""
    row = []
    for key in COLUMNS:
        values = [figures.get(key, np.nan) for figures in own]
        share = key in ("among", "best", "online", "hard", "bands")
        row.append(f"{np.mean(values):.0%}" if share else f"{max(values) if key == 'wrong' else np.mean(values):.1f}")
    return row
