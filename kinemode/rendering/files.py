"""The files of a rendered clip."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from estimator.synthesis import SceneSettings
from kinemode.target import made_folder


@dataclass(frozen=True)
class RenderedClip:
    """Files of a rendered clip, by camera name where there is one a camera.

    videos: mp4, empty where only the rest was asked for. keypoints: as a detector would give them. first_frame: exact
    places of all landmarks in the first frame, and in no other. plates: PNG of the empty scene; empty where the
    background moves. cameras, truth, subject: camera file, true motion, and URDF of the body in the pictures.
    masks: by camera, the folder of one PNG a frame, white where the body is visible; empty unless asked for. depths: by
    camera, the folder of one 16-bit PNG a frame, the exact depth in mm, 0 where there is nothing; empty unless asked
    for.
    """

    videos: dict[str, Path]
    keypoints: dict[str, Path]
    first_frame: dict[str, Path]
    plates: dict[str, Path]
    cameras: Path
    truth: Path
    subject: Path
    masks: dict[str, Path] = field(default_factory=dict)
    depths: dict[str, Path] = field(default_factory=dict)


class WantedFiles(NamedTuple):
    """Which files of a clip are asked for beside those that every clip has."""

    videos: bool = True
    masks: bool = False
    depths: bool = False


def clip_files(folder: Path, names: list[str], scene: SceneSettings, wanted: WantedFiles) -> RenderedClip:
    """The paths of a clip in a folder; makes its folders, and removes plates, masks and depths of an earlier clip."""
    for stale in (*folder.glob("plate_*.png"), *folder.glob("masks/*/*.png"), *folder.glob("depths/*/*.png")):
        stale.unlink()
    still = scene.background != "moving"
    return RenderedClip(
        {name: folder / f"{name}.mp4" for name in names} if wanted.videos else {},
        {name: made_folder(folder / "keypoints") / f"{name}.json" for name in names},
        {name: made_folder(folder / "first_frame") / f"{name}.json" for name in names},
        {name: folder / f"plate_{name}.png" for name in names} if wanted.videos and still else {},
        folder / "cameras.json",
        folder / "truth.npz",
        folder / "subject.urdf",
        {name: made_folder(folder / "masks" / name) for name in names} if wanted.masks else {},
        {name: made_folder(folder / "depths" / name) for name in names} if wanted.depths else {},
    )
