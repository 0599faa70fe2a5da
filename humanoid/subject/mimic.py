"""Joints that follow others by <mimic>: limits valid for both, followers that cannot move, and Pinocchio's models of
them.

Pinocchio's own reader of <mimic> refuses a master that comes after its follower, which by its order of names is common
(the inner knuckle of a gripper before the knuckle that drives it). So the model is built without, its joints are put
into an order in which masters come first, and then tied.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import pinocchio as pin

from humanoid.subject.urdf_document import Document, elements
from humanoid.subject.urdf_edit import few, lock_joint
from humanoid.subject.urdf_mimic import Mimic, compose_mimics, read_mimics
from humanoid.support.errors import InputError


def with_mimics(model: pin.Model, mimics: Sequence[Mimic], source: str) -> pin.Model:
    """A model, its joints of one degree of freedom each, with some of them following others; the same object where none
    follows.

    The followers stay joints, with placements, but have no entries in configuration and velocity (nq, nv are smaller).
    Other joints keep their order, as far as masters come first.

    Raises
    ------
    InputError: a master hangs on its own follower, so that it is first in no order.
    """
    if not mimics:
        return model
    order = _order(model, mimics, source)
    tied = model if order == sorted(order) else _reordered(model, order)
    for mimic in mimics:
        joints = tied.getJointId(mimic.master), tied.getJointId(mimic.joint)
        tied = pin.transformJointIntoMimic(tied, *joints, mimic.multiplier, mimic.offset)
    return tied


def _order(model: pin.Model, mimics: Sequence[Mimic], source: str) -> list[int]:
    """The joints, each after its parent and its master."""
    master = {model.getJointId(m.joint): model.getJointId(m.master) for m in mimics}
    placed, waiting = [0], list(range(1, model.njoints))
    while waiting:
        ready = (j for j in waiting if model.parents[j] in placed and master.get(j, 0) in placed)
        joint = next(ready, None)
        if joint is None:
            first = next(m for m in mimics if model.getJointId(m.joint) in waiting)
            problem = f"joint {first.joint!r} carries the joint {first.master!r} that it follows"
            remedy = "let the outer joint follow the inner one, with 1/multiplier and -offset/multiplier"
            raise InputError(source, problem, place="<mimic>", remedy=remedy)
        placed.append(joint)
        waiting.remove(joint)
    return placed[1:]


def _reordered(model: pin.Model, order: Sequence[int]) -> pin.Model:
    """The same model with its joints in another order."""
    made = pin.Model()
    made.name = model.name
    place = {0: 0}
    for j in order:
        q = slice(model.idx_qs[j], model.idx_qs[j] + model.nqs[j])
        v = slice(model.idx_vs[j], model.idx_vs[j] + model.nvs[j])
        place[j] = made.addJoint(
            place[model.parents[j]], model.joints[j], model.jointPlacements[j], model.names[j],
            model.effortLimit[v], model.velocityLimit[v], model.lowerPositionLimit[q], model.upperPositionLimit[q],
        )  # fmt: skip
        made.inertias[place[j]] = model.inertias[j]
    frames = {0: 0}
    for i, frame in enumerate(list(model.frames)[1:], 1):
        joint, parent = place[frame.parentJoint], frames[frame.parentFrame]
        copy = pin.Frame(frame.name, joint, parent, frame.placement, frame.type, frame.inertia)
        frames[i] = made.addFrame(copy, False)
    return made


def settle_mimics(document: Document) -> tuple[str, ...]:
    """Make what follows from <mimic> explicit in a checked URDF; returns notes. Done twice it changes nothing more.

    What follows a follower follows its master. Limits of masters are narrowed so that those of their followers hold; a
    follower without limits takes its master's.
    A follower whose value cannot change, because its master is fixed or its multiplier zero, becomes fixed.

    Raises
    ------
    InputError: a master without limits, or limits that leave it nothing.
    """
    joints = {j.get("name", ""): j for j in elements(document.root, "joint")}
    for joint in joints.values():
        for idle in list(elements(joint, "mimic")) if joint.get("type") == "fixed" else ():
            joint.remove(idle)
    compose_mimics(document)
    narrowed = []
    for mimic in read_mimics(document):
        joint, master = joints[mimic.joint], joints[mimic.master]
        if master.get("type") == "fixed" or mimic.multiplier == 0.0:
            lock_joint(document, joint, mimic.offset)
        elif _narrow(document, joint, master, mimic):
            narrowed.append(mimic.master)
    return _notes(read_mimics(document), list(dict.fromkeys(narrowed)))


def _notes(mimics: tuple[Mimic, ...], narrowed: list[str]) -> tuple[str, ...]:
    if not mimics:
        return ()
    note = f"joints that follow others (<mimic>) and are not in q: {few([m.joint for m in mimics])}"
    if narrowed:
        note += f"; limits of {few(narrowed)} are narrowed to what their followers allow"
    return (note,)


def _narrow(document: Document, joint: ET.Element, master: ET.Element, mimic: Mimic) -> bool:
    """Whether the follower's limits narrow the master's; both are changed in place."""
    element, of_master = joint.find("mimic"), master.find("limit")
    assert element is not None
    if master.get("type") == "continuous" or of_master is None:
        problem = f"its master {mimic.master!r} is continuous, so that a turn more would be another value here"
        raise document.fault(element, problem, "give the master [limits] in a landmark file, or remove the <mimic>")
    low, high = document.number(of_master, "lower"), document.number(of_master, "upper")
    if joint.get("type") == "continuous":
        own = sorted(mimic.multiplier * end + mimic.offset for end in (low, high))
        _limit(joint, *own)
        joint.set("type", "revolute")
    limit = joint.find("limit")
    assert limit is not None
    ends = sorted((document.number(limit, key) - mimic.offset) / mimic.multiplier for key in ("lower", "upper"))
    lower, upper = max(low, ends[0]), min(high, ends[1])
    if lower > upper:
        problem = f"the limits of {mimic.joint!r} leave its master {mimic.master!r} no value"
        raise document.fault(element, problem, f"{mimic.master!r} would have to be within {ends[0]:g} and {ends[1]:g}")
    if (lower, upper) == (low, high) or joint.get("type") == "continuous":
        return False
    _limit(master, lower, upper)
    return True


def _limit(joint: ET.Element, lower: float, upper: float) -> None:
    limit = joint.find("limit")
    if limit is None:
        limit = ET.SubElement(joint, "limit")
    limit.set("lower", repr(float(lower)))
    limit.set("upper", repr(float(upper)))
    for key in ("effort", "velocity"):  # URDF parsers refuse a limit without them
        limit.attrib.setdefault(key, "1000")
