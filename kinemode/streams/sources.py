"""Where the keypoints of a live picture come from: a detector, or a file that is played back."""

from __future__ import annotations

import numpy as np

from estimator.data.formats.keypoints import load_keypoints
from estimator.vision.resolution import Size, fitted_track
from kinemode.detection.detectors import DetectorChoice
from kinemode.detection.people import People, Seen
from kinemode.detection.process import DetectorProcess
from kinemode.named import PathLike


class PlayedBack:
    """The keypoints of a file, by time.

    path: of the file. picture: size [px] of the pictures that it is played beside. rate: frames per second of these,
    for a file that declares none.

    Attributes
    ----------
    names (K): landmark of each keypoint, None where none corresponds. notes: for the user.

    Raises
    ------
    InputError: as `estimator.data.formats.keypoints.load_keypoints`; keypoints of pictures of another aspect.
    """

    def __init__(self, path: PathLike, name: str, picture: Size, rate: float) -> None:
        track = load_keypoints(path, image_size=picture)
        fitted, notes = fitted_track(name, track, track.image_size, picture)
        self.names, self.notes = fitted.names, (*track.notes, *notes)
        self._rate = track.fps or rate
        self._points = np.concatenate([fitted.pixels, fitted.confidence[..., None]], axis=2)

    def __call__(self, picture: np.ndarray, time: float, /) -> np.ndarray | None:
        """See `KeypointSource`: those of the frame nearest in time, None after the last."""
        frame = round(time * self._rate)
        return self._points[frame] if frame < len(self._points) else None


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
        """See `KeypointSource`."""
        seen = self._people.see(self._process, picture)
        if self._person not in self._people.lost and self._person not in seen:
            self._person = max(seen, key=lambda number: _size(seen[number]), default=None)
        return seen[self._person]["keypoints"] if self._person in seen else None


def _size(person: Seen) -> float:
    return float(np.hypot(*np.ptp(person["keypoints"][:, :2], axis=0)))
