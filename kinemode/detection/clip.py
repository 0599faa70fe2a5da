"""A clip's keypoints into a file: frame by frame into one beside it, which a second call goes on with."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from estimator.formats.keypoints_people import LAYOUT_BY_COUNT
from estimator.formats.people_file import write_people
from estimator.media.clip import Clip
from humanoid.subject.landmarks import FORMATS
from humanoid.support.atomic import unwritable
from humanoid.support.errors import InputError
from kinemode.detection.detectors import Wanted
from kinemode.detection.people import People
from kinemode.detection.process import DetectorProcess
from kinemode.terminal.progress import Progress

_PIXELS, _CONFIDENCE = 2, 4  # decimals
Frame = dict[int, list[list[float]]]
"""The keypoints [x, y, confidence] of the people in a frame, by their numbers."""


@dataclass(frozen=True)
class _Beginning:
    """What was done before: who was followed when it ended, and where it ends in the file [bytes]."""

    about: dict[str, Any]
    frames: list[Frame]
    people: People
    end: int


def detect_clip(path: Path, out: Path, wanted: Wanted, progress: Progress) -> Path:
    """The keypoints of all people in a clip, into a file in MediaPipe's layout or that of the model's keypoints.

    What is done stands in OUT.part, from which the same call goes on.

    Raises
    ------
    InputError: a clip that cannot be read, a detector that cannot be had or fails, a file that cannot be written.
    KeyboardInterrupt: on Ctrl-C, saying what there is by then.
    """
    clip = Clip.open(path)
    part = out.with_name(f"{out.name}.part")
    try:
        done = _frames(clip, part, wanted, progress)
    finally:
        clip.close()
    if not any(done.frames):
        part.unlink(missing_ok=True)
        raise InputError(path, f"{wanted.name} finds nobody in {len(done.frames)} frames")
    layout, names = done.about["layout"], done.about["names"]
    rate = clip.fps if clip.rate_known else None
    write_people(out, layout, names, done.frames, image_size=clip.image_size, fps=rate, detector=wanted.identity)
    part.unlink(missing_ok=True)
    return out


def _frames(clip: Clip, part: Path, wanted: Wanted, progress: Progress) -> _Beginning:
    """The people of every frame, each written to the part file at once."""
    key = {"detector": wanted.identity, "clip": _state_of(clip.path), "image_size": list(clip.image_size)}
    with DetectorProcess(wanted) as detector:
        done = _begun(part, key, wanted.people)
        if done is None:
            done = _Beginning({"layout": detector.layout, "names": detector.names}, [], People(wanted.people), 0)
        with _appended(part, done.end) as file:
            if not done.end:
                file.write(_line(key))
            try:
                for picture in clip.frames(len(done.frames)):
                    done.frames.append(_rounded(done.people.see(detector, picture)))
                    file.write(_line({"people": done.frames[-1], "next": done.people.content()}))
                    file.flush()
                    progress(len(done.frames), max(len(done.frames), clip.frame_count or 0))
            except KeyboardInterrupt as stop:
                kept = f"{len(done.frames)} frames are kept in {part}, the same call goes on"
                raise KeyboardInterrupt(f"interrupted; {kept}") from stop
        return _named(done, detector)


def _named(done: _Beginning, detector: DetectorProcess) -> _Beginning:
    """With the layout and the names of the keypoints, which their count tells where the detector does not."""
    count = next((len(points) for frame in done.frames for points in frame.values()), 0)
    layout = detector.layout or LAYOUT_BY_COUNT.get(3 * count)
    if count and layout is None:
        remedy = "counts: " + ", ".join(f"{len(names)} ({layout})" for layout, names in FORMATS.items())
        raise InputError("model", f"its {count} keypoints are of no known layout", remedy=remedy)
    labels = FORMATS.get(layout or "", ())
    names = detector.names or [name or f"keypoint_{j}" for j, name in enumerate(labels)]
    return _Beginning({"layout": layout, "names": names}, done.frames, done.people, done.end)


def _rounded(people: dict[int, np.ndarray]) -> Frame:
    decimals = (_PIXELS, _PIXELS, _CONFIDENCE)
    return {
        number: [[round(v, d) for v, d in zip(row, decimals, strict=True)] for row in points.tolist()]
        for number, points in people.items()
    }


def _state_of(path: Path) -> list[Any]:
    about = path.stat()
    return [str(path.absolute()), about.st_size, about.st_mtime_ns]


def _line(content: dict[str, Any]) -> bytes:
    return json.dumps(content).encode() + b"\n"


def _begun(part: Path, key: dict[str, Any], most: int) -> _Beginning | None:
    """What the part file has of the same clip by the same detector, without a last line that is not whole."""
    frames: list[Frame] = []
    last: dict[str, Any] | None = None
    end = 0
    try:
        lines = part.read_bytes().splitlines(keepends=True)
        if not lines or json.loads(lines[0]) != key:
            return None
        for line in lines:
            content = json.loads(line) if line.endswith(b"\n") else None
            if content is None:
                break
            if end:
                frames.append({int(number): points for number, points in content["people"].items()})
                last = content["next"]
            end += len(line)
    except (OSError, ValueError, KeyError):
        return None
    people = People(most) if last is None else People.of(last, most)
    return _Beginning({}, frames, people, end)


@contextmanager
def _appended(path: Path, end: int) -> Iterator[IO[bytes]]:
    """The file, to be written on from there; raises InputError where it cannot be."""
    try:
        with path.open("r+b" if end else "wb") as file:
            file.truncate(end)
            file.seek(end)
            yield file
    except OSError as error:
        raise unwritable(path, error) from None
