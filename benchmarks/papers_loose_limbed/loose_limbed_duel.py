"""Figure 8, right, of Sigal et al. (CVPR 2004): errors over the frames of both trackers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.support.figure_file import new_figure, write_figure
from benchmarks.support.result_store import Figures

_OURS, _RIVALS = "#1f4e79", ("#d9822b", "#8a5a2b", "#c0504d")
_CONTRASTS = "normal contrast", "low contrast"


def write_duel(path: Path, figures: Mapping[str, Sequence[Figures]]) -> None:
    """One panel for each contrast of the clothes: mean and deviation over seeds of what is expected of all markers
    [mm], from the first tracked frame; figures: runs by label, which ends with the contrast."""
    figure = new_figure(8.0, 3.2)
    for axes, contrast in zip(figure.subplots(1, 2, sharey=True), _CONTRASTS, strict=True):
        rivals = iter(_RIVALS)
        for label, runs in figures.items():
            if not label.endswith(contrast):
                continue
            ours = "beliefs" in runs[0]
            errors = np.array([run["beliefs" if ours else "expected"] for run in runs], dtype=float)
            frames = np.arange(1, errors.shape[1] + 1)
            mean, deviation = np.nanmean(errors, axis=0), np.nanstd(errors, axis=0)
            colour = _OURS if ours else next(rivals)
            axes.fill_between(frames, mean - deviation, mean + deviation, color=colour, alpha=0.2, linewidth=0)
            axes.plot(frames, mean, color=colour, label=f"{label.partition(',')[0]}, {len(runs)} seeds")
        axes.set_title(contrast, fontsize=9)
        axes.set_xlabel("frame")
        axes.set_xlim(1, len(frames))
        axes.legend(fontsize=7, loc="upper left", frameon=False)
    figure.axes[0].set_ylabel("error of a marker [mm]")
    figure.axes[0].set_ylim(bottom=0.0)  # of both, now that all is drawn
    write_figure(path, figure)
