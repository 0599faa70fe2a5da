"""The <flesh> elements of a subject: one part of the body each, read, written, and stretched with a segment.

    <flesh shape="superquadric" radii="a b c" exponents="e1 e2" taper="tx ty" bend="bx by" xyz rpy clearance/>
    <flesh shape="capsule" radius length xyz rpy clearance/>
    <flesh shape="ellipsoid" radii xyz rpy clearance/>

Parameters and deformations of a superquadric are those of `humanoid.subject.superquadric`; exponents are 1 1, taper and
bend 0 0 where they are not given.

clearance is the solid that other parts keep away from: "on", the default, the flesh itself; "off", nothing, for a part
that only fills a joint; "a b c", a solid with these half-axes [m] on the flesh's axes and centre. Flesh is as wide as a
person looks; a solid is slimmer, because soft parts give way, and arms rest against the trunk. A change of the
half-axes of the flesh, by a fit or a segment's length, changes those of its solid in proportion.

Flesh given other parameters, and which of its parts mirror each other.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pinocchio as pin

from humanoid.subject import superquadric
from humanoid.subject.urdf_document import PLAUSIBLE, Document, elements
from humanoid.support.errors import InputError, nearest

SHAPES: tuple[Literal["superquadric", "capsule", "ellipsoid"], ...] = ("superquadric", "capsule", "ellipsoid")
FLESH_ATTRIBUTES: tuple[str, ...] = (
    "shape",
    "radii",
    "radius",
    "length",
    "exponents",
    "taper",
    "bend",
    "xyz",
    "rpy",
    "clearance",
)
ROUND = 1.25  # a section whose half-axes differ by no more is a limb's
OVERLAP = 0.5  # of a limb's radius: how far its flesh reaches beyond its capsule at either end


@dataclass(frozen=True)
class Flesh:
    """A part of the body, fixed to a link.

    `size` is the half-axes for a superquadric or ellipsoid, and (radius, length of the cylindrical part along z, 0)
    for a capsule, all in metres; `xyz`, `rpy` place the part's frame in the link's frame. `exponents`, `taper` and
    `bend` deform a superquadric and are neutral for the other shapes. `clearance`: other parts keep away from it.
    `solid`: half-axes [m] of the solid that they keep away from, None for those of `size`; never of a capsule.
    """

    link: str
    shape: Literal["superquadric", "capsule", "ellipsoid"]
    size: tuple[float, float, float]
    xyz: tuple[float, float, float]
    rpy: tuple[float, float, float]
    exponents: tuple[float, float] = (1.0, 1.0)
    taper: tuple[float, float] = (0.0, 0.0)
    bend: tuple[float, float] = (0.0, 0.0)
    clearance: bool = True
    solid: tuple[float, float, float] | None = None

    @property
    def core(self) -> Flesh:
        """The flesh as thick as its solid, which determines distances between parts and its stretching."""
        return self if self.solid is None else replace(self, size=self.solid, solid=None)

    @property
    def parameters(self) -> np.ndarray:
        """The nine deformable parameters (9,): size, exponents, taper, bend (CSS section 2)."""
        return np.array([*self.size, *self.exponents, *self.taper, *self.bend])

    def widened(self, girth: float) -> list[float]:
        """The nine parameters with a cross-section that is `girth` times as wide."""
        return [float(v) for v in self.parameters * [girth, girth, *[1.0] * 7]]

    def with_parameters(self, parameters: np.ndarray) -> Flesh:
        """The same part with other parameters (9,), in its place; its solid changes in proportion."""
        p = [float(v) for v in parameters]
        size = (p[0], p[1], p[2])
        made = replace(self, size=size, exponents=(p[3], p[4]), taper=(p[5], p[6]), bend=(p[7], p[8]))
        if self.solid is None:
            return made
        a, b, c = (own * (new / old) for own, new, old in zip(self.solid, size, self.size, strict=True))
        return replace(made, solid=(a, b, c))

    @property
    def state(self) -> np.ndarray:
        """Place and parameters: xyz, then the nine (12,)."""
        return np.concatenate([self.xyz, self.parameters])

    def with_state(self, state: np.ndarray) -> Flesh:
        """The same part with another `state` (12,)."""
        x, y, z = (float(v) for v in state[:3])
        return replace(self.with_parameters(state[3:]), xyz=(x, y, z))

    @property
    def R_link_part(self) -> np.ndarray:
        """Rotation of T_link_part, (3, 3)."""
        return np.array(pin.rpy.rpyToMatrix(*self.rpy))


def read_flesh(document: Document, link: str, e: ET.Element) -> Flesh:
    """One <flesh> of a link.

    Raises
    ------
    InputError: an attribute is missing, no number or out of range.
    """
    xyz, rpy, shape = document.triple(e, "xyz"), document.triple(e, "rpy"), document.attribute(e, "shape")
    solid = _read_solid(document, e, shape)
    clearance = e.get("clearance", "on") != "off"
    if shape == "capsule":
        size = (document.number(e, "radius"), document.number(e, "length"), 0.0)
        if size[0] <= 0.0 or size[1] < 0.0 or max(size) > PLAUSIBLE:
            raise document.fault(e, "a size is not positive", "give radii and lengths in metres, above 0")
        return Flesh(link, "capsule", size, xyz, rpy, clearance=clearance)
    if shape not in SHAPES:
        raise document.fault(e, f"unknown shape {shape!r}", "shapes: " + ", ".join(SHAPES))
    flesh = Flesh(link, "ellipsoid", document.triple(e, "radii", None), xyz, rpy, clearance=clearance)
    if shape == "superquadric":
        pairs = [document.numbers(e, k, 2, d) for k, d in (("exponents", "1 1"), ("taper", "0 0"), ("bend", "0 0"))]
        given = np.concatenate([flesh.size, *pairs])
        flesh = replace(flesh.with_parameters(given), shape="superquadric")
    fault = superquadric.fault(flesh.parameters)
    if fault is not None:
        raise document.fault(e, *fault)
    return replace(flesh, solid=solid)


def _read_solid(document: Document, e: ET.Element, shape: str) -> tuple[float, float, float] | None:
    """The half-axes that clearance gives; None where it is "on" or "off"."""
    given = e.get("clearance", "on")
    if given in ("on", "off"):
        return None
    if shape == "capsule" or len(given.split()) != 3:
        choices = "on or off" if shape == "capsule" else "on, off, or three half-axes in metres"
        raise document.fault(e, f"clearance={given[:40]!r} is unknown", f"clearance of this shape: {choices}")
    solid = document.triple(e, "clearance", None)
    if min(solid) <= 0.0 or max(solid) > PLAUSIBLE:
        raise document.fault(e, "a half-axis of clearance is not positive", "give half-axes in metres, above 0")
    return solid


def write_flesh(e: ET.Element, flesh: Flesh) -> None:
    """Write place and shape into a <flesh>, with every digit."""
    for key in ("radius", "length", "radii", "exponents", "taper", "bend"):
        e.attrib.pop(key, None)
    e.set("shape", flesh.shape)
    if flesh.shape == "capsule":
        e.set("radius", numbers_text(flesh.size[:1]))
        e.set("length", numbers_text(flesh.size[1:2]))
    else:
        e.set("radii", numbers_text(flesh.size))
    if flesh.shape == "superquadric":
        for key, pair in (("exponents", flesh.exponents), ("taper", flesh.taper), ("bend", flesh.bend)):
            e.set(key, numbers_text(pair))
    if flesh.solid is not None:
        e.set("clearance", numbers_text(flesh.solid))
    e.set("xyz", numbers_text(flesh.xyz))


def numbers_text(values: np.ndarray | tuple[float, ...]) -> str:
    """Numbers as an attribute that reads back to the same bits."""
    return " ".join(f"{v:.17g}" for v in values)


def limb_capsule(flesh: Flesh) -> tuple[float, float] | None:
    """Radius and length of the cylindrical part [m] of a superquadric limb's capsule; None for anything but a limb.

    It uses the solid's half-axes. A limb has a nearly round section (half-axes a, b within a factor of 1.25) and is
    long: c >= 1.5 r with the mean radius r = (a + b) / 2. Its flesh has to cover the joints at its ends, its capsule
    has to leave them free: the capsule has the radius r and is shorter by r / 2 at either end. Exponents, taper and
    bend do not count.
    """
    a, b, c = flesh.core.size
    radius = (a + b) / 2.0
    length = 2.0 * (c - (1.0 + OVERLAP) * radius)
    limb = flesh.shape == "superquadric" and max(a, b) <= ROUND * min(a, b) and length >= 0.0
    return (radius, length) if limb else None


def stretch_matrix(flesh: Flesh, offset: np.ndarray) -> np.ndarray:
    """Growth of a part when the segment `offset` (3,) [m], in its link's frame, is scaled: A (12, 12).

    With x = `Flesh.state`, the stretched part has the state x + (scale - 1) A x: its centre moves along the segment,
    and a capsule grows between its ends. So does a limb, for its solid capsule's sake; other parts grow along the axis
    that is nearest to the segment.
    """
    A = np.zeros((12, 12))
    axis = offset / np.linalg.norm(offset)
    A[:3, :3] = np.outer(axis, axis)
    along = np.abs(flesh.R_link_part.T @ axis)  # the segment in the part's own frame
    if flesh.shape == "capsule":
        A[4, 4] = along[2]
    elif limb_capsule(flesh) is not None:
        slimness = np.array(flesh.core.size) / np.array(flesh.size)
        A[5, 3:6] = along[2] * np.array([-(1.0 + OVERLAP) / 2.0, -(1.0 + OVERLAP) / 2.0, 1.0]) * slimness / slimness[2]
    else:
        grown = 3 + int(np.argmax(along))
        A[grown, grown] = 1.0
    return A


def stretched(flesh: Flesh, offset: np.ndarray, scale: float) -> Flesh:
    """The part after the segment `offset` (3,) [m], in its link's frame, was multiplied by `scale`."""
    grown = flesh.with_state(flesh.state + (scale - 1.0) * (stretch_matrix(flesh, offset) @ flesh.state))
    if flesh.solid is None:
        return grown
    return replace(grown, solid=stretched(flesh.core, offset, scale).size)  # the same bits for any flesh


def reshape(document: Document, shapes: Mapping[int | str, Sequence[float]]) -> None:
    """Give parts other parameters, in place; they become superquadrics.

    shapes: nine parameters (`humanoid.subject.superquadric`) by the part's place among the document's parts, or by its
    link, which then has to have one part.

    Raises
    ------
    InputError: there is no such part, or its parameters are not a surface.
    """
    links = [link for link in elements(document.root, "link") for _ in elements(link, "flesh")]
    parts = [e for link in elements(document.root, "link") for e in elements(link, "flesh")]
    names = [link.get("name", "") for link in links]
    for key, values in shapes.items():
        k = _part_index(document.source, names, key)
        parameters = np.asarray(values, dtype=float)
        fault = superquadric.fault(parameters)
        if fault is not None:
            raise InputError(document.source, fault[0], place=f"shape of {key!r}", remedy=fault[1])
        flesh = read_flesh(document, names[k], parts[k]).with_parameters(parameters)
        write_flesh(parts[k], replace(flesh, shape="superquadric"))


def _part_index(source: str, names: Sequence[str], key: int | str) -> int:
    if isinstance(key, str):
        count = names.count(key)
        if count == 1:
            return names.index(key)
        problem = f"link {key!r} has {count} parts" if count else f"link {key!r} has no flesh"
        places = ", ".join(str(k) for k, name in enumerate(names) if name == key)
        remedy = f"name the part by its number, one of {places}" if count else nearest(key, names, "links")
        raise InputError(source, problem, place="shapes", remedy=remedy)
    if not 0 <= key < len(names):
        raise InputError(source, f"there is no part {key}", place="shapes", remedy=f"0 to {len(names) - 1}")
    return int(key)


def mirror_parts(links: Sequence[str]) -> np.ndarray:
    """The part that mirrors each part, (B,) int, itself without one.

    links (B): the links of the parts. Two parts mirror each other if their links' names differ in left and right, and
    if they come equally far among the parts of their links. `superquadric.MIRROR` turns the parameters of the one into
    those of the other.
    """
    known = {(link, list(links[:k]).count(link)): k for k, link in enumerate(links)}
    swap = {"left": "right", "right": "left"}
    other = [re.sub("left|right", lambda m: swap[m.group()], link) for link in links]
    return np.array([known.get((other[k], order), k) for (_, order), k in known.items()], dtype=np.int64)
