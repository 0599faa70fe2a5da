"""<mimic> of a URDF: joints whose value follows another's, value = multiplier * master + offset."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

from humanoid.subject.urdf_document import Document, elements
from humanoid.support.near_names import nearest


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
    """Check a <mimic>; that of a fixed joint says nothing, but has to name a joint.

    Raises
    ------
    InputError: its master is no joint, is the joint itself, follows a third, or has no single value; a number is none.
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
    of_master = mimic_of(joints[name])
    if of_master is not None:
        remedy = f"follow {of_master.get('joint', '')!r}, with the multipliers and offsets of both put together"
        raise document.fault(mimic, f"{name!r} follows a joint itself", remedy)


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
            document.number(mimic, "multiplier", "1"),
            document.number(mimic, "offset", "0"),
            joint.get("type") == "prismatic",
        )
        for joint, mimic in following
        if mimic is not None
    )
