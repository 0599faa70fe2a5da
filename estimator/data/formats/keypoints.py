"""2D keypoints of one person in one camera, from files of any common detector or from arrays of a program."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.formats.hdf5 import is_hdf5
from estimator.data.formats.keypoints_coco import COCO
from estimator.data.formats.keypoints_deeplabcut import DEEPLABCUT, DEEPLABCUT_H5
from estimator.data.formats.keypoints_mmpose import MMPOSE, RTMLIB
from estimator.data.formats.keypoints_npy import ARRAYS
from estimator.data.formats.keypoints_openpose import ALPHAPOSE, OPENPOSE
from estimator.data.formats.keypoints_own import OWN
from estimator.data.formats.keypoints_reading import (
    LAYOUT_BY_COUNT,
    KeypointFile,
    KeypointFormat,
    Notes,
    Person,
    Reading,
    cleaned,
)
from estimator.data.formats.keypoints_sleap import SLEAP, refuse_hdf5
from estimator.data.formats.keypoints_ultralytics import ULTRALYTICS
from estimator.data.formats.people_tracks import AUTO, jump_note, select
from humanoid.subject.landmarks import FORMATS, landmark_name
from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from humanoid.support.plugins import Registry

KEYPOINT_FORMATS: Registry[KeypointFormat] = Registry(
    "keypoint format",
    (ALPHAPOSE, OPENPOSE, MMPOSE, OWN, RTMLIB, COCO, ULTRALYTICS, DEEPLABCUT, DEEPLABCUT_H5, SLEAP, ARRAYS),
)
"""Formats that are read, by name; those registered last are tried first."""
register = KEYPOINT_FORMATS.register

_BEGINNINGS = {
    ".csv": "DeepLabCut's csv does, with 'scorer,'",
    **dict.fromkeys((".npy", ".npz"), "NumPy's files do"),
    **dict.fromkeys((".h5", ".hdf5", ".slp"), "HDF5 files do"),
}


def read_layout(path: Path, layout: str) -> Reading:
    """Read a keypoint file or folder of any registered format.

    Raises InputError where it is missing, no format recognises it, or `layout` is neither "auto" nor a key of
    `humanoid.subject.landmarks.FORMATS`.
    """
    if layout != "auto" and layout not in FORMATS:
        raise InputError(path, f"no layout {layout!r}", remedy=f"one of auto, {', '.join(FORMATS)}")
    if not path.exists():
        raise InputError(path, "no such file or folder")
    file, reading = KeypointFile(path), Reading(path, layout)
    _format_of(file).read(file, reading)
    return reading


def formats_read() -> str:
    """The error for a file of no known format."""
    return "read are " + ", ".join(KEYPOINT_FORMATS)


def _format_of(file: KeypointFile) -> KeypointFormat:
    """The format that recognises a file; raises InputError where none does."""
    known = [*reversed(list(KEYPOINT_FORMATS.values()))]
    by_start = next((f for f in known if not f.of_json and f.recognises(file)), None)
    if by_start is not None:
        return by_start
    _refuse_others(file)
    by_content = next((f for f in known if f.of_json and f.recognises(file)), None)
    if by_content is None:
        raise InputError(file.path, "is not a keypoint file of a known layout", remedy=formats_read())
    return by_content


def _refuse_others(file: KeypointFile) -> None:
    """Raise InputError for a file that is not JSON, by its ending and first bytes."""
    if is_hdf5(file.start):
        refuse_hdf5(file.path)
    begins = _BEGINNINGS.get(file.ending)
    if begins is not None and not file.is_folder:
        raise InputError(file.path, f"does not begin as {begins}", remedy=formats_read())


_LONGEST_GAP = 1000  # frames that may be missing for each present one


@dataclass(frozen=True)
class KeypointTrack:
    """One person's keypoints over time in one camera.

    layout: name of the keypoint format (a key of `humanoid.subject.landmarks.FORMATS`, or its name in the file).
    names (J): landmark of each keypoint, None where none corresponds.
    pixels (T, J, 2): [px], NaN where missing.
    confidence (T, J): 0 to 1, 0 exactly where missing.
    world (T, J, 3): the same points in space [m], see `estimator.data.formats.keypoints_own`, NaN in frames without;
        None where no frame has it.
    image_size: width, height [px], None where the file does not give it. fps: likewise.
    notes: corrections and remarks.
    source: the file.
    """

    layout: str
    names: tuple[str | None, ...]
    pixels: np.ndarray
    confidence: np.ndarray
    image_size: tuple[int, int] | None = None
    fps: float | None = None
    notes: tuple[str, ...] = ()
    source: str = ""
    world: np.ndarray | None = None

    @property
    def frame_count(self) -> int:
        """Number of frames T."""
        return len(self.pixels)


@dataclass(frozen=True)
class PeopleFile:
    """All people in a keypoint file; `one` and `track_of` are the way to a single person's keypoints."""

    reading: Reading

    @property
    def source(self) -> str:
        """The file."""
        return str(self.reading.source)

    @property
    def image_size(self) -> tuple[int, int] | None:
        """Width, height [px], None where the file does not give it."""
        return self.reading.image_size

    @property
    def frames(self) -> Mapping[int, Sequence[Person]]:
        """The people of each frame."""
        return self.reading.frames

    def in_pixels(self, image_size: tuple[int, int]) -> PeopleFile:
        """The same people where the file has fractions of a picture, whose width and height [px] it lacks; unchanged
        where it has pixels."""
        if not self.reading.fractions:
            return self
        scale = np.array([*image_size, 1.0])
        frames = {
            index: [replace(person, points=scale * person.points) for person in people]
            for index, people in self.frames.items()
        }
        return PeopleFile(replace(self.reading, frames=frames, fractions=False, image_size=image_size))

    def one(self, person: str | int = AUTO, *, first: int = 0) -> KeypointTrack:
        """The keypoints of one person, chosen by this file alone; see `load_keypoints`."""
        chosen, note = select(self.frames, person, self.source)
        if not chosen:
            raise InputError(self.source, "has no person in any frame")
        return self.track_of(chosen, (note, jump_note(chosen)), first=first)

    def track_of(self, chosen: Mapping[int, Person], notes: Sequence[str] = (), *, first: int = 0) -> KeypointTrack:
        """The keypoints of these detections, one in each frame they are of; with no person chosen all are missing.
        Raises InputError for fractions of a picture of unknown size."""
        reading = self.reading
        if reading.fractions and chosen:
            remedy = "give the clip, or --keypoint-size WxH (image_size=)"
            raise InputError(reading.source, "has fractions of a picture whose size is not known", remedy=remedy)
        pixels, confidence = _as_arrays(reading, chosen, first)
        all_notes = tuple(n for n in (*notes, *reading.notes.texts, *_numbering_notes(reading, first)) if n)
        return KeypointTrack(
            reading.layout, reading.names, pixels, confidence, reading.image_size, reading.fps, all_notes, self.source,
            _worlds(chosen, first, pixels.shape[:2]),
        )  # fmt: skip


def load_people(path: str | Path, *, layout: str = "auto") -> PeopleFile:
    """Read all people of a keypoint file or folder; raises InputError as `load_keypoints` does."""
    reading = read_layout(Path(path), layout)
    if not any(p.size > 0.0 for people in reading.frames.values() for p in people):
        raise InputError(path, "has no person in any frame")
    if not reading.fractions:
        _refuse_normalised(reading.frames, Path(path))
    return PeopleFile(reading)


def load_keypoints(
    path: str | Path,
    *,
    layout: str = "auto",
    person: str | int = AUTO,
    first: int = 0,
    image_size: tuple[int, int] | None = None,
) -> KeypointTrack:
    """Read keypoints: kinemode's JSON, OpenPose folders, Pose2Sim, Sports2D, AlphaPose, MMPose, rtmlib, COCO data sets,
    Ultralytics' JSON and labels, DeepLabCut's csv and h5, SLEAP's analysis h5, npy and npz.

    Parameters
    ----------
    layout: "auto" finds the format from the count of numbers; else a key of `humanoid.subject.landmarks.FORMATS`.
    person: which of several people, see `people_choice.select`.
    first: number that the clip's first frame has in the file.
    image_size: width and height [px] of the pictures, for a file that has fractions of them; not used by others.

    Raises
    ------
    InputError: with file, frame and person.
    """
    people = load_people(path, layout=layout)
    return (people if image_size is None else people.in_pixels(image_size)).one(person, first=first)


def write_keypoints(path: str | Path, track: KeypointTrack, *, names: tuple[str, ...] | None = None) -> None:
    """Write a track as kinemode's JSON; `names` are needed where the track has keypoints without a landmark."""
    labels = names or tuple(name or f"keypoint_{j}" for j, name in enumerate(track.names))
    values = np.concatenate([np.nan_to_num(track.pixels), track.confidence[..., None]], axis=2)
    seen = np.any(track.confidence > 0.0, axis=1).tolist()
    frames: list[dict[str, Any]] = [{"keypoints": v.tolist() if s else None} for v, s in zip(values, seen, strict=True)]
    for frame, world in zip(frames, () if track.world is None else track.world, strict=False):
        if frame["keypoints"] and np.isfinite(world).all():
            frame["world"] = world.tolist()
    size = list(track.image_size) if track.image_size else None
    content = {"format": track.layout, "image_size": size, "fps": track.fps, "names": list(labels), "frames": frames}
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content), encoding="utf-8")


def _as_arrays(reading: Reading, chosen: Mapping[int, Person], first: int) -> tuple[np.ndarray, np.ndarray]:
    count = reading.count if reading.count is not None else max(reading.frames) + 1
    if first >= count or first < 0:
        raise InputError(reading.source, f"has no frame {first}", remedy=f"its frames end at {count - 1}")
    if count - first > _LONGEST_GAP * (1 + len(reading.frames)):
        problem = f"frame number {count - 1} in a file of {len(reading.frames)} frames"
        raise InputError(reading.source, problem, remedy="number the frames from the clip's first")
    points: np.ndarray = np.full((count, len(reading.names), 3), [np.nan, np.nan, 0.0])
    for index, person in chosen.items():
        points[index] = person.points
    points = points[first:]
    return np.ascontiguousarray(points[..., :2]), np.ascontiguousarray(points[..., 2])


def _worlds(chosen: Mapping[int, Person], first: int, shape: tuple[int, ...]) -> np.ndarray | None:
    """World (T, J, 3) of the chosen detections, None where none has any; shape: T, J."""
    known = {t - first: p.world for t, p in chosen.items() if t >= first and p.world is not None}
    if not known:
        return None
    worlds = np.full((*shape, 3), np.nan)
    for t, world in known.items():
        worlds[t] = world
    return worlds


def _numbering_notes(reading: Reading, first: int) -> tuple[str, ...]:
    lowest = min(reading.frames)
    if lowest <= first:
        return ()
    return (f"the frame numbers begin at {lowest}: frames before it are missing (is {lowest} the clip's first?)",)


def _refuse_normalised(frames: Mapping[int, Sequence[Person]], path: Path) -> None:
    """Refuse fractions of the image as pixels: no person is that small."""
    if all(_small(p) for people in frames.values() for p in people if p.size > 0.0):
        remedy = "pixels are needed; OpenPose: leave --keypoint_scale at 0"
        raise InputError(path, "the coordinates are fractions of the image", remedy=remedy)


def _small(person: Person) -> bool:
    return float(np.nanmax(np.abs(person.points[:, :2]))) <= 2.0


BY_VALUES = "auto"
Layout = str | Sequence[str]
"""Names of keypoints: a key of `humanoid.subject.landmarks.FORMATS`, a name for each of them, or "auto", which finds
the format from their number."""


def keypoint_track(
    values: Any, layout: Layout = BY_VALUES, *, fps: float | None = None, argument: str = "keypoints"
) -> KeypointTrack:
    """A track from an array (T, K, 2) of x, y [px], or (T, K, 3) with confidences from 0 to 1.

    A point is missing where both coordinates are NaN, or its confidence is 0. argument: the array's name in errors.

    Raises
    ------
    InputError: an array of another shape, or that is not of numbers; a layout that is unknown or has another number of
    keypoints; impossible coordinates.
    """
    points = keypoint_points(values, 3, "(T, K, 2) or (T, K, 3)", argument)
    name, names = named_layout(layout, points.shape[1], argument)
    notes = Notes()
    clean = np.array([cleaned(p, notes, argument, f"frame {i}") for i, p in enumerate(points)]).reshape(points.shape)
    pixels, confidence = np.ascontiguousarray(clean[..., :2]), np.ascontiguousarray(clean[..., 2])
    return KeypointTrack(name, names, pixels, confidence, None, fps, notes.texts, argument)


def keypoint_points(values: Any, axes: int, shape: str, argument: str) -> np.ndarray:
    """x, y and confidence (..., K, 3) from an array of some axes, the last of which has two or three numbers; a copy.

    Raises InputError, telling the `shape` that is taken, for any other.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(argument, "is not an array of numbers", remedy=f"give one of shape {shape}") from None
    if array.ndim != axes or array.shape[-1] not in (2, 3) or 0 in array.shape[-2:]:
        raise InputError(argument, f"has the shape {array.shape}", remedy=f"{shape} is needed")
    if array.shape[-1] == 2:
        seen = np.isfinite(array).any(axis=-1, keepdims=True).astype(np.float64)
        array = np.concatenate([array, seen], axis=-1)
    return array


def named_layout(layout: Layout, count: int | None, argument: str = "keypoints") -> tuple[str, tuple[str | None, ...]]:
    """The name of a layout and the landmark of each of its keypoints, None where none corresponds.

    count: how many there are; None where that is not known yet, with a layout that is not "auto". Raises InputError
    for a layout that is unknown or has another number of them.
    """
    if not isinstance(layout, str):
        names: tuple[str | None, ...] = tuple(landmark_name(name) or name for name in layout)
        name = "named"
    elif layout == BY_VALUES:
        if count is None or 3 * count not in LAYOUT_BY_COUNT:
            raise InputError(argument, f"{count} keypoints fit no layout", remedy=f"layout: {_known()}")
        name = LAYOUT_BY_COUNT[3 * count]
        names = FORMATS[name]
    elif layout in FORMATS:
        name, names = layout, FORMATS[layout]
    else:
        raise InputError("layout", f"there is no {layout!r}", remedy=_known())
    if count not in (None, len(names)):
        problem = f"has {count} keypoints, the layout {name} {len(names)}"
        raise InputError(argument, problem, remedy=f"layout: {_known()}")
    return name, names


def _known() -> str:
    return "a list of names, or one of " + ", ".join(f"{name} ({len(names)})" for name, names in FORMATS.items())
