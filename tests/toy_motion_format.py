"""A motion format of another package: one line a landmark. Registered by being imported."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimator.retargeting.source import SourceMotion
from kinemode.inputs.motions import MotionFormat, SourceOptions, register


def read(path: Path, given: SourceOptions) -> SourceMotion:
    """Lines of time [s], landmark, x, y, z [m], z up."""
    rows = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    times, names = sorted({float(row[0]) for row in rows}), list(dict.fromkeys(row[1] for row in rows))
    points = np.full((len(times), len(names), 3), np.nan)
    for time, name, *place in rows:
        points[times.index(float(time)), names.index(name)] = list(map(float, place))
    return SourceMotion(tuple(names), points, np.array(times), path.name)


register(MotionFormat("motion lines", lambda path: path.suffix == ".motion", read))
