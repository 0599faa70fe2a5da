"""`landmark_start`: a landmark template for a user's robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from humanoid.support.errors import InputError
from kinemode import kinds
from kinemode.checks import check_exists
from kinemode.named import PathLike
from kinemode.notices import warn
from kinemode.target import check_new

if TYPE_CHECKING:
    from kinemode.public.tracking import SubjectLike


def landmark_start(subject: SubjectLike, *, out: PathLike | None = None) -> str:
    """The text of a landmark template for a URDF, to be checked and completed; it loads unchanged.

    It has a landmark at every joint (under COCO's names where the names of the links identify a person's joints, the
    rest in comments), the tips of the last links, and stabilisers in comments.

    Parameters
    ----------
    subject: the path of a URDF, a robot of example-robot-data by name, or a loaded subject. Missing meshes are left
        out; landmarks that it has from a landmark file do not count.
    out: a file to write it to. `load_subject` finds NAME.landmarks.toml next to NAME.urdf, and takes any other by
        `landmarks=`.

    Raises
    ------
    InputError: no such subject, one with landmarks in its URDF, a file that is there already or cannot be written.
    """
    kinds.check(subject=(subject, kinds.SUBJECT), out=(out, kinds.NEW_FILE))
    if isinstance(subject, (str, Path)) and Path(subject).suffix:  # no name: before what loads URDFs is imported
        check_exists(subject)
    if out is not None:
        check_new(Path(out))
    from humanoid.shape import landmark_start as beginning
    from humanoid.subject.subject import Subject, load_subject
    from humanoid.subject.urdf_edit import NO_LANDMARKS
    from humanoid.support.files import replacing

    loaded = subject if isinstance(subject, Subject) else load_subject(subject)
    if not isinstance(subject, Subject):
        _check_without_landmarks(str(subject))
    for note in loaded.notes:
        if note != NO_LANDMARKS:
            warn(note)
    text = beginning.landmark_start(loaded)
    if out is not None:
        with replacing(out) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return text


def _check_without_landmarks(source: str) -> None:
    """Raise InputError where a URDF has landmarks of its own: they would go before those of a file."""
    from humanoid.subject.subject import BUILT_IN
    from humanoid.subject.urdf_document import read_document
    from humanoid.support.files import read_bytes

    own = source in BUILT_IN
    if not own and Path(source).is_file():
        own = read_document(read_bytes(Path(source)), source).root.find("landmark") is not None
    if own:
        raise InputError(source, "has landmarks in its URDF, which needs no landmark file", remedy="change them there")


def marker_start(points: PathLike, *, begin: PathLike | None = None, out: PathLike | None = None) -> str:
    """The text of a set of markers with the names of a file of points, to be checked and completed.

    Markers known to a built-in set have their places on human34; the others are comments, with ? for their link.

    Parameters
    ----------
    points: a .trc, .c3d, .npz, .npy or .csv file; its unit and axes do not matter.
    begin: the set whose places take precedence over those of the others, a built-in one by name or a file.
    out: a file to write it to.

    Raises
    ------
    InputError: a file that cannot be read, or has no names; no such set; a file that exists already or cannot be
        written.
    """
    kinds.check(points=(points, kinds.FILE), begin=(begin, kinds.ONE_FILE), out=(out, kinds.NEW_FILE))
    check_exists(points)
    if out is not None:
        check_new(Path(out))
    from estimator.data.markers.load import point_names
    from humanoid.subject.marker_start import marker_start as beginning
    from humanoid.subject.subject import load_subject
    from humanoid.support.files import replacing

    model = load_subject("human34").model
    links = [frame.name for frame in model.frames if frame.type.name == "BODY" and not frame.name.endswith("_link")]
    text = beginning(point_names(points), Path(points).name, links, None if begin is None else str(begin))
    if out is not None:
        with replacing(out) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return text
