"""Joint angles over time in one picture: their uncertainty, other hypotheses, and frames not to trust.

Left and right are drawn over each other in the blue and orange of Okabe and Ito (Color Universal Design, 2008).

Which joints a plot shows, and which of them share a panel.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from estimator.runs.joint_angle import JointAngle
from estimator.runs.run_reader import Run
from humanoid.support.errors import InputError, nearest
from humanoid.support.files import replacing
from viz.palette import ON_PAPER, web
from viz.solids.solid import Side, side_of, without_side

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


USUAL = ("hip", "knee", "ankle", "shoulder", "elbow")
"""Parts of names of the joints that are shown of a body with many."""
_FEW = 12
"""Panels up to which all joints are shown."""


class JointPanel(NamedTuple):
    """Curves in one panel: a joint, or those of both sides; their common name."""

    title: str
    curves: tuple[tuple[Side, JointAngle], ...]


def chosen_joints(names: Sequence[str], wanted: str | Iterable[str] | None) -> tuple[str, ...]:
    """The requested joints, in their own order.

    wanted: names, parts of names and sides ("left"), separated by commas or as several texts; by default the limbs of a
    body with more than twelve panels, and all joints otherwise.

    Raises
    ------
    InputError: a text that is not part of any name, with the nearest names.
    """
    if wanted is None:
        return _usual(names)
    parts = [part.strip() for text in ([wanted] if isinstance(wanted, str) else wanted) for part in text.split(",")]
    parts = [part for part in parts if part]
    if not parts:
        raise InputError("joints", "names no joint", remedy=nearest("", names, "joints"))
    chosen = {name for part in parts for name in _asked(part, names)}
    return tuple(name for name in names if name in chosen)


def _asked(part: str, names: Sequence[str]) -> list[str]:
    if part in names:
        return [part]
    text = "_".join(part.lower().split())
    asked = [name for name in names if (side_of(name) == text if text in ("left", "right") else text in name.lower())]
    if not asked:
        raise InputError("joints", f"no joint is called {part!r}", remedy=nearest(part, names, "joints"))
    return asked


def _usual(names: Sequence[str]) -> tuple[str, ...]:
    usual = tuple(name for name in names if any(part in name.lower() for part in USUAL))
    return usual if usual and len({without_side(name) for name in names}) > _FEW else tuple(names)


def panels_of(angles: Sequence[JointAngle]) -> tuple[JointPanel, ...]:
    """One panel a joint, those of both sides in one, in the order in which they first come."""
    groups: dict[tuple[str, str], list[tuple[Side, JointAngle]]] = {}
    for angle in angles:
        side = side_of(angle.name)
        title = angle.name if side == "trunk" else without_side(angle.name)
        groups.setdefault((title, angle.unit), []).append((side, angle))
    panels = []
    for (title, _), curves in groups.items():
        if len({side for side, _ in curves}) == len(curves):
            panels.append(JointPanel(title, tuple(curves)))
        else:  # names that differ by more than the side
            panels += [JointPanel(angle.name, ((side, angle),)) for side, angle in curves]
    return tuple(panels)


FORMATS = ("png", "svg", "pdf")
_COLUMNS = 3
_PANEL = (4.2, 2.45)  # inches
_HEAD = 0.95  # inches above and below the panels
_FLAGS: dict[str, dict[str, Any]] = {
    "hard": {"facecolor": "#FAE9C0", "edgecolor": "none"},
    "unobserved": {"facecolor": "#F3F4F6", "edgecolor": "#C3C8D0", "hatch": "////"},
}
_LEAST = {"deg": 5.0, "m": 0.02}  # that an axis shows at least
_NEAR_LIMIT = 0.12  # share of the axis from which a limit beyond it is shown
_FAINT = 0.02  # weight from which a hypothesis is drawn


def write_joint_plot(run: Run, path: str | Path, joints: str | Iterable[str] | None = None) -> Path:
    """Write curves of joints in degrees, or metres where they slide, and return the path: .png, .svg or .pdf. The file
    is written whole or not at all.

    joints: see `chosen_joints`.
    Raises InputError: another ending, no such joint, a run without a pose, a file that cannot be written.
    """
    path = Path(path)
    kind = path.suffix.lstrip(".").lower()
    if kind not in FORMATS:
        raise InputError(path, "is not a picture file", remedy=f"let it end in {', '.join('.' + f for f in FORMATS)}")
    names = chosen_joints(run.joint_names, joints)
    if not names:
        raise InputError(run.file, "has no joint with a single coordinate")
    if not np.isfinite(run.q).all(axis=1).any():
        raise InputError(run.file, "contains no poses", remedy="track with --resume first")
    panels = panels_of([run[name].degrees for name in names])
    import matplotlib as mpl

    dated = {"svg": "Date", "pdf": "CreationDate"}
    style: Any = {"svg.hashsalt": run.file.name, "font.family": "sans-serif", "font.size": 9.0}
    with replacing(path) as temporary, mpl.rc_context(style):
        figure = drawn(run, panels)
        figure.savefig(temporary, format=kind, dpi=130, metadata={dated[kind]: None} if kind in dated else None)
    return path


def drawn(run: Run, panels: Sequence[JointPanel]) -> Figure:
    """The whole figure; angles are in degrees."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = 2 if len(panels) == 4 else min(_COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    size = (max(_PANEL[0] * columns, 6.0), _PANEL[1] * rows + _HEAD)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)  # no window, and none of pyplot's global state
    every = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, panel in zip(every, panels, strict=False):
        draw_panel(axes, run, panel)
    units = {curve.unit for panel in panels for _, curve in panel.curves}
    for k, axes in enumerate(every):
        axes.set_visible(k < len(panels))
        if k + columns >= len(panels):
            axes.set_xlabel("time [s]")
        if k % columns and len(units) == 1:
            axes.set_ylabel("")
    filtered = "" if run.filtering is None else f", low-pass filtered at {run.filtering.cutoff:g} Hz"
    figure.suptitle(f"{run.file.name}: {len(run)} frames{filtered}", x=0.01, ha="left", fontweight="bold")
    entries = _legend(run, panels)
    figure.legend(handles=entries, loc="outside lower left", ncols=(3, 4, 8)[columns - 1], frameon=False)
    return figure


def draw_panel(axes: Axes, run: Run, panel: JointPanel) -> None:
    """The curves of a panel with their 90 % bands, other hypotheses, limits, and the frames that are not to be trusted;
    angles are in degrees. An unobserved joint is dotted."""
    _mark_flagged(axes, run)
    for side, curve in panel.curves:
        colour = web(ON_PAPER[side])
        _draw_hypotheses(axes, run, curve, colour)
        axes.fill_between(curve.time, curve.low, curve.high, color=colour, alpha=0.18, linewidth=0.0)
        marker, line = "." if len(curve.time) == 1 else "", "-" if curve.seen else ":"
        axes.plot(curve.time, curve.value, color=colour, linewidth=1.5, linestyle=line, marker=marker, zorder=3)
    if not all(curve.seen for _, curve in panel.curves):
        axes.text(0.02, 0.95, "not seen (dotted)", transform=axes.transAxes, va="top", fontsize="small")
    _dress(axes, panel)


def _draw_hypotheses(axes: Axes, run: Run, curve: JointAngle, colour: str) -> None:
    """The other hypotheses as thin lines, each led on from the one that it continues, the fainter the lighter it is."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import to_rgba

    lines, alphas = [], []
    for t in range(len(curve.time)):
        for k in np.flatnonzero(curve.weights[t] > _FAINT):
            before = run.mode_parent[t, k] if t else -1
            if k == run.path[t] and (t == 0 or before == run.path[t - 1]):
                continue  # the curve itself
            here = (curve.time[t], curve.hypotheses[t, k])
            start = (curve.time[t - 1], curve.hypotheses[t - 1, before]) if before >= 0 else here
            lines.append((start, here))
            alphas.append(0.25 + 0.75 * float(curve.weights[t, k]))
    colours = [to_rgba(colour, alpha) for alpha in alphas]
    axes.add_collection(LineCollection(lines, colors=colours, linewidths=0.9, capstyle="round", zorder=2))


def _mark_flagged(axes: Axes, run: Run) -> None:
    """Frames that are not to be trusted as upright stripes in the colour of their status."""
    time, status = run.time, run.status
    if not len(time):
        return
    middle = 0.5 * (time[1:] + time[:-1])
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    edges = np.concatenate([[time[0] - 0.5 * step], middle, [time[-1] + 0.5 * step]])
    starts = np.flatnonzero(np.concatenate([[True], status[1:] != status[:-1]]))
    for start, end in zip(starts, [*starts[1:], len(time)], strict=True):
        if (name := str(status[start])) in _FLAGS:
            axes.axvspan(edges[start], edges[end], **_FLAGS[name], linewidth=0.0, zorder=0)


def _dress(axes: Axes, panel: JointPanel) -> None:
    unit = panel.curves[0][1].unit
    shown = [part for _, c in panel.curves for part in (c.value, c.low, c.high, c.hypotheses[c.weights > _FAINT])]
    values = np.concatenate([part[np.isfinite(part)] for part in shown])
    low, high = float(values.min()), float(values.max())
    if high - low < _LEAST[unit]:
        low, high = 0.5 * (low + high - _LEAST[unit]), 0.5 * (low + high + _LEAST[unit])
    margin = 0.05 * (high - low)
    near = _NEAR_LIMIT * (high - low)
    for limit in {round(x, 9) for _, c in panel.curves for x in (c.lower, c.upper) if np.isfinite(x)}:
        if low - near <= limit <= high + near:
            axes.axhline(limit, color="0.55", linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
            low, high = min(low, limit), max(high, limit)
    axes.set_ylim(low - margin, high + margin)
    axes.set_title(panel.title.replace("_", " "), loc="left", fontsize=10.0, fontweight="bold")
    axes.set_ylabel({"deg": "degrees", "m": "metres"}[unit])
    axes.grid(True, color="0.92", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.01)


def _legend(run: Run, panels: Sequence[JointPanel]) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    sides = {side for panel in panels for side, _ in panel.curves}
    neither = "neither side" if len(sides) > 1 else "best hypothesis"
    entries: list[Any] = [
        Line2D([], [], color=web(colour), linewidth=1.5, label=neither if side == "trunk" else side)
        for side, colour in ON_PAPER.items()
        if side in sides
    ]
    if any(np.isfinite(c.low).any() for panel in panels for _, c in panel.curves):
        entries.append(Patch(color="0.5", alpha=0.3, linewidth=0.0, label="90 % interval"))
    if run.hypothesis_count > 1:
        entries.append(Line2D([], [], color="0.5", linewidth=0.8, label="other hypotheses"))
    if any(np.isfinite([c.lower, c.upper]).any() for panel in panels for _, c in panel.curves):
        entries.append(Line2D([], [], color="0.55", linewidth=0.8, linestyle=(0, (4, 3)), label="joint limit"))
    there = set(run.status.tolist())
    entries += [Patch(**_FLAGS[s], linewidth=0.0, label=f"{s} frames") for s in _FLAGS if s in there]
    return entries
