"""Every URDF of the installed packages, and of given folders, loaded and posed as `kinemode track` does, beside forward
kinematics by lxml and numpy (`benchmarks.robustness.urdf_kinematics`). Meshes are not needed.

A file is posed or refused in one line; any other result, or another place of a link, is a fault.
"""

from __future__ import annotations

import sysconfig
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.robustness.urdf_kinematics import UrdfJoint, draw_values, link_placements, read_joints
from benchmarks.support.common import Json, Several, save
from humanoid.kinematics.body import Body, points_in_world, points_on_links
from humanoid.subject.subject import URDF_FOLDER, load_subject
from humanoid.support.errors import InputError
from kinemode.terminal import report

NEAR = 1e-9  # m and rad: of a link's place, by which two kinematics agree
_FREE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_CORNERS = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Deviation(NamedTuple):
    """The largest differences of a link's place [m] and of its rotation [rad], and the links that have them."""

    place: float = 0.0
    turn: float = 0.0
    place_of: str = ""
    turn_of: str = ""


SAME = Deviation()


@dataclass(frozen=True)
class UrdfOutcome:
    """The outcome of a file: the links compared and the deviation, or why it was refused, or what else came out."""

    path: str
    links: int = 0
    deviation: Deviation = SAME
    refusal: str = ""
    fault: str = ""

    @property
    def posed(self) -> bool:
        """Whether there is something to compare."""
        return not self.refusal and not self.fault


def configuration(
    body: Body, joints: Mapping[str, UrdfJoint], values: Mapping[str, np.ndarray], root: np.ndarray
) -> np.ndarray:
    """Values of joints as a body's q (nq,), by `Body.q_names`; root (7,): place and quaternion of a free one."""
    entries = {f"root_{end}": number for end, number in zip(_FREE, root, strict=True)}
    for name, value in values.items():
        ends = _FREE if joints[name].kind == "floating" else "xy"
        entries |= {f"{name}_{end}": number for end, number in zip(ends, value, strict=False)}
        entries |= {name: value[-1], f"{name}_cos": np.cos(value[-1]), f"{name}_sin": np.sin(value[-1])}
    return np.array([entries[name] for name in body.q_names])


def body_placements(body: Body, links: Sequence[str], q: np.ndarray) -> np.ndarray:
    """T_first_link (N, 4, 4) of links, from where four points of each are; relative to the first of them."""
    local = points_on_links(body.model, [(link, corner) for link in links for corner in _CORNERS])
    points = points_in_world(body.at(q), *local).reshape(-1, 4, 3)
    T_world_link = np.tile(np.eye(4), (len(points), 1, 1))
    T_world_link[:, :3, 3] = points[:, 0]
    T_world_link[:, :3, :3] = (points[:, 1:] - points[:, :1]).transpose(0, 2, 1)
    return np.linalg.solve(T_world_link[0], T_world_link)


def deviation(body: Body, text: bytes, poses: int, rng: np.random.Generator) -> tuple[int, Deviation]:
    """The number of a body's links, and their distance, in random poses, from their places by the URDF's text."""
    joints, worst = read_joints(text), SAME
    links: list[str] = []
    for _ in range(poses if joints else 0):  # a single link is where it is
        values = draw_values(joints, rng)
        expected = link_placements(joints, values)
        links = list(expected)
        root = np.concatenate([rng.uniform(-1.0, 1.0, 3), Rotation.from_quat(rng.normal(size=4)).as_quat()])
        placed = body_placements(body, links, configuration(body, joints, values, root))
        difference = placed - np.array([expected[link] for link in links])
        places = np.linalg.norm(difference[:, :3, 3], axis=1)
        turns = 2.0 * np.arcsin(np.clip(np.linalg.norm(difference[:, :3, :3], axis=(1, 2)) / np.sqrt(8.0), 0.0, 1.0))
        p, t = int(places.argmax()), int(turns.argmax())
        if places[p] > worst.place:
            worst = worst._replace(place=float(places[p]), place_of=links[p])
        if turns[t] > worst.turn:
            worst = worst._replace(turn=float(turns[t]), turn_of=links[t])
    return len(links) or 1, worst


def outcome(path: Path, called: str, poses: int, seed: int) -> UrdfOutcome:
    """One file, loaded as it is; `called` names it in what is printed."""
    try:
        body = Body(load_subject(path))
    except InputError as error:
        return UrdfOutcome(called, refusal=str(error).replace(str(path), called))
    except Exception as error:  # any other exception is a fault
        return UrdfOutcome(called, fault=f"{called}: {type(error).__name__}: {' '.join(str(error).split())}")
    links, worst = deviation(body, path.read_bytes(), poses, np.random.default_rng((seed, 17)))
    # written so that a NaN is a fault
    far = (
        ""
        if max(worst.place, worst.turn) <= NEAR
        else f"{called}: link {worst.place_of or worst.turn_of!r} is elsewhere"
    )
    return UrdfOutcome(called, links, worst, fault=far)


def sources(folders: Sequence[Path]) -> dict[str, list[tuple[Path, str]]]:
    """URDF and xacro files, each with a short name, by where they are from: our own, installed packages, given folders.

    Raises InputError: a given folder does not exist.
    """
    for folder in folders:
        if not folder.is_dir():
            raise InputError(folder, "is not a folder", remedy="give folders with URDF files")
    made = {"kinemode": list(_files(URDF_FOLDER))}
    for folder in dict.fromkeys(Path(sysconfig.get_path(key)) for key in ("purelib", "platlib")):
        for path, called in _files(folder):
            parts = called.split("/")
            package = parts[2] if parts[0] == "cmeel.prefix" else parts[0]  # below which cmeel's wheels put share/NAME
            made.setdefault(package, []).append((path, "/".join(parts[-3:])))
    for folder in folders:
        made.setdefault(folder.resolve().name, []).extend(_files(folder))
    return made


def _files(folder: Path) -> Iterator[tuple[Path, str]]:
    for path in sorted(folder.rglob("*")):
        if path.suffix in (".urdf", ".xacro") and path.is_file():
            yield path, path.relative_to(folder).as_posix()


def main(
    *, folders: Annotated[tuple[Path, ...], Several] = (), poses: int = 8, seed: int = 0, out: Json = None
) -> None:
    """Print how far links are from where forward kinematics by numpy has them.

    Parameters
    ----------
    folders
        Folders whose URDF and xacro files are posed too.
    poses
        Random configurations of each file, within its limits.
    seed
        Of the configurations.
    out
        A file for the figures.
    """
    if poses < 1:
        raise InputError("--poses", f"is {poses}", remedy="1 or more")
    columns = "from", "files", "posed", "refused", "faults", "links", "worst [m]", "worst [rad]", "of"
    made, figures, all_ = report.table("links relative to the root link", *columns), dict[str, Any](), []
    for source, files in sources(folders).items():
        results = [outcome(path, called, poses, seed) for path, called in files]
        compared = [r for r in results if r.links]
        first = max(compared, key=lambda r: r.deviation.place, default=None)
        counts = len(results), sum(r.posed for r in results), sum(bool(r.refusal) for r in results)
        worst = [] if first is None else [
            f"{first.deviation.place:.1e}", f"{max(r.deviation.turn for r in compared):.1e}",
            f"{first.path} {first.deviation.place_of}",
        ]  # fmt: skip
        faults, links = sum(bool(r.fault) for r in results), sum(r.links for r in results)
        made.add_row(source, *map(str, (*counts, faults, links)), *worst)
        figures[source] = [{**vars(r), "deviation": r.deviation._asdict()} for r in results]
        all_ += results
    report.console().print(made)
    for kind, lines in (("refused", [r.refusal for r in all_]), ("faults", [r.fault for r in all_])):
        print(f"{kind}: {sum(map(bool, lines))}", *(f"  {line}" for line in lines if line), sep="\n")
    save(out, figures)
