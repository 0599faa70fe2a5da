"""Motion capture in BVH files (Biovision hierarchy): a skeleton of offsets and angles, and where its joints are.

Read strictly, because existing readers are not: of those on PyPI, bvhio 1.5 never returns from a file that is cut short
and pins a PyGLM without wheels for CPython 3.14, and bvhtoolbox 0.1 takes ragged or missing frames as they are.
The format: M. Meredith and S. Maddock, Motion Capture File Formats Explained, University of Sheffield CS-01-11, 2001.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimator.data.media.clip import FPS_RANGE
from humanoid.support.errors import InputError
from humanoid.support.files import read_bytes

_CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ")
_MOST_JOINTS, _DEEPEST = 2000, 200  # of a skeleton; deeper ones are damage
_LARGEST = 1e7  # of a length in the file's unit, or of an angle [deg]
END_SITE = "_end"
"""Suffix of a joint's name for its end site."""


@dataclass(frozen=True)
class BvhMotion:
    """A BVH file as it stands; lengths in the file's own unit, angles in degrees.

    names (J): of joints and, as NAME_end, of end sites, parents first. parents (J,) int: -1 at the root.
    offsets (J, 3): from the parent, in the parent's frame. channels: (joint, channel name) of each column.
    values (T, C): the columns, by frame. frame_time [s]. source: the file.
    """

    names: tuple[str, ...]
    parents: np.ndarray
    offsets: np.ndarray
    channels: tuple[tuple[int, str], ...]
    values: np.ndarray
    frame_time: float
    source: str

    def rest(self) -> np.ndarray:
        """Joint places (J, 3) with all angles and the root's position zero, in the file's frame and unit."""
        places = self.offsets.copy()
        for j in range(1, len(places)):
            places[j] += places[self.parents[j]]
        return places

    def positions(self) -> np.ndarray:
        """Joint places (T, J, 3) in the file's frame and unit.

        A joint's rotation is the product of its channels' rotations in the file's order; position channels replace
        its offset.
        """
        count = len(self.values)
        local = np.repeat(self.offsets[None], count, axis=0)
        R_parent_joint: np.ndarray = np.tile(np.eye(3), (count, len(self.names), 1, 1))
        for column, (j, channel) in enumerate(self.channels):
            axis = "XYZ".index(channel[0])
            if channel.endswith("position"):
                local[:, j, axis] = self.values[:, column]
            else:
                R_parent_joint[:, j] = R_parent_joint[:, j] @ _turn(axis, np.radians(self.values[:, column]))
        places, R_world_joint = local.copy(), R_parent_joint.copy()
        for j in range(1, len(self.names)):
            p = self.parents[j]
            places[:, j] = places[:, p] + np.einsum("tab,tb->ta", R_world_joint[:, p], local[:, j])
            R_world_joint[:, j] = R_world_joint[:, p] @ R_parent_joint[:, j]
        return places

    def with_offsets(self, offsets: np.ndarray) -> BvhMotion:
        """The same motion of other bones, offsets (J, 3)."""
        return replace(self, offsets=offsets)


def _turn(axis: int, angle: np.ndarray) -> np.ndarray:
    """Rotations (T, 3, 3) about a coordinate axis."""
    R: np.ndarray = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[:, axis, axis] = 1.0
    R[:, i, i] = R[:, j, j] = np.cos(angle)
    R[:, j, i] = np.sin(angle)
    R[:, i, j] = -R[:, j, i]
    return R


def read_bvh(path: str | Path) -> BvhMotion:
    """Read a BVH file.

    Raises
    ------
    InputError: missing, cut short, or not of the format; names the line.
    """
    text = read_bytes(Path(path), remedy="name a BVH file").decode("utf-8", errors="replace")
    lines = _Lines(text, str(path))
    lines.expect("HIERARCHY")
    skeleton = _Skeleton([], [], [], [])
    _read_joint(lines, skeleton, -1, lines.take("ROOT", 2)[1])
    lines.expect("MOTION")
    count = lines.numbers("Frames:", 1)[0]
    if count < 1 or count != round(count):
        raise lines.error("a whole positive number is needed")
    frame_time = lines.numbers("Frame Time:", 1)[0]
    if frame_time <= 0.0:
        raise lines.error("a positive number is needed")
    shortest, longest = 1.0 / FPS_RANGE[1], 1.0 / FPS_RANGE[0]
    if not shortest <= frame_time <= longest:
        raise lines.error(f"the frame time must be {shortest:g} to {longest:g} s, got {frame_time:g}")
    values = lines.table(int(count), len(skeleton.channels))
    return BvhMotion(
        tuple(skeleton.names), np.array(skeleton.parents), np.array(skeleton.offsets), tuple(skeleton.channels), values,
        frame_time, str(path),
    )  # fmt: skip


@dataclass(frozen=True)
class _Skeleton:
    """The content read so far."""

    names: list[str]
    parents: list[int]
    offsets: list[list[float]]
    channels: list[tuple[int, str]]

    def add(self, name: str, parent: int, offset: list[float], lines: _Lines) -> int:
        if name in self.names:
            raise lines.error(f"the name {name!r} is used twice")
        if len(self.names) >= _MOST_JOINTS:
            raise lines.error(f"has more than {_MOST_JOINTS} joints")
        self.names.append(name)
        self.parents.append(parent)
        self.offsets.append(offset)
        return len(self.names) - 1


def _read_joint(lines: _Lines, skeleton: _Skeleton, parent: int, name: str, depth: int = 0) -> None:
    lines.expect("{")
    if depth >= _DEEPEST:
        raise lines.error(f"joints are nested over {_DEEPEST} deep")
    joint = skeleton.add(name, parent, lines.numbers("OFFSET", 3), lines)
    words = lines.take("CHANNELS")
    if len(words) < 2 or words[1] != str(len(words) - 2) or any(w not in _CHANNELS for w in words[2:]):
        raise lines.error("CHANNELS needs their number and their names", remedy=", ".join(_CHANNELS))
    skeleton.channels.extend((joint, word) for word in words[2:])
    while True:
        words = lines.next()
        if words == ["}"]:
            return
        if words[0] == "JOINT" and len(words) == 2:
            _read_joint(lines, skeleton, joint, words[1], depth + 1)
        elif words == ["End", "Site"]:
            lines.expect("{")
            skeleton.add(name + END_SITE, joint, lines.numbers("OFFSET", 3), lines)
            lines.expect("}")
        else:
            raise lines.error(f"JOINT NAME, End Site or }} is needed, found {' '.join(words)[:40]!r}")


class _Lines:
    """The file's lines without the empty ones, read one after the other."""

    def __init__(self, text: str, source: str) -> None:
        self._lines = [(i, line.split()) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
        self._source, self._at = source, 0

    def next(self) -> list[str]:
        if self._at >= len(self._lines):
            raise InputError(self._source, "ends too early", remedy="a BVH file has HIERARCHY and MOTION")
        self._at += 1
        return self._lines[self._at - 1][1]

    def error(self, problem: str, remedy: str = "") -> InputError:
        return InputError(self._source, problem, place=f"line {self._lines[self._at - 1][0]}", remedy=remedy)

    def take(self, keyword: str, count: int | None = None) -> list[str]:
        words = self.next()
        if words[0] != keyword or (count is not None and len(words) != count):
            raise self.error(f"{keyword} is needed, found {' '.join(words)[:40]!r}")
        return words

    def expect(self, keyword: str) -> None:
        self.take(keyword, 1)

    def numbers(self, keyword: str, count: int) -> list[float]:
        words, key = self.next(), keyword.split()
        if words[: len(key)] != key:
            raise self.error(f"{keyword} is needed, found {' '.join(words)[:40]!r}")
        return self._floats(words[len(key) :], count)

    def table(self, rows: int, columns: int) -> np.ndarray:
        left = len(self._lines) - self._at
        if left != rows:
            raise InputError(self._source, f"{rows} frames are announced, found {left}", place="MOTION")
        return np.array([self._floats(self.next(), columns) for _ in range(rows)])

    def _floats(self, words: list[str], count: int) -> list[float]:
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != count or not np.isfinite(values).all():
            raise self.error(f"{count} numbers are needed")
        if values and max(map(abs, values)) >= _LARGEST:
            raise self.error("has a number at least 1e7 in size", f"lengths and angles are below {_LARGEST:g}")
        return values


def write_bvh(path: Path, motion: BvhMotion) -> None:
    """Write a motion whose joints are in the order of the hierarchy: each one's parent before it, and what hangs on it
    directly after it. Nodes named NAME_end, after their parent NAME, become its end sites."""
    lines = ["HIERARCHY", *_joint(motion, 0, 0), "MOTION", f"Frames: {len(motion.values)}"]
    lines.append(f"Frame Time: {motion.frame_time:.9f}")
    lines += [" ".join(f"{value:.8f}" for value in row) for row in motion.values]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _joint(motion: BvhMotion, j: int, depth: int) -> list[str]:
    tab, name = "\t" * depth, motion.names[j]
    parent = int(motion.parents[j])
    offset = "OFFSET " + " ".join(f"{value:.8f}" for value in motion.offsets[j])
    if parent >= 0 and name == motion.names[parent] + END_SITE:
        return [f"{tab}End Site", f"{tab}{{", f"{tab}\t{offset}", f"{tab}}}"]
    channels = [channel for joint, channel in motion.channels if joint == j]
    head = [f"{tab}{'ROOT' if parent < 0 else 'JOINT'} {name}", f"{tab}{{", f"{tab}\t{offset}"]
    head.append(" ".join([f"{tab}\tCHANNELS", str(len(channels)), *channels]))
    children = np.flatnonzero(motion.parents == j).tolist()
    return [*head, *(line for child in children for line in _joint(motion, child, depth + 1)), f"{tab}}}"]
