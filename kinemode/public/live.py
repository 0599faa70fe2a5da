"""`live`: a camera or a file tracked while somebody watches."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from kinemode.checks import check_exists, check_together
from kinemode.kinds import is_path
from kinemode.option import takes
from kinemode.public.arguments import whole
from kinemode.public.detection import checked_detector
from kinemode.public.tracking import loaded_subject
from kinemode.request import LiveRequest
from kinemode.target import RunTarget

if TYPE_CHECKING:
    from kinemode.streams.session import Session


@takes(LiveRequest)
def live(request: LiveRequest) -> Session:
    """Track a camera, or a file as if it were one, with a preview that moves; until it ends, or Ctrl-C.

    An image that is overtaken by the next one while another is tracked is dropped.

    Parameters
    ----------
    OPTIONS

    Returns
    -------
    What became of it: images that were tracked and dropped, statuses, seconds.

    Raises
    ------
    InputError: no such camera or clip, a detector that cannot be had; and as `kinemode.Tracker`.
    """
    check_together(request)
    device = _device(request.source)
    if request.keypoints is None:
        checked_detector(request)
    elif is_path(request.keypoints):
        check_exists(str(request.keypoints))
    if request.out is not None:
        RunTarget(Path(request.out), False, request.overwrite).check()
    loaded = loaded_subject(request.subject)
    from kinemode.streams.job import track_live

    return track_live(loaded, device, request)


def _device(source: int | str | Path) -> int | Path:
    """The number of a camera, also as text, or the path of a clip that is there."""
    if not isinstance(source, (str, Path)):
        return whole("source", source, 0)
    if str(source).isdecimal():
        return int(str(source))
    check_exists(source)
    return Path(source)
