"""A clip's keypoints into a file: frame by frame into one beside it, which a second call continues."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from estimator.data.formats.keypoints_reading import LAYOUT_BY_COUNT
from estimator.data.media.clip import Clip
from humanoid.subject.landmarks import FORMATS
from humanoid.support.errors import InputError
from humanoid.support.files import replacing, unwritable
from kinemode.detection.detectors import DetectorChoice
from kinemode.detection.people import Asked, People, Seen
from kinemode.detection.process import DetectorProcess
from kinemode.progress import Progress

_DECIMALS = {"keypoints": (2, 2, 4), "world": (4, 4, 4)}
PersonContent = Mapping[str, Sequence[Sequence[float]]]
"""A person: keypoints (K, 3) x, y [px], confidence; optionally world (K, 3) [m], see
`estimator.data.formats.keypoints_own`."""
Frame = dict[int, PersonContent]
"""The people in a frame, by their numbers."""


@dataclass(frozen=True)
class _Done:
    """The progress: the people of the frames, those followed, and the size of the part file [bytes]."""

    frames: list[Frame]
    people: People
    end: int = 0


def detect_clip(path: Path, out: Path, wanted: DetectorChoice, progress: Progress) -> Path:
    """The keypoints of all people in a clip, into a file in MediaPipe's layout or that of the model's keypoints.

    Finished frames are in OUT.part, from which the same call resumes.

    Raises
    ------
    InputError: a clip that cannot be read, a detector that cannot be had or fails, a file that cannot be written.
    KeyboardInterrupt: on Ctrl-C, with what is finished by then.
    """
    part = out.with_name(f"{out.name}.part")
    with closing(Clip.open(path)) as clip, DetectorProcess(wanted) as detector:
        frames = _frames(clip, part, wanted, detector, progress)
        layout, names = _keypoints_of(detector, frames)
        rate = clip.fps if clip.rate_known else None
        if not any(frames):
            part.unlink(missing_ok=True)
            raise InputError(path, f"{wanted.name} finds no person in {len(frames)} frames")
        write_people(out, layout, names, frames, image_size=clip.image_size, fps=rate, detector=wanted.identity)
    part.unlink(missing_ok=True)
    return out


def detector_of(file: Path) -> str | None:
    """The identity of the detector that a keypoint file was written by, None where it is unknown."""
    with suppress(OSError, ValueError, AttributeError):
        stored = json.loads(file.read_text(encoding="utf-8")).get("detector")
        return stored if isinstance(stored, str) else None
    return None


def _frames(clip: Clip, part: Path, wanted: DetectorChoice, detector: Asked, progress: Progress) -> list[Frame]:
    """The people of every frame, each written to the part file at once."""
    key = {"detector": wanted.identity, "clip": _state_of(clip.path), "image_size": list(clip.image_size)}
    done = _begun(part, key, wanted.most) or _Done([], People(wanted.most))
    frames = done.frames
    with _appended(part, done.end) as file:
        if not done.end:
            file.write(_line(key))
        try:
            for picture in clip.frames(len(frames)):
                people = _rounded(done.people.see(detector, picture))
                file.write(_line({"people": people, "next": done.people.content()}))
                file.flush()
                frames.append(people)
                progress(len(frames), max(len(frames), clip.frame_count or 0))
        except KeyboardInterrupt as stop:
            kept = f"{len(frames)} frames are kept in {part}, the same call resumes"
            raise KeyboardInterrupt(f"interrupted; {kept}") from stop
    return frames


def _keypoints_of(detector: DetectorProcess, frames: list[Frame]) -> tuple[str, list[str]]:
    """The layout and the names of the keypoints; by their count where the detector has none."""
    count = next((len(person["keypoints"]) for frame in frames for person in frame.values()), 0)
    layout = detector.layout or LAYOUT_BY_COUNT.get(3 * count, "")
    if count and not layout:
        remedy = "counts: " + ", ".join(f"{len(names)} ({name})" for name, names in FORMATS.items())
        raise InputError("model", f"its {count} keypoints have no known layout", remedy=remedy)
    labels = FORMATS.get(layout, ())
    return layout, detector.names or [name or f"keypoint_{j}" for j, name in enumerate(labels)]


def _rounded(people: dict[int, Seen]) -> Frame:
    def rows(points: np.ndarray, decimals: tuple[int, ...]) -> list[list[float]]:
        return [[round(v, d) for v, d in zip(row, decimals, strict=True)] for row in points.tolist()]

    return {n: {name: rows(values, _DECIMALS[name]) for name, values in seen.items()} for n, seen in people.items()}


def _state_of(path: Path) -> list[Any]:
    about = path.stat()
    return [str(path.absolute()), about.st_size, about.st_mtime_ns]


def _line(content: dict[str, Any]) -> bytes:
    return json.dumps(content).encode() + b"\n"


def _begun(part: Path, key: dict[str, Any], most: int) -> _Done | None:
    """The content of the part file for the same clip and detector, without an incomplete last line."""
    try:
        head, *lines = part.read_bytes().splitlines(keepends=True)
        if json.loads(head) != key:
            return None
        whole = [line for line in lines if line.endswith(b"\n")]
        stored = [json.loads(line) for line in whole]
        frames = [{int(number): person for number, person in frame["people"].items()} for frame in stored]
        people = People.of(stored[-1]["next"], most) if stored else People(most)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return _Done(frames, people, len(head) + sum(map(len, whole)))


@contextmanager
def _appended(path: Path, end: int) -> Iterator[IO[bytes]]:
    """The file, to be written on from there; raises InputError where that fails."""
    try:
        with path.open("r+b" if end else "wb") as file:
            file.truncate(end)
            file.seek(end)
            yield file
    except OSError as error:
        raise unwritable(path, error) from None


def write_people(
    path: str | Path,
    layout: str,
    names: Sequence[str],
    frames: Sequence[Mapping[int, PersonContent]],
    *,
    image_size: tuple[int, int] | None = None,
    fps: float | None = None,
    **more: Any,
) -> None:
    """Write every frame's people, by their numbers.

    Parameters
    ----------
    layout: a key of `humanoid.subject.landmarks.FORMATS`. names (K): of the keypoints.
    frames: for each frame the people by number; a frame may be empty. Where there is only one number in all of them,
        they are written as one person.
    image_size: width, height [px]. fps: frames per second. more: further members of the file.

    Raises
    ------
    InputError: the file cannot be written.
    """
    numbers = {number for people in frames for number in people}
    rows = [_of_one(people) if len(numbers) < 2 else _of_all(people) for people in frames]
    size = None if image_size is None else list(image_size)
    content = {"format": layout, "image_size": size, "fps": fps, "names": list(names), **more, "frames": rows}
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, separators=(",", ":")), encoding="utf-8")


def _of_one(people: Mapping[int, PersonContent]) -> dict[str, Any]:
    return next((dict(person) for person in people.values()), {"keypoints": None})


def _of_all(people: Mapping[int, PersonContent]) -> dict[str, Any]:
    return {"people": [{"id": number, **person} for number, person in people.items()]}
