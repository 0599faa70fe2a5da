"""What `track` and `fit` are given with points in space: checked, and made into files of points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from humanoid.support.errors import InputError
from kinemode.inputs.declared import Declared
from kinemode.inputs.files import POINTS, check_exists
from kinemode.inputs.named import kept, named_paths
from kinemode.inputs.point_options import MARKERS, check_no_cameras
from kinemode.public.arguments import check_as

if TYPE_CHECKING:
    from kinemode.inputs.points import PointFiles


def point_files(given: Mapping[str, Any], declared: Declared) -> PointFiles:
    """Files of points, as `points`, `markers` and `unit` of the arguments name them.

    given: all arguments of `track` or `fit`. Raises InputError: one that is of cameras, which points are tracked
    without; a file that does not exist; none.
    """
    check_no_cameras(given)
    check_as("unit of length", unit=given["unit"])
    paths, static = (tuple(named_paths(kept(given[name]), POINTS).values()) for name in ("points", "static"))
    if not paths:
        raise InputError("points", "there are none", remedy="a .trc, .c3d, .npz, .npy or .csv")
    if Path(given[MARKERS]).suffix == ".toml":
        check_exists(given[MARKERS])
    from kinemode.inputs.points import PointFiles

    return PointFiles(paths, given[MARKERS], given["unit"], declared, static)
