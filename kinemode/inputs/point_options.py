"""What may be said beside points in space, and what only beside them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from humanoid.support.errors import InputError
from kinemode.inputs.declared import AUTO
from kinemode.inputs.named import Named, PathLike

MARKERS = "markers"
_FITS = (AUTO, MARKERS, "off")
_OF_CAMERAS: dict[str, Any] = {
    "clips": None, "cameras": None, "keypoints": None, "layout": AUTO, "masks": None, "background": None,
    "stereo": None, "depth": None, "person": AUTO, "keypoint_size": None, "keypoint_noise": None,
    "offset": None, "sync": "off",
    "focal": None, "phone": None, "lenses": None, "index": None, "detect": False, "height": None, "cues": AUTO,
}  # fmt: skip
"""Arguments that say something of cameras, or that only they leave open, with what they are where they are left out."""


def check_no_cameras(given: Mapping[str, Any]) -> None:
    """Raise InputError for an argument of `track` or `fit`, of those given, that is of cameras: points are tracked
    without."""
    for name, usual in _OF_CAMERAS.items():
        value = given.get(name, usual)
        plain = value[0] if isinstance(value, (tuple, list)) and len(value) == 1 else value
        if plain is not None and plain not in (usual, "off", (), []):
            raise InputError(name, "is of cameras, and points are given", remedy="leave one of them out")


def check_fit(fit: str, *, points: bool) -> None:
    """Raise InputError for a fit by markers where there are none, or by lengths of keypoints where there are."""
    if points and fit not in _FITS:
        raise InputError("fit", f"{fit!r} is of keypoints, and points are given", remedy=f"one of {', '.join(_FITS)}")
    if not points and fit == MARKERS:
        raise InputError("fit", "no points are given", remedy="add --points FILE, or leave it out")


def check_static(fit: str) -> None:
    """Raise InputError for a static trial where nothing is fitted."""
    if fit not in (AUTO, MARKERS):
        raise InputError("--static", f"is for the fit, and fit is {fit!r}", remedy="use --fit markers, or leave it out")


def check_no_points(markers: PathLike, unit: str | None, static: Named) -> None:
    """Raise InputError for what is said of points where there are none."""
    for option, value, usual in (("--markers", markers, AUTO), ("--unit", unit, None), ("--static", static, None)):
        if value != usual:
            raise InputError(option, "is of points, and none are given", remedy="add --points FILE, or leave it out")
