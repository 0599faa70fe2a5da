"""A URDF of another size: the whole body larger or smaller, its angles as they are."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from humanoid.subject.joint_names import ROOT_VELOCITY
from humanoid.subject.urdf_document import Document, elements
from humanoid.subject.urdf_flesh import numbers_text

_LENGTHS = {
    "origin": ("xyz",), "landmark": ("xyz", "keypoint", "keypoint_std"), "marker": ("xyz", "std"),
    "flesh": ("xyz", "radii", "radius", "length", "clearance"),
    "box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length"),
    "mesh": ("scale",),
}  # fmt: skip
"""Attributes that are lengths, or factors on them, by element."""
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def resize(document: Document, factor: float) -> None:
    """Multiply every length of a checked URDF, in place: joints, shapes, flesh, landmarks, ways of sliding joints with
    their rest and its deviation; masses as volumes. Proportions are relative and stay."""
    sliding = {joint.get("name") for joint in elements(document.root, "joint") if joint.get("type") == "prismatic"}
    for element in document.root.iter():
        tag = element.tag if isinstance(element.tag, str) else ""
        if tag == "mesh":
            element.attrib.setdefault("scale", "1 1 1")
        _multiply(element, _LENGTHS.get(tag, ()), factor)
        if tag == "flesh":
            _multiply(element, ("bend",), 1.0 / factor)  # a curvature
        if tag == "mass":
            _multiply(element, ("value",), factor**3)
        elif tag == "inertia":
            _multiply(element, _INERTIA, factor**5)
        elif tag == "zero" and element.get("name") in {*sliding, *ROOT_VELOCITY[:3]}:
            _multiply(element, ("std",), factor)
        elif tag == "stabiliser" and element.get("joint") in sliding:
            _multiply(element, ("rest", "std", "std_above"), factor)
        elif tag == "joint" and element.get("name") in sliding:
            for limit in elements(element, "limit"):
                _multiply(limit, ("lower", "upper"), factor)
            for mimic in elements(element, "mimic"):
                _multiply(mimic, ("offset",), factor)


def _multiply(element: ET.Element, keys: tuple[str, ...], factor: float) -> None:
    for key in keys:
        text = element.get(key)
        if text is not None and text not in ("on", "off"):  # of clearance
            element.set(key, numbers_text(factor * np.array([float(part) for part in text.split()])))
