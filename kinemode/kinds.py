"""Kinds of values that arguments take: whether a value is one, and the kind's name for messages.

Nothing is imported to check against: a value cannot be of a class whose module was never imported.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from humanoid.support.errors import misplaced

if TYPE_CHECKING:
    import numpy as np


class KeypointSource(Protocol):
    """Finds one person's keypoints. A function will do."""

    def __call__(self, picture: np.ndarray, time: float, /) -> np.ndarray | None:
        """Keypoints (K, 3), x, y [px] and confidence, in a picture (H, W, 3) uint8 BGR taken at a time [s]; None where
        no person is seen."""
        ...


class Kind(NamedTuple):
    """A kind of values. fits: whether a value is one. taken: what may be given, for messages."""

    fits: Callable[[Any], bool]
    taken: str


def is_array(value: Any) -> bool:
    """Whether it is an array of numpy, which is not imported for that."""
    numpy = sys.modules.get("numpy")
    return numpy is not None and isinstance(value, numpy.ndarray)


def are_pictures(value: Any) -> bool:
    """Whether it is an array, or several in a list."""
    return is_array(value) or (isinstance(value, (list, tuple)) and bool(value) and all(map(is_array, value)))


def instance_of(module: str, name: str) -> Callable[[Any], bool]:
    """Whether a value is of a class, identified by its module and name."""

    def fits(value: Any) -> bool:
        imported = sys.modules.get(module)
        return imported is not None and isinstance(value, getattr(imported, name))

    return fits


def is_path(value: Any) -> bool:
    """Whether a value is a path as a text or a `Path`."""
    return isinstance(value, (str, Path)) and bool(str(value)) and "\0" not in str(value)


def can_be_opened(value: Any) -> bool:
    """Whether a value is a path of any kind."""
    return is_path(value) or isinstance(value, os.PathLike)


def are_paths(value: Any) -> bool:
    """An input of `kinemode.named.named_paths`; a generator is left to it, since it can be read only once."""
    if value is None or is_path(value) or hasattr(value, "__next__"):
        return True
    if isinstance(value, Mapping):
        return all(map(is_path, value.values()))
    return are_several(value, is_path)


def are_clips(value: Any) -> bool:
    """An input of `kinemode.inputs.arrays.Spool`."""
    if isinstance(value, Mapping):
        return all(is_path(v) or are_pictures(v) or hasattr(v, "__next__") for v in value.values())
    return are_paths(value) or are_pictures(value)


def are_keypoints(value: Any) -> bool:
    """An input of `kinemode.inputs.arrays.Spool`."""
    if isinstance(value, Mapping):
        return all(is_path(v) or is_array(v) for v in value.values())
    return are_paths(value) or is_array(value)


def are_pairs(value: Any) -> bool:
    """An input of `kinemode.inputs.load.pairs_of`."""
    named = isinstance(value, Mapping) and all(map(is_text, (*value, *value.values())))
    return value is None or named or are_texts(value)


def are_several(value: Any, fits: Callable[[Any], bool]) -> bool:
    """Whether a value is a collection of values that fit."""
    return isinstance(value, (list, tuple, set, frozenset)) and all(map(fits, value))


def is_text(value: Any) -> bool:
    """Whether a value is a text."""
    return isinstance(value, str)


def are_texts(value: Any) -> bool:
    """Whether a value is a text or several; a generator is left to its reader."""
    return is_text(value) or hasattr(value, "__next__") or are_several(value, is_text)


def is_whole(value: Any) -> bool:
    """Whether a value is a whole number of any integer type."""
    return (isinstance(value, int) and not isinstance(value, bool)) or instance_of("numpy", "integer")(value)


def is_flag(value: Any) -> bool:
    """Whether a value is True or False."""
    return isinstance(value, bool) or instance_of("numpy", "bool_")(value)


def is_person(value: Any) -> bool:
    """Whether a value names a person."""
    return is_text(value) or (isinstance(value, int) and not isinstance(value, bool))


def are_persons(value: Any) -> bool:
    """An input of `kinemode.inputs.declared.persons_of`."""
    named = isinstance(value, Mapping) and all(map(is_person, value.values()))
    return is_person(value) or named or are_several(value, is_text)


def are_cameras(value: Any) -> bool:
    """Whether a value is the path of a camera file, cameras by name, or none."""
    named = (
        isinstance(value, Mapping)
        and bool(value)
        and all(map(instance_of("estimator.data.cameras.camera", "Camera"), value.values()))
    )
    return value is None or is_path(value) or named


def is_pair(value: Any) -> bool:
    """Whether a value is a text or two whole numbers."""
    return is_text(value) or (isinstance(value, (list, tuple)) and len(value) == 2 and all(map(is_whole, value)))


def is_number(value: Any) -> bool:
    """Whether a value is a number of any type."""
    return isinstance(value, float) or is_whole(value) or instance_of("numpy", "floating")(value)


def is_size(value: Any) -> bool:
    """Whether a value is two sizes in pixels."""
    return isinstance(value, (tuple, list)) and len(value) == 2 and all(is_whole(side) and side > 0 for side in value)


def is_jitter(value: Any) -> bool:
    """Whether a value is a number, or numbers by name."""
    return is_number(value) or (isinstance(value, Mapping) and all(map(is_number, value.values())))


def is_mapping(value: Any) -> bool:
    """Whether a value is a mapping."""
    return isinstance(value, Mapping)


def either(*kinds: Callable[[Any], bool]) -> Callable[[Any], bool]:
    """Whether a value is of one of several kinds."""
    return lambda value: any(fits(value) for fits in kinds)


def or_none(fits: Callable[[Any], bool]) -> Callable[[Any], bool]:
    """Whether a value is of a kind, or None."""
    return lambda value: value is None or fits(value)


def settings(name: str) -> Kind:
    """Settings of a rendered scene, by the name of their class, or None."""
    return Kind(or_none(instance_of("estimator.synthesis.settings", name)), f"kinemode.{name}")


def check(**given: tuple[Any, Kind]) -> None:
    """Raise InputError for an argument, by its name, whose value is of another kind, with those that are taken."""
    for name, (value, kind) in given.items():
        if not kind.fits(value):
            raise misplaced(name, value, kind.taken)


FLAG = Kind(is_flag, "True or False")
WHOLE = Kind(is_whole, "a whole number")
NUMBER = Kind(is_number, "a number")
TEXT = Kind(is_text, "a text")
FILES = Kind(are_paths, "a path, a list of paths, or a mapping of names to paths")
FILE = Kind(can_be_opened, "the path of a file")
RUN_FILE = Kind(can_be_opened, "the path of a run file")
ONE_FILE = Kind(or_none(is_path), "the path of a file")
NEW_FILE = Kind(or_none(can_be_opened), "the path of a file to write")
MAYBE_NUMBER = Kind(or_none(is_number), "a number")
CAMERAS = Kind(are_cameras, "the path of a camera file, or a mapping of names to cameras")
SUBJECT = Kind(
    either(instance_of("humanoid.subject.subject", "Subject"), is_path),
    "a subject from load_subject, a built-in name, or the path of a URDF",
)
CHANGES = Kind(or_none(either(is_mapping, is_path)), "a nested mapping, or the path of a TOML file")
LAYOUT = Kind(are_texts, 'the name of a layout such as "mediapipe33", or a list of names')
NAMES = Kind(are_texts, 'a text such as "edges,flow", or a list of texts')
PERSONS = Kind(are_persons, '"auto", a number, the id of a person, or a mapping of camera names to them')
RUN = either(instance_of("estimator.runs.run_reader", "Run"), can_be_opened)
MOTION = Kind(
    either(RUN, instance_of("estimator.retargeting.source", "SourceMotion")),
    "a run, a SourceMotion, or the path of a file",
)
REPORTER = Kind(callable, "a reporter such as kinemode.reported")
REFERENCE = Kind(
    or_none(either(instance_of("estimator.runs.evaluation", "Reference"), is_path)),
    "a kinemode.Reference, or the path of an .npz, .trc, .c3d, .mot, .sto or .csv file",
)
