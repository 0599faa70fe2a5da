"""What the user names: clips, keypoint files and cameras, matched by name, made into observations."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from humanoid.errors import InputError

PathLike = str | os.PathLike[str]
Named = PathLike | Iterable[PathLike] | Mapping[str, PathLike] | None


def named_paths(given: Named, what: str) -> dict[str, Path]:
    """Files by name, from `[NAME=]PATH` texts or a mapping; the name is the file's stem unless given.

    Raises InputError, calling the files `what`, where a name is empty or used twice or a file does not exist.
    """
    if given is None:
        return {}
    if isinstance(given, Mapping):
        pairs = [(str(name), Path(path)) for name, path in given.items()]
    else:
        pairs = [_name_and_path(p, what) for p in ([given] if isinstance(given, (str, os.PathLike)) else given)]
    found: dict[str, Path] = {}
    for name, path in pairs:
        if not path.exists():
            raise InputError(path, f"no such {what}")
        if name in found:
            remedy = "give names: NAME=" + str(path)
            raise InputError(path, f"{what} {found[name]} has the name {name!r} too", remedy=remedy)
        found[name] = path
    return found


def _name_and_path(given: PathLike, what: str) -> tuple[str, Path]:
    text = os.fspath(given)
    if Path(text).exists() or "=" not in text:  # a file may have = in its name
        return _stem(Path(text)), Path(text)
    name, _, path = text.partition("=")
    if not name or not path:
        raise InputError(text, f"not a {what}", remedy="write NAME=PATH or PATH")
    return name, Path(path)


def _stem(path: Path) -> str:
    return path.name if path.is_dir() else path.stem


def matched(names: Iterable[str], files: Mapping[str, Path], what: str, owner: str) -> dict[str, Path]:
    """One file for each name; a single file serves a single name whatever it is called."""
    names = list(names)
    if len(names) == 1 and len(files) == 1:
        return {names[0]: next(iter(files.values()))}
    for name, path in files.items():
        if name not in names:
            remedy = f"{owner}s: {', '.join(names)}; choose with NAME={path}"
            raise InputError(path, f"there is no {owner} {name!r} for this {what}", remedy=remedy)
    for name in names:
        if name not in files:
            raise InputError(name, f"this {owner} has no {what}", remedy=f"add {name}=FILE")
    return {name: files[name] for name in names}


def choose_camera(name: str, cameras: Mapping[str, Any], source: str, count: int) -> Any:
    """The camera of a clip, by its name; a file with one camera serves a single clip."""
    if name in cameras:
        return cameras[name]
    if count == 1 and len(cameras) == 1:
        return next(iter(cameras.values()))
    remedy = f"cameras: {', '.join(cameras)}; choose with NAME=PATH"
    raise InputError(source, f"there is no camera {name!r}", remedy=remedy)
