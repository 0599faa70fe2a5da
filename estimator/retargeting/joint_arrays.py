"""Joints of a body in an array over time as a motion, in SMPL's order or in that of another program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import UPS, axis_of, nearest_axis
from estimator.data.formats.markers import check_spread
from estimator.data.formats.npz import read_npz
from estimator.data.formats.opensim import METRES, checked_unit, upright_world
from estimator.data.formats.point_arrays import checked_points, checked_rate, number_array
from estimator.data.repeats import measured_points
from estimator.numerics.vectors import mean_direction
from estimator.retargeting.joint_orders import (
    ORDERS,
    SMPL,
    clear_order,
    landmarks_named,
    order_misfit,
    orders_of,
)
from estimator.retargeting.source import SourceMotion
from humanoid.subject.landmarks import without_side
from humanoid.support.errors import InputError, shown

ARRAYS = ("joints", "person", "joints3d", "positions")
RATES = ("fps", "mocap_framerate", "mocap_frame_rate", "frame_rate")
NAMES = ("joint_names", "names", "landmarks", "keypoint_names", "joints_names", "bone_names")
LAYOUTS = ("layout", "order", "skeleton", "joint_order", "skeleton_type")
_CLEAR = 0.7  # length of the mean of directions from which a person counts as standing most of the time
_HEADS = ("head", "head_top", "nose", "neck")
_NEEDED = f"an array {', '.join(ARRAYS)} of (frames, joints, 3) is needed"
_CONVENTION = 0.9  # share of the frames in which the joint that a program put the origin at is there


class _Order(NamedTuple):
    """names: landmark of each joint, None of those that have none. note: what is worth knowing of the choice."""

    names: tuple[str | None, ...]
    note: str = ""


def has_joints(arrays: Mapping[str, np.ndarray]) -> bool:
    """Whether one of the arrays has a name that files of such joints give theirs."""
    return any(name in arrays for name in ARRAYS)


def load_joints(
    path: str | Path, *, up: str | None = None, unit: str | None = None, fps: float | None = None,
    layout: str | None = None,
) -> SourceMotion:  # fmt: skip
    """Read an npz of a body's joints: one of `ARRAYS`, and frames per second as one of `RATES`.

    Which joint is which is taken from `layout`, one of `ORDERS`; from the file, where it has the joints' names or their
    order's; else it is that order of as many joints under which the body's limbs are rigid and alike on both sides. up:
    the axis that points up, one of `UPS`; unless given that along which the head is above the feet on average, with a
    note. unit: of length, m unless given. fps: instead of that in the file. A joint is missing where it is NaN, and
    where it is exactly zero unless that is where the origin was put.

    Raises
    ------
    InputError: no such file, damaged, arrays of another shape, no rate, a rate, axis, unit or order that does not
        exist, no order or several that fit, no joint known, joints farther apart than in any body, undeterminable
        which way is up.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "no such file")
    if up is not None and up not in UPS:
        raise InputError("up", f"{shown(up)} is not an axis", remedy=f"one of {', '.join(UPS)}")
    metres = METRES["m" if unit is None else checked_unit(unit)]
    arrays = read_npz(path)
    place, joints = _joints(arrays, path)
    joints = metres * joints
    times = np.arange(len(joints)) / _rate(arrays, path, len(joints), fps)
    masked = without_zeros(checked_points(path, joints))
    if not np.isfinite(masked).all(axis=2).any():
        raise InputError(path, "has no joint that is known: all are NaN or zero")
    check_spread(masked, unit or "m", path, "--unit")
    order = _order_of(masked, arrays, path, place, layout)
    joints, zeros = with_origin(joints, order.names)
    notes = [note for note in (f"{path.name}: {zeros}" if zeros else "", order.note) if note]
    chosen = [i for i, name in enumerate(order.names) if name is not None]
    names = tuple(name for name in order.names if name is not None)
    points, repeats = measured_points(path.name, names, joints[:, chosen], times)
    notes += repeats
    if not np.isfinite(points).all(axis=2).any():
        raise InputError(path, "has no joint that is known: all are NaN or zero")
    if up is None:
        up = _upward(names, points, path)
        notes.append(f"{path.name}: {up} is taken to point up, by head and feet; give another with --up")
    return SourceMotion(names, points @ upright_world(up).T, times, path.name, tuple(notes))


def _joints(arrays: Mapping[str, np.ndarray], path: Path) -> tuple[str, np.ndarray]:
    """The array's name and the joints (T, J, 3) in the file's unit."""
    name = next((name for name in ARRAYS if name in arrays), None)
    if name is None:
        raise InputError(path, "has no joints", remedy=f"{_NEEDED}; it has {', '.join(arrays) or 'nothing'}")
    joints = number_array(arrays[name], path, name)
    if joints.ndim != 3 or joints.shape[2] != 3:
        raise InputError(path, f"is of shape {joints.shape}", place=name, remedy=_NEEDED)
    if not len(joints):
        raise InputError(path, "has no frame", place=name)
    return name, joints


def _order_of(
    joints: np.ndarray, arrays: Mapping[str, np.ndarray], path: Path, place: str, layout: str | None
) -> _Order:
    """The landmarks of joints (T, J, 3): by the option, by the file's words, or by what fits a body."""
    count = joints.shape[1]
    if layout is not None and layout not in ORDERS:
        raise InputError("layout", f"{shown(layout)} is not an order of joints", remedy=f"one of {', '.join(ORDERS)}")
    if layout is None:
        named = _named_in(arrays, count)
        if named is not None:
            return named
        layout = _layout_in(arrays)
    if layout is not None:
        return _given(joints, path, place, layout)
    misfits = {name: order_misfit(joints, ORDERS[name]) for name in orders_of(count)}
    chosen = clear_order(misfits)
    if chosen is None:
        if not misfits:
            raise InputError(path, f"is of shape {joints.shape}", place=place, remedy=_choices(count))
        several = sum(misfit.value <= 1.0 for misfit in misfits.values()) > 1
        reasons = "; ".join(f"as {name} {misfit.why}" for name, misfit in misfits.items() if misfit.why)
        problem = f"{count} joints fit several orders" if several else f"{count} joints fit no known order: {reasons}"
        raise InputError(path, problem, place=place, remedy=_choices(count))
    order = f"{path.name}: its {count} joints are in the order of {chosen}, by the lengths of limbs"
    return _Order(ORDERS[chosen], "" if chosen == SMPL else f"{order}; give another with --layout")


def _given(joints: np.ndarray, path: Path, place: str, layout: str) -> _Order:
    """An order that is given, with a note where the joints do not fit it."""
    count = joints.shape[1]
    if layout not in orders_of(count):
        remedy = f"{layout} has {len(ORDERS[layout])} joints; {_choices(count)}"
        raise InputError(path, f"is of shape {joints.shape}", place=place, remedy=remedy)
    misfit = order_misfit(joints, ORDERS[layout])
    bad = misfit.value > 1.0
    return _Order(ORDERS[layout], f"{path.name}: not a body's in the order of {layout}: {misfit.why}" if bad else "")


def _choices(count: int) -> str:
    """The remedy for so many joints."""
    known = orders_of(count)
    if known:
        return f"--layout {' or '.join(known)}, or an array {NAMES[0]}"
    return f"an array {NAMES[0]} of {count} names, or joints in an order of --layout: {', '.join(ORDERS)}"


def _named_in(arrays: Mapping[str, np.ndarray], count: int) -> _Order | None:
    """Landmarks by the joints' names where the file has them, and they are a person's."""
    for key in NAMES:
        names = arrays.get(key)
        if names is not None and names.dtype.kind == "U" and names.shape == (count,):
            landmarks = landmarks_named(names.tolist())
            if {"left_hip", "right_hip", "left_knee", "right_knee"} <= set(landmarks):
                return _Order(landmarks)
    return None


def _layout_in(arrays: Mapping[str, np.ndarray]) -> str | None:
    """The order that the file names."""
    for key in LAYOUTS:
        word = arrays.get(key)
        if (
            word is not None
            and word.dtype.kind == "U"
            and word.size == 1
            and (own := str(word.item()).lower()) in ORDERS
        ):
            return own
    return None


def _rate(arrays: Mapping[str, np.ndarray], path: Path, frames: int, fps: float | None) -> float:
    """Frames per second: the user's, else the file's; of one frame it does not matter."""
    if fps is not None:
        return checked_rate("fps", fps)
    name = next((name for name in RATES if name in arrays), None)
    if name is None:
        if frames == 1:
            return 1.0
        raise InputError(
            path, "does not give its frames per second", remedy=f"--fps gives them, or an array {RATES[0]}"
        )
    rate = number_array(arrays[name], path, name)
    if rate.size != 1:
        raise InputError(path, "one number is needed", place=name)
    return checked_rate(path, float(rate.reshape(())))


def _upward(names: tuple[str, ...], points: np.ndarray, path: Path) -> str:
    """The axis, one of `UPS`, along which the head is above the feet in points (T, L, 3) on average."""
    at, head = names.index, next((name for name in _HEADS if name in names), None)
    if head is None or not {"left_ankle", "right_ankle"} <= set(names):
        raise InputError(
            path, "does not give the axis that points up", remedy=f"give it with --up, one of {', '.join(UPS)}"
        )
    rise = points[:, at(head)] - points[:, [at("left_ankle"), at("right_ankle")]].mean(axis=1)
    mean = mean_direction(rise)
    up = nearest_axis(mean)
    if not float(axis_of(up) @ mean) > _CLEAR:
        problem = "does not give the axis that points up, and the head is mostly above the feet along none"
        raise InputError(path, problem, remedy=f"give it with --up, one of {', '.join(UPS)}")
    return up


def without_zeros(joints: np.ndarray) -> np.ndarray:
    """Joints (T, J, 3) with NaN where one is at exactly zero, as lifting networks and detectors write what they did not
    find."""
    return np.where(_at_zero(joints)[..., None], np.nan, joints)


def with_origin(joints: np.ndarray, names: Sequence[str | None]) -> tuple[np.ndarray, str]:
    """Joints (T, J, 3) of which the first have landmarks' names, None of others, without those that were not found, and
    what was left out, empty where nothing was.

    A joint on the body's middle that is at zero in nearly all frames that have others is where the origin was put; a
    knee or a wrist there was never found.
    """
    zero = _at_zero(joints)
    whole = np.asarray(zero.all(axis=1))
    with_joints = zero[~whole]
    origin = np.asarray(with_joints.sum(axis=0) >= _CONVENTION * max(len(with_joints), 1))
    origin[[i for i, name in enumerate(names) if name is not None and without_side(name) != name]] = False
    zero &= ~(origin & ~whole[:, None])
    return np.where(zero[..., None], np.nan, joints), _left_out(int(whole.sum()), int(zero[~whole].sum()))


def _at_zero(joints: np.ndarray) -> np.ndarray:
    """Which joints (T, J) of (T, J, 3) are at exactly zero."""
    return np.asarray((joints == 0.0).all(axis=2))


def _left_out(frames: int, single: int) -> str:
    """So many frames without any joint, and single joints of others."""
    parts = [f"all joints of {frames} frame{'s' if frames > 1 else ''}"] if frames else []
    parts += [f"{single} single joint{'s' if single > 1 else ''}"] if single else []
    return f"{' and '.join(parts)} are at exactly zero and treated as missing" if parts else ""
