"""Reading TOML and YAML of other programs, with errors that name file and place."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from estimator.data.formats.checked_json import mapping
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


class _Loader(yaml.SafeLoader):
    """YAML with OpenCV's matrices, which are mappings; what refers to another place is refused."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("it has aliases, which calibration tools never write")
        return super().compose_node(parent, index)


_Loader.add_constructor(
    "tag:yaml.org,2002:opencv-matrix", lambda loader, node: loader.construct_mapping(node, deep=True)
)


def parsed_yaml(content: bytes, source: str | Path) -> Mapping[str, Any]:
    """The members of a YAML text, OpenCV's too; raises InputError with the line where it breaks off."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(source, "is not text") from None
    if text.startswith("%YAML"):  # %YAML:1.0 is not a directive of YAML
        text = "#" + text
    try:
        return mapping(yaml.load(text, _Loader), source)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        raise InputError(
            source, f"is not YAML: {error.problem}", place=f"line {mark.line + 1}" if mark else ""
        ) from None
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(source, f"is not usable YAML: {error}") from None
