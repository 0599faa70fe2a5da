"""What `track` and `fit` are given with points in space: checked, and made into files of points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from humanoid.support.errors import InputError
from kinemode.inputs.declared import AUTO, Declared
from kinemode.inputs.files import check_exists
from kinemode.inputs.named import Named, PathLike, kept, named_paths
from kinemode.public.arguments import check_as

if TYPE_CHECKING:
    from kinemode.inputs.points import PointFiles

MARKERS = "markers"
_FITS = (AUTO, MARKERS, "off")
_FILE = "file of points"
_OF_CAMERAS: dict[str, Any] = {
    "clips": None, "cameras": None, "keypoints": None, "layout": AUTO, "masks": None, "background": None,
    "stereo": None, "depth": None, "person": AUTO, "keypoint_size": None, "keypoint_noise": None,
    "offset": None, "sync": "off",
    "focal": None, "phone": None, "lenses": None, "index": None, "detect": False, "height": None, "cues": AUTO,
}  # fmt: skip
"""Arguments that say something of cameras, or that only they leave open, with what they are where they are left out."""


def point_files(given: Mapping[str, Any], declared: Declared) -> PointFiles:
    """Files of points, as `points`, `markers` and `unit` of the arguments name them.

    given: all arguments of `track` or `fit`. Raises InputError: one that is of cameras, which points are tracked
    without; a file that does not exist; none.
    """
    for name, usual in _OF_CAMERAS.items():
        value = given.get(name, usual)
        plain = value[0] if isinstance(value, (tuple, list)) and len(value) == 1 else value
        if plain is not None and plain not in (usual, "off", (), []):
            raise InputError(name, "is of cameras, and points are given", remedy="leave one of them out")
    check_as("unit of length", unit=given["unit"])
    paths, static = (tuple(named_paths(kept(given[name]), _FILE).values()) for name in ("points", "static"))
    if not paths:
        raise InputError("points", "there are none", remedy="a .trc, .c3d, .npz, .npy or .csv")
    if Path(given[MARKERS]).suffix == ".toml":
        check_exists(given[MARKERS])
    from kinemode.inputs.points import PointFiles

    return PointFiles(paths, given[MARKERS], given["unit"], declared, static)


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
