"""A keypoint format of another package: one line a keypoint. Registered by being imported."""

from __future__ import annotations

import numpy as np

from estimator.data.formats.keypoints import register
from estimator.data.formats.keypoints_reading import KeypointFile, KeypointFormat, Person, Reading, as_landmarks


def is_lines(file: KeypointFile) -> bool:
    return file.start.startswith(b"# keypoints by line")


def read(file: KeypointFile, reading: Reading) -> None:
    """Lines of frame, name, x, y [px]."""
    rows = [line.split() for line in file.path.read_text(encoding="utf-8").splitlines()[1:]]
    names = list(dict.fromkeys(row[1] for row in rows))
    reading.layout, reading.names = "lines", as_landmarks(names)
    for frame in sorted({int(row[0]) for row in rows}):
        points = np.full((len(names), 3), [np.nan, np.nan, 0.0])
        for _, name, x, y in (row for row in rows if int(row[0]) == frame):
            points[names.index(name)] = float(x), float(y), 1.0
        reading.add(frame, [Person(points)])


register(KeypointFormat("lines", is_lines, read, of_json=False))
