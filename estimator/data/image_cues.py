"""The image cues of one instant in one camera, by their names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from estimator.data.cameras.camera import Camera


@dataclass(frozen=True, eq=False)
class ImageCues(Mapping[str, Any]):
    """The evidence of one camera's image at one instant: the reading of each cue, by the cue's name.

    A cue that is not used, or has no reading for this image, is not in it: there is no flow at the first frame, no
    silhouette without a background.

    camera: at the working resolution, that of all maps. by_name: what was read. picture (H, W, 3) uint8 BGR: the frame
        at that resolution, read-only; None where it is unknown.
    """

    camera: Camera
    by_name: Mapping[str, Any] = field(default_factory=dict)
    picture: np.ndarray | None = None

    def __getitem__(self, name: str) -> Any:
        return self.by_name[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.by_name)

    def __len__(self) -> int:
        return len(self.by_name)

    def __bool__(self) -> bool:
        """True: an image was used, even where no cue has a reading for it."""
        return True

    def changed(self, **read: Any) -> ImageCues:
        """The same with other things read; None takes a cue out."""
        both = {**self.by_name, **read}
        return replace(self, by_name={name: value for name, value in both.items() if value is not None})
