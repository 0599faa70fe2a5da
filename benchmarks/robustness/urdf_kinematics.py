"""Forward kinematics of a URDF after its specification (wiki.ros.org/urdf/XML), by lxml and numpy alone: what
`humanoid`, which uses Pinocchio, is compared with. It takes files that `humanoid` accepts and checks nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from lxml import etree
from scipy.spatial.transform import Rotation

REACH = 1.0  # m, of what slides without limits
_AS_IT_IS = etree.XMLParser(recover=True)  # prefixes without a namespace are common


@dataclass(frozen=True)
class UrdfJoint:
    """A joint as its file has it. kind: its type. axis (3,): a unit vector. lower, upper [rad or m]. master: the joint
    that it follows, empty for none."""

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: np.ndarray
    axis: np.ndarray
    lower: float
    upper: float
    master: str
    multiplier: float
    offset: float


def read_joints(text: bytes) -> dict[str, UrdfJoint]:
    """The joints of a URDF by their names."""
    return {element.attrib["name"]: _joint(element) for element in etree.fromstring(text, _AS_IT_IS).findall("joint")}


def _joint(element: etree._Element) -> UrdfJoint:
    origin, axis, limit, mimic = (
        {} if part is None else part.attrib
        for part in (element.find(tag) for tag in ("origin", "axis", "limit", "mimic"))
    )
    kind, normal = element.attrib["type"], _numbers(axis.get("xyz", "1 0 0"))
    turn, place = (_numbers(origin.get(key, "0 0 0")) for key in ("rpy", "xyz"))
    ends = [element.find(tag) for tag in ("parent", "child")]
    parent, child = ("" if end is None else end.attrib["link"] for end in ends)
    return UrdfJoint(
        element.attrib["name"], kind, parent, child,
        transform(Rotation.from_euler("xyz", turn), place),  # about the fixed axes x, y, z in turn
        normal / (np.linalg.norm(normal) or 1.0),
        float(limit.get("lower", "0")), float(limit.get("upper", "0")),
        "" if kind == "fixed" else mimic.get("joint", ""),
        float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0")),
    )  # fmt: skip


def _numbers(text: str) -> np.ndarray:
    return np.array(text.split(), dtype=float)


def transform(turn: Rotation, place: np.ndarray) -> np.ndarray:
    """A rotation and a translation (3,) as a matrix (4, 4)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn.as_matrix(), place
    return T


def draw_values(joints: Mapping[str, UrdfJoint], rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Random values within the limits of the joints that follow none: one number, of a planar joint x, y [m] and the
    turn [rad], of a floating one x, y, z and the quaternion xyzw."""
    values = {}
    for joint in joints.values():
        if joint.kind == "floating":
            values[joint.name] = np.concatenate(
                [rng.uniform(-REACH, REACH, 3), Rotation.from_quat(rng.normal(size=4)).as_quat()]
            )
        elif joint.kind == "planar":
            values[joint.name] = rng.uniform([-REACH, -REACH, -np.pi], [REACH, REACH, np.pi])
        elif joint.kind == "continuous":
            values[joint.name] = rng.uniform(-np.pi, np.pi, 1)
        elif joint.kind != "fixed":
            values[joint.name] = rng.uniform(joint.lower, joint.upper, 1)
    return {name: value for name, value in values.items() if not joints[name].master}


def value_of(joints: Mapping[str, UrdfJoint], name: str, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """A joint's own value: the drawn one, or that from the joint that it follows; 0 for a fixed one."""
    joint = joints[name]
    if joint.master:
        return joint.multiplier * value_of(joints, joint.master, values) + joint.offset
    return values.get(name, np.zeros(1))


def link_placements(joints: Mapping[str, UrdfJoint], values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """T_root_link (4, 4) of every link, the root link's included, by the links' names; of one joint at least."""
    root = ({joint.parent for joint in joints.values()} - {joint.child for joint in joints.values()}).pop()
    placements, rest = {root: np.eye(4)}, [root]
    while rest:
        parent = rest.pop()
        for joint in joints.values():
            if joint.parent == parent:
                motion = _motion(joint, value_of(joints, joint.name, values))
                placements[joint.child] = placements[parent] @ joint.T_parent_joint @ motion
                rest.append(joint.child)
    return placements


def _motion(joint: UrdfJoint, value: np.ndarray) -> np.ndarray:
    still, nowhere = Rotation.identity(), np.zeros(3)
    if joint.kind in ("revolute", "continuous"):
        return transform(Rotation.from_rotvec(joint.axis * value[0]), nowhere)
    if joint.kind == "prismatic":
        return transform(still, joint.axis * value[0])
    if joint.kind == "planar":  # the specification names a plane and no directions in it: those of a plane of x and y
        return transform(Rotation.from_rotvec(joint.axis * value[2]), np.array([*value[:2], 0.0]))
    if joint.kind == "floating":
        return transform(Rotation.from_quat(value[3:]), value[:3])
    return transform(still, nowhere)
