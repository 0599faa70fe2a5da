"""Files: read with clear errors, and written whole or not at all."""

from __future__ import annotations

import errno
import hashlib
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from humanoid.support.errors import InputError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_BLOCK = 1 << 20


def read_bytes(path: Path, *, most: int = 20_000_000, remedy: str = "") -> bytes:
    """Content of a file of at most `most` bytes.

    Raises
    ------
    InputError: there is no such file (with `remedy`), it is a folder, too large, or cannot be read.
    """
    try:
        with path.open("rb") as file:
            content = file.read(most + 1)
    except FileNotFoundError as error:
        raise InputError(path, "there is no such file", remedy=remedy) from error
    except IsADirectoryError as error:
        raise InputError(path, "is a folder", remedy="give a file") from error
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(repr(str(path)), f"cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if len(content) > most:
        raise InputError(path, f"is larger than {most // 1_000_000} MB", remedy="give a smaller file")
    return content


def content_digest(file: IO[bytes]) -> str:
    """The SHA-256 of an open file's remaining content, which may not fit into memory."""
    total = hashlib.sha256()
    while block := file.read(_BLOCK):
        total.update(block)
    return total.hexdigest()


def read_toml(path: Path, *, remedy: str) -> dict[str, Any]:
    """Content of a TOML file.

    Raises
    ------
    InputError: it cannot be read, or is not TOML (with `remedy`).
    """
    try:
        return tomllib.loads(read_bytes(path).decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(path, f"is not TOML: {error}", remedy=remedy) from error


_NO_ROOM = "make room, or name a file on another disk"
_NOT_OURS = "name a file in a folder of your own"
REMEDIES = {
    errno.ENOENT: "does its folder exist?",
    errno.ENOTDIR: "does its folder exist?",
    errno.ENOSPC: _NO_ROOM,
    errno.EDQUOT: _NO_ROOM,
    errno.EFBIG: _NO_ROOM,
    errno.EROFS: _NOT_OURS,
    errno.EACCES: _NOT_OURS,
    errno.EPERM: _NOT_OURS,
}
"""Remedies for a file that cannot be written, by error number."""


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path`, moved onto it when the block ends well and all of it has reached the disk.

    Otherwise only the old file is left, unchanged.

    Raises
    ------
    InputError: naming `path` and the reason, where a file is not possible there, or writing fails.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise InputError(path, f"is a {'folder' if path.is_dir() else 'device'}, a file name is needed")
    temporary = _beside(path)
    try:
        yield temporary
        _to_disk(temporary)
        os.replace(temporary, path)
    except OSError as error:
        raise unwritable(path, error) from None
    finally:
        with suppress(OSError):
            temporary.unlink()


def unwritable(path: str | Path, error: OSError) -> InputError:
    """An operating system's refusal as an error of the file."""
    why = error.strerror or str(error) or type(error).__name__
    return InputError(path, f"cannot be written: {why}", remedy=REMEDIES.get(error.errno or 0, ""))


def _beside(path: Path) -> Path:
    """A new, empty file in the same folder; names may be 255 bytes long, and `path`'s own may need them."""
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name[:40]}.", suffix=".part", dir=path.parent)
    except OSError as error:
        raise unwritable(path, error) from None
    os.close(handle)
    return Path(name)


def _to_disk(path: Path) -> None:
    """Wait until the file's data are on the disk: network disks and quotas may refuse them as late as that."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
    os.chmod(path, 0o666 & ~_umask())  # mkstemp makes files that no other user may read


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
