"""Pictures and keypoints that a program has as arrays, or makes on demand, written as files.

What reads clips goes through them more than once and from anywhere, which only files allow for pictures that do not
all fit into memory. They are PNG and JSON, which lose nothing: the run is that of the arrays, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from estimator.runs.run_store import TemporaryFolder
from humanoid.support.errors import InputError, misplaced
from kinemode.kinds import are_pictures, is_array
from kinemode.named import Named

if TYPE_CHECKING:
    import numpy as np

    from kinemode.request import Clips, Keypoints

_ALONE = "clip"  # what pictures, or keypoints, are called that have no name
_NEEDED = "(H, W, 3) uint8, BGR, is needed"
_QUICK = 1  # compression of PNG, of 9


class Spool:
    """Makes files of the clips and keypoints that are given as arrays; inputs given as files are unchanged.

    clips: also arrays (T, H, W, 3) uint8 BGR, or iterators of pictures (H, W, 3). keypoints: also arrays (T, K, 2) or
    (T, K, 3), see `estimator.data.formats.keypoints`, which has `layout` too. Both alone or in a mapping by
    camera.

    Attributes
    ----------
    clips, keypoints: files, as `kinemode.named` takes them. file_layout: the layout that keypoint files are to
    be read by, "auto" for those that were written here. folder: where those are that were written, gone
    with this object unless a run lies in it; None where there are none.

    Raises
    ------
    InputError: arrays of another shape or type, pictures of different sizes or none at all.
    """

    def __init__(self, clips: Clips, keypoints: Keypoints, layout: str | Sequence[str] = "auto") -> None:
        self.folder: TemporaryFolder | None = None
        self._layout, self._arguments = layout, dict[str, str]()
        self.clips = self._files("clips", clips, self._pictures)
        self.keypoints = self._files("keypoints", keypoints, self._points)
        self.file_layout = "auto" if self.folder is not None else self._of_files(keypoints)

    def run_path(self, out: str | Path | None) -> str | Path | None:
        """Where a run is written: beside the pictures that were written here, which it keeps, unless `out` is given."""
        return self.folder.path / "track.run" if out is None and self.folder else out

    def _of_files(self, keypoints: Keypoints) -> str:
        if self._layout != "auto" and (keypoints is None or not isinstance(self._layout, str)):
            problem = "is of keypoints in arrays, which are not given"
            raise InputError("layout", problem, remedy="leave it out; for files it is a name")
        return str(self._layout)

    def _files(self, argument: str, given: Any, write: Callable[[str, str, Any], Path | None]) -> Named:
        if isinstance(given, Mapping):
            return {name: write(f"{argument}[{name!r}]", str(name), value) or value for name, value in given.items()}
        if hasattr(given, "__next__"):
            first = next(given, None)
            given = given if first is None else chain([first], given)
            if not is_array(first):
                return cast(Named, given)
        return write(argument, _ALONE, given) or cast(Named, given)

    def _pictures(self, argument: str, name: str, given: Any) -> Path | None:
        if not are_pictures(given) and not hasattr(given, "__next__"):
            return None
        if is_array(given) and given.ndim != 4:
            raise InputError(argument, f"has the shape {given.shape}", remedy="(T, H, W, 3) uint8, BGR, is needed")
        path = self._place(argument, name)
        path.mkdir()
        _write_pictures(path, argument, given)
        return path

    def _points(self, argument: str, name: str, given: Any) -> Path | None:
        if not is_array(given):
            return None
        from estimator.data.formats.keypoints import keypoint_track, write_keypoints

        track = keypoint_track(given, self._layout, argument=argument)
        path = self._place(argument, f"{name}.json")
        write_keypoints(path, track)
        return path

    @contextmanager
    def telling(self) -> Iterator[None]:
        """Within it errors of a file that was written here name the argument that it is of."""
        try:
            yield
        except InputError as error:
            argument = self._arguments.get(error.source)
            if argument is None:
                raise
            raise InputError(argument, error.problem, place=error.place, remedy=error.remedy) from None

    def _place(self, argument: str, name: str) -> Path:
        if self.folder is None:
            self.folder = TemporaryFolder()
        path = self.folder.path / name
        if path.parent != self.folder.path or not name.strip("."):
            raise InputError(name, "is not a valid camera name", remedy="leave out slashes")
        self._arguments[str(path)] = argument
        return path


def _write_pictures(folder: Path, argument: str, pictures: Iterable[Any]) -> None:
    import cv2

    size: tuple[int, ...] | None = None
    for i, picture in enumerate(_arrays(argument, pictures)):
        if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != "uint8" or 0 in picture.shape:
            problem = f"has the shape {picture.shape} and type {picture.dtype}"
            raise InputError(argument, problem, place=f"frame {i}", remedy=_NEEDED)
        if picture.shape != (size := size or picture.shape):
            raise InputError(argument, f"has the shape {picture.shape}, those before {size}", place=f"frame {i}")
        file = folder / f"{i:08d}.png"
        if not cv2.imwrite(str(file), picture, [cv2.IMWRITE_PNG_COMPRESSION, _QUICK]):
            raise InputError(folder, "cannot be written", remedy="make room on the disk of temporary files")
    if size is None:
        raise InputError(argument, "has no picture in it")


def _arrays(argument: str, pictures: Iterable[Any]) -> Iterator[np.ndarray]:
    for i, picture in enumerate(pictures):
        if not is_array(picture):
            raise misplaced(f"{argument}: frame {i}", picture, "an array (H, W, 3) of uint8, BGR")
        yield picture
