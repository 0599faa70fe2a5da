"""A rendered clip small enough to be tracked in a test."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import kinemode as km
from estimator.synthesis.settings import DetectorSettings, ViewSettings
from kinemode.shot import RenderedClip

FEW_STARTS: dict[str, Any] = {"start_samples": 2}
"""Changes to the settings of the search, which make a first frame fast."""
QUICK: dict[str, Any] = {
    "css": {"samples": 2, "jumps": 0, "modes": 2, "budget": {"searches": 8}},
    "search": FEW_STARTS,
    "cues": {"working_size": 160},
}
"""Changes to the settings that make a search fast."""
QUICK_BY_KEYPOINTS: dict[str, Any] = {name: QUICK[name] for name in ("css", "search")}
"""Those where no pictures are used."""


def tiny_clip(folder: Path, *, frames: int = 5, fps: float = 5.0) -> RenderedClip:
    """human34 reaching, 160 x 120 pixels, one camera, with masks, depth and the empty scene."""
    view = ViewSettings(image_size=(160, 120))
    detector = DetectorSettings(noise_px=0.6, outlier_fraction=0.0, missing_fraction=0.0)
    return km.render(
        folder, "reach", view=view, detector=detector, fps=fps, seconds=frames / fps, seed=3, masks=True, depths=True
    )


def named(clip: RenderedClip) -> dict[str, Any]:
    """The clip as `kinemode.track` takes it, with keypoints of its first frame alone."""
    return {"clips": clip.videos, "cameras": clip.cameras, "keypoints": clip.first_frame}
