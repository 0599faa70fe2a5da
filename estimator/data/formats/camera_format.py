"""Formats of camera files: how they are recognised and read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from estimator.data.cameras.camera import Camera
from estimator.data.formats.checked_config import parsed_yaml
from estimator.data.formats.checked_json import decoded, mapping, parsed_json
from humanoid.subject.urdf_document import Document, read_document
from humanoid.support.errors import InputError


@dataclass(frozen=True)
class CameraFile:
    """A file that should hold cameras. path, content: of it."""

    path: Path
    content: bytes

    @property
    def ending(self) -> str:
        """Ending of its name, in lower case, with the dot."""
        return self.path.suffix.lower()

    @cached_property
    def start(self) -> bytes:
        """Its first characters, without a byte order mark or blanks before them."""
        return self.content.removeprefix(b"\xef\xbb\xbf").lstrip()[:200]

    @cached_property
    def json(self) -> Mapping[str, Any] | None:
        """Its content as JSON, None where neither its ending nor its first character is that of JSON. Raises InputError
        where it is damaged."""
        looks_so = self.start.startswith(b"{") or self.ending == ".json"
        if not looks_so or self.start.startswith(b"<"):
            return None
        return mapping(parsed_json(decoded(self.content, self.path), self.path), self.path)

    @cached_property
    def yaml(self) -> Mapping[str, Any] | None:
        """The same for YAML."""
        looks_so = self.start.startswith(b"%YAML") or self.ending in (".yml", ".yaml")
        return parsed_yaml(self.content, self.path) if looks_so else None

    @cached_property
    def xml(self) -> Document | None:
        """The same for XML."""
        if not self.start.startswith(b"<"):
            return None
        try:
            return read_document(self.content, str(self.path))
        except InputError as error:  # its remedies are about subjects
            raise InputError(
                self.path, error.problem, place=error.place, remedy="fix it, or export the cameras again"
            ) from None

    @property
    def root(self) -> str:
        """The outermost element's name of XML, empty for other files."""
        return "" if self.xml is None else self.xml.root.tag


@dataclass(frozen=True)
class CameraFormat:
    """A format of camera files; register it with `estimator.data.formats.cameras.register`.

    name: as errors list it. recognises: whether a file is of this format, by its content; those registered last are
    tried first. read: its cameras, in the file's order; raises InputError naming the place. up: the axis of the
    cameras' world that points up, one of `estimator.data.cameras.camera.UPS`, where the file or its format declares it.
    floor: its height along that axis [m], where the file has it.
    """

    name: str
    recognises: Callable[[CameraFile], bool]
    read: Callable[[CameraFile], list[Camera]]
    up: Callable[[CameraFile], str | None] = lambda _: None
    floor: Callable[[CameraFile], float | None] = lambda _: None
