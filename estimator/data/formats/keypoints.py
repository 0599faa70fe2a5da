"""2D keypoints of one person in one camera, from the files of any common detector."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.formats.keypoints_layouts import read_layout
from estimator.data.formats.keypoints_people import Person
from estimator.data.formats.keypoints_reading import Reading
from estimator.data.formats.people_choice import AUTO, jump_note, select
from humanoid.support.atomic import replacing
from humanoid.support.errors import InputError

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
