"""<mimic> of a URDF: joints whose value follows another's, value = multiplier * master + offset."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

from humanoid.subject.urdf_document import Document, elements
from humanoid.support.errors import nearest


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another: its value is `multiplier` times its master's, plus `offset` [rad, or m if it
    slides]."""

    joint: str
    master: str
    multiplier: float
    offset: float
    slides: bool


def check_mimic(document: Document, joint: ET.Element, mimic: ET.Element, joints: dict[str, ET.Element]) -> None:
    """Check a <mimic>; that of a fixed joint has no effect, but has to name a joint.

    Raises
    ------
    InputError: its master is not a joint, is the joint itself, follows it in turn, or has no single value; or a number
        is invalid.
    """
    name = mimic.get("joint", "")
    if name not in joints:
        raise document.fault(mimic, f"there is no joint {name!r} to follow", nearest(name, joints, "joints"))
    if joints[name] is joint:
        raise document.fault(mimic, "the joint follows itself", "name another joint, or remove the <mimic>")
    for key in ("multiplier", "offset"):
        if key in mimic.attrib:
            document.plausible(mimic, key)
    if joint.get("type") == "fixed":
        return
    for end in (joint, joints[name]):
        if end.get("type") in ("planar", "floating"):
            problem = f"joint {end.get('name')!r} is {end.get('type')} and has no single value"
            raise document.fault(mimic, problem, "only joints of one degree of freedom can follow and be followed")
    chain, master = [joint], joints.get(name)
    while master is not None and (of_master := mimic_of(master)) is not None:
        chain.append(master)
        master = joints.get(of_master.get("joint", ""))  # a missing one is reported where it is named
        if master in chain:
            circle = ", ".join(str(each.get("name")) for each in chain)
            raise document.fault(mimic, f"joints follow each other in a circle: {circle}", "remove one <mimic>")


def compose_mimics(document: Document) -> None:
    """Let every joint of a checked URDF follow one that follows none: a follower's follower follows its master, with
    combined multipliers and offsets."""
    joints = {joint.get("name", ""): joint for joint in elements(document.root, "joint")}
    for joint in joints.values():
        mimic = mimic_of(joint)
        while mimic is not None and (of_master := mimic_of(joints[mimic.get("joint", "")])) is not None:
            multiplier, offset = _line(document, mimic)
            inner, shift = _line(document, of_master)
            mimic.set("joint", of_master.get("joint", ""))
            mimic.set("multiplier", repr(multiplier * inner))
            mimic.set("offset", repr(multiplier * shift + offset))


def _line(document: Document, mimic: ET.Element) -> tuple[float, float]:
    """Multiplier and offset."""
    return document.number(mimic, "multiplier", "1"), document.number(mimic, "offset", "0")


def mimic_of(joint: ET.Element) -> ET.Element | None:
    """The <mimic> of a joint that moves."""
    return None if joint.get("type") == "fixed" else joint.find("mimic")


def read_mimics(document: Document) -> tuple[Mimic, ...]:
    """The joints of a checked URDF that follow others, in the file's order."""
    following = [(joint, mimic_of(joint)) for joint in elements(document.root, "joint")]
    return tuple(
        Mimic(
            joint.get("name", ""),
            mimic.get("joint", ""),
            *_line(document, mimic),
            joint.get("type") == "prismatic",
        )
        for joint, mimic in following
        if mimic is not None
    )
