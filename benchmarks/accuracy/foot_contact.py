"""When feet stand, by markers on heels and toes, against force plates.

The trials are of a person of OpenCap's validation (Uhlrich et al., PLOS Computational Biology 2023; as published with
nimblephysics). A foot stands by the plates where more than 20 N act nearer to it than to the other foot, and by the
markers where any of its three stands with a probability above a half. Sitting unloads feet that touch the floor.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from cyclopts import Parameter

import kinemode as km
from benchmarks.accuracy.captured_steps import print_captured
from benchmarks.accuracy.degrees import FILMS, columns_of, film_run
from benchmarks.accuracy.gait_events import COLUMNS, KINDS, WAYS, EventErrors, events_by, loaded_events
from benchmarks.accuracy.plates import each_plate
from benchmarks.support.common import Data, Json, Several, data_folder, save
from estimator.data.formats.opensim import MarkerFile, read_trc
from estimator.inference.contacts import foot_contact
from estimator.retargeting.metrics import NEAR, SKATES, Footing, footing_of
from estimator.runs.contact import Contact, contact_of_points
from estimator.runs.events import SIDES, Side
from humanoid.support.errors import InputError
from kinemode.terminal import report

TRIALS = ("walking1", "walkingTS1", "STS1", "squats1")
MARKERS = {"left": ("L_calc", "L_toe", "L_5meta"), "right": ("r_calc", "r_toe", "r_5meta")}
RUNNER_MARKERS = {"left": ("LCAL", "LTOE", "LMT5"), "right": ("RCAL", "RTOE", "RMT5")}
"""The trial of a treadmill runner, forces/runner."""
PELVIS = ("L.ASIS", "L.PSIS", "r.ASIS", "r.PSIS")
WALKS = TRIALS[:2]
FLOOR_COLUMNS = ("film, seed", "frames below the floor", "deepest [mm]", "skating", "contact kept")
LEGEND = (
    f"below the floor: any part of the flesh. skating: of heels and toes that stand, those that have moved over"
    f" {1e3 * SKATES:.0f} mm along it in 1/30 s. contact kept: of those that stand by markers, those within"
    f" {1e3 * NEAR:.0f} mm of the floor"
)
_LOADED = 20.0  # N
_LOWEST = 2.0  # percentile of a marker's height: it is on a shoe, not under it
_MOST_OFF = 0.25  # s between an event of the plates and ours


class PlateAgreement(NamedTuple):
    """f1: of frames that stand. events: how many of the plates'. off [s]: of ours nearest to each, ours minus theirs,
    NaN where none is near."""

    f1: float
    events: int
    off: np.ndarray


def agreements(folder: Path, trial: str, names: Mapping[str, tuple[str, ...]] = MARKERS) -> dict[str, PlateAgreement]:
    """The agreement of both feet of a trial, by side; names: of a foot's heel, toe and fifth metatarsal."""
    markers = read_trc(folder / f"{trial}.trc")
    sides = {side: _points(markers, own) for side, own in names.items()}
    loaded = _loaded(folder / f"{trial}_grf.mot", markers.time, sides)
    points = _under_shoes(sides)
    kind = np.tile(np.arange(3), 2)
    standing = foot_contact(points, markers.time, kind, np.array([0.0, 0.0, 1.0])).standing.reshape(-1, 2, 3)
    ours = dict(zip(sides, (standing.max(axis=2) > 0.5).T, strict=True))
    return {side: _agreement(ours[side], loaded[side], markers.time) for side in sides}


def gait_agreements(folder: Path, trial: str) -> dict[tuple[str, str], EventErrors]:
    """Events of a walk by its markers against those of the plates, by way and kind."""
    markers = read_trc(folder / f"{trial}.trc")
    sides = {side: _points(markers, names) for side, names in MARKERS.items()}
    truth = loaded_events(markers.time, _loaded(folder / f"{trial}_grf.mot", markers.time, sides))
    names = [f"{side}_{part}" for side in SIDES for part in ("heel", "big_toe", "small_toe")]
    contact = contact_of_points(markers.time, names, _under_shoes(sides))
    told, span = events_by(contact, _points(markers, PELVIS).mean(axis=1)), (markers.time[0], markers.time[-1])
    return {(way, kind): EventErrors.of(told[way], truth, kind, span) for way in WAYS for kind in KINDS}


def _under_shoes(sides: dict[str, np.ndarray]) -> np.ndarray:
    """The markers of both feet (T, 6, 3), each lowered by its least height above the floor."""
    points = np.concatenate(list(sides.values()), axis=1)
    points[..., 2] -= np.nanpercentile(points[..., 2], _LOWEST, axis=0)
    return points


def _points(markers: MarkerFile, names: tuple[str, ...]) -> np.ndarray:
    return markers.points[:, [markers.names.index(name) for name in names]]


def _loaded(path: Path, time: np.ndarray, sides: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Whether each foot is loaded, (T,)."""
    middle = np.array([points.mean(axis=1)[:, :2] for points in sides.values()])
    load = np.zeros((len(sides), len(time)))
    for force, place in each_plate(path, time):
        nearest = np.argmin(np.linalg.norm(middle - place[:, :2], axis=2), axis=0)
        load[nearest, np.arange(len(time))] += force[:, 2]
    return dict(zip(sides, load > _LOADED, strict=True))


def _agreement(ours: np.ndarray, theirs: np.ndarray, time: np.ndarray) -> PlateAgreement:
    events = [np.flatnonzero(np.diff(each.astype(int))) for each in (ours, theirs)]
    kinds = [each[index + 1] for each, index in zip((ours, theirs), events, strict=True)]
    off = np.full(len(events[1]), np.nan)
    for k, (index, rises) in enumerate(zip(events[1], kinds[1], strict=True)):
        alike = time[events[0][kinds[0] == rises]] - time[index]
        if len(alike) and np.abs(alike).min() <= _MOST_OFF:
            off[k] = alike[np.argmin(np.abs(alike))]
    return PlateAgreement(float(2.0 * (ours & theirs).sum() / (ours.sum() + theirs.sum())), len(off), off)


class FilmAgreement(NamedTuple):
    """A run of a phone film. by_side: agreement of each foot with the markers of heels and toes. ours, truth: contact
    by the run and by the markers. footing: on the run's own floor; what stands by the markers ought to."""

    by_side: dict[Side, PlateAgreement]
    ours: Contact
    truth: Contact
    footing: Footing


def film_agreement(place: Path, seed: int) -> FilmAgreement:
    """The agreement of a film tracked by its one camera and smoothed."""
    column, parts = columns_of(place / "truth.csv.gz"), ("heel", "toe")
    marks = [[column[f"{side}_{part}_{axis}"] for axis in "xyz"] for side in SIDES for part in parts]
    names = [f"{side}_{part}" for side in SIDES for part in ("heel", "big_toe")]
    truth = contact_of_points(column["time"], names, np.array(marks).transpose(2, 0, 1))
    run = film_run(place, seed)
    ours = km.contact(run)
    here = (ours.time >= truth.time[0]) & (ours.time <= truth.time[-1])
    time = ours.time[here]
    result = {}
    for side in SIDES:
        theirs = np.interp(time, truth.time, truth.foot(side)) > 0.5
        result[side] = _agreement(ours.foot(side)[here] > 0.5, theirs, time)
    ought = np.zeros(ours.standing.shape, dtype=bool)
    for k, name in enumerate(truth.names):
        ought[here, ours.names.index(name)] = np.interp(time, truth.time, truth.standing[:, k]) > 0.5
    return FilmAgreement(result, ours, truth, footing_of(run, ours, ought))


def _print_films(folder: Path, seeds: Sequence[int], figures: dict[str, dict[str, object]]) -> None:
    columns = (
        "film, seed", "foot", "F1", "off [ms]", "slide [mm], median, largest", "by markers",
    )  # fmt: skip
    table = report.table("standing by one camera against standing by markers", *columns)
    floors = report.table("the body by one camera and its floor", *FLOOR_COLUMNS)
    for film, seed in itertools.product(FILMS, seeds):
        by_side, ours, truth, footing = film_agreement(folder / film, seed)
        for side, agreement in by_side.items():
            off = [f"{1e3 * x:.0f}" if np.isfinite(x) else "none" for x in agreement.off]
            slides = [[1e3 * s.slide for s in c.stances if s.point.startswith(side)] for c in (ours, truth)]
            sizes = [f"{np.median(s):.0f}, {max(s):.0f}" for s in slides]
            table.add_row(f"{film}, {seed}", side, f"{agreement.f1:.3f}", ", ".join(off), *sizes)
            figures[f"{film} {side} {seed}"] = {
                "f1": agreement.f1, "off": agreement.off.tolist(), "slides": slides[0],
            }  # fmt: skip
        depth = f"{1e3 * footing.deepest:.1f}"
        floors.add_row(
            f"{film}, {seed}", f"{footing.penetrating:.1%}", depth, f"{footing.skating:.1%}", f"{footing.near:.1%}"
        )
        figures[f"{film} floor {seed}"] = dict(footing._asdict())
    report.console().print(table)
    report.console().print(floors)
    report.print_lines([LEGEND])


def _print_gait(folder: Path, figures: dict[str, dict[str, object]]) -> None:
    table = report.table("events of walking by markers against force plates", "kind, source", *COLUMNS)
    several = [gait_agreements(folder, trial) for trial in WALKS]
    for kind, way in itertools.product(KINDS, WAYS):
        errors = EventErrors.joined([of[way, kind] for of in several])
        table.add_row(f"{kind}, {way}", *errors.cells())
        figures[f"gait {kind} {way}"] = {"off": errors.off.tolist(), "extra": errors.extra}
    report.console().print(table)


def main(
    *,
    films: Annotated[bool, Parameter(negative=())] = False,
    captured: Annotated[bool, Parameter(negative=())] = False,
    seeds: Annotated[tuple[int, ...], Several] = (0,),
    data: Data = None,
    json: Json = None,
) -> None:
    """Print how well standing by markers agrees with force plates, trial by trial.

    Parameters
    ----------
    films
        Also track the phone films by their one camera, and compare with standing by markers.
    captured
        Also detect the events of captured walks and runs from landmarks with noise, against those without.
    seeds
        Of the tracker, and of the noise.
    """
    folder = data_folder(data)
    folder = None if folder is None else folder / "opencap" / "subject4"
    if folder is None or not folder.is_dir():
        raise InputError("data", "there is no opencap/subject4", remedy="--data DIR or KINEMODE_DATA names the folder")
    table = report.table("standing by markers against force plates", "trial", "foot", "F1", "events", "off [ms]")
    scores, figures = list[float](), dict[str, dict[str, object]]()
    for trial in TRIALS:
        for side, agreement in agreements(folder, trial).items():
            off = [f"{1e3 * x:.0f}" if np.isfinite(x) else "none" for x in agreement.off]
            table.add_row(trial, side, f"{agreement.f1:.3f}", str(agreement.events), ", ".join(off[:8]))
            scores.append(agreement.f1)
            figures[f"{trial} {side}"] = {"f1": agreement.f1, "off": agreement.off.tolist()}
    report.console().print(table)
    print(f"F1 {np.mean(scores):.3f} in the mean, {min(scores):.3f} at least; target 0.9")
    _print_gait(folder, figures)
    if films:
        _print_films(folder.parent, seeds, figures)
    if captured:
        print_captured(data, seeds, figures)
    save(json, figures)
