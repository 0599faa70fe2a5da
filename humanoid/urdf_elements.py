"""The elements kinemode adds to a URDF: <subject>, <flesh>, <landmark>, <stabiliser>, <proportion>.

URDF parsers skip what they do not know, so one file serves Pinocchio, yourdfpy and kinemode.

    <subject base="free|fixed"/>
    <link ...><flesh shape="capsule" radius length xyz rpy/> or <flesh shape="ellipsoid" radii xyz rpy/></link>
    <landmark name link xyz/>
    <stabiliser joint rest std/>                      rest position and standard deviation [rad or m]
    <proportion joint scale_min scale_max mean std symmetric_with/>

A proportion scales the origin of its joint, and of the joints named in `symmetric_with`, and stretches the flesh of
the parent link with it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

EXTRA_TAGS = ("subject", "landmark", "stabiliser", "proportion")


@dataclass(frozen=True)
class Landmark:
    """A named point: `xyz` [m] in the frame of `link`."""

    name: str
    link: str
    xyz: tuple[float, float, float]


@dataclass(frozen=True)
class Flesh:
    """A simple solid on a link.

    `size` is (radius, length of the cylindrical part along z, 0) for a capsule and the three radii for an ellipsoid,
    all in metres; `xyz`, `rpy` place the solid's frame in the link's frame.
    """

    link: str
    shape: Literal["capsule", "ellipsoid"]
    size: tuple[float, float, float]
    xyz: tuple[float, float, float]
    rpy: tuple[float, float, float]


@dataclass(frozen=True)
class Stabiliser:
    """Equilibrium of a joint (CSS 3.2.2): rest position and standard deviation [rad or m]."""

    joint: str
    rest: float
    std: float


@dataclass(frozen=True)
class Proportion:
    """A segment length that may be fitted: scale of a joint's origin, with its prior (CSS 3.2.1) and hard range."""

    joint: str
    scale_min: float
    scale_max: float
    mean: float
    std: float
    symmetric_with: tuple[str, ...] = ()

    @property
    def joints(self) -> tuple[str, ...]:
        """Every joint whose origin this proportion scales."""
        return (self.joint, *self.symmetric_with)


@dataclass(frozen=True)
class Elements:
    """What `parse` found, and the URDF without it."""

    base: str | None
    plain_urdf: str
    landmarks: tuple[Landmark, ...]
    flesh: tuple[Flesh, ...]
    stabilisers: tuple[Stabiliser, ...]
    proportions: tuple[Proportion, ...]


def _triple(text: str | None) -> tuple[float, float, float]:
    a, b, c = (float(x) for x in (text or "0 0 0").split())
    return a, b, c


def _flesh(link: str, e: ET.Element) -> Flesh:
    if e.get("shape") == "capsule":
        size = (float(e.attrib["radius"]), float(e.attrib["length"]), 0.0)
        return Flesh(link, "capsule", size, _triple(e.get("xyz")), _triple(e.get("rpy")))
    return Flesh(link, "ellipsoid", _triple(e.get("radii")), _triple(e.get("xyz")), _triple(e.get("rpy")))


def parse(text: str, source: str) -> Elements:
    """Read the extra elements of a URDF text."""
    root = ET.fromstring(text)
    subject = root.find("subject")
    landmarks = tuple(
        Landmark(e.attrib["name"], e.attrib["link"], _triple(e.get("xyz"))) for e in root.findall("landmark")
    )
    flesh = tuple(_flesh(link.attrib["name"], e) for link in root.findall("link") for e in link.findall("flesh"))
    stabilisers = tuple(
        Stabiliser(e.attrib["joint"], float(e.attrib["rest"]), float(e.attrib["std"]))
        for e in root.findall("stabiliser")
    )
    proportions = tuple(
        Proportion(
            e.attrib["joint"],
            float(e.attrib["scale_min"]),
            float(e.attrib["scale_max"]),
            float(e.attrib["mean"]),
            float(e.attrib["std"]),
            tuple(e.get("symmetric_with", "").split()),
        )
        for e in root.findall("proportion")
    )
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag in EXTRA_TAGS or child.tag == "flesh":
                parent.remove(child)
    plain = ET.tostring(root, encoding="unicode")
    return Elements(
        subject.get("base") if subject is not None else None, plain, landmarks, flesh, stabilisers, proportions
    )


def scaled_urdf(text: str, proportions: Sequence[Proportion], scales: Mapping[str, float]) -> str:
    """The same URDF with the origins of the proportions' joints scaled, and the flesh of their parent links stretched.

    The prior of each `<proportion>` is divided by its scale, so that the written file still prefers, and allows, the
    same lengths in metres.
    """
    root = ET.fromstring(text, parser=ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    joints = {j.attrib["name"]: j for j in root.findall("joint")}
    links = {e.attrib["name"]: e for e in root.findall("link")}
    for proportion in proportions:
        scale = float(scales.get(proportion.joint, 1.0))
        stretched: set[str] = set()
        for name in proportion.joints:
            origin = joints[name].find("origin")
            assert origin is not None
            offset = np.array(_triple(origin.get("xyz")))
            origin.set("xyz", _text(offset * scale))
            parent = joints[name].find("parent")
            assert parent is not None
            link = parent.attrib["link"]
            if link not in stretched:  # neck and clavicles share the trunk, which is stretched once
                stretched.add(link)
                for flesh in links[link].findall("flesh"):
                    _stretch(flesh, offset, scale)
        for element in root.findall("proportion"):
            if element.get("joint") == proportion.joint:
                for key in ("scale_min", "scale_max", "mean", "std"):
                    element.set(key, f"{float(element.attrib[key]) / scale:.9g}")
    return ET.tostring(root, encoding="unicode")


def _stretch(flesh: ET.Element, offset: np.ndarray, scale: float) -> None:
    """Move a solid's centre along the segment that was scaled, and lengthen the solid with it."""
    axis = offset / np.linalg.norm(offset)
    centre = np.array(_triple(flesh.get("xyz")))
    flesh.set("xyz", _text(centre + axis * (axis @ centre) * (scale - 1.0)))
    if flesh.get("shape") == "capsule":
        flesh.set("length", f"{float(flesh.attrib['length']) * scale:.9g}")
    else:
        radii = np.array(_triple(flesh.get("radii")))
        radii[np.argmax(np.abs(axis))] *= scale
        flesh.set("radii", _text(radii))


def _text(xyz: np.ndarray) -> str:
    return " ".join(f"{v:.9g}" for v in xyz)
