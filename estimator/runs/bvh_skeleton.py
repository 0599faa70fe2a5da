"""A body's motion as a skeleton of BVH: any tree of joints, standing upright in its offsets.

Centimetres, y up: the world turned as for OpenSim (x stays, z becomes y, y becomes -z). Every joint's frame is turned
so that at the configuration zero all of them are parallel to the root: then the offsets are the body at zero, and
rotations are zero there too. The motion of a joint is given by its placement, so a joint of any kind becomes rotation
channels (z, x, y) and, where it slides, position channels that replace its offset. A joint at the place of a parent
with no other child is merged with it: three hinges of a hip are one joint of three channels.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from estimator.data.formats.bvh import END_SITE, BvhMotion
from estimator.data.formats.opensim import R_OPENSIM_WORLD, frame_rate
from humanoid.kinematics.body import Body

CENTIMETRES = 100.0
"""Units of the file in a metre."""
_SAME = 1e-9  # [m] between joints that are at one place
_TURNS = "ZXY"
_SHORTEST = 1e-3  # [m] of a bone that is drawn
_STUB = 0.05  # [m] of one of which nothing is known


class BvhSkeleton(NamedTuple):
    """The nodes of a BVH file, in the order of its hierarchy.

    joints (N,): the body's joint that each represents, 0 the trunk of a fixed body. names (N). parents (N,): nodes, -1
    at the root. slides (N,) bool: has position channels. ends (N, 3) [m]: where its last bone ends, in the joint's own
    frame; NaN where others hang on it.
    """

    joints: np.ndarray
    names: tuple[str, ...]
    parents: np.ndarray
    slides: np.ndarray
    ends: np.ndarray


def bvh_motion(body: Body, q: np.ndarray, time: np.ndarray) -> BvhMotion:
    """The motion q (T, nq) at times (T,) [s] for a BVH file; missing poses (NaN) are copied from before, at the
    beginning from after."""
    skeleton = skeleton_of(body)
    aligned = _aligned(body, skeleton)
    places, turns = _local(body, skeleton, aligned, _held(body, q))
    zero, _ = _local(body, skeleton, aligned, pin.neutral(body.model)[None])
    names: list[str] = []
    parents: list[int] = []
    offsets: list[np.ndarray] = []
    channels: list[tuple[int, str]] = []
    columns: list[np.ndarray] = []
    node: list[int] = []
    for n, name in enumerate(skeleton.names):
        node.append(len(names))
        parent = int(skeleton.parents[n])
        names.append(name)
        parents.append(node[parent] if parent >= 0 else -1)
        offsets.append(zero[0, n] if parent >= 0 else np.zeros(3))
        if skeleton.slides[n]:
            channels += [(node[n], f"{axis}position") for axis in "XYZ"]
            columns += list(CENTIMETRES * places[:, n].T)
        channels += [(node[n], f"{axis}rotation") for axis in _TURNS]
        columns += list(turns[:, n].T)
        if np.isfinite(skeleton.ends[n]).all():
            names.append(name + END_SITE)
            parents.append(node[n])
            offsets.append(aligned[n].T @ skeleton.ends[n])
    values = np.stack(columns, axis=1)
    return BvhMotion(
        tuple(names), np.array(parents), CENTIMETRES * np.array(offsets), tuple(channels), values,
        1.0 / frame_rate(time), body.subject.source,
    )  # fmt: skip


def skeleton_of(body: Body) -> BvhSkeleton:
    """The nodes a body's joints become."""
    model = body.model
    slides = [j == 0 or _slides(body, j) for j in _joints(body)]
    children: list[list[int]] = [[c for c in _joints(body) if c and model.parents[c] == j] for j in _joints(body)]
    first = 1 if body.has_free_root else 0
    joints, parents, sliding = [], [], []
    rows = [(first, -1)]
    while rows:
        joint, parent = rows.pop()
        sliding.append(slides[joint])
        while joint != first and len(children[joint]) == 1 and _is_one_with(body, children[joint][0], slides):
            joint = children[joint][0]
        joints.append(joint)
        parents.append(parent)
        rows += [(child, len(joints) - 1) for child in reversed(children[joint])]
    ends = np.array([np.full(3, np.nan) if children[j] else _end(body, j) for j in joints])
    return BvhSkeleton(np.array(joints), _names(body, joints), np.array(parents), np.array(sliding), ends)


def _joints(body: Body) -> range:
    return range(body.njoints)


def _slides(body: Body, joint: int) -> bool:
    """Whether a joint moves its own place."""
    directions = np.array(body.model.joints[joint].createData().S).reshape(6, -1)
    return bool(np.any(directions[:3]))


def _is_one_with(body: Body, joint: int, slides: list[bool]) -> bool:
    """Whether a joint stays at the place of its parent."""
    return not slides[joint] and float(np.linalg.norm(body.model.jointPlacements[joint].translation)) < _SAME


def _names(body: Body, joints: list[int]) -> tuple[str, ...]:
    """The link that each joint moves, else the joint's own name; one word that is not read as an end site."""
    links: dict[int, str] = {}
    for frame in body.model.frames:
        if frame.type == pin.FrameType.BODY and frame.name != "universe":
            links.setdefault(int(frame.parentJoint), frame.name)
    words = ["_".join(links.get(j, str(body.model.names[j])).split()) for j in joints]
    return tuple(word + "_" if word.endswith(END_SITE) else word for word in words)


def _end(body: Body, joint: int) -> np.ndarray:
    """End of the last bone of a limb, in its joint's frame [m]: its farthest landmark or half the bone before."""
    local = body.landmark_local[body.landmark_joint == joint]
    if len(local) and float(np.linalg.norm(local, axis=1).max()) > _SHORTEST:
        return np.asarray(local[np.linalg.norm(local, axis=1).argmax()])
    placement = body.model.jointPlacements[joint]
    before = 0.5 * placement.rotation.T @ placement.translation
    return np.asarray(before if float(np.linalg.norm(before)) > _SHORTEST else np.array([_STUB, 0.0, 0.0]))


def _aligned(body: Body, skeleton: BvhSkeleton) -> np.ndarray:
    """Rotations R_joint_node (N, 3, 3): the node's frame, y up and parallel to the root's at zero, in its joint's."""
    R_world_joint = body.at(pin.neutral(body.model)).rotations[skeleton.joints]
    return np.asarray(R_world_joint.transpose(0, 2, 1) @ R_OPENSIM_WORLD.T)


def _local(body: Body, skeleton: BvhSkeleton, aligned: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each node's place in its parent's frame (T, N, 3) [m] and its turns about z, x, y (T, N, 3) [deg]."""
    placements = body.placed(q).placements[:, skeleton.joints]
    R_world_node = placements[..., :9].reshape(*placements.shape[:2], 3, 3).swapaxes(2, 3) @ aligned
    places, turns = np.empty((2, *placements.shape[:2], 3))
    for n, parent in enumerate(skeleton.parents.tolist()):
        R_above = R_world_node[:, parent] if parent >= 0 else np.broadcast_to(R_OPENSIM_WORLD.T, (len(q), 3, 3))
        step = placements[:, n, 9:] - (placements[:, parent, 9:] if parent >= 0 else 0.0)
        places[:, n] = np.einsum("tba,tb->ta", R_above, step)
        if len(q):
            turns[:, n] = _unwrapped_turns(R_above.transpose(0, 2, 1) @ R_world_node[:, n])
    return places, turns


def _unwrapped_turns(R: np.ndarray) -> np.ndarray:
    """Turns (T, 3) [deg] about z, x and y of rotations (T, 3, 3), without leaps of a whole turn."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # where two axes coincide one of the turns is chosen, rightly
        turns = Rotation.from_matrix(R).as_euler(_TURNS, degrees=True)
    return np.asarray(np.unwrap(turns, axis=0, period=360.0))


def _held(body: Body, q: np.ndarray) -> np.ndarray:
    known = np.flatnonzero(np.isfinite(q).all(axis=1))
    if not len(known):
        return np.tile(pin.neutral(body.model), (len(q), 1))
    before = np.searchsorted(known, np.arange(len(q)), side="right") - 1
    return np.ascontiguousarray(q[known[np.maximum(before, 0)]])
