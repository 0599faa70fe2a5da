"""Reading JSON of other programs, with errors that name file and place."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from humanoid.support.errors import InputError, near_names, nearest, shown
from humanoid.support.files import read_bytes

LARGEST = 1e7  # no length [m], pixel or coefficient comes near it
BEYOND = "has a number that is not finite, or at least 1e7 in size"
WITHIN = f"numbers are finite and below {LARGEST:g}"
_MOST_BYTES = 2_000_000_000  # hours of keypoints


def read_json(path: str | Path) -> Any:
    """The JSON value in a file; raises InputError with the line where it breaks off."""
    return parsed_json(read_text(path), path)


def parsed_json(text: str, path: str | Path) -> Any:
    """The JSON value of a text; `path` is where it is from."""
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise InputError(path, f"not valid JSON: {error.msg}", place=place) from None
    except (ValueError, RecursionError) as error:
        raise InputError(path, f"not usable JSON: {error}") from None


def read_text(path: str | Path) -> str:
    """The text of a file that has some."""
    return decoded(read_bytes(Path(path), most=_MOST_BYTES), path)


def decoded(content: bytes, path: str | Path) -> str:
    """The text that a file's content is."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(path, "is not text") from None
    if not text.strip():
        raise InputError(path, "is empty")
    return text


def mapping(value: Any, source: str | Path, place: str = "") -> Mapping[str, Any]:
    """`value`, which has to be a JSON object."""
    if not isinstance(value, dict):
        raise InputError(source, f"an object {{...}} is needed, found {_kind(value)}", place=place)
    return value


def sequence(value: Any, source: str | Path, place: str = "") -> list[Any]:
    """`value`, which has to be a JSON array."""
    if not isinstance(value, list):
        raise InputError(source, f"a list [...] is needed, found {_kind(value)}", place=place)
    return value


def member(value: Mapping[str, Any], key: str, source: str | Path, place: str) -> Any:
    """`value[key]`, which has to be there; `place` names `value` itself."""
    if key not in value:
        raise InputError(source, "is missing", place=f"{place}.{key}" if place else key)
    return value[key]


def check_members(
    entry: Mapping[str, Any], known: Collection[str], source: str | Path, place: str, *, near: bool = False
) -> None:
    """Refuse unknown members, except texts: nothing in a file may be ignored in silence.

    near: only those that may have been meant for a known one that is missing, for files in which tools keep more.

    Raises
    ------
    InputError: the first such member, with the nearest known ones.
    """
    missing = [name for name in known if name not in entry]
    for name, value in entry.items():
        told = value is not None and (near or not isinstance(value, str))
        if name in known or not told or (near and not near_names(name, missing)):
            continue
        remedy = nearest(name, missing if near_names(name, missing) else known, "members")
        raise InputError(source, f"the member {shown(name)} is unknown", place=place, remedy=remedy)


def numbers(value: Any, source: str | Path, place: str, *, finite: bool = True) -> np.ndarray:
    """An array of float64 from nested lists of numbers, of any shape."""
    try:
        array = np.array(value)
    except (ValueError, OverflowError):
        raise InputError(source, "the lists differ in length", place=place) from None
    if array.size and array.dtype.kind not in "iuf":
        culprit = _culprit(value)
        if culprit is None:  # whole numbers too large for any type of numpy's
            raise InputError(source, BEYOND, place=place, remedy=WITHIN)
        raise InputError(source, f"numbers are needed, found {_kind(culprit[0])}", place=place)
    array = array.astype(np.float64)
    if finite and not (np.abs(array) < LARGEST).all():
        raise InputError(source, BEYOND, place=place, remedy=WITHIN)
    return array


def number_between(value: Any, low: float, high: float, source: str | Path, place: str) -> float:
    """One number of a given range, ends included."""
    number = shaped(value, (), source, place)
    if not low <= number <= high:
        raise InputError(source, f"must be {low:g} to {high:g}, got {number:g}", place=place)
    return float(number)


def shaped(value: Any, shape: tuple[int, ...], source: str | Path, place: str) -> np.ndarray:
    """Finite numbers of a given shape."""
    array = numbers(value, source, place)
    if array.shape != shape:
        need, got = (" x ".join(map(str, s)) or "one" for s in (shape, array.shape))
        raise InputError(source, f"{need} numbers are needed, found {got}", place=place)
    return array


def _culprit(value: Any) -> tuple[Any] | None:
    """The first value in nested lists that is not a number, if any."""
    if isinstance(value, list):
        return next((culprit for v in value if (culprit := _culprit(v)) is not None), None)
    return None if isinstance(value, (int, float)) and not isinstance(value, bool) else (value,)


def _kind(value: Any) -> str:
    names = {dict: "an object", list: "a list", str: "text", bool: "true or false", type(None): "null"}
    return names.get(type(value), "a number")
