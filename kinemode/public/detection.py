"""`detect`: keypoints of the people in clips, for `track` and for others."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from humanoid.support.errors import InputError
from kinemode.detection.detectors import DetectorChoice
from kinemode.named import Named, PathLike, named_paths
from kinemode.notices import warn
from kinemode.option import takes
from kinemode.progress import Reporter
from kinemode.request import CLIP, KEYPOINTS, DetectRequest, FileOptions
from kinemode.target import check_absent, check_folder, made_folder


@takes(DetectRequest)
def detect(request: DetectRequest) -> dict[str, Path]:
    """Find the keypoints of all people in clips, and write them as keypoint files that `track` reads.

    The detector runs in an environment of its own in the user's cache, made by uv when it is first needed. The same
    call resumes an interrupted one. Returns the files by the clips' names.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: anything that is wrong with the input; an environment that cannot be made; no person in a clip.
    """
    wanted = DetectorChoice.of(request)
    wanted.check()
    paths = named_paths(request.clip_files, CLIP)
    if not paths:
        raise InputError("clips", "none given", remedy="name a video or a folder of images")
    files = _files(paths, Path(request.out))
    check_absent(list(files.values()), False, request.overwrite, "--overwrite replaces it")
    for name, path in paths.items():
        _detect(name, path, files[name], wanted, request.reporter)
    return files


@contextmanager
def with_detected(files: FileOptions, out: PathLike | None, progress: Reporter) -> Iterator[FileOptions]:
    """Files with keypoints found for the clips that have none, where they are to be detected.

    They go into the folder OUT.keypoints (its suffix replaced), where they are taken from the next time unless the clip
    or the detector has changed; without `out` into a temporary one. The detector was checked.
    Raises InputError as `detect` does.
    """
    if not files.detect:
        yield files
        return
    wanted = DetectorChoice.of(files)
    clips, known = named_paths(files.clip_files, CLIP), named_paths(files.keypoint_files, KEYPOINTS)
    missing = {} if len(clips) == len(known) == 1 else {n: path for n, path in clips.items() if n not in known}
    with tempfile.TemporaryDirectory(prefix="kinemode-") as temporary:
        folder = Path(temporary) if out is None else made_folder(Path(out).with_suffix(".keypoints"))
        made = [folder / f"{name}.json" for name in missing]
        for (name, path), file in zip(missing.items(), made, strict=True):
            if not _still_good(file, path, wanted):
                _detect(name, path, file, wanted, progress)
            if out is not None:
                warn(f"the keypoints of {name} are in {file}")
        yield replace(files, keypoints=[*_as_texts(files.keypoint_files), *made])


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
    """Whether a keypoint file was made from the unchanged clip by the same detector."""
    if not file.is_file() or file.stat().st_mtime < clip.stat().st_mtime:
        return False
    from kinemode.detection.clip import detector_of

    return detector_of(file) == wanted.identity


def _as_texts(keypoints: Named) -> list[PathLike]:
    """Keypoint files in the given form, as a list."""
    if isinstance(keypoints, Mapping):
        return [f"{name}={path}" for name, path in keypoints.items()]
    return [] if keypoints is None else [keypoints] if isinstance(keypoints, (str, Path)) else list(keypoints)
