"""Names of a body's coordinates, the same in every file that is written of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import pinocchio as pin

from humanoid.support.errors import InputError, nearest

ROOT = "root"
ROOT_POSITION = ("root_x", "root_y", "root_z")
"""Position of a free root in the world [m], in q and in every export."""
ROOT_QUATERNION = ("root_qx", "root_qy", "root_qz", "root_qw")
"""Its orientation in q, and wherever quaternions do."""
ROOT_TURNS = ("root_tilt", "root_list", "root_rotation")
"""The same as turns, for files that have angles alone (`estimator.runs.coordinates.opensim_coordinates`)."""
ROOT_VELOCITY = ("root_vx", "root_vy", "root_vz", "root_wx", "root_wy", "root_wz")
"""Its entries of tangent vectors: linear and angular, in the root's own frame."""

_PINOCCHIO_ROOT = "root_joint"
_FREE = 7  # entries of a free joint in q
_OF_Q = {2: ("cos", "sin"), 4: ("x", "y", "cos", "sin")}


class JointPlace(NamedTuple):
    """Entries of a joint in configurations and in tangent vectors: for `q[..., place.q]`, `std[..., place.v]`.

    Both are slices: of one entry for a joint of one number, of seven and six for a free root.
    """

    name: str
    q: slice
    v: slice


def joint_place(model: pin.Model, name: str) -> JointPlace:
    """The place of a joint by its name, "root" for a free root.

    Raises
    ------
    InputError: no such joint, with the nearest names, or one that follows another and has no entries of its own.
    """
    names = joint_names(model)
    if name not in names:
        raise InputError("joint", f"there is no joint {name!r}", remedy=nearest(name, names, "joints"))
    j = names.index(name) + 1
    q, v, count_q, count_v = int(model.idx_qs[j]), int(model.idx_vs[j]), int(model.nqs[j]), int(model.nvs[j])
    if count_q == 0:
        raise InputError("joint", f"{name!r} follows another joint", remedy=f"which has entry {q} of q")
    return JointPlace(name, slice(q, q + count_q), slice(v, v + count_v))


def joint_names(model: pin.Model) -> tuple[str, ...]:
    """The name of every joint but the universe."""
    return tuple(ROOT if name == _PINOCCHIO_ROOT else name for name in list(model.names)[1:])


def q_names(model: pin.Model) -> tuple[str, ...]:
    """A name for each entry of q (nq): the joint's, with a suffix where the joint has several entries."""
    names: list[str] = []
    for name, count in zip(joint_names(model), list(model.nqs)[1:], strict=True):
        names += _of_free(name, (*ROOT_POSITION, *ROOT_QUATERNION)) if count == _FREE else _of(name, count, _OF_Q)
    return tuple(names)


def v_names(model: pin.Model) -> tuple[str, ...]:
    """A name for each entry of a tangent vector (nv): the joint's, with a suffix where the joint has several."""
    names: list[str] = []
    for name, count, in_q in zip(joint_names(model), list(model.nvs)[1:], list(model.nqs)[1:], strict=True):
        names += _of_free(name, ROOT_VELOCITY) if in_q == _FREE else _of(name, count, {})
    return tuple(names)


def _of_free(joint: str, root: tuple[str, ...]) -> list[str]:
    return [joint + name.removeprefix(ROOT) for name in root]


def _of(joint: str, count: int, suffixes: Mapping[int, Sequence[str]]) -> list[str]:
    return [joint] if count == 1 else [f"{joint}_{s}" for s in suffixes.get(count, tuple(map(str, range(count))))]
