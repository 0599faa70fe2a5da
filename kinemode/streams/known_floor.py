"""What is known of the floor under a stream."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from estimator.data.floor import OFF, KnownFloor
from estimator.data.formats.cameras import declared_floor
from humanoid.support.errors import InputError
from kinemode.inputs.declared import Declared

if TYPE_CHECKING:
    from kinemode.inputs.files import Cameras


def stream_floor(floor: float | str, cameras: Cameras, lag: int, placed: bool) -> KnownFloor:
    """What the user says, or a camera file; nothing is found in a stream.

    placed: whether a camera was given, which places the world. lag: frames that are smoothed.

    Raises
    ------
    InputError: no height, one without a camera, or without a lag.
    """
    told = Declared(floor=floor).known_floor()
    if told is None:
        return declared_floor(cameras) if lag and isinstance(cameras, (str, Path)) else None
    if told != OFF and not placed:
        raise InputError("floor", "is of the cameras' world, and none is given", remedy="leave it out, or off")
    if told != OFF and not lag:
        raise InputError("floor", "is kept by smoothing, which there is none of", remedy="give a lag, as 8 frames")
    return told
