"""Names of keypoints where their file has none, or has unknown ones: a file beside it.

Beside walk.npy or walkDLC.csv it is walk.names.txt (a name a line), or walk.names.json: a list of names, or an object
that gives the file's own names ours, {"snout": "nose"}.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from estimator.data.formats.checked_json import mapping, read_json, read_text
from estimator.data.formats.keypoints_reading import Reading, as_landmarks, checked_names
from humanoid.subject.landmarks import FORMATS, landmark_name
from humanoid.support.errors import InputError, first_of, near_names, shown

_KNOWN = {name for names in FORMATS.values() for name in names if name is not None}
_ENDINGS = (".names.json", ".names.txt")


class Naming(NamedTuple):
    """names: of all keypoints in order, None for those of the file. of: ours by the file's own. source: where it
    stands, None where there is nothing beside the keypoints."""

    names: tuple[str, ...] | None = None
    of: dict[str, str] | None = None
    source: Path | None = None


def named_landmarks(own: Sequence[str], reading: Reading) -> tuple[str, ...]:
    """The landmark of each of a file's keypoint names, by the file beside it, else by the words; with a note on unknown
    names. Raises InputError for a renamed keypoint that the file does not have."""
    naming = naming_beside(reading.source)
    renamed = naming.of or {}
    unknown = [name for name in renamed if name not in own]
    if unknown:
        remedy = f"the keypoints are {', '.join(own)}"
        raise InputError(naming.source or "names", f"there is no keypoint {shown(unknown[0])}", remedy=remedy)
    names = as_landmarks([renamed.get(name, name) for name in own])
    for theirs, ours in renamed.items():
        if landmark_name(ours) is None and (meant := near_names(ours, _KNOWN, most=1)):
            reading.notes.say(f"{theirs} is called {shown(ours, 30)}, which is not a landmark of people: {meant[0]}?")
    foreign = [name for name in names if landmark_name(name) is None]
    if foreign and naming.of is None:
        some = first_of([shown(name, 30) for name in foreign], 8)
        beside = places_of_names(reading.source).partition(" or ")[0]
        reading.notes.say(f"keypoints with unknown names ({some}): {beside} can map them to landmarks")
    return names


def naming_beside(path: Path) -> Naming:
    """The names in a file beside a keypoint file; raises InputError where it is not a list or object of names."""
    for ending in _ENDINGS:
        beside = path.with_name(path.name.removesuffix(path.suffix) + ending)
        if beside.is_file():
            return _read(beside)
    return Naming()


def places_of_names(path: Path) -> str:
    """Files in which names are searched, for an error's remedy."""
    return " or ".join(path.name.removesuffix(path.suffix) + ending for ending in _ENDINGS)


def _read(path: Path) -> Naming:
    if path.suffix == ".txt":
        lines = [line.strip() for line in read_text(path).splitlines() if line.strip()]
        return Naming(checked_names(lines, path, ""), None, path)
    value = read_json(path)
    if isinstance(value, list):
        return Naming(checked_names(value, path, ""), None, path)
    renamed = mapping(value, path)
    checked_names(list(renamed.values()), path, "")
    return Naming(None, {str(k): str(v).strip() for k, v in renamed.items()}, path)
