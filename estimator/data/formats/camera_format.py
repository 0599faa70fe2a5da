"""Formats of camera files: how they are recognised and read; conversions of rotation vectors and unknown units of
length.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.checked_config import parsed_yaml
from estimator.data.formats.checked_json import decoded, mapping, numbers, parsed_json, shaped
from humanoid.subject.urdf_document import Document, read_document
from humanoid.support.errors import InputError, shown


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


UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
FARTHEST = 50.0  # m that cameras of one subject are apart, or one is from its origin


def rotation_matrix(value: Any, source: str | Path, place: str) -> list[list[float]]:
    """A rotation (3, 3) from a matrix, or from a rotation vector (3,) [rad] (Rodrigues), as rows."""
    given = numbers(value, source, place)
    if given.size != 3:
        return np.asarray(shaped(value, (3, 3), source, place)).tolist()
    return np.asarray(cv2.Rodrigues(given.reshape(3))[0]).tolist()


def in_metres(cameras: Sequence[Camera], unit: Any, source: str | Path, place: str, remedy: str) -> list[Camera]:
    """Cameras whose translations are in a unit, None for undeclared metres.

    remedy: how the file can declare its unit.

    Raises
    ------
    InputError: an unknown unit; without one, cameras implausibly far apart in metres.
    """
    if unit is None:
        centres = np.array([camera.origin_world for camera in cameras])
        first = centres[0] if len(centres) > 1 else np.zeros(3)
        farthest = float(np.linalg.norm(centres - first, axis=1).max())
        if farthest > FARTHEST:
            where = "apart" if len(centres) > 1 else "from the origin"
            problem = f"the cameras are {farthest:.0f} m {where}, if translations are in metres"
            raise InputError(source, problem, place=place, remedy=f"{remedy}, if they are in millimetres")
        return list(cameras)
    if unit not in UNITS:
        raise InputError(source, f"the unit {shown(unit)} is unknown", place=place, remedy=f"one of {', '.join(UNITS)}")
    return [_scaled(camera, UNITS[unit]) for camera in cameras]


def _scaled(camera: Camera, factor: float) -> Camera:
    """The cameras with all lengths multiplied by a factor."""
    deviations = camera.deviations
    if deviations is not None:
        deviations = deviations * np.repeat([1.0, factor, 1.0], (3, 3, 1))[:, None]
    return replace(camera, t_camera_world=factor * camera.t_camera_world, deviations=deviations)


def check_apart(cameras: Sequence[Camera], source: str | Path, place: str) -> None:
    """Raise InputError where several cameras all have the very same placement, which a file without any may give."""
    places = [np.column_stack([c.R_camera_world, c.t_camera_world]) for c in cameras]
    if len(cameras) > 1 and all(np.array_equal(place, places[0]) for place in places):
        problem = f"all {len(cameras)} cameras are at one place: the file has only intrinsics"
        raise InputError(source, problem, place=place, remedy="calibrate the placements too (extrinsics)")
