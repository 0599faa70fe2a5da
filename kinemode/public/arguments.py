"""What the functions of the front door are given, checked: one line says what is taken where something else came.

Nothing is imported to check against: a value cannot be of a class whose module was never imported.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from humanoid.support.errors import InputError, misplaced, shown
from kinemode.inputs.arrays import are_pictures, is_array

_MOST = 2**63 - 1


def check_arguments(**given: Any) -> None:
    """Check arguments by the names that the functions of the front door give them.

    Raises
    ------
    InputError: one is of a kind that is not taken; it says which are.
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
        problem = f"{shown(number)} {'is negative' if number < 0 else 'cannot be'}"
        raise InputError(name, problem, remedy=f"{low} or more, at most {_MOST}")
    return number


def choice(name: str, value: Any, choices: tuple[str, ...]) -> None:
    """Raise InputError unless a text is one of the choices."""
    check_arguments(**{name: value})
    if value not in choices:
        raise InputError(name, f"{value!r} is unknown", remedy=f"one of {', '.join(choices)}")


def _of(module: str, name: str) -> Callable[[Any], bool]:
    """Whether a value is of a class, told by its module and name."""

    def fits(value: Any) -> bool:
        imported = sys.modules.get(module)
        return imported is not None and isinstance(value, getattr(imported, name))

    return fits


def _path(value: Any) -> bool:
    return isinstance(value, (str, Path)) and bool(str(value)) and "\0" not in str(value)


def _to_open(value: Any) -> bool:
    return _path(value) or isinstance(value, os.PathLike)


def _paths(value: Any) -> bool:
    """What `kinemode.inputs.named.named_paths` takes; a generator is left to it, since it can be read only once."""
    if value is None or _path(value) or hasattr(value, "__next__"):
        return True
    if isinstance(value, Mapping):
        return all(map(_path, value.values()))
    return _several(value, _path)


def _clips(value: Any) -> bool:
    """What `kinemode.inputs.arrays.Spool` takes."""
    if isinstance(value, Mapping):
        return all(_path(v) or are_pictures(v) or hasattr(v, "__next__") for v in value.values())
    return _paths(value) or are_pictures(value)


def _keypoints(value: Any) -> bool:
    if isinstance(value, Mapping):
        return all(_path(v) or is_array(v) for v in value.values())
    return _paths(value) or is_array(value)


def _pairs(value: Any) -> bool:
    named = isinstance(value, Mapping) and all(map(_text, (*value, *value.values())))
    return value is None or named or _texts(value)


def _several(value: Any, fits: Callable[[Any], bool]) -> bool:
    return isinstance(value, (list, tuple, set, frozenset)) and all(map(fits, value))


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _texts(value: Any) -> bool:
    return _text(value) or hasattr(value, "__next__") or _several(value, _text)


def _whole(value: Any) -> bool:
    return (isinstance(value, int) and not isinstance(value, bool)) or _of("numpy", "integer")(value)


def _flag(value: Any) -> bool:
    return isinstance(value, bool) or _of("numpy", "bool_")(value)


def _person(value: Any) -> bool:
    return _text(value) or (isinstance(value, int) and not isinstance(value, bool))


def _persons(value: Any) -> bool:
    """What `kinemode.inputs.persons.persons_of` takes."""
    named = isinstance(value, Mapping) and all(map(_person, value.values()))
    return _person(value) or named or _several(value, _text)


def _cameras(value: Any) -> bool:
    named = (
        isinstance(value, Mapping)
        and bool(value)
        and all(map(_of("estimator.data.cameras.camera", "Camera"), value.values()))
    )
    return value is None or _path(value) or named


def _pair(value: Any) -> bool:
    return _text(value) or (isinstance(value, (list, tuple)) and len(value) == 2 and all(map(_whole, value)))


def _number(value: Any) -> bool:
    return isinstance(value, float) or _whole(value) or _of("numpy", "floating")(value)


def _size(value: Any) -> bool:
    return isinstance(value, (tuple, list)) and len(value) == 2 and all(_whole(side) and side > 0 for side in value)


def _jitter(value: Any) -> bool:
    return _number(value) or (isinstance(value, Mapping) and all(map(_number, value.values())))


def _factors(value: Any) -> bool:
    return isinstance(value, Mapping)


def _either(*kinds: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: any(fits(value) for fits in kinds)


def _or_none(fits: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: value is None or fits(value)


_FILES = (_paths, "a path, a list of paths, or a mapping of names to paths")
_CAMERAS = (_cameras, "the path of a camera file, or a mapping of names to cameras")
_FLAG = (_flag, "True or False")
_WHOLE = (_whole, "a whole number")
_MAYBE_NUMBER = (_or_none(_number), "a number")
_SUBJECT = _either(_of("humanoid.subject.subject", "Subject"), _path)
_SUBJECT_TAKEN = "a subject from load_subject, a built-in name, or the path of a URDF"
_RUN = _either(_of("estimator.runs.run_reader", "Run"), _to_open)
_TAKEN: dict[str, tuple[Callable[[Any], bool], str]] = {
    "motion to follow": (
        _either(_RUN, _of("estimator.retargeting.source", "SourceMotion")),
        "a run, a SourceMotion, or the path of a file",
    ),
    "subject": (_SUBJECT, _SUBJECT_TAKEN),
    "subject or none": (_or_none(_SUBJECT), _SUBJECT_TAKEN),
    "clips": (
        _clips,
        "a path, a list of paths, an array (T, H, W, 3), an iterator of pictures, or a mapping of names to such",
    ),
    "keypoints": (_keypoints, "a path, a list of paths, an array (T, K, 3), or a mapping of names to such"),
    "points": _FILES,
    "static": _FILES,
    "markers": (_path, "the name of a set of markers, or the path of a TOML file"),
    "unit of length": (_or_none(_text), "a text"),
    "masks": _FILES,
    "background": _FILES,
    "depth": _FILES,
    "stereo": (_pairs, "a text LEFT=RIGHT, a list of such texts, or a mapping of left cameras to right ones"),
    "cameras": _CAMERAS,
    "lenses": _CAMERAS,
    "settings": (
        _or_none(lambda value: isinstance(value, Mapping) or _path(value)),
        "a nested mapping, or the path of a TOML file",
    ),
    "cues": (_texts, 'a text such as "edges,flow", or a list of texts'),
    "trackers": (_texts, 'a text such as "css,single-mode", or a list of texts'),
    "tracker": (_or_none(_text), "a text"),
    "layout": (_texts, 'the name of a layout such as "mediapipe33", or a list of names'),
    "image_size": (_or_none(_size), "(width, height) in pixels"),
    "jitter": (_or_none(_jitter), "a number of pixels, or a mapping of camera names to numbers"),
    "lag": _WHOLE,
    "time": (_number, "a number of seconds"),
    "fit": (_text, "a text"),
    "sync": (_text, "a text"),
    "person": (_persons, '"auto", a number, the id of a person, or a mapping of camera names to them'),
    "modes": (_or_none(_whole), "a whole number"),
    "seed": _WHOLE,
    "workers": _WHOLE,
    "people": _WHOLE,
    "detect": (
        _either(_flag, _text, lambda value: isinstance(value, Mapping)),
        "True, the name of a detector, or a mapping of kinemode.detect's arguments",
    ),
    "examples": _WHOLE,
    "poses": _WHOLE,
    "limbs": (_texts, "a text with commas, or a list of names"),
    "index": (_or_none(_path), "the path of an index that train_index wrote"),
    "frame": _WHOLE,
    "port": _WHOLE,
    "hands": _FLAG,
    "resume": _FLAG,
    "overwrite": _FLAG,
    "open_browser": _FLAG,
    "videos": _FLAG,
    "degrees": _FLAG,
    "filter": _MAYBE_NUMBER,
    "progress": (_or_none(callable), "a reporter such as kinemode.reported"),
    "path": (_to_open, "the path of a run file"),
    "run": (_RUN, "a run, or the path of a run file"),
    "out": (_or_none(_to_open), "the path of a file to write"),
    "file": (_to_open, "the path of a file to write"),
    "html": (_or_none(_to_open), "the path of a file to write"),
    "plot": (_or_none(_to_open), "the path of a file to write"),
    "folder": (_to_open, "the path of a folder to write into"),
    "clip": (_path, "the path of a video or of a folder of images"),
    "keypoint file": (_or_none(_path), "the path of a keypoint file"),
    "one file": (_or_none(_path), "the path of a file"),
    "source": (_whole, "the number of a camera, or the path of a video or of a folder of images"),
    "realtime": _FLAG,
    "show": _FLAG,
    "camera": (_or_none(_text), "the name of a camera"),
    "pictures": _FILES,
    "square": (_number, "a number"),
    "marker": _MAYBE_NUMBER,
    "size": (_pair, 'a text such as "9x6", or two whole numbers'),
    "board": (_text, "a text"),
    "lens": (_text, "a text"),
    "format": (_or_none(_text), "a text"),
    "joints": (_or_none(_texts), "names of landmarks"),
    "joints of the body": (_or_none(_texts), "names of joints, or parts of them"),
    "motion": (_path, "the name of a motion, or the path of a BVH, csv or npz file"),
    "proportions": (_or_none(_factors), "a mapping of joints to scales"),
    "shape": (_or_none(_factors), "a mapping of parts to nine parameters each"),
    "girth": (_number, "a number"),
    "fps": (_number, "a number"),
    "offset": (_number, "a number of seconds"),
    "seconds": _MAYBE_NUMBER,
    "height": _MAYBE_NUMBER,
    "unit": _MAYBE_NUMBER,
    "up": (_or_none(_text), "a text"),
    "focal": (_or_none(_text), "a text"),
    "floor": (_either(_number, _text), 'a height [m], "off" or "auto"'),
    "phone": (_or_none(_text), "a text"),
    "scene": (_or_none(_of("estimator.synthesis.settings", "SceneSettings")), "kinemode.SceneSettings"),
    "view": (_or_none(_of("estimator.synthesis.settings", "ViewSettings")), "kinemode.ViewSettings"),
    "detector": (_or_none(_of("estimator.synthesis.settings", "DetectorSettings")), "kinemode.DetectorSettings"),
    "reference": (
        _or_none(_either(_of("estimator.runs.evaluation", "Reference"), _path)),
        "a kinemode.Reference, or the path of an .npz, .trc, .c3d, .mot, .sto or .csv file",
    ),
}
"""By argument: whether a value is of a kind that is taken, and what to say of those that are."""
