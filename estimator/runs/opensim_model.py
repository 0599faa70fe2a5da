"""A body as an OpenSim model, whose coordinates are those of the motion files (`coordinates.opensim_coordinates`).

Every frame is turned from our axes (z up) to OpenSim's (y up) in the same way, so that a segment that stands upright
has OpenSim's axes: x forward, y up, z to the right. Angles and lengths then stay what they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np
import pinocchio as pin

from estimator.data.formats.opensim import R_OPENSIM_WORLD
from estimator.data.formats.osim import (
    GROUND,
    Axis,
    Coupling,
    Joint,
    Model,
    OsimMarker,
    OsimPlacement,
    OsimShape,
    Segment,
    component_name,
)
from estimator.runs.coordinates import JointEntry, joint_entries, opensim_names
from humanoid.kinematics.body import Body
from humanoid.shape.segment_masses import Mass, flesh_of, links_of, segment_masses
from humanoid.support.errors import InputError

_APART = 0.1  # sine of the angle between axes that one joint may have together
_NO_OFFSET = 1e-9  # m
_STILL = pin.SE3.Identity()


def opensim_model(body: Body, name: str) -> Model:
    """The model of a body: one segment for each joint, or for each group of turns about one point, as at a hip.

    What hangs on fixed (also locked) joints is part of the segment that carries it. A joint that follows another has a
    coordinate of its own, coupled to its leader's: OpenSim's joints do not share coordinates.

    Raises InputError for a joint that neither turns nor slides.
    """
    links, (masses, mass_source) = links_of(body), segment_masses(body)
    names = {j: component_name(of_joint[0]) for j, of_joint in links.items()}
    segments, joints, carrier = [], [], {0: 0}
    if not body.has_free_root:
        joints.append(Joint(f"{names[0]}_to_ground", GROUND, names[0], _place(_STILL), _place(_STILL)))
        segments.append(_segment(body, 0, names[0], masses[0]))
    for group in _groups(body):
        carrier |= dict.fromkeys(group.numbers, group.last)
        before = int(body.model.parents[group.numbers[0]])
        parent = GROUND if before == 0 and body.has_free_root else names[carrier[before]]
        made = _joint(body, group, parent, names[group.last])
        again = made.name in {joint.name for joint in joints}
        joints.append(replace(made, name=component_name(group.entries[0].name)) if again else made)
        segments.append(_segment(body, group.last, names[group.last], masses[group.last]))
    markers = _markers(body, {j: names[last] for j, last in carrier.items() if last in names})
    credits = f"Written by kinemode of the subject {body.subject.name}. {mass_source}"
    return Model(name, credits, tuple(segments), tuple(joints), tuple(markers), tuple(_couplings(body)))


def _markers(body: Body, segments: dict[int, str]) -> list[OsimMarker]:
    """The landmarks and the markers, on the segments of their joints; of one name the marker, which was measured."""
    known, points = set(body.marker_names), list[tuple[str, int, np.ndarray]]()
    landmarks = zip(body.landmark_names, body.landmark_joint, body.landmark_local, strict=True)
    points += [each for each in landmarks if each[0] not in known]
    points += zip(body.marker_names, body.marker_joint, body.marker_local, strict=True)
    return [OsimMarker(name, segments[int(j)], R_OPENSIM_WORLD @ place) for name, j, place in points]


@dataclass(frozen=True)
class _Group:
    """Joints that become one: their numbers, entries, and axes (3,) in the frame of the first before it moves; turned:
    rotation from the last joint's frame to the first's while all are at zero."""

    numbers: tuple[int, ...]
    entries: tuple[JointEntry, ...]
    axes: tuple[np.ndarray, ...]
    turned: np.ndarray

    @property
    def last(self) -> int:
        return self.numbers[-1]

    def takes(self, body: Body, j: int, entry: JointEntry, axis: np.ndarray) -> bool:
        """Whether a joint with this axis turns about the same point, and nothing hangs between them."""
        model, last = body.model, self.last
        turning = all(e.kind in ("turn", "endless") for e in (*self.entries, entry))
        alone = model.parents[j] == last and list(model.parents).count(last) == 1
        here = float(np.abs(model.jointPlacements[j].translation).max()) < _NO_OFFSET
        bare = model.inertias[last].mass == 0.0 and last not in body.landmark_joint and not flesh_of(body, last)
        apart = all(np.linalg.norm(np.cross(axis, other)) > _APART for other in self.axes)
        return turning and alone and here and bare and apart and len(self.numbers) < 3


def _groups(body: Body) -> Iterator[_Group]:
    """All joints in the order of q."""
    group: _Group | None = None
    for j, entry in enumerate(joint_entries(body), 1):
        if entry.kind == "other":
            problem = f"the joint {entry.name} neither turns nor slides, which an OpenSim model cannot have"
            raise InputError(body.subject.source, problem, remedy="export it as mot or npz")
        own = _axis(body.model.joints[j], entry)
        turned = np.eye(3) if group is None else group.turned @ body.model.jointPlacements[j].rotation
        if group is not None and group.takes(body, j, entry, turned @ own):
            numbers, entries = (*group.numbers, j), (*group.entries, entry)
            group = replace(group, numbers=numbers, entries=entries, axes=(*group.axes, turned @ own), turned=turned)
            continue
        if group is not None:
            yield group
        group = _Group((j,), (entry,), (own,), np.eye(3))
    if group is not None:
        yield group


def _axis(joint: pin.JointModel, entry: JointEntry) -> np.ndarray:
    """The direction (3,) about which a joint with one degree of freedom turns, or along which it slides; else zero."""
    data = joint.createData()
    if joint.nv != 1 and not entry.follows:
        return np.zeros(3)
    at_zero = np.zeros(entry.start + entry.count)
    at_zero[entry.start] = float(entry.kind == "endless")  # the cosine
    joint.calc(data, at_zero)
    # a follower's is its master's motion; its multiplier is not 0: that follower was fixed when the subject was read
    motion = np.asarray(data.S).reshape(6) / entry.multiplier
    return np.asarray(motion[:3] + motion[3:])  # one of them is zero


def _couplings(body: Body) -> Iterator[Coupling]:
    """The coordinates of joints that follow others, from those of their leaders."""
    leaders = {entry.start: entry for entry in joint_entries(body) if not entry.follows}
    for entry in joint_entries(body):
        if entry.follows:
            (follower,), (leader,) = (opensim_names(body, each) for each in (entry, leaders[entry.start]))
            yield Coupling(follower, leader, entry.multiplier, entry.offset)


def _joint(body: Body, group: _Group, parent: str, child: str) -> Joint:
    first, kind = group.entries[0], group.entries[0].kind
    if kind == "free":
        turns, slides = _free_axes(opensim_names(body, first), body.neutral[first.start : first.start + 3])
    elif kind == "planar":
        x, y, turn = opensim_names(body, first)
        turns = (Axis(turn, R_OPENSIM_WORLD[:, 2]),)
        slides = (Axis(x, R_OPENSIM_WORLD[:, 0]), Axis(y, R_OPENSIM_WORLD[:, 1]))
    else:
        axes = tuple(
            _limited(body, e, R_OPENSIM_WORLD @ axis) for e, axis in zip(group.entries, group.axes, strict=True)
        )
        turns, slides = ((), axes) if kind == "slide" else (axes, ())
    on_parent = _place(body.model.jointPlacements[group.numbers[0]])
    on_child = _place(pin.SE3(group.turned.T, np.zeros(3)))
    return Joint(_joint_name(group), parent, child, on_parent, on_child, turns, slides)


def _joint_name(group: _Group) -> str:
    """The words that the names of the joints begin with: left_hip for left_hip_flexion, ..."""
    words = zip(*(entry.name.split("_") for entry in group.entries), strict=False)
    shared = [each[0] for each in takewhile(lambda each: len(set(each)) == 1, words)]
    return component_name("_".join(shared) or group.entries[0].name)


def _free_axes(names: list[str], place: np.ndarray) -> tuple[tuple[Axis, ...], tuple[Axis, ...]]:
    """Turns about OpenSim's Z, X and Y in this order; lengths along our x, y and z."""
    tilt, sideways, turn, *lengths = names
    z, x, y = np.eye(3)[[2, 0, 1]]
    slides = tuple(
        Axis(name, direction, float(start))
        for name, direction, start in zip(lengths, R_OPENSIM_WORLD.T, place, strict=True)
    )
    return (Axis(tilt, z), Axis(sideways, x), Axis(turn, y)), slides


def _limited(body: Body, entry: JointEntry, direction: np.ndarray) -> Axis:
    (name,), i = opensim_names(body, entry), entry.start
    if entry.kind == "endless":
        return Axis(name, direction, float(np.arctan2(body.neutral[i + 1], body.neutral[i])))
    rest, low, high = entry.of(np.array([body.neutral, body.lower, body.upper]))[:, 0].tolist()
    ends = min(low, high), max(low, high)
    return Axis(name, direction, rest, ends if np.isfinite(ends).all() else None)


def _segment(body: Body, joint: int, name: str, mass: Mass) -> Segment:
    shapes = []
    for flesh, placed in flesh_of(body, joint):
        a, b, c = flesh.size  # OpenSim's y is our z, which is also the long axis of its cylinder
        size = (a, 0.5 * b) if flesh.shape == "capsule" else (a, c, b)
        shapes.append(OsimShape(size, _place(placed)))
    R = R_OPENSIM_WORLD
    return Segment(name, mass.mass, R @ mass.centre, R @ mass.inertia @ R.T, tuple(shapes))


def _place(placed: pin.SE3) -> OsimPlacement:
    """A frame in another, both with OpenSim's axes instead of ours."""
    return OsimPlacement(R_OPENSIM_WORLD @ placed.rotation @ R_OPENSIM_WORLD.T, R_OPENSIM_WORLD @ placed.translation)
