"""When feet stand, over time: the probability of each heel and toe, and how high it is above the floor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.runs.contact import Contact
from estimator.runs.events import Event
from humanoid.support.files import replacing
from viz.palette import ON_PAPER, web

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_ROW, _HEIGHTS, _WIDTH = 0.32, 2.2, 9.0  # inches
_FULL = 0.85  # of a row, where it stands for certain
_MARKS = {"strike": "v", "off": "^"}
_MARK_SIZE = 5.0  # points


def write_contact_plot(contact: Contact, path: str | Path, events: Sequence[Event] = ()) -> Path:
    """Write the picture as a PNG and return its path; raises InputError where it cannot be written. events: of gait,
    marked."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    drawing = contact_drawing(contact, events)
    FigureCanvasAgg(drawing)
    with replacing(path) as temporary:
        drawing.savefig(temporary, format="png", dpi=110)
    return Path(path)


def contact_drawing(contact: Contact, events: Sequence[Event] = ()) -> Drawing:
    """The picture: a band for every point, as high as it probably stands, and the heights below. events: of gait, a
    mark in the band of the foot's first point, pointing down where it strikes and up where it leaves the ground."""
    from matplotlib.figure import Figure

    names, standing = contact.names, contact.standing
    if contact.hands is not None:
        names, standing = (*names, *contact.hand_names), np.concatenate([standing, contact.hands], axis=1)
    count = len(names)
    drawing = Figure(figsize=(_WIDTH, _ROW * count + _HEIGHTS + 1.0), layout="constrained")
    bands, heights = drawing.subplots(2, 1, sharex=True, height_ratios=[_ROW * count, _HEIGHTS])
    above = 1e3 * contact.heights
    for k, name in enumerate(names):
        colour = web(ON_PAPER["left" if name.startswith("left") else "right"])
        row = count - 1 - k
        bands.fill_between(contact.time, row, row + _FULL * standing[:, k], color=colour, linewidth=0.0)
        if k < len(contact.names):
            style = "-" if name.endswith("heel") else ":"
            heights.plot(contact.time, above[:, k], color=colour, linestyle=style)
    for event in events:
        own = [k for k, name in enumerate(contact.names) if name.startswith(event.side)]
        for k in own[:1]:
            bands.plot(
                [event.time], [count - 1 - k + 0.5 * _FULL], color="black", linestyle="none", marker=_MARKS[event.kind],
                markersize=_MARK_SIZE, markeredgecolor="white",
            )  # fmt: skip
    bands.set_yticks(np.arange(count) + 0.5 * _FULL, [name.replace("_", " ") for name in reversed(names)])
    doubt = f"\n{contact.remark}" if contact.remark else ""
    marks = "; a mark down: the foot strikes, up: it leaves the ground" if events else ""
    belt = f"\nstanding on a belt of {contact.known_belt.described}" if contact.known_belt is not None else ""
    bands.set_title(f"probability of standing{marks}{belt}{doubt}")
    heights.axhline(0.0, color="black", linewidth=0.6)
    heights.set_ylabel("height above the floor [mm]")
    heights.set_xlabel("time [s]; heels are solid, toes dotted")
    return drawing
