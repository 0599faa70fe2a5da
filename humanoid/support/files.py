"""Reading a file a user named."""

from __future__ import annotations

import hashlib
import sys
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
