"""The one way functions are compiled: numba with its cache on disk, wherever a cache can be written."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def jit(function: Function) -> Function:
    """Compile for plain arrays and numbers, `@jit` without brackets; compiled code is kept between runs.

    Numba keeps it in the package's folder or the user's cache folder and refuses the function where it can write to
    neither (an installation by root, a container without a home). Then it goes to the folder for temporary files, and
    where that is closed too every process compiles anew.
    """
    try:
        return _njit(function, cache=True)
    except RuntimeError:  # "cannot cache function: no locator available"
        pass
    folder = _temporary_folder()
    if folder is None:
        return _njit(function, cache=False)
    config = cast(Any, numba.config)
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder)  # read while the decorator runs, so nobody else's functions move
    try:
        return _njit(function, cache=True)
    except RuntimeError:
        return _njit(function, cache=False)
    finally:
        config.CACHE_DIR = before


def _njit(function: Function, *, cache: bool) -> Function:
    return cast(Function, numba.njit(cache=cache, nogil=True, error_model="numpy")(function))


def _temporary_folder() -> Path | None:
    """A folder that only this user can write to: the cache is code, so nobody else may plant it."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"kinemode-compiled-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o022
    return folder if private and found.st_uid in (user, 0) else None
