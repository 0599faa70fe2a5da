"""Consequences of <mimic>, written into the URDF: limits valid for both, followers that cannot move."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from humanoid.subject.urdf_document import Document, elements
from humanoid.subject.urdf_edit import few, lock_joint
from humanoid.subject.urdf_mimic import Mimic, compose_mimics, read_mimics


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
