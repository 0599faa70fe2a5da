"""Keypoints of one person by a detector, picture by picture."""

from __future__ import annotations

import numpy as np

from kinemode.detection.detectors import DetectorChoice
from kinemode.detection.people import People
from kinemode.detection.process import DetectorProcess


class Detecting:
    """A running detector as a source of keypoints; a context manager, which ends it.

    It keeps to the person who was largest at first, and takes who is largest then where nobody has that number any
    more.

    Raises
    ------
    InputError: a detector that cannot be had or fails.
    """

    def __init__(self, wanted: DetectorChoice) -> None:
        self._process = DetectorProcess(wanted)
        self._people = People(wanted.most)
        self._person: int | None = None

    @property
    def layout(self) -> str | tuple[str, ...]:
        """What its keypoints are called, as a name or one by one; "auto": their count tells."""
        names = self._process.names
        return self._process.layout or (tuple(names) if names else "auto")

    def __enter__(self) -> Detecting:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.close()

    def __call__(self, picture: np.ndarray, time: float, /) -> np.ndarray | None:
        """See `kinemode.streams.sources.KeypointSource`."""
        seen = self._people.see(self._process, picture)
        if self._person not in self._people.lost and self._person not in seen:
            self._person = max(seen, key=lambda number: _size(seen[number]), default=None)
        return None if self._person is None else seen.get(self._person)


def _size(points: np.ndarray) -> float:
    return float(np.hypot(*np.ptp(points[:, :2], axis=0)))
