"""When feet stand, over time: the probability of each heel and toe, and how high it is above the floor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.runs.contact import Contact
from humanoid.support.atomic import replacing
from viz.palette import ON_PAPER, web

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_ROW, _HEIGHTS, _WIDTH = 0.32, 2.2, 9.0  # inches
_FULL = 0.85  # of a row, where it stands for certain


def write_contact_plot(contact: Contact, path: str | Path) -> Path:
    """Write the picture as a PNG and return its path; raises InputError where it cannot be written."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    drawing = contact_drawing(contact)
    FigureCanvasAgg(drawing)
    with replacing(path) as temporary:
        drawing.savefig(temporary, format="png", dpi=110)
    return Path(path)


def contact_drawing(contact: Contact) -> Drawing:
    """The picture: a band for every point, as high as it probably stands, and the heights below."""
    from matplotlib.figure import Figure

    count = len(contact.names)
    drawing = Figure(figsize=(_WIDTH, _ROW * count + _HEIGHTS + 1.0), layout="constrained")
    bands, heights = drawing.subplots(2, 1, sharex=True, height_ratios=[_ROW * count, _HEIGHTS])
    above = 1e3 * contact.heights
    for k, name in enumerate(contact.names):
        colour = web(ON_PAPER["left" if name.startswith("left") else "right"])
        row = count - 1 - k
        bands.fill_between(contact.time, row, row + _FULL * contact.standing[:, k], color=colour, linewidth=0.0)
        style = "-" if name.endswith("heel") else ":"
        heights.plot(contact.time, above[:, k], color=colour, linestyle=style)
    bands.set_yticks(np.arange(count) + 0.5 * _FULL, [name.replace("_", " ") for name in reversed(contact.names)])
    doubt = f"\n{contact.remark}" if contact.remark else ""
    bands.set_title(f"probability of standing{doubt}")
    heights.axhline(0.0, color="black", linewidth=0.6)
    heights.set_ylabel("height above the floor [mm]")
    heights.set_xlabel("time [s]; heels are solid, toes dotted")
    return drawing
