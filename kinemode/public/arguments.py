"""Checks of the arguments of public functions: where one is of another kind, one line names the kinds that are taken.

Nothing is imported to check against: a value cannot be of a class whose module was never imported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
_RUN = kinds.either(kinds.instance_of("estimator.runs.run_reader", "Run"), kinds.can_be_opened)
_TAKEN: dict[str, tuple[Callable[[Any], bool], str]] = {
    "motion to follow": (
        kinds.either(_RUN, kinds.instance_of("estimator.retargeting.source", "SourceMotion")),
        "a run, a SourceMotion, or the path of a file",
    ),
    "subject": kinds.SUBJECT,
    "subject or none": (kinds.or_none(kinds.SUBJECT.fits), kinds.SUBJECT.taken),
    "clips": (
        kinds.are_clips,
        "a path, a list of paths, an array (T, H, W, 3), an iterator of pictures, or a mapping of names to such",
    ),
    "keypoints": (kinds.are_keypoints, "a path, a list of paths, an array (T, K, 3), or a mapping of names to such"),
    "points": kinds.FILES,
    "static": kinds.FILES,
    "markers": (kinds.is_path, "the name of a set of markers, or the path of a TOML file"),
    "unit of length": (kinds.or_none(kinds.is_text), "a text"),
    "masks": kinds.FILES,
    "background": kinds.FILES,
    "depth": kinds.FILES,
    "stereo": (kinds.are_pairs, "a text LEFT=RIGHT, a list of such texts, or a mapping of left cameras to right ones"),
    "cameras": kinds.CAMERAS,
    "lenses": kinds.CAMERAS,
    "settings": (
        kinds.or_none(lambda value: isinstance(value, Mapping) or kinds.is_path(value)),
        "a nested mapping, or the path of a TOML file",
    ),
    "cues": (kinds.are_texts, 'a text such as "edges,flow", or a list of texts'),
    "trackers": (kinds.are_texts, 'a text such as "css,single-mode", or a list of texts'),
    "tracker": (kinds.or_none(kinds.is_text), "a text"),
    "layout": (kinds.are_texts, 'the name of a layout such as "mediapipe33", or a list of names'),
    "image_size": (kinds.or_none(kinds.is_size), "(width, height) in pixels"),
    "jitter": (kinds.or_none(kinds.is_jitter), "a number of pixels, or a mapping of camera names to numbers"),
    "lag": kinds.WHOLE,
    "time": (kinds.is_number, "a number of seconds"),
    "fit": (kinds.is_text, "a text"),
    "sync": (kinds.is_text, "a text"),
    "person": (kinds.are_persons, '"auto", a number, the id of a person, or a mapping of camera names to them'),
    "modes": (kinds.or_none(kinds.is_whole), "a whole number"),
    "seed": kinds.WHOLE,
    "workers": kinds.WHOLE,
    "people": kinds.WHOLE,
    "detect": (
        kinds.either(kinds.is_flag, kinds.is_text, lambda value: isinstance(value, Mapping)),
        "True, the name of a detector, or a mapping of kinemode.detect's arguments",
    ),
    "examples": kinds.WHOLE,
    "poses": kinds.WHOLE,
    "limbs": (kinds.are_texts, "a text with commas, or a list of names"),
    "index": (kinds.or_none(kinds.is_path), "the path of an index that train_index wrote"),
    "frame": kinds.WHOLE,
    "port": kinds.WHOLE,
    "hands": kinds.FLAG,
    "resume": kinds.FLAG,
    "overwrite": kinds.FLAG,
    "browser": kinds.FLAG,
    "videos": kinds.FLAG,
    "degrees": kinds.FLAG,
    "filter": _MAYBE_NUMBER,
    "progress": (kinds.or_none(callable), "a reporter such as kinemode.reported"),
    "path": (kinds.can_be_opened, "the path of a run file"),
    "run": (_RUN, "a run, or the path of a run file"),
    "out": (kinds.or_none(kinds.can_be_opened), "the path of a file to write"),
    "file": (kinds.can_be_opened, "the path of a file to write"),
    "html": (kinds.or_none(kinds.can_be_opened), "the path of a file to write"),
    "plot": (kinds.or_none(kinds.can_be_opened), "the path of a file to write"),
    "folder": (kinds.can_be_opened, "the path of a folder to write into"),
    "clip": (kinds.is_path, "the path of a video or of a folder of images"),
    "keypoint file": (kinds.or_none(kinds.is_path), "the path of a keypoint file"),
    "one file": (kinds.or_none(kinds.is_path), "the path of a file"),
    "source": (kinds.is_whole, "the number of a camera, or the path of a video or of a folder of images"),
    "realtime": kinds.FLAG,
    "show": kinds.FLAG,
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
    "height": _MAYBE_NUMBER,
    "unit": _MAYBE_NUMBER,
    "up": (kinds.or_none(kinds.is_text), "a text"),
    "focal": (kinds.or_none(kinds.is_text), "a text"),
    "floor": (kinds.either(kinds.is_number, kinds.is_text), 'a height [m], "off" or "auto"'),
    "phone": (kinds.or_none(kinds.is_text), "a text"),
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
