"""Robots of the example-robot-data package, loadable as example-robot-data:NAME."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path

from humanoid.support.errors import InputError, nearest

PREFIX = "example-robot-data:"
LANDMARK_FOLDER = Path(__file__).parent / "landmark_files"


@dataclass(frozen=True)
class ExampleRobot:
    """One robot: its URDF below the package's `robots` folder and what it is."""

    urdf: str
    about: str


ROBOTS = {
    "human": ExampleRobot("human_description/robots/human.urdf", "person after ISB, Y up, limits tightened"),
    "talos": ExampleRobot("talos_data/robots/talos_reduced.urdf", "humanoid robot Talos"),
    "g1": ExampleRobot("g1_description/urdf/g1_29dof_rev_1_0.urdf", "humanoid robot G1"),
    "panda": ExampleRobot("panda_description/urdf/panda.urdf", "robot arm Panda with its gripper"),
}


@cache  # a distribution's list of files takes ten milliseconds to read
def share_folder() -> Path | None:
    """The folder its package:// names start in, None where example-robot-data is not installed.

    The distribution has no Python module; its list of files contains the place of its data.
    """
    try:
        files = metadata.distribution("example-robot-data").files or []
    except metadata.PackageNotFoundError:
        return None
    for file in files:
        if file.name == "package.xml" and file.parent.name == "example-robot-data":
            folder = Path(str(file.locate())).resolve().parent.parent
            return folder if folder.is_dir() else None
    return None


def _path(share: Path, robot: ExampleRobot) -> Path:
    return share / "example-robot-data" / "robots" / robot.urdf


def installed() -> dict[str, ExampleRobot]:
    """The robots whose URDF is installed."""
    share = share_folder()
    return {} if share is None else {name: r for name, r in ROBOTS.items() if _path(share, r).is_file()}


def find(source: str) -> tuple[Path, Path, Path]:
    """URDF, package folder and landmark file of example-robot-data:NAME.

    Raises
    ------
    InputError: the package is not installed or has no such robot.
    """
    share, name = share_folder(), source[len(PREFIX) :]
    if share is None:
        raise InputError(source, "example-robot-data is not installed", remedy="pip install example-robot-data")
    available = installed()
    if name not in available:
        raise InputError(source, f"there is no robot {name!r}", remedy=nearest(name, available, "names"))
    return _path(share, available[name]), share, LANDMARK_FOLDER / f"{name}.landmarks.toml"
