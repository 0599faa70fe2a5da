"""Figures 4 and 5 of ELMO from what the measure `elmo` saved: errors by sequence and tracker, and frame by frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from benchmarks.support.common import Several, check_known
from benchmarks.support.figure_file import new_figure, write_figure
from estimator.data.formats.checked_json import read_json
from humanoid.support.errors import InputError

_COLOURS = {"elmo": "#1f4e79", "icp": "#c44e52", "condensation": "#55a868", "psh": "0.55", "css": "#8172b2"}
_LONGEST = 400.0  # mm that a curve is drawn to
Errors = Mapping[tuple[str, str], np.ndarray]
"""Errors (T,) of each frame [mm], by sequence and tracker."""


def main(
    runs: Annotated[tuple[Path, ...], Several],
    *,
    out: Path = Path("docs/reproductions"),
    curves: Annotated[tuple[str, ...], Several] = ("wave", "punch"),
    fps: float = 30.0,
) -> None:
    """Draw Figures 4 and 5.

    Parameters
    ----------
    runs
        Files that `python -m benchmarks elmo --json` wrote; what is in several is that of the last; of seed 0.
    out
        Folder of the pictures: elmo_errors.png and elmo_curves.png.
    curves
        Sequences whose errors are drawn frame by frame.
    fps
        Frames per second of the sequences.
    """
    errors = read_runs(runs)
    known = {sequence for sequence, _ in errors}
    check_known("--curves", curves, sorted(known))
    write_errors(out / "elmo_errors.png", errors)
    write_curves(out / "elmo_curves.png", errors, curves, fps)


def read_runs(files: Sequence[Path]) -> Errors:
    """The errors in some files; raises InputError where one is not of `benchmarks.papers_elmo.elmo`."""
    errors: dict[tuple[str, str], np.ndarray] = {}
    for file in files:
        content: Any = read_json(file)
        if not isinstance(content, dict) or content.get("measure") != "elmo":
            raise InputError(file, "is not of benchmarks.papers_elmo.elmo", remedy="name files that its --json wrote")
        for run in content["runs"]:
            if run.get("seed", 0) == 0:
                errors[run["sequence"], run["tracker"]] = np.array(run["error"], dtype=float)
    return errors


def write_errors(path: Path, errors: Errors) -> None:
    """Figure 4: mean error and deviation of every tracker on every sequence, as a PNG."""
    sequences, trackers = (list(dict.fromkeys(key[k] for key in errors)) for k in (0, 1))
    figure = new_figure(9.0, 3.6)
    axes, width = figure.subplots(), 0.8 / len(trackers)
    for k, tracker in enumerate(trackers):
        at = [i for i, sequence in enumerate(sequences) if (sequence, tracker) in errors]
        own = [errors[sequences[i], tracker] for i in at]
        axes.bar(
            np.array(at) + (k - 0.5 * (len(trackers) - 1)) * width, [np.nanmean(e) for e in own], 0.9 * width,
            yerr=[np.nanstd(e) for e in own], color=_COLOURS.get(tracker), label=tracker, ecolor="0.3", capsize=2,
        )  # fmt: skip
    axes.set_xticks(range(len(sequences)), sequences)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("error of a joint [mm]")
    axes.legend(frameon=False, ncols=len(trackers), fontsize=8)
    write_figure(path, figure)


def write_curves(path: Path, errors: Errors, sequences: Sequence[str], fps: float) -> None:
    """Figure 5: the errors of some sequences frame by frame, as a PNG; what is above 400 mm is drawn there."""
    figure = new_figure(9.0, 2.4 * len(sequences))
    for axes, sequence in zip(figure.subplots(len(sequences), squeeze=False)[:, 0], sequences, strict=True):
        for (of, tracker), error in errors.items():
            if of == sequence:
                axes.plot(
                    np.arange(len(error)) / fps, np.minimum(error, _LONGEST), color=_COLOURS.get(tracker),
                    label=tracker, linewidth=1.0,
                )  # fmt: skip
        axes.set(title=sequence, ylabel="error of a joint [mm]", ylim=(0.0, 1.02 * _LONGEST))
        axes.set_xlim(left=0.0)
        axes.legend(frameon=False, fontsize=8, loc="upper right")
    axes.set_xlabel("time [s]")
    write_figure(path, figure)
