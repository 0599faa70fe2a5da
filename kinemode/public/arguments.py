"""What the functions of the front door are given, checked: one line says what is taken where something else came."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from estimator.cameras.camera import Camera
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError, misplaced, shown

_MOST = 2**63 - 1


def check_arguments(**given: Any) -> None:
    """Check arguments by their names, as `kinemode.track`, `fit`, `compare` and `open_run` call them.

    Raises
    ------
    InputError: one is of a kind that is not taken; it says which are.
    """
    for name, value in given.items():
        fits, taken = _TAKEN[name]
        if not fits(value):
            raise misplaced(name, value, taken)


def whole(name: str, value: Any, low: int) -> int:
    """A whole number that is at least `low`, of any integer type; raises InputError for anything else."""
    check_arguments(**{name: value})
    number = int(value)
    if not low <= number <= _MOST:
        problem = f"{shown(number)} {'is negative' if number < 0 else 'cannot be'}"
        raise InputError(name, problem, remedy=f"{low} or more, at most {_MOST}")
    return number


def _path(value: Any) -> bool:
    return isinstance(value, (str, Path)) and bool(str(value)) and "\0" not in str(value)


def _paths(value: Any) -> bool:
    """What `kinemode.inputs.named.named_paths` takes; a generator is left to it, since it can be read only once."""
    if value is None or _path(value) or hasattr(value, "__next__"):
        return True
    if isinstance(value, Mapping):
        return all(map(_path, value.values()))
    return _several(value, _path)


def _several(value: Any, fits: Callable[[Any], bool]) -> bool:
    return isinstance(value, (list, tuple, set, frozenset)) and all(map(fits, value))


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _texts(value: Any) -> bool:
    return _text(value) or hasattr(value, "__next__") or _several(value, _text)


def _whole(value: Any) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def _flag(value: Any) -> bool:
    return isinstance(value, (bool, np.bool_))


def _person(value: Any) -> bool:
    return _text(value) or (isinstance(value, int) and not isinstance(value, bool))


def _persons(value: Any) -> bool:
    """What `kinemode.inputs.persons.persons_of` takes."""
    named = isinstance(value, Mapping) and all(map(_person, value.values()))
    return _person(value) or named or _several(value, _text)


def _cameras(value: Any) -> bool:
    named = isinstance(value, Mapping) and bool(value) and all(isinstance(c, Camera) for c in value.values())
    return value is None or _path(value) or named


def _or_none(fits: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: value is None or fits(value)


_FILES = (_paths, "a path, a list of paths, or a mapping of names to paths")
_TAKEN: dict[str, tuple[Callable[[Any], bool], str]] = {
    "subject": (
        lambda value: isinstance(value, Subject) or _path(value),
        "a subject from load_subject, a built-in name, or the path of a URDF",
    ),
    "clips": _FILES,
    "keypoints": _FILES,
    "masks": _FILES,
    "background": _FILES,
    "cameras": (_cameras, "the path of a camera file, or a mapping of names to cameras"),
    "settings": (
        _or_none(lambda value: isinstance(value, Mapping) or _path(value)),
        "a nested mapping, or the path of a TOML file",
    ),
    "cues": (_texts, 'a text such as "edges,flow", or a list of texts'),
    "trackers": (_texts, 'a text such as "css,single-mode", or a list of texts'),
    "tracker": (_text, "a text"),
    "fit": (_text, "a text"),
    "person": (_persons, '"auto", a number, the id of a person, or a mapping of camera names to them'),
    "modes": (_or_none(_whole), "a whole number"),
    "seed": (_whole, "a whole number"),
    "workers": (_whole, "a whole number"),
    "resume": (_flag, "True or False"),
    "overwrite": (_flag, "True or False"),
    "progress": (_or_none(callable), "a reporter such as kinemode.terminal.progress.reported"),
    "path": (lambda value: _path(value) or isinstance(value, os.PathLike), "the path of a run file"),
    "out": (_or_none(lambda value: _path(value) or isinstance(value, os.PathLike)), "the path of a file to write"),
    "reference": (_or_none(_path), "the path of an .npz or .trc file"),
}
"""By argument: whether a value is of a kind that is taken, and what to say of those that are."""
