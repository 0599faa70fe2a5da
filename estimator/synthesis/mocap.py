"""Motion capture as landmarks: joints' names, axes, unit, and the faults of known converters."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from estimator.data.cameras.camera import UPS, axis_of
from estimator.data.formats.bvh import BvhMotion, read_bvh
from humanoid.support.errors import InputError, shown

CMU_UNIT = 0.0254 / 0.45  # [m]
"""Metres in one unit of the CMU database (mocap.cs.cmu.edu): its skeletons have a length scale of 0.45 to the inch."""

_OPPOSITE = 0.7  # cosine from which legs and trunk lead in opposite directions
_CLEAR = 0.7  # length of the mean of directions from which a person stands most of the time
_UNITS = (1e-6, 1e3)  # metres in one unit
_FARTHEST = 1e4  # m from where a person moves to where the person began
_SHORTEST = 1e-3  # of thigh and shank: a bone shorter than this share of them has no direction
_SKELETON = "a skeleton with all bones is needed"
_ADULT_LEG = 0.83  # thigh and shank of an adult [m], for files that do not declare their unit
_CMU_FOREARM = 1.4

# landmark: joint names without the side, in order of preference
_SIDED = {
    "hip": ("UpLeg",), "knee": ("Leg",), "ankle": ("Foot",), "toe": ("ToeBase_end", "ToeBase", "Toe"),
    "shoulder": ("Arm",), "elbow": ("ForeArm",), "wrist": ("Hand",),
}  # fmt: skip
_BONES = (("hip", "knee"), ("knee", "ankle"), ("ankle", "toe"), ("shoulder", "elbow"), ("elbow", "wrist"),
          ("hip", "shoulder"))  # fmt: skip
_HEAD_TOP, _NECK = ("Head_end",), ("Head",)


@dataclass(frozen=True)
class Mocap:
    """A captured motion as landmarks.

    names (L): left_hip ... right_wrist, left_toe, right_toe, head_base, head_top. points (T, L, 3) [m]: world with z
    up, the floor under the lowest point at z = 0, the person near the origin and facing x at first.
    fps: frames per second. unit: metres in one unit of the file. source: the file.
    """

    names: tuple[str, ...]
    points: np.ndarray
    fps: float
    unit: float
    source: str

    def at(self, times: np.ndarray) -> np.ndarray:
        """Points (K, L, 3) at times (K,) [s], which are moved into the clip's duration."""
        own = np.arange(len(self.points)) / self.fps
        if len(own) < 2:
            return np.repeat(self.points[:1], len(times), axis=0)
        return np.asarray(CubicSpline(own, self.points)(np.clip(times, 0.0, own[-1])))

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return len(self.points) / self.fps


def load_mocap(path: str | Path, *, unit: float | None = None, up: str | None = None) -> Mocap:
    """Read a BVH file of a person: the joints of MotionBuilder's names, which most converters use.

    unit: metres in one unit of the file. By default it is 0.0564 for skeletons of the CMU database and otherwise makes
    thigh and shank together 0.83 m. up: the file's axis that points up, one of `UPS`; by default found from the rest
    pose, if that stands, and the frames.

    Raises
    ------
    InputError: see `read_bvh`; a joint is missing, a bone has no length, the unit or the axis is invalid, or the upward
        axis is undetermined.
    """
    if up is not None and up not in UPS:
        raise InputError("up", f"is {shown(up)}", remedy=f"one of {', '.join(UPS)}")
    if unit is not None and not _UNITS[0] <= unit <= _UNITS[1]:
        raise InputError("unit", f"is {unit:g}", remedy=f"a positive number of metres, {_UNITS[0]:g} to {_UNITS[1]:g}")
    motion = read_bvh(path)
    of_cmu = "LHipJoint" in motion.names and "LowerBack" in motion.names
    if of_cmu:
        motion = _with_lost_bones(motion)
    names, chosen = _landmarks(motion)
    rest, points = motion.rest()[chosen], motion.positions()[:, chosen]
    _check_bones(names, points, motion.source)
    if unit is None:
        unit = CMU_UNIT if of_cmu else _ADULT_LEG / _leg_length(names, points)
    if not unit * np.abs(points - points[0, 0]).max() < _FARTHEST:
        raise InputError(motion.source, f"the person is over {_FARTHEST:g} m from where the motion began")
    axes = _axes(names, rest, points, up, motion.source)
    upright = unit * points @ axes.T
    return Mocap(names, _facing_x(names, upright), 1.0 / motion.frame_time, unit, str(path))


def _check_bones(names: tuple[str, ...], points: np.ndarray, source: str) -> None:
    """Every part that a body is to follow has a direction, in every frame of points (T, L, 3)."""
    place, least = names.index, _SHORTEST * _leg_length(names, points)
    pairs = [(f"{side}_{a}", f"{side}_{b}") for side in ("left", "right") for a, b in _BONES]
    pairs += [(f"left_{name}", f"right_{name}") for name in ("hip", "shoulder")]
    for a, b in pairs:
        if not np.linalg.norm(points[:, place(a)] - points[:, place(b)], axis=1).min() > least:
            raise InputError(source, f"{a} and {b} are at the same place", remedy=_SKELETON)


def _landmarks(motion: BvhMotion) -> tuple[tuple[str, ...], list[int]]:
    """Landmark names and the joints they are at."""
    wanted = {f"{side.lower()}_{name}": [side + s for s in options] for name, options in _SIDED.items()
              for side in ("Left", "Right")}  # fmt: skip
    wanted.update(head_base=list(_NECK), head_top=list(_HEAD_TOP))
    joints = {}
    for name, options in wanted.items():
        joint = next((o for o in options if o in motion.names), None)
        if joint is None:
            remedy = f"the joints are {', '.join(motion.names[:8])}, ..."
            raise InputError(motion.source, f"has no joint {' or '.join(options)}", remedy=remedy)
        joints[name] = motion.names.index(joint)
    return tuple(joints), list(joints.values())


def _with_lost_bones(motion: BvhMotion) -> BvhMotion:
    """A CMU skeleton of the cgspeed conversion with the bones that it lost.

    In an ASF skeleton a joint's offset is the bone behind it, which the conversion drops where several joints follow:
    Neck and both Shoulders begin at Spine1 and not at its end, and the hand's first bone is gone, so that the wrist
    comes out a third too near to the elbow. Both are put back: Spine1's own offset once more, and 1.4 times the
    forearm.
    """
    offsets, place = motion.offsets.copy(), motion.names.index
    for name in ("Neck", "LeftShoulder", "RightShoulder"):
        if not {name, "Spine1"} <= set(motion.names):  # lost by another program
            continue
        if motion.parents[place(name)] == place("Spine1") and not offsets[place(name)].any():
            offsets[place(name)] = offsets[place("Spine1")]
    for name in ("LeftHand", "RightHand"):
        if name in motion.names:
            offsets[place(name)] *= _CMU_FOREARM
    return motion.with_offsets(offsets)


def _leg_length(names: tuple[str, ...], points: np.ndarray) -> float:
    """Mean length of thigh and shank together, in the unit of points (T, L, 3)."""
    sides = ("left", "right")
    hip, knee, ankle = (points[:, [names.index(f"{s}_{n}") for s in sides]] for n in ("hip", "knee", "ankle"))
    return float((np.linalg.norm(hip - knee, axis=-1) + np.linalg.norm(knee - ankle, axis=-1)).mean())


def _axes(names: tuple[str, ...], rest: np.ndarray, points: np.ndarray, up: str | None, source: str) -> np.ndarray:
    """R_world_file: up is one of the file's axes.

    Of a rest pose (L, 3) that stands it is the axis along which head and feet are farthest apart; of another, as in
    skeletons whose bones lie along their joints' own axes, that along which they are so in the frames (T, L, 3) on
    average. Where the two disagree, or a person does not stand in most frames either, it is undetermined.
    """
    if up is None:
        of_rest, of_frames = _rise(names, rest), _rise(names, points).mean(axis=0)
        stands, clear = _stands(names, rest), float(np.abs(of_frames).max()) > _CLEAR
        chosen = _axis(of_rest if stands else of_frames)
        if not (stands or clear) or (stands and clear and _axis(of_frames) != chosen):
            said = f"its rest pose stands along {_axis(of_rest)}, the person along {_axis(of_frames)}"
            problem = said if stands else "the person stands along none of its axes for most of the time"
            raise InputError(
                source, f"which way is up? {problem}", remedy=f"give it with --up, one of {', '.join(UPS)}"
            )
        up = chosen
    upward = axis_of(up)
    first = np.roll(np.abs(upward), 1)
    return np.stack([first, np.cross(upward, first), upward])


def _rise(names: tuple[str, ...], points: np.ndarray) -> np.ndarray:
    """Unit vectors (..., 3) from the feet to the head of points (..., L, 3); zero where they are at one place."""
    feet = 0.5 * (points[..., names.index("left_ankle"), :] + points[..., names.index("right_ankle"), :])
    rise = points[..., names.index("head_top"), :] - feet
    return np.asarray(rise / np.maximum(np.linalg.norm(rise, axis=-1, keepdims=True), 1e-12))


def _axis(direction: np.ndarray) -> str:
    """The file's axis that is nearest to a direction (3,): one of `UPS`."""
    axis = int(np.argmax(np.abs(direction)))
    return ("-" if direction[axis] < 0.0 else "") + "xyz"[axis]


def _stands(names: tuple[str, ...], rest: np.ndarray) -> bool:
    """Whether both legs of a pose (L, 3) lead away from the head."""
    hips, ankles = (np.array([rest[names.index(f"{s}_{n}")] for s in ("left", "right")]) for n in ("hip", "ankle"))
    trunk, legs = rest[names.index("head_base")] - hips.mean(axis=0), ankles - hips
    lengths = np.linalg.norm(legs, axis=1) * np.linalg.norm(trunk)
    return bool((legs @ trunk < -_OPPOSITE * lengths).all() and (lengths > 0.0).all())


def _facing_x(names: tuple[str, ...], points: np.ndarray) -> np.ndarray:
    """Points (T, L, 3) turned about z and moved so that the motion begins facing x and is centred over the origin."""
    across = points[0, names.index("left_hip")] - points[0, names.index("right_hip")]
    heading = np.arctan2(-across[0], across[1])  # forward is across x up
    c, s = np.cos(heading), np.sin(heading)
    turned = points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]).T
    hips = 0.5 * (turned[:, names.index("left_hip")] + turned[:, names.index("right_hip")])
    middle = 0.5 * (hips.min(axis=0) + hips.max(axis=0))
    floor = np.percentile(turned[..., 2].min(axis=1), 5.0)
    return turned - np.array([middle[0], middle[1], floor])
