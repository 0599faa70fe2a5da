"""Checks of the arguments of public functions: where one is of another kind, one line names the kinds that are taken.

Nothing is imported to check against: a value cannot be of a class whose module was never imported.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from humanoid.support.errors import InputError, misplaced, shown
from kinemode import kinds

_MOST = 2**63 - 1


def check_arguments(**given: Any) -> None:
    """Check arguments by the names that the functions of the front door give them.

    Raises
    ------
    InputError: one is of another kind; it names those that are taken.
    """
    for name, value in given.items():
        _check(name, value, name)


def check_as(kind: str, **given: Any) -> None:
    """Check arguments whose names mean something else in another function: as the argument `kind` is checked there."""
    for name, value in given.items():
        _check(name, value, kind)


def _check(name: str, value: Any, kind: str) -> None:
    fits, taken = _TAKEN[kind]
    if not fits(value):
        raise misplaced(name, value, taken)


def whole(name: str, value: Any, low: int) -> int:
    """A whole number that is at least `low`, of any integer type; raises InputError for anything else."""
    check_arguments(**{name: value})
    number = int(value)
    if not low <= number <= _MOST:
        problem = f"{shown(number)} {'is negative' if number < 0 else 'is too large'}"
        raise InputError(name, problem, remedy=f"{low} or more, at most {_MOST}")
    return number


def choice(name: str, value: Any, choices: tuple[str, ...]) -> None:
    """Raise InputError unless a text is one of the choices."""
    check_arguments(**{name: value})
    if value not in choices:
        raise InputError(name, f"{value!r} is unknown", remedy=f"one of {', '.join(choices)}")


_MAYBE_NUMBER = (kinds.or_none(kinds.is_number), "a number")
_TAKEN: dict[str, tuple[Callable[[Any], bool], str]] = {
    "subject": kinds.SUBJECT,
    "subject or none": (kinds.or_none(kinds.SUBJECT.fits), kinds.SUBJECT.taken),
    "cameras": kinds.CAMERAS,
    "time": (kinds.is_number, "a number of seconds"),
    "seed": kinds.WHOLE,
    "workers": kinds.WHOLE,
    "examples": kinds.WHOLE,
    "poses": kinds.WHOLE,
    "limbs": (kinds.are_texts, "a text with commas, or a list of names"),
    "frame": kinds.WHOLE,
    "port": kinds.WHOLE,
    "hands": kinds.FLAG,
    "overwrite": kinds.FLAG,
    "browser": kinds.FLAG,
    "videos": kinds.FLAG,
    "degrees": kinds.FLAG,
    "filter": _MAYBE_NUMBER,
    "progress": (kinds.or_none(callable), "a reporter such as kinemode.reported"),
    "path": (kinds.can_be_opened, "the path of a run file"),
    "run": (kinds.RUN, "a run, or the path of a run file"),
    "out": (kinds.or_none(kinds.can_be_opened), "the path of a file to write"),
    "file": (kinds.can_be_opened, "the path of a file to write"),
    "html": (kinds.or_none(kinds.can_be_opened), "the path of a file to write"),
    "plot": (kinds.or_none(kinds.can_be_opened), "the path of a file to write"),
    "folder": (kinds.can_be_opened, "the path of a folder to write into"),
    "clip": (kinds.is_path, "the path of a video or of a folder of images"),
    "keypoint file": (kinds.or_none(kinds.is_path), "the path of a keypoint file"),
    "one file": (kinds.or_none(kinds.is_path), "the path of a file"),
    "source": (kinds.is_whole, "the number of a camera, or the path of a video or of a folder of images"),
    "camera": (kinds.or_none(kinds.is_text), "the name of a camera"),
    "pictures": kinds.FILES,
    "square": (kinds.is_number, "a number"),
    "marker": _MAYBE_NUMBER,
    "size": (kinds.is_pair, 'a text such as "9x6", or two whole numbers'),
    "board": (kinds.is_text, "a text"),
    "lens": (kinds.is_text, "a text"),
    "format": (kinds.or_none(kinds.is_text), "a text"),
    "joints": (kinds.or_none(kinds.are_texts), "names of landmarks"),
    "joints of the body": (kinds.or_none(kinds.are_texts), "names of joints, or parts of them"),
    "motion": (kinds.is_path, "the name of a motion, or the path of a BVH, csv or npz file"),
    "proportions": (kinds.or_none(kinds.is_mapping), "a mapping of joints to scales"),
    "shape": (kinds.or_none(kinds.is_mapping), "a mapping of parts to nine parameters each"),
    "girth": (kinds.is_number, "a number"),
    "fps": (kinds.is_number, "a number"),
    "offset": (kinds.is_number, "a number of seconds"),
    "seconds": _MAYBE_NUMBER,
    "unit": _MAYBE_NUMBER,
    "up": (kinds.or_none(kinds.is_text), "a text"),
    "scene": (
        kinds.or_none(kinds.instance_of("estimator.synthesis.settings", "SceneSettings")),
        "kinemode.SceneSettings",
    ),
    "view": (kinds.or_none(kinds.instance_of("estimator.synthesis.settings", "ViewSettings")), "kinemode.ViewSettings"),
    "detector": (
        kinds.or_none(kinds.instance_of("estimator.synthesis.settings", "DetectorSettings")),
        "kinemode.DetectorSettings",
    ),
    "reference": (
        kinds.or_none(kinds.either(kinds.instance_of("estimator.runs.evaluation", "Reference"), kinds.is_path)),
        "a kinemode.Reference, or the path of an .npz, .trc, .c3d, .mot, .sto or .csv file",
    ),
}
"""By argument: whether a value is of a kind that is taken, and their names."""
