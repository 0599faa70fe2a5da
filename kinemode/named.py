"""Values given by name: files as [NAME=]PATH, values as [NAME=]VALUE, each for one camera or for all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from humanoid.support.errors import InputError

Value = TypeVar("Value")
PathLike = str | Path
_SHOWN = 60  # characters of user input that messages repeat
Named = PathLike | Iterable[PathLike] | Mapping[str, PathLike] | None


def named_paths(given: Named, what: str) -> dict[str, Path]:
    """Files by name, from `[NAME=]PATH` texts or a mapping; the name is the file's stem unless given.

    Raises InputError, calling the files `what`, where a name is empty or used twice or a file does not exist.
    """
    files: dict[str, Path] = {}
    for name, path, _ in _pairs(given, what):
        if not path.exists():
            raise InputError(path, f"no such {what}")
        if name in files:
            remedy = "give names: NAME=" + str(path)
            raise InputError(path, f"{what} {files[name]} has the name {name!r} too", remedy=remedy)
        files[name] = path
    return files


def kept(given: Named) -> Named:
    """The same, to be read more than once."""
    return given if given is None or isinstance(given, (str, Path, Mapping)) else list(given)


def chosen_names(given: Named, what: str) -> frozenset[str]:
    """The names that the user wrote; the others are stems of files."""
    return frozenset(name for name, _, chosen in _pairs(given, what) if chosen)


def _pairs(given: Named, what: str) -> list[tuple[str, Path, bool]]:
    """Name, path, and whether the name was written."""
    if given is None:
        return []
    if isinstance(given, Mapping):
        return [(str(name), Path(path), True) for name, path in given.items()]
    return [_name_and_path(p, what) for p in ([given] if isinstance(given, (str, Path)) else given)]


def _name_and_path(given: PathLike, what: str) -> tuple[str, Path, bool]:
    text = str(given)
    if Path(text).exists() or "=" not in text:  # a file may have = in its name
        return _stem(Path(text)), Path(text), False
    name, _, path = text.partition("=")
    if not name or not path:
        raise InputError(text, f"not a {what}", remedy="write NAME=PATH or PATH")
    return name, Path(path), True


def _stem(path: Path) -> str:
    return path.name if path.is_dir() else path.stem


def matched(
    names: Iterable[str],
    files: Mapping[str, Path],
    what: str,
    owner: str,
    *,
    chosen: frozenset[str] = frozenset(),
    every: bool = True,
) -> dict[str, Path]:
    """One file for each name, or for some unless `every` one needs it.

    A single file serves a single name even if it is called otherwise, unless its own name is one the user wrote, in
    `chosen`.
    """
    names = list(names)
    if len(names) == 1 and len(files) == 1 and not chosen & set(files):
        return {names[0]: next(iter(files.values()))}
    for name, path in files.items():
        if name not in names:
            remedy = f"{owner}s: {', '.join(names) or 'none'}; choose with NAME={path}"
            raise InputError(path, f"there is no {owner} {name!r} for this {what}", remedy=remedy)
    for name in names:
        if every and name not in files:
            raise InputError(name, f"this {owner} has no {what}", remedy=f"add {name}=FILE")
    return {name: files[name] for name in names if name in files}


def named_values(
    given: Any, names: Iterable[str], option: str, read: Callable[[Any], Value], needed: str
) -> dict[str, Value]:
    """A value for each camera that one is given for: from `[NAME=]VALUE` texts, a value for all, or a mapping by name.

    read, needed: see `value_of`. A value given by name overrides one given for all.

    Raises
    ------
    InputError: no such camera, no value, two values for one camera or for all.
    """
    names = list(names)
    for_all: dict[str, Value] = {}
    by_camera: dict[str, Value] = {}
    for camera, text in named_pairs(given):
        value = value_of(text, option, read, needed)
        if camera is not None and camera not in names:
            remedy = f"cameras: {', '.join(names)}"
            raise InputError(option, f"there is no camera {camera[:_SHOWN]!r}", remedy=remedy)
        values, cameras = (for_all, names) if camera is None else (by_camera, [camera])
        for name in cameras:
            if values.setdefault(name, value) != value:
                problem = f"camera {name!r} is given {str(values[name])[:_SHOWN]} and {str(value)[:_SHOWN]}"
                raise InputError(option, problem, remedy="choose one")
    return for_all | by_camera


def value_of(value: Any, option: str, read: Callable[[Any], Value], needed: str) -> Value:
    """The result of `read` for a value; raises InputError with what is `needed` where it fails."""
    try:
        return read(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(option, f"{str(value)[:_SHOWN]!r} cannot be used", remedy=needed) from None


def by_name(given: Any) -> bool:
    """Whether every value is for a camera that is named."""
    return all(name is not None for name, _ in named_pairs(given))


def words_of(given: Any) -> tuple[str, ...]:
    """The equivalent arguments of a command line."""
    return tuple(_word(value) if name is None else f"{name}={_word(value)}" for name, value in named_pairs(given))


def _word(value: Any) -> str:
    """A value as written: a size as WIDTHxHEIGHT."""
    return "x".join(map(str, value)) if isinstance(value, (tuple, list)) else str(value)


def named_pairs(given: Any) -> list[tuple[str | None, Any]]:
    """Values with the name that each is given for, None for all: the texts of a list one by one, a mapping by name."""
    if given is None:
        return []
    if isinstance(given, Mapping):
        return [(str(name), value) for name, value in given.items()]
    several = isinstance(given, (list, tuple, set, frozenset)) and all(isinstance(text, str) for text in given)
    pairs: list[tuple[str | None, Any]] = []
    for value in given if several else [given]:
        name, separator, text = value.partition("=") if isinstance(value, str) else ("", "", value)
        pairs.append((name, text) if separator else (None, value))
    return pairs
