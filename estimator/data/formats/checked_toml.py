"""Reading TOML that someone else wrote: what is wrong is said with file and place."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from humanoid.support.errors import InputError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def parsed_toml(content: bytes, source: str | Path, *, remedy: str = "") -> dict[str, Any]:
    """The tables of a TOML text; raises InputError with the line where it breaks off."""
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise InputError(source, "is not text") from None
    except (ValueError, RecursionError) as error:  # ValueError: also of a number of over 4300 digits
        problem, place = _parted(str(error))
        raise InputError(source, f"is not TOML: {problem}", place=place, remedy=remedy) from None


def _parted(message: str) -> tuple[str, str]:
    """The parser's problem and where it is."""
    match = re.fullmatch(r"(.*) \(at (line \d+, column \d+|end of document)\)", message, re.DOTALL)
    return (match[1], match[2]) if match else (message, "")
