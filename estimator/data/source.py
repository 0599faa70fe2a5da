"""What work over a whole sequence is given beside its observations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from estimator.data.image_cues import ImageCues

Progress = Callable[[int, int], None]
"""Is told how many instants of how many are done."""


class Cues(Protocol):
    """Where the pictures' cues come from (see `estimator.vision.likelihood.reader.CueReader`)."""

    def at(self, index: int) -> tuple[ImageCues, ...]:
        """The cues of every camera at a frame."""
        ...
