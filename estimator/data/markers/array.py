"""Points over time from an array alone: .npy of (frames, points, 3), as FreeMoCap writes them.

FreeMoCap's arrays have MediaPipe's body in its order, 33 points (`mediapipe_body_3d_xyz.npy`), or 553 with both hands
and the face after it (`mediaPipeSkel_3d_body_hands_face.npy`), in millimetres; they have no names, unit or times.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimator.data.formats.keypoints_names import naming_beside, places_of_names
from estimator.data.formats.npz import read_npy
from estimator.data.formats.point_arrays import number_array
from estimator.data.markers.track import PointFile
from humanoid.subject.landmarks import FORMATS
from humanoid.support.errors import InputError

_BODY = FORMATS["mediapipe33"]
_COUNTS = (len(_BODY), 553)  # of the body, and with 21 points of each hand and 478 of the face after it


def read_point_array(path: Path) -> PointFile:
    """Read an array of points (T, M, 3). Their names are those beside the file (`walk.names.txt`, see
    `estimator.data.formats.keypoints_names`), else MediaPipe's of 33 or 553 points; the others are left out, with a
    note.

    Raises
    ------
    InputError: no array of numbers of this shape, or of another count of points without names beside it.
    """
    points = number_array(read_npy(path), path, "")
    if points.ndim != 3 or points.shape[2] != 3:
        raise InputError(path, f"has the shape {points.shape}", remedy="(frames, points, 3) is needed")
    count = points.shape[1]
    naming = naming_beside(path)
    if naming.names is not None and len(naming.names) != count:
        raise InputError(naming.source or path, f"has {len(naming.names)} names, the points are {count}")
    if naming.names is None and count not in _COUNTS:
        counts = " or ".join(map(str, _COUNTS))
        remedy = f"{counts} are MediaPipe's, as FreeMoCap writes them; name others in {places_of_names(path)}"
        raise InputError(path, f"has {count} points without names", remedy=remedy)
    time = np.full(len(points), np.nan)
    if naming.names is not None:
        return PointFile(path, naming.names, points, time)
    known = {name: i for i, name in enumerate(_BODY) if name is not None}
    others = f", {count - len(known)} that are not landmarks of the body left out"
    notes = (f"{path.name}: {count} points without names are read as MediaPipe's{others}",)
    return PointFile(path, tuple(known), points[:, list(known.values())], time, notes=notes)
