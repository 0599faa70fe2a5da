"""The cache of compiled code: a folder for every state of the sources it was compiled from."""

from __future__ import annotations

import functools
import os
import shutil
import stat
import tempfile
import time
import uuid
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

KEPT = 4  # folders of one module, the one in use included: a few checkouts and branches side by side
UNUSED = 24 * 3600.0  # [s] since a process last took code from a folder, before which it stays


def cache_roots() -> Iterator[Path]:
    """Folders that may hold the cache, the best first: that of KINEMODE_CACHE, NUMBA_CACHE_DIR or the user's cache,
    then one among the temporary files."""
    given, numbas = os.environ.get("KINEMODE_CACHE"), os.environ.get("NUMBA_CACHE_DIR")
    if given or numbas:
        first: Path | None = Path(given) if given else Path(numbas or "", "kinemode")
    else:
        first = _users_cache()
    if first is not None:
        yield first
    last = _temporary_folder()
    if last is not None:
        yield last


@functools.cache
def source_folder(root: Path, module: str, digest: str) -> Path:
    """The folder for what is compiled from one state of a module's sources.

    Older ones of the module that have not been used for a day are removed. Raises OSError where the folder cannot be
    made.
    """
    folder = root.absolute() / f"{module}-{digest}"
    new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    tempfile.TemporaryFile(dir=folder).close()  # OSError where it cannot be written to
    os.utime(folder)  # when it was last used
    if new:
        _tidy(folder, module)
    return folder


def _tidy(used: Path, module: str) -> None:
    """Remove all but the last used folders of a module."""
    with suppress(OSError):  # another process does the same
        others = sorted((path.stat().st_mtime, path) for path in used.parent.glob(f"{module}-*") if path != used)
        for last, folder in others[: 1 - KEPT]:
            if last < time.time() - UNUSED:
                gone = folder.rename(used.with_name(f"removed-{uuid.uuid4().hex}"))
                shutil.rmtree(gone, ignore_errors=True)


def _users_cache() -> Path | None:
    given = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(given):
        return Path(given, "kinemode")
    home = os.path.expanduser("~")
    return Path(home, ".cache", "kinemode") if os.path.isabs(home) else None


def _temporary_folder() -> Path | None:
    """A folder that only this user can write to: the cache is code, so no other user may plant it."""
    user = os.getuid()
    folder = Path(tempfile.gettempdir()) / f"kinemode-compiled-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        about = folder.lstat()
    except OSError:
        return None
    private = stat.S_ISDIR(about.st_mode) and not about.st_mode & 0o022
    return folder if private and about.st_uid in (user, 0) else None
