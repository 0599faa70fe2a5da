"""`detect`: keypoints of the people in clips, for `track` and for others."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from humanoid.support.errors import InputError
from kinemode.detection.detectors import DETECTORS, DetectorChoice
from kinemode.inputs.files import CLIP, KEYPOINTS, InputFiles
from kinemode.inputs.named import Named, PathLike, named_paths
from kinemode.notices import InputWarning
from kinemode.public.arguments import check_arguments, check_as, whole
from kinemode.target import check_absent, check_folder, made_folder
from kinemode.terminal.progress import Reporter, unreported

if TYPE_CHECKING:
    Detect = bool | str | Mapping[str, Any]


def detect(
    clips: Named,
    *,
    out: PathLike,
    detector: str = "mediapipe",
    model: PathLike | None = None,
    boxes: PathLike | None = None,
    people: int = 6,
    python: PathLike | None = None,
    overwrite: bool = False,
    progress: Reporter | None = None,
) -> dict[str, Path]:
    """Find the keypoints of all people in clips, and write them as keypoint files that `track` reads.

    The detector runs in an environment of its own in the user's cache, made when it is first needed, by uv.
    The same call goes on where one was interrupted.

    Parameters
    ----------
    clips: paths or `NAME=PATH` texts of videos or folders of images, or a mapping by name.
    out: the file of one clip; of several clips, or where it is a folder, the folder that NAME.json are written into.
    detector: "mediapipe" has 33 keypoints and brings its models; "onnx" works by the file `model`: RTMPose or another
        model of one person's picture whose output are a line and a column for each keypoint (SimCC).
    model: an ONNX file. boxes: another one that finds people in a picture; without it "onnx" follows one person.
    people: at most so many are followed.
    python: an interpreter to make the environment with; one that has the packages itself is taken as it is.
    overwrite: replace files that are there. progress: opens a progress report for each clip, such as
        `kinemode.reported`; none by default.

    Returns the files by the clips' names.

    Raises
    ------
    InputError: anything that is wrong with the input; an environment that cannot be made; nobody in a clip.
    """
    check_arguments(clips=clips, overwrite=overwrite, progress=progress)
    check_as("file", out=out)
    wanted = wanted_detector(detector=detector, model=model, boxes=boxes, people=people, python=python)
    paths = named_paths(clips, CLIP)
    if not paths:
        raise InputError("clips", "there is none", remedy="name a video or a folder of images")
    files = _files(paths, Path(out))
    check_absent(list(files.values()), False, overwrite, "--overwrite replaces it")
    for name, path in paths.items():
        _detect(name, path, files[name], wanted, progress or unreported)
    return files


@contextmanager
def with_detected(
    files: InputFiles, how: Detect, out: PathLike | None, progress: Reporter | None
) -> Iterator[InputFiles]:
    """Input files with keypoints found for the clips that have none; see the argument `detect` of `track`.

    They go into the folder OUT.keypoints (its suffix replaced), where they are taken from the next time unless the clip
    or the detector has changed; without `out` into a temporary one. Raises InputError as `detect` does.
    """
    check_arguments(detect=how)
    if how is False or how == {}:
        yield files
        return
    given = {} if how is True else {"detector": how} if isinstance(how, str) else dict(how)
    wanted = wanted_detector(**given)
    clips, known = named_paths(files.clips, CLIP), named_paths(files.keypoints, KEYPOINTS)
    missing = {} if len(clips) == len(known) == 1 else {n: path for n, path in clips.items() if n not in known}
    if not clips:
        raise InputError("detect", "there is no clip", remedy="name one")
    with tempfile.TemporaryDirectory(prefix="kinemode-") as temporary:
        folder = Path(temporary) if out is None else made_folder(Path(out).with_suffix(".keypoints"))
        made = [folder / f"{name}.json" for name in missing]
        for (name, path), file in zip(missing.items(), made, strict=True):
            if not _still_good(file, path, wanted):
                _detect(name, path, file, wanted, progress or unreported)
            if out is not None:
                warnings.warn(f"the keypoints of {name} are in {file}", InputWarning, stacklevel=4)
        yield replace(files, keypoints=[*_as_texts(files.keypoints), *made])


def wanted_detector(
    *,
    detector: str = "mediapipe",
    model: PathLike | None = None,
    boxes: PathLike | None = None,
    people: int = 6,
    python: PathLike | None = None,
) -> DetectorChoice:
    """A detector by the arguments of `detect`. Raises InputError for what they cannot be."""
    check_as("tracker", detector=detector)
    check_as("keypoint file", model=model, boxes=boxes, python=python)
    if detector not in DETECTORS:
        raise InputError("detector", f"{detector!r} is unknown", remedy=f"one of {', '.join(DETECTORS)}")
    paths = [None if path is None else Path(path) for path in (model, boxes, python)]
    wanted = DetectorChoice(detector, paths[0], paths[1], whole("people", people, 1), paths[2])
    wanted.check()
    return wanted


def _files(clips: Mapping[str, Path], out: Path) -> dict[str, Path]:
    """The keypoint file of each clip."""
    if len(clips) == 1 and not out.is_dir():
        check_folder(out)
        return dict.fromkeys(clips, out)
    folder = made_folder(out)
    return {name: folder / f"{name}.json" for name in clips}


def _detect(name: str, clip: Path, file: Path, wanted: DetectorChoice, progress: Reporter) -> None:
    from kinemode.detection.clip import detect_clip

    with progress(f"detecting {name}") as report:
        detect_clip(clip, file, wanted, report)


def _still_good(file: Path, clip: Path, wanted: DetectorChoice) -> bool:
    """Whether a keypoint file was made from the clip as it is, by the same detector."""
    if not file.is_file() or file.stat().st_mtime < clip.stat().st_mtime:
        return False
    from kinemode.detection.clip import detector_of

    return detector_of(file) == wanted.identity


def _as_texts(keypoints: Named) -> list[PathLike]:
    """Keypoint files as they are given, in a list."""
    if isinstance(keypoints, Mapping):
        return [f"{name}={path}" for name, path in keypoints.items()]
    return [] if keypoints is None else [keypoints] if isinstance(keypoints, (str, Path)) else list(keypoints)
