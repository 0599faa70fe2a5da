"""The elements kinemode adds to a URDF: subject, flesh, landmark, marker, zero, upright, stabiliser and proportion.

URDF parsers skip unknown elements, so one file serves Pinocchio, yourdfpy and kinemode.

    <subject base="free|fixed"/>
    <link ...><flesh .../></link>                     see `humanoid.subject.urdf_flesh`
    <landmark name link xyz [keypoint keypoint_std]/> a named point; where a detector marks it, off from there, and the
                                                      std of that [m]
    <marker name link xyz std/>                       a point that is measured in space; std of its place [m]
    <zero name std/>                                  by how much a degree of freedom may be off in all frames alike,
                                                      since markers may sit elsewhere; std [rad or m]
    <upright link xyz std/>                           up axis of the root link at rest, std of its tilt [rad]
    <stabiliser joint rest std [std_above] [quickness]/>
                                                      rest position and standard deviation [rad or m], another above it
                                                      where the joint's angles are not symmetric; how quickly the joint
                                                      moves, as a factor of the settings' speed and acceleration
    <proportion joint scale_min scale_max mean std symmetric_with/>

A proportion scales the origin of its joint, and of the joints named in `symmetric_with`, and stretches the flesh of
the parent link with it.

What Pinocchio gets is the URDF without these and without what it would act on differently or does not need: materials,
simulator and transmission elements, <mimic> (`humanoid.subject.mimic` ties the joints afterwards). Missing effort
and velocity limits, which a kinematic model does not use, are filled in for its parser.
"""

from __future__ import annotations

import copy
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from humanoid.subject.joint_names import ROOT_VELOCITY
from humanoid.subject.urdf_check import ends_of
from humanoid.subject.urdf_document import Document, elements, read_document
from humanoid.subject.urdf_flesh import FLESH_ATTRIBUTES, Flesh, numbers_text, read_flesh, stretched, write_flesh
from humanoid.subject.urdf_mimic import Mimic, mimic_of, read_mimics
from humanoid.support.errors import InputError, near_names, nearest

T = TypeVar("T")

_QUICKNESS = (0.01, 100.0)
LEAST_STD = 1e-6  # rad, m or a factor: what is surer than this divides by zero
_CLOSE_TAG = 0.75  # likeness from which an element is meant for one of ours; other programs have their own
_URDF = ("link", "joint", "material", "transmission", "gazebo", "inertial", "visual", "collision", "origin")
_ROOT: dict[str, tuple[str, ...]] = {
    "subject": ("base",),
    "landmark": ("name", "link", "xyz", "keypoint", "keypoint_std"),
    "marker": ("name", "link", "xyz", "std"),
    "zero": ("name", "std"),
    "upright": ("link", "xyz", "std"),
    "stabiliser": ("joint", "rest", "std", "std_above", "quickness"),
    "proportion": ("joint", "scale_min", "scale_max", "mean", "std", "symmetric_with"),
}
_LINK: dict[str, tuple[str, ...]] = {"flesh": FLESH_ATTRIBUTES}
_KEPT = {
    "robot": ("link", "joint"),
    "link": ("inertial", "visual", "collision"),
    "visual": ("origin", "geometry"),
    "collision": ("origin", "geometry"),
    "joint": ("origin", "parent", "child", "axis", "limit"),
}


@dataclass(frozen=True)
class Landmark:
    """A named point: `xyz` [m] in the frame of `link`.

    keypoint [m]: how far from there a detector marks it, in the same frame: a keypoint is a marker, whose place on the
    body is the same in all frames. keypoint_std [m]: standard deviation from that place along each axis; None where
    unknown, and then the value of `estimator.search.cost_terms` is assumed.
    """

    name: str
    link: str
    xyz: tuple[float, float, float]
    keypoint: tuple[float, float, float] = (0.0, 0.0, 0.0)
    keypoint_std: float | None = None


@dataclass(frozen=True)
class Marker:
    """A point that is measured in space, such as one on the skin: `xyz` [m] in the frame of `link`.

    std [m]: how far from there it may be, as one standard deviation along each axis.
    """

    name: str
    link: str
    xyz: tuple[float, float, float]
    std: float


@dataclass(frozen=True)
class Zero:
    """Uncertainty of the zero of a degree of freedom after a fit by markers.

    name: the joint, or of a free root `root_vx` to `root_wz`. std [rad or m]: standard deviation of its common error in
    all frames.
    """

    name: str
    std: float


@dataclass(frozen=True)
class UprightElement:
    """Equilibrium of a free root's tilt: the unit vector `axis` of the root link points up; `std` of the tilt [rad]."""

    link: str
    axis: tuple[float, float, float]
    std: float


@dataclass(frozen=True)
class Stabiliser:
    """Equilibrium of a joint (CSS 3.2.2): its commonest position and the standard deviations on either side of it.

    rest, std, std_above [rad or m]: the mode, and the scale below and above it; they differ for joints that are mostly
    near an end of their range, as knees are. quickness: the joint's usual speeds and accelerations, as a factor of
    those that settings have for all joints.
    """

    joint: str
    rest: float
    std: float
    std_above: float
    quickness: float = 1.0

    @property
    def moments(self) -> tuple[float, float]:
        """Mean and standard deviation [rad or m] of the two halves of Gaussians that it consists of (S. John, The
        three-parameter two-piece normal family, Communications in Statistics 11(8), 1982): what one Gaussian in its
        place has."""
        apart = self.std_above - self.std
        variance = (1.0 - 2.0 / math.pi) * apart**2 + self.std * self.std_above
        return self.rest + math.sqrt(2.0 / math.pi) * apart, math.sqrt(variance)


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
    """The result of `parse`, and the URDF without it."""

    base: str | None
    plain_urdf: str
    landmarks: tuple[Landmark, ...]
    flesh: tuple[Flesh, ...]
    stabilisers: tuple[Stabiliser, ...]
    proportions: tuple[Proportion, ...]
    upright: UprightElement | None
    mimics: tuple[Mimic, ...] = ()
    markers: tuple[Marker, ...] = ()
    zeros: tuple[Zero, ...] = ()


def parse(text: str, source: str) -> Elements:
    """Read the extra elements of a URDF text; faults raise InputError."""
    return read_elements(read_document(text, source))


def read_elements(document: Document) -> Elements:
    """Read the extra elements of a URDF whose links and joints have been checked.

    Raises
    ------
    InputError: an attribute is missing or out of range, a name unknown or given twice.
    """
    root = document.root
    _check_known(document)
    links = {e.get("name", "") for e in elements(root, "link")}
    joints = {e.get("name", ""): e for e in elements(root, "joint")}
    proportions = _each(document, "proportion", "joint", lambda e: _proportion(document, e, joints))
    _check_shared(document, proportions)
    return Elements(
        base=_base(document),
        plain_urdf=ET.tostring(_plain(root), encoding="unicode"),
        landmarks=_each(document, "landmark", "name", lambda e: _landmark(document, e, links)),
        flesh=tuple(
            read_flesh(document, link.get("name", ""), e)
            for link in elements(root, "link")
            for e in elements(link, "flesh")
        ),
        stabilisers=_each(document, "stabiliser", "joint", lambda e: _stabiliser(document, e, joints)),
        proportions=proportions,
        upright=_upright(document, links - {ends_of(j)[1] for j in joints.values()}),
        mimics=read_mimics(document),
        markers=_each(document, "marker", "name", lambda e: _marker(document, e, links)),
        zeros=_each(document, "zero", "name", lambda e: _zero(document, e, joints)),
    )


def _check_known(document: Document) -> None:
    """Refuse attributes that the extra elements do not have, and elements that may have been meant for them."""
    given = [(e, _ROOT) for e in elements(document.root)]
    given += [(e, _LINK) for link in elements(document.root, "link") for e in elements(link)]
    for element, own in given:
        tag = element.tag
        if tag not in own and tag not in _URDF and (meant := near_names(tag, own, close=_CLOSE_TAG)):
            raise document.fault(element, f"the element <{tag}> is unknown", f"did you mean <{meant[0]}>?")
        for key in element.attrib if tag in own else ():
            if key not in own[tag]:
                raise document.fault(element, f"the attribute {key!r} is unknown", nearest(key, own[tag], "attributes"))


def _upright(document: Document, roots: set[str]) -> UprightElement | None:
    given = _each(document, "upright", "link", lambda e: e)
    if not given:
        return None
    e = given[-1]
    link, axis, std = (
        document.attribute(e, "link"),
        np.array(document.triple(e, "xyz", None)),
        document.plausible(e, "std"),
    )
    if len(given) > 1:
        raise document.fault(e, "a second <upright>", "keep one")
    if link not in roots:
        raise document.fault(e, f"{link!r} is not the root link", nearest(link, roots, "root link"))
    if not np.any(axis) or std < LEAST_STD:
        raise document.fault(e, f"no direction, or std below {LEAST_STD:g}", 'such as xyz="0 0 1" std="0.35"')
    x, y, z = (axis / np.linalg.norm(axis)).tolist()
    return UprightElement(link, (x, y, z), std)


def _each(document: Document, tag: str, key: str, read: Callable[[ET.Element], T]) -> tuple[T, ...]:
    """All elements of a kind, each name once."""
    seen: set[str] = set()
    results = []
    for element in elements(document.root, tag):
        name = document.attribute(element, key)
        if name in seen:
            raise document.fault(element, f"a second <{tag}> of {name!r}", "keep one")
        seen.add(name)
        results.append(read(element))
    return tuple(results)


def _base(document: Document) -> str | None:
    given = list(elements(document.root, "subject"))
    if not given:
        return None
    base = given[-1].get("base")
    if len(given) > 1:
        raise document.fault(given[-1], "a second <subject>", "keep one")
    if base not in ("free", "fixed"):
        raise document.fault(given[0], f"base={base!r} is unknown", 'write base="free" or base="fixed"')
    return base


def _landmark(document: Document, e: ET.Element, links: set[str]) -> Landmark:
    name, link, xyz = document.attribute(e, "name"), _link(document, e, links), document.triple(e, "xyz")
    std = None if e.get("keypoint_std") is None else document.plausible(e, "keypoint_std")
    if std is not None and std < 0.0:
        raise document.fault(e, f"keypoint_std={std:g} is below 0", "give the deviation in m, or leave it out")
    return Landmark(name, link, xyz, document.triple(e, "keypoint"), std)


def _marker(document: Document, e: ET.Element, links: set[str]) -> Marker:
    std = _deviation(document, e, "std", "m")
    return Marker(document.attribute(e, "name"), _link(document, e, links), document.triple(e, "xyz"), std)


def _zero(document: Document, e: ET.Element, joints: Mapping[str, ET.Element]) -> Zero:
    name, known = document.attribute(e, "name"), [*joints, *ROOT_VELOCITY]
    if name not in known:
        raise document.fault(e, f"there is no joint {name!r}", nearest(name, known, "joints"))
    return Zero(name, _deviation(document, e, "std", "rad or m"))


def _deviation(document: Document, e: ET.Element, key: str, unit: str, default: str | None = None) -> float:
    """A standard deviation, by which can be divided."""
    std = document.plausible(e, key, default)
    if std < LEAST_STD:
        remedy = f"give the deviation in {unit}, above 0"
        raise document.fault(e, f"{key}={std:g} is not positive, or too small", remedy)
    return std


def _link(document: Document, e: ET.Element, links: set[str]) -> str:
    link = document.attribute(e, "link")
    if link not in links:
        raise document.fault(e, f"there is no link {link!r}", nearest(link, links, "links"))
    return link


def with_keypoint_places(
    text: str, source: str, places: Mapping[str, tuple[np.ndarray, float]], zeros: Sequence[Zero] = ()
) -> str:
    """A URDF whose landmarks have these places of keypoints, by name: offset (3,) and its deviation [m]; and the zeros
    that are known by them in place of its own."""
    document = read_document(text, source)
    _put_zeros(document, zeros)
    for element in elements(document.root, "landmark"):
        place = places.get(element.get("name", ""))
        if place is not None:
            element.set("keypoint", numbers_text(place[0]))
            element.set("keypoint_std", f"{place[1]:.17g}")
    return document.text()


def with_markers(text: str, source: str, markers: Sequence[Marker], zeros: Sequence[Zero] = ()) -> str:
    """The same URDF with these markers in place of its own, and the zeros that are known by them."""
    document = read_document(text, source)
    for old in list(elements(document.root, "marker")):
        document.root.remove(old)
    for m in markers:
        attributes = {"name": m.name, "link": m.link, "xyz": numbers_text(np.array(m.xyz)), "std": f"{m.std:.17g}"}
        ET.SubElement(document.root, "marker", attributes).tail = "\n"
    _put_zeros(document, zeros)
    return document.text()


def _put_zeros(document: Document, zeros: Sequence[Zero]) -> None:
    for old in list(elements(document.root, "zero")):
        document.root.remove(old)
    for zero in zeros:
        ET.SubElement(document.root, "zero", {"name": zero.name, "std": f"{zero.std:.17g}"}).tail = "\n"


def _joint_named(document: Document, e: ET.Element, name: str, joints: Mapping[str, ET.Element]) -> ET.Element:
    if name not in joints:
        raise document.fault(e, f"there is no joint {name!r}", nearest(name, joints, "joints"))
    return joints[name]


def _stabiliser(document: Document, e: ET.Element, joints: Mapping[str, ET.Element]) -> Stabiliser:
    name = document.attribute(e, "joint")
    joint = _joint_named(document, e, name, joints)
    kind, mimic = joint.get("type"), mimic_of(joint)
    if mimic is not None:
        master = mimic.get("joint")
        raise document.fault(e, f"joint {name!r} follows {master!r}", f"give the stabiliser to {master!r}")
    if kind not in ("revolute", "prismatic"):
        movable = [n for n, j in joints.items() if j.get("type") in ("revolute", "prismatic")]
        raise document.fault(e, f"joint {name!r} is {kind} and has no rest position", nearest(name, movable, "joints"))
    rest, std = document.plausible(e, "rest"), _deviation(document, e, "std", "rad or m")
    std_above = _deviation(document, e, "std_above", "rad or m", e.get("std"))
    quickness = document.plausible(e, "quickness", "1")
    if not _QUICKNESS[0] <= quickness <= _QUICKNESS[1]:
        remedy = f"give a factor of {_QUICKNESS[0]:g} to {_QUICKNESS[1]:g}, or leave it out"
        raise document.fault(e, f"quickness={quickness:g} is out of range", remedy)
    return Stabiliser(name, rest, std, std_above, quickness)


def _proportion(document: Document, e: ET.Element, joints: Mapping[str, ET.Element]) -> Proportion:
    name = document.attribute(e, "joint")
    low, high, mean, std = (document.plausible(e, key) for key in ("scale_min", "scale_max", "mean", "std"))
    proportion = Proportion(name, low, high, mean, std, tuple(e.get("symmetric_with", "").split()))
    for joint in proportion.joints:
        origin = _joint_named(document, e, joint, joints).find("origin")
        if origin is None or not any(document.triple(origin, "xyz")):
            raise document.fault(e, f"joint {joint!r} has no offset to scale", "name a joint whose origin is not zero")
    if not 0.0 < low <= high:
        raise document.fault(e, f"scale_min={low:g}, scale_max={high:g} is not a range", "0 < scale_min <= scale_max")
    if std < LEAST_STD or mean <= 0.0:
        raise document.fault(e, f"mean={mean:g}, std={std:g}: not positive", "mean near 1, std near 0.05")
    return proportion


def _check_shared(document: Document, proportions: Sequence[Proportion]) -> None:
    owner: dict[str, str] = {}
    for proportion, element in zip(proportions, elements(document.root, "proportion"), strict=True):
        for joint in proportion.joints:
            if joint in owner:
                raise document.fault(
                    element, f"joint {joint!r} is scaled by the proportion of {owner[joint]!r} already", "keep one"
                )
            owner[joint] = proportion.joint


def _plain(root: ET.Element) -> ET.Element:
    """A copy with only what Pinocchio needs."""
    plain = copy.deepcopy(root)
    for parent in list(plain.iter()):
        for key in [key for key in parent.attrib if ":" in key]:  # of other programs; yourdfpy complains of them
            del parent.attrib[key]
        kept = _KEPT.get(str(parent.tag))
        for child in list(parent):
            if not isinstance(child.tag, str) or (kept is not None and child.tag not in kept):
                parent.remove(child)
    for limit in plain.findall("joint/limit"):
        for key in ("effort", "velocity"):
            limit.attrib.setdefault(key, "1000")
    return plain


def scaled_urdf(text: str, source: str, scales: Mapping[str, float]) -> str:
    """The same URDF with the origins of the proportions' joints scaled, and the flesh of their parent links stretched.

    scales: keys are `Proportion.joint`, values factors on the file's lengths within the hard range; 1 where not given.
    The prior and range of each `<proportion>` are divided by its scale, so that the written file still prefers, and
    allows, the same lengths in metres.

    Raises
    ------
    InputError: a key is not a proportion, or a value is not within scale_min and scale_max.
    """
    document = read_document(text, source)
    proportions = {p.joint: p for p in read_elements(document).proportions}
    joints = {j.attrib["name"]: j for j in elements(document.root, "joint")}
    links = {e.attrib["name"]: e for e in elements(document.root, "link")}
    for name, value in scales.items():
        scale = _checked_scale(source, proportions, name, value)
        for link, offset in segments(document, proportions[name]).items():
            for element in elements(links[link], "flesh"):
                write_flesh(element, stretched(read_flesh(document, link, element), offset, scale))
        for joint in proportions[name].joints:
            origin = joints[joint].find("origin")
            assert origin is not None
            origin.set("xyz", numbers_text(np.array(document.triple(origin, "xyz")) * scale))
        for element in elements(document.root, "proportion"):
            if element.get("joint") == name:
                for key in ("scale_min", "scale_max", "mean", "std"):
                    element.set(key, f"{document.number(element, key) / scale:.17g}")
    return document.text()


def segments(document: Document, proportion: Proportion) -> dict[str, np.ndarray]:
    """The links whose flesh a proportion stretches, each with the offset (3,) [m] of the first joint it scales there.

    Neck and clavicles share the trunk, which is stretched once.
    """
    joints = {j.attrib["name"]: j for j in elements(document.root, "joint")}
    offsets: dict[str, np.ndarray] = {}
    for name in proportion.joints:
        origin = joints[name].find("origin")
        assert origin is not None
        offsets.setdefault(ends_of(joints[name])[0], np.array(document.triple(origin, "xyz")))
    return offsets


def _checked_scale(source: str, proportions: Mapping[str, Proportion], name: str, value: float) -> float:
    if name not in proportions:
        tied = next((p.joint for p in proportions.values() if name in p.symmetric_with), None)
        remedy = f"it is tied to {tied!r}" if tied else nearest(name, proportions, "proportions")
        raise InputError(source, f"there is no proportion {name!r}", place="scales", remedy=remedy)
    low, high = proportions[name].scale_min, proportions[name].scale_max
    slack = 1e-9 * high  # a fit that ends on the bound may differ from it in the last bit
    if not low - slack <= float(value) <= high + slack:
        raise InputError(
            source, f"scale {value:g} of {name!r} is out of range", place="scales", remedy=f"{low:g} to {high:g}"
        )
    return float(value)
