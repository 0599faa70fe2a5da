"""The videos, keypoints and cameras in a folder, and which of them belong together."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from humanoid.support.errors import InputError

VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".mts", ".m2ts", ".wmv", ".3gp")
_PICTURES = (".jpg", ".jpeg", ".png", ".bmp")
_CALIBRATIONS = (".toml", ".json", ".yaml", ".yml", ".xml", ".txt")
_CALIBRATION = re.compile(r"(.*[_-])?(calib|calibration|cameras?)([._-].*)?", re.IGNORECASE)
_CALIBRATION_FOLDER = re.compile(r"(.*[_-])?calib(ration)?", re.IGNORECASE)
_BEST_STEMS = ("calibration", "calib", "cameras")


@dataclass(frozen=True)
class ClipFiles:
    """A clip as it lies in a folder.

    parts: names of the folders that it is in and its own, of which the last ones distinguish it. videos,
    keypoints: by camera. cameras: the camera file. others: what else the layout has, by column.
    """

    parts: tuple[str, ...]
    videos: Mapping[str, Path]
    keypoints: Mapping[str, Path] = field(default_factory=dict)
    cameras: Path | None = None
    others: Mapping[str, str] = field(default_factory=dict)


class Listing:
    """The folders below one, each read once; hidden files aside, and what cannot be written down, which is noted."""

    def __init__(self, top: Path) -> None:
        self.top = top
        self.notes: list[str] = []
        self._content: dict[Path, list[Path]] = {}
        self._loaded: dict[Path, list[str] | None] = {}

    def note(self, path: Path, sentence: str) -> None:
        """Keep a sentence about a file or folder, once."""
        name = path.relative_to(self.top).as_posix() if path != self.top else path.name
        text = f"{name}: {sentence}"
        if text not in self.notes:
            self.notes.append(text)

    def of(self, folder: Path) -> list[Path]:
        """The content of a folder in natural order, empty without one."""
        if folder not in self._content:
            self._content[folder] = self._read(folder)
        return self._content[folder]

    def _read(self, folder: Path) -> list[Path]:
        if not folder.is_dir():
            return []
        try:
            content = sorted((p for p in folder.iterdir() if not p.name.startswith(".")), key=natural)
        except OSError as error:
            self.note(folder, f"cannot be read ({error.strerror})")
            return []
        return [path for path in content if self._can_be_written(path)]

    def _can_be_written(self, path: Path) -> bool:
        try:
            path.name.encode()
        except UnicodeEncodeError:
            self.note(path.parent, f"{path.name!a} has a name that is not in UTF-8: rename it")
            return False
        return True

    def folders(self, folder: Path) -> list[Path]:
        """Its subfolders."""
        return [path for path in self.of(folder) if path.is_dir()]

    def subfolder(self, folder: Path, name: str) -> Path:
        """Its subfolder of a name, ignoring case."""
        named = [path for path in self.folders(folder) if path.name.lower() == name]
        return named[0] if named else folder / name

    def videos(self, folder: Path) -> dict[str, Path]:
        """Its videos by stem; of two with the same the first, the other is noted."""
        videos: dict[str, Path] = {}
        for path in self.of(folder):
            if path.suffix.lower() in VIDEOS and path.is_file():
                first = videos.setdefault(path.stem, path)
                if first != path:
                    self.note(path, f"left out, {first.name} is taken: one video of a name in a folder")
        return videos

    def pictures(self, folder: Path) -> int:
        """The number of its pictures."""
        return sum(path.suffix.lower() in _PICTURES for path in self.of(folder))

    def keypoints(self, stem: str, folders: Iterable[Path]) -> Path | None:
        """The keypoint file or folder of a video in the first of some folders that has any; its own STEM.keypoints goes
        before those of others."""
        for folder in sorted(folders, key=lambda path: path.name != f"{stem}.keypoints"):
            for name in (f"{stem}.json", f"{stem}_json", f"{stem}_pose_json", f"pose_{stem}_json"):
                path = folder / name
                if path in self.of(folder) and (path.is_file() or self.has_frames(path)):
                    return path
        return None

    def has_frames(self, folder: Path) -> bool:
        """Whether a folder has keypoints, a file a frame."""
        return any(path.suffix.lower() == ".json" for path in self.of(folder))

    def calibration(self, folder: Path) -> Path | None:
        """The camera file of a folder: the nearest one, in it, in its folder of calibrations, or above; where there are
        several the first by name, which is noted."""
        for place in (folder, *folder.parents):
            files = [path for path in self.of(place) if is_calibration(path)]
            for inner in self.folders(place):
                if is_calibration_folder(inner):
                    files += [p for p in self.of(inner) if p.is_file() and p.suffix.lower() in _CALIBRATIONS]
            usable = [path for path in files if self.camera_names(path) is not None]
            if usable:
                usable.sort(key=lambda path: (path.stem.lower() not in _BEST_STEMS, *natural(path)))
                if len(usable) > 1:
                    others = ", ".join(path.name for path in usable[1:])
                    self.note(usable[0], f"used for the cameras; {others} could be too")
                return usable[0]
            if place == self.top:
                break
        return None

    def camera_names(self, path: Path) -> list[str] | None:
        """Names of the cameras in a file; None, which is noted, where it cannot be read."""
        if path not in self._loaded:
            from estimator.data.formats.cameras import load_cameras  # it imports numpy

            try:
                self._loaded[path] = list(load_cameras(path))
            except InputError as error:
                self._loaded[path] = None
                self.note(path, f"not used for the cameras: {error.problem}")
        return self._loaded[path]


def natural(path: Path) -> tuple[list[tuple[int, int, str]], str]:
    """A key that sorts 2 before 10."""
    parts = re.split(r"([0-9]+)", path.name.lower())
    return [(0, int(p), "") if p.isdecimal() else (1, 0, p) for p in parts], path.name


def is_calibration(path: Path) -> bool:
    """Whether a file is called as camera files are."""
    return path.suffix.lower() in _CALIBRATIONS and _CALIBRATION.fullmatch(path.stem) is not None and path.is_file()


def is_calibration_folder(path: Path) -> bool:
    """Whether a folder is called as those of calibrations are; its videos show boards."""
    return _CALIBRATION_FOLDER.fullmatch(path.name) is not None


def with_cameras(
    listing: Listing, folder: Path, parts: tuple[str, ...], videos: Mapping[str, Path], keypoints: Mapping[str, Path],
    others: Mapping[str, str] | None = None,
) -> ClipFiles:  # fmt: skip
    """A recording whose cameras have the names that the camera file nearest to a folder gives them; what has to be
    guessed for that is noted."""
    stems = list(dict.fromkeys([*videos, *keypoints]))
    file = listing.calibration(folder)
    names = None if file is None else _paired(listing, file, folder, stems)
    if names is None:
        if len(stems) > 1 and file is None:
            listing.note(
                folder, "no camera file: name one in the column cameras, or write auto to find it from the person"
            )
        return ClipFiles(parts, videos, keypoints, None, others or {})
    videos, keypoints = ({names[stem]: path for stem, path in paths.items()} for paths in (videos, keypoints))
    return ClipFiles(parts, videos, keypoints, file, others or {})


def _paired(listing: Listing, file: Path, folder: Path, stems: Sequence[str]) -> dict[str, str] | None:
    """The camera of each video: that of its name, or in order where none has one; None where undecidable."""
    cameras = listing.camera_names(file) or []
    if set(stems) <= set(cameras) or (len(stems) == len(cameras) == 1):
        return {stem: stem for stem in stems}
    if len(stems) == len(cameras):
        pairs = dict(zip(stems, cameras, strict=True))
        listed = ", ".join(f"{camera}={stem}" for stem, camera in pairs.items())
        listing.note(folder, f"cameras of {os.path.basename(file)} taken in their order: {listed}")
        return pairs
    problem = f"{', '.join(stems)}: not the cameras of {os.path.basename(file)}, which are {', '.join(cameras)}"
    listing.note(folder, f"{problem}; the column cameras is left empty")
    return None
