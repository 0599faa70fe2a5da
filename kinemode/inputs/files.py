"""The files that a body is tracked from, as the user names them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from humanoid.support.errors import InputError
from kinemode.inputs.declared import AUTO, Declared
from kinemode.inputs.named import Named, PathLike, kept, named_paths

if TYPE_CHECKING:
    from estimator.data.cameras.camera import Camera
    from kinemode.inputs.depth import Pairs
    from kinemode.inputs.persons import Persons

    Cameras = PathLike | Mapping[str, Camera] | None

CLIP, KEYPOINTS, MASK, BACKGROUND, DEPTH = "clip", "keypoint file", "mask", "background", "depth folder"
POINTS = "file of points"


@dataclass(frozen=True)
class InputFiles:
    """Clips, keypoint files, cameras, masks, backgrounds and depth, and what the files do not say themselves.

    clips, keypoints, masks, backgrounds: paths, `[NAME=]PATH` texts or mappings by name, None for none; iterators are
    read once, here. cameras: the path of a camera file, cameras by name, or "auto": they are found from the person.
    lenses: a camera file, or cameras by name, whose lenses the cameras that are found have; where they stand does not
    count. person: see `kinemode.inputs.persons.persons_of`. depths: folders of depth pictures, given as masks are.
    stereo: see `kinemode.inputs.depth.pairs_of`.
    """

    clips: Named = None
    keypoints: Named = None
    cameras: Cameras = None
    masks: Named = None
    backgrounds: Named = None
    person: Persons = "auto"
    declared: Declared = Declared()  # noqa: RUF009, it is frozen
    depths: Named = None
    stereo: Pairs = None
    lenses: Cameras = None

    def __post_init__(self) -> None:
        for name in ("clips", "keypoints", "masks", "backgrounds", "depths", "stereo"):
            object.__setattr__(self, name, kept(getattr(self, name)))
        if isinstance(self.cameras, (str, Path)) and str(self.cameras) == AUTO:
            object.__setattr__(self, "cameras", AUTO)

    @property
    def world_given(self) -> bool:
        """Whether cameras are given that stand in a world which others, as a reference, may share."""
        return self.cameras is not None and self.cameras != AUTO

    def checked(self) -> InputFiles:
        """The same; raises InputError where a file does not exist: no library has to be loaded to say so."""
        for given, what in (
            (self.clips, CLIP),
            (self.keypoints, KEYPOINTS),
            (self.masks, MASK),
            (self.backgrounds, BACKGROUND),
            (self.depths, DEPTH),
        ):
            named_paths(given, what)
        for path in (None if self.cameras == AUTO else self.cameras, self.lenses):
            if isinstance(path, (str, Path)):
                check_exists(path)
        self._check_lenses()
        return self

    def _check_lenses(self) -> None:
        """Raise InputError for lenses of cameras that are not found from a person, and for two words on a lens."""
        if self.lenses is None:
            return
        if self.cameras != AUTO:
            problem = "is for cameras that are found from a person"
            raise InputError("--lenses", problem, remedy="add --cameras auto, or give the file as --cameras")
        for option, said in (("--focal", self.declared.focal), ("--phone", self.declared.phone)):
            if said is not None:
                raise InputError(
                    "--lenses", f"gives the focal length, as {option} does", remedy="leave one of them out"
                )


def check_exists(path: PathLike) -> None:
    """Raise InputError where there is no such file or folder."""
    if not Path(path).exists():
        raise InputError(path, "there is no such file")
