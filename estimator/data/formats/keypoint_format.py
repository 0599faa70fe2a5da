"""Formats of keypoint files: how they are recognised and read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from estimator.data.formats.checked_json import read_json
from estimator.data.formats.keypoints_reading import Reading


@dataclass(frozen=True)
class KeypointFile:
    """A file or folder that should hold keypoints."""

    path: Path

    @cached_property
    def is_folder(self) -> bool:
        """Whether it is one."""
        return self.path.is_dir()

    @cached_property
    def start(self) -> bytes:
        """Its first bytes, empty for a folder and for an unreadable file, for which the reader of JSON gives the
        reason."""
        try:
            with self.path.open("rb") as file:
                return file.read(64)
        except (OSError, ValueError):
            return b""

    @property
    def ending(self) -> str:
        """Ending of its name, in lower case, with the dot."""
        return self.path.suffix.lower()

    @cached_property
    def json(self) -> Any:
        """Its content as JSON, None for a folder; raises InputError where it is not JSON."""
        return None if self.is_folder else read_json(self.path)


@dataclass(frozen=True)
class KeypointFormat:
    """A format of keypoint files; register it with `estimator.data.formats.keypoints_layouts.register`.

    name: as errors list it. recognises: whether a file is of this format, by its content; those registered last are
    tried first. read: fills a `Reading` of the file with the people of every frame; raises InputError naming frame and
    person. of_json: whether its files are JSON; formats of other files are tried before any file is read as JSON.
    """

    name: str
    recognises: Callable[[KeypointFile], bool]
    read: Callable[[KeypointFile, Reading], None]
    of_json: bool = True
