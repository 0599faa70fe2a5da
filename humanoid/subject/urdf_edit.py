"""Changes that make a foreign URDF a subject's: meshes found, joints locked, landmarks put in."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Literal
from urllib.parse import unquote, urlparse

import numpy as np
import pinocchio as pin

from humanoid.subject.urdf_check import ends_of
from humanoid.subject.urdf_document import Document, elements
from humanoid.subject.urdf_mimic import read_mimics
from humanoid.support.errors import InputError, nearest, shown

Meshes = Literal["ignore", "require"]
NO_LANDMARKS = "no landmarks are given: the origin of every moving link is one"
"""The note on a subject without landmarks of its own."""


def resolve_meshes(document: Document, folder: Path, packages: Sequence[Path], meshes: Meshes) -> tuple[str, ...]:
    """Write every mesh as an absolute path, so that the text loads from anywhere; returns notes.

    folder: where the URDF lies; relative names start there. package://name/... is searched for in `packages`, in the
    folders above the URDF and in ROS_PACKAGE_PATH. With "ignore" the shapes whose mesh is missing are left out, and a
    note gives their number, and the links that therefore collide with nothing.

    Raises
    ------
    InputError: a mesh is missing and `meshes` is "require".
    """
    missing: list[str] = []
    passing: set[str] = set()
    for link in elements(document.root, "link"):
        for shape in [e for e in elements(link) if e.tag in ("visual", "collision")]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            file = _find(name, folder, packages)
            if file is not None:
                mesh.set("filename", str(file))
            elif meshes == "ignore":
                missing.append(name)
                link.remove(shape)
                if shape.tag == "collision" and link.find("collision") is None:
                    passing.add(link.get("name", ""))
            else:
                raise document.fault(
                    mesh, f"the mesh {name!r} of link {link.get('name')!r} is missing", _mesh_remedy(name)
                )
    return (_missing_note(missing, sorted(passing)),) if missing else ()


def _missing_note(missing: Sequence[str], passing: Sequence[str]) -> str:
    """A note on meshes that are missing, and on the links that are left without any collision shape by that."""
    shapes = "1 shape is" if len(missing) == 1 else f"{len(missing)} shapes are"
    note = f"{shapes} left out, their mesh files are missing (the first is {shown(missing[0])}): kinematics needs none"
    links = [shown(link, 30) for link in passing]
    return note + (f", but nothing keeps these links apart from others: {few(links)}" if links else "")


def _mesh_remedy(name: str) -> str:
    if urlparse(name).scheme in ("http", "https"):
        return 'nothing is fetched from the net: store it next to the URDF, or load it without meshes="require"'
    if name.startswith("package://"):
        return 'name the folder that holds the package in ROS_PACKAGE_PATH, or load it without meshes="require"'
    return 'put it there, or load it without meshes="require": kinematics needs no meshes'


def _find(name: str, folder: Path, packages: Sequence[Path]) -> Path | None:
    if name.startswith("package://"):
        rest = name[len("package://") :].lstrip("/")
        ros = [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
        places = [root / rest for root in (*packages, *folder.parents, folder, *ros)]
    elif name.startswith("file://"):
        places = [Path(unquote(urlparse(name).path))]
    else:
        places = [folder / name]
    try:
        return next((p.resolve() for p in places if p.is_file()), None)
    except (OSError, ValueError):  # names too long or with characters no file can have
        return None


def few(names: Sequence[str]) -> str:
    """Names for a sentence: the first five of many."""
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


def set_base(document: Document, base: str) -> None:
    """Write the base into the file, so that its text alone gives the same subject."""
    for old in list(elements(document.root, "subject")):
        document.root.remove(old)
    document.root.insert(0, ET.Element("subject", {"base": base}))


def lock_joints(document: Document, names: Sequence[str]) -> None:
    """Fix joints of a checked URDF at their rest: the stabiliser's, else zero, moved into the limits.

    Raises
    ------
    InputError: a name is not a joint, or the joint is planar or floating, or follows another.
    """
    joints = {j.get("name", ""): j for j in elements(document.root, "joint")}
    mimics = read_mimics(document)
    masters = {m.joint: m.master for m in mimics}
    for name in names:
        if name not in joints:
            raise InputError(
                document.source, f"there is no joint {name!r}", place="lock", remedy=nearest(name, joints, "joints")
            )
        joint, kind = joints[name], joints[name].get("type")
        if kind in ("planar", "floating"):
            raise document.fault(joint, f"a {kind} joint has no single rest to lock at", 'make it type="fixed"')
        if name in masters and masters[name] not in names:
            raise document.fault(joint, f"it follows {masters[name]!r}", f"lock {masters[name]!r}, and both are fixed")
        if kind != "fixed" and name not in masters:
            rest = _rest(document, joint)
            lock_joint(document, joint, rest)
            for m in mimics:
                if m.master == name:
                    lock_joint(document, joints[m.joint], m.multiplier * rest + m.offset)
    for stabiliser in list(elements(document.root, "stabiliser")):
        if stabiliser.get("joint") in names:
            document.root.remove(stabiliser)


def lock_joint(document: Document, joint: ET.Element, rest: float) -> None:
    """Make a joint of one degree of freedom fixed, at a position `rest` [rad or m]."""
    origin, axis = joint.find("origin"), joint.find("axis")
    placement = pin.SE3.Identity()
    if origin is not None:
        rpy = document.triple(origin, "rpy")
        placement = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(document.triple(origin, "xyz")))
    direction = np.array([1.0, 0.0, 0.0] if axis is None else document.triple(axis, "xyz"))
    direction /= np.linalg.norm(direction)
    if joint.get("type") == "prismatic":
        motion = pin.SE3(np.eye(3), direction * rest)
    else:
        motion = pin.SE3(pin.exp3(direction * rest), np.zeros(3))
    placement = placement * motion
    for child in list(joint):
        if child.tag not in ("parent", "child"):
            joint.remove(child)
    joint.set("type", "fixed")
    numbers = {"xyz": placement.translation, "rpy": pin.rpy.matrixToRpy(placement.rotation)}
    ET.SubElement(joint, "origin", {k: " ".join(repr(float(v)) for v in n) for k, n in numbers.items()})


def _rest(document: Document, joint: ET.Element) -> float:
    rest = 0.0
    for stabiliser in elements(document.root, "stabiliser"):
        if stabiliser.get("joint") == joint.get("name"):
            rest = document.number(stabiliser, "rest")
    limit = joint.find("limit")
    if limit is None or joint.get("type") == "continuous":
        return rest
    return min(max(rest, document.number(limit, "lower")), document.number(limit, "upper"))


def add_link_landmarks(document: Document) -> tuple[str, ...]:
    """Make the origin of every link that hangs on a movable joint a landmark named after the link; returns notes."""
    moved = [ends_of(j)[1] for j in elements(document.root, "joint") if j.get("type") != "fixed"]
    for link in moved:
        ET.SubElement(document.root, "landmark", {"name": link, "link": link, "xyz": "0 0 0"})
    return (NO_LANDMARKS,) if moved else ()
