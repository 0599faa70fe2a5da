"""Forces over time: what each foot carries, and the moments of the legs, with 90 % bands."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.runs.forces import Forces
from humanoid.support.files import replacing
from viz.palette import ON_PAPER, web

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

_WIDTH, _ROW = 9.0, 1.9  # inches
_LETTERS = 100  # in a line of the title
_AXES = ("forwards", "to the left", "upwards")
_ORDER = (2, 0, 1)
_SHADE = 0.2
_WANTED = ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")
_MOST = 6


def write_forces_plot(forces: Forces, path: str | Path) -> Path:
    """Write the picture as a PNG and return its path; raises InputError where it cannot be written."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    drawing = forces_drawing(forces)
    FigureCanvasAgg(drawing)
    with replacing(path) as temporary:
        drawing.savefig(temporary, format="png", dpi=110)
    return Path(path)


def forces_drawing(forces: Forces) -> Drawing:
    """The picture: forces of the feet and of a seat in percent of the weight, along the way the body faces, to its left
    and upwards, then moments by joint, per kilogram."""
    from matplotlib.figure import Figure

    joints = _joints(forces)
    count = (3 if forces.feet else 0) + len(joints)
    drawing = Figure(figsize=(_WIDTH, _ROW * count + 0.8), layout="constrained")
    rows = np.atleast_1d(drawing.subplots(count, 1, sharex=True))
    if forces.feet:
        force, band = (forces.in_percent(part) for part in (forces.force_in_facing, forces.interval("force_in_facing")))
        seat = forces.in_percent(forces.in_facing(forces.seat[:, None]))[:, 0]
        for row, axis in zip(rows[:3], _ORDER, strict=True):
            for k, foot in enumerate(forces.feet):
                _curve(row, forces.time, force[:, k, axis], band[:, :, k, axis], foot)
            if np.nanmax(np.abs(forces.seat), initial=0.0) > 0.02 * forces.weight:
                row.plot(forces.time, seat[:, axis], color=web(ON_PAPER["trunk"]), label="seat")
            row.set_ylabel(f"{_AXES[axis]} [% weight]")
        rows[0].legend(loc="upper right", ncols=3, frameon=False)
    per_kilogram = forces.moment / forces.mass.kilograms, forces.interval("moment") / forces.mass.kilograms
    for row, (joint, places) in zip(rows[count - len(joints) :], joints.items(), strict=True):
        for side, j in places:
            _curve(row, forces.time, per_kilogram[0][:, j], per_kilogram[1][:, :, j], side)
        row.set_ylabel(f"{joint.replace('_', ' ')}\n[{forces.units[places[0][1]]}/kg]")
    doubts = textwrap.wrap(forces.remark, _LETTERS)
    rows[0].set_title("\n".join([f"{forces.mass.kilograms:.0f} kg, {forces.mass.source}; shaded: 90 %", *doubts]))
    rows[-1].set_xlabel("time [s]")
    return drawing


def _curve(row: Axes, time: np.ndarray, value: np.ndarray, band: np.ndarray, side: str) -> None:
    colour = web(ON_PAPER[side])
    row.fill_between(time, band[0], band[1], color=colour, alpha=_SHADE, linewidth=0.0)
    row.plot(time, value, color=colour, linewidth=1.0, label=f"{side} foot")
    row.axhline(0.0, color="black", linewidth=0.4)


def _joints(forces: Forces) -> dict[str, list[tuple[str, int]]]:
    """Sides and places of the joints that are drawn, by their names without a side: flexion of the legs, or the first
    of a body without them."""
    joints: dict[str, list[tuple[str, int]]] = {}
    wanted = [name for name in forces.names if name.split("_", 1)[-1] in _WANTED] or list(forces.names[:_MOST])
    for name in wanted:
        side, _, rest = name.partition("_")
        own = (side, rest) if side in ("left", "right") else ("trunk", name)
        joints.setdefault(own[1], []).append((own[0], forces.names.index(name)))
    return joints
