"""Figures 5, 7, 8 and 13 of CSS as plots of our problem: `python -m benchmarks css_tables --figures FOLDER`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from benchmarks.papers_css.css_figures_valleys import valleys
from benchmarks.papers_css.css_tables_minima import Searches, distinct, known_problem
from benchmarks.papers_css.css_tables_problem import PAPERS, Problem, joint_image_problem
from benchmarks.support.figure_file import new_figure, write_figure
from kinemode.target import made_folder

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"CSS": "#1f6f8b", "SS": "#d9772b"}
PAPER_SPECTRA = {"arm8": 350.0, "human34": 2000.0}
SLICES = 4  # of the weakest directions
SMALL, LARGE = 3.0, 3.0  # standard deviations; rad or m
VALLEYS = ("#d9772b", "#7a4ea3")  # the mode's, and those that searches fall into at its ends
DPI = 90


def draw_all(folder: Path, pose: int, scale_8: dict[str, Searches], points: int = 121) -> None:
    """Every figure of the random pose `pose` as PNG.

    scale_8: the table's rows at scale 8 by proposal. points: along each valley of Figure 7.
    """
    made_folder(folder)
    squared, robust = known_problem(pose), joint_image_problem(pose, regime=PAPERS._replace(potential="lorentzian"))
    arm = joint_image_problem(pose, subject_name="arm8")
    _page(folder / "figure05.png", 1, 1, (6.0, 3.6), lambda axes: _spectra(axes[0], {"arm8": arm, "human34": squared}))
    _page(folder / "figure07.png", 2, 2, (8.0, 5.6), lambda axes: _valleys(axes, squared, points))
    _page(folder / "figure08.png", 2, 2, (8.0, 5.6), lambda axes: _slices(axes, {"squared": squared, "robust": robust}))
    _page(folder / "figure13.png", 2, 3, (10.5, 5.6), lambda axes: _histograms(axes, squared, scale_8))


def _page(path: Path, rows: int, columns: int, size: tuple[float, float], draw: Callable[[list[Axes]], None]) -> None:
    """A figure of rows x columns axes, `size` in inches."""
    figure = new_figure(*size, dpi=DPI)
    draw(list(figure.subplots(rows, columns, squeeze=False).ravel()))
    write_figure(path, figure)


def _spectra(axes: Axes, problems: dict[str, Problem]) -> None:
    """Standard deviations of the covariance's eigenvectors, largest first (Figure 5)."""
    for (name, problem), marker in zip(problems.items(), "so", strict=True):
        std = problem.std
        label = f"{name}: {std[0] / std[-1]:.0f}:1 (the paper {PAPER_SPECTRA[name]:.0f}:1)"
        axes.semilogy(np.arange(1, len(std) + 1), std, marker=marker, markersize=4, linewidth=1, label=label)
    axes.set_xlabel("eigen-direction, least certain first")
    axes.set_ylabel("standard deviation [rad, m]")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)


def _valleys(axes: list[Axes], problem: Problem, points: int) -> None:
    """Costs within a few standard deviations of the mode: on the line, and along valleys, where everything else is at
    its best for the place along the line (Figure 7). Valleys that end are drawn apart: no line leads over the gap."""
    mode_cost = problem.mode.quadratic.value
    for k, panel in enumerate(axes[:SLICES]):
        reach = min(SMALL * float(problem.std[k]), np.pi)
        t = np.linspace(-reach, reach, points)
        _curve(panel, t, _line_costs(problem, problem, k, t) - mode_cost, "-", "on the line")
        for i, valley in enumerate(valleys(problem, k, reach, points)):
            style, label = ("--", "the mode's valley") if i == 0 else (":", "other valleys")
            _curve(panel, valley.t, valley.cost - mode_cost, style, label if i < 2 else "", VALLEYS[min(i, 1)])
            ends = np.array([0, -1])[list(valley.folded)]
            panel.plot(valley.t[ends], valley.cost[ends] - mode_cost + 1.0, "x", color=VALLEYS[min(i, 1)], markersize=5)
        _labelled(panel, k, problem)
        panel.set_ylim(0.8, 3e2)
    shown = {label: line for panel in axes for line, label in zip(*panel.get_legend_handles_labels(), strict=True)}
    axes[0].legend(shown.values(), shown.keys(), frameon=False, fontsize=8)


def _slices(axes: list[Axes], problems: dict[str, Problem]) -> None:
    """Costs far along straight lines through the mode, projected onto the limits (Figure 8)."""
    squared, t = problems["squared"], np.linspace(-LARGE, LARGE, 401)
    for k, panel in enumerate(axes[:SLICES]):
        for (name, problem), style in zip(problems.items(), ("-", "--"), strict=True):
            cost = _line_costs(problem, squared, k, t)
            _curve(panel, t, cost - problem.cost.value_at(squared.mode.q), style, f"{name} errors")
        _labelled(panel, k, squared)
    axes[0].legend(frameon=False, fontsize=8)


def _line_costs(problem: Problem, line: Problem, k: int, t: np.ndarray) -> np.ndarray:
    """Cost (T,) of a problem at t (T,) along direction k of the problem `line`."""
    model, q, axis = line.body.model, line.mode.q, line.axes[:, k]
    return problem.cost.values_at(np.array([line.body.clamp(pin.integrate(model, q, s * axis)) for s in t]))


def _curve(panel: Axes, t: np.ndarray, cost: np.ndarray, style: str, label: str, colour: str | None = None) -> None:
    """A cost above the mode's, its minima as dots."""
    panel.plot(t, cost + 1.0, style, linewidth=1.2, label=label, color=colour)
    low = 1 + np.flatnonzero((cost[1:-1] < cost[:-2]) & (cost[1:-1] <= cost[2:]))
    panel.plot(t[low], cost[low] + 1.0, "k.", markersize=5)


def _labelled(panel: Axes, k: int, problem: Problem) -> None:
    panel.set_yscale("log")
    panel.set_title(f"direction {k + 1}, standard deviation {problem.std[k]:.2f}", fontsize=9)
    panel.set_xlabel("distance along it [rad, m]", fontsize=9)
    panel.set_ylabel("cost above the mode, + 1", fontsize=9)
    panel.grid(alpha=0.3)


def _histograms(axes: list[Axes], problem: Problem, rows: dict[str, Searches]) -> None:
    """Samples and distinct minima by distance, standard deviations and cost (Figure 13)."""
    names = ("parameter distance [rad, m]", "standard deviations", "cost")
    for column, name in enumerate(names):
        for row in (0, 1):
            by_method = {m: _measured(problem, s, row == 1)[column] for m, s in rows.items()}
            _histogram(axes[3 * row + column], by_method, logarithmic=column > 0)
            axes[3 * row + column].set_xlabel(name, fontsize=9)
            axes[3 * row + column].set_ylabel("distinct minima" if row else "samples", fontsize=9)
    axes[0].legend(frameon=False)


def _measured(problem: Problem, searches: Searches, optimised: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance, standard deviations and cost of the samples, or of the distinct minima they lead to."""
    kept = distinct(problem, searches)
    q, cost = (searches.q[kept], searches.energy[kept]) if optimised else (searches.raw_q, searches.raw_energy)
    steps = problem.steps(q)
    return np.linalg.norm(steps, axis=1), problem.deviations(steps), cost


def _histogram(axes: Axes, by_method: dict[str, np.ndarray], logarithmic: bool) -> None:
    values = np.concatenate(list(by_method.values()))
    if logarithmic:
        bins = np.geomspace(max(values.min(), 1e-3), values.max(), 36)
        axes.set_xscale("log")
    else:
        bins = np.linspace(0.0, values.max(), 36)
    for name, measured in by_method.items():
        axes.hist(measured, bins=bins.tolist(), alpha=0.6, color=COLOURS[name], label=f"{name}, scale 8")
    axes.grid(alpha=0.3)
