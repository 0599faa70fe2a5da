"""`marker_start`: a set of markers to begin with, for a laboratory of one's own."""

from __future__ import annotations

from pathlib import Path

from kinemode.checks import check_exists
from kinemode.named import PathLike
from kinemode.public.arguments import check_arguments, check_as
from kinemode.target import check_new


def marker_start(points: PathLike, *, begin: PathLike | None = None, out: PathLike | None = None) -> str:
    """The text of a set of markers with the names of a file of points, to be looked through and completed.

    Markers that a built-in set knows have their places on human34; the others are in comments, with ? for their link.

    Parameters
    ----------
    points: a .trc, .c3d, .npz, .npy or .csv file; its unit and axes do not matter.
    begin: the set whose places go before those of the others, a built-in one by name or a file.
    out: a file to write it to.

    Raises
    ------
    InputError: a file that cannot be read, or has no names; no such set; a file that is there already or cannot be
        written.
    """
    check_as("out", points=points, begin=begin)
    check_arguments(out=out)
    check_exists(points)
    if out is not None:
        check_new(Path(out))
    from estimator.data.markers.load import point_names
    from humanoid.subject.marker_start import marker_start as beginning
    from humanoid.subject.subject import load_subject
    from humanoid.support.atomic import replacing

    model = load_subject("human34").model
    links = [frame.name for frame in model.frames if frame.type.name == "BODY" and not frame.name.endswith("_link")]
    text = beginning(point_names(points), Path(points).name, links, None if begin is None else str(begin))
    if out is not None:
        with replacing(out) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return text
