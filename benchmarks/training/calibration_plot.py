"""The reliability diagram of the calibration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.support.figure_file import new_figure, write_figure
from benchmarks.training.credible_levels import KINDS, Levels
from kinemode.testing.calibration import LEVELS, calibration_error, coverage

TITLES = {"dof": "degrees of freedom", "landmark": "landmark places", "pose": "whole poses"}
_COLOURS = ("#c44e52", "#1f4e79")


def write_reliability(path: Path, variants: Mapping[str, Levels], conditions: Mapping[str, Levels]) -> None:
    """Coverage over level for every kind of region, as a PNG: the variants, and thin and grey the last one's
    conditions."""
    figure = new_figure(11.0, 4.0)
    ends = np.concatenate([[0.0], LEVELS, [1.0]])
    panels = figure.subplots(1, len(KINDS), sharey=True)
    for axes, kind in zip(panels, KINDS, strict=True):
        axes.plot([0, 1], [0, 1], color="black", linewidth=0.8, linestyle="--")
        for i, levels in enumerate(conditions.values()):
            curve = coverage(getattr(levels, kind), ends)
            axes.plot(ends, curve, color="0.7", linewidth=0.8, label="calibrated, each condition" if i == 0 else None)
        for colour, (name, levels) in zip(_COLOURS, variants.items(), strict=True):
            of_kind = getattr(levels, kind)
            label = f"{name}, error {calibration_error(of_kind):.3f}"
            axes.plot(ends, coverage(of_kind, ends), color=colour, linewidth=2.0, label=label)
        axes.set(title=TITLES[kind], xlabel="level of the region", xlim=(0, 1), ylim=(0, 1), aspect="equal")
        axes.legend(loc="upper left", fontsize=7.5, frameon=False)
    panels[0].set_ylabel("share of truths inside")
    write_figure(path, figure)
