"""The subject: one articulated body as its URDF describes it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from humanoid.subject import example_robots, urdf_elements
from humanoid.subject.joint_names import ROOT_VELOCITY
from humanoid.subject.landmark_file import SUFFIX, merge_landmark_file
from humanoid.subject.mimic import settle_mimics, with_mimics
from humanoid.subject.urdf_check import check_urdf, check_with_yourdfpy, natural_base
from humanoid.subject.urdf_document import Document, elements, read_document
from humanoid.subject.urdf_edit import Meshes, add_link_landmarks, lock_joints, resolve_meshes, set_base
from humanoid.subject.urdf_elements import Landmark, Marker, Proportion, Stabiliser, UprightElement, Zero
from humanoid.subject.urdf_flesh import Flesh, numbers_text, reshape
from humanoid.subject.urdf_mimic import Mimic, read_mimics
from humanoid.support.errors import InputError, misplaced, nearest
from humanoid.support.files import read_bytes, replacing
from humanoid.support.quiet import quiet
from humanoid.support.summary import Facts, Summarised

__all__ = [
    "Flesh",
    "Landmark",
    "Marker",
    "Proportion",
    "Stabiliser",
    "Subject",
    "SubjectName",
    "UprightElement",
    "Zero",
    "is_built_in",
    "load_subject",
    "subject_from_text",
    "subject_names",
]

URDF_FOLDER = Path(__file__).parent.parent / "urdf"
BUILT_IN = {
    "human34": "adult with clavicles, free root (CSS, Sminchisescu and Triggs 2003)",
    "human30": "human34 with the clavicles locked at rest (the first body of CSS section 6)",
    "arm8": "left arm with clavicle on a fixed trunk (CSS arm)",
    "upper13": "upper body seen under orthogonal projection (Taycher, Fisher and Darrell 2004)",
}
_CLAVICLES = tuple(f"{side}_clavicle_{turn}" for side in ("left", "right") for turn in ("elevation", "protraction"))
_LOCKED = {"human30": ("human34", _CLAVICLES)}
"""Built-in subjects without a file: that of another, some of its joints locked."""
Base = Literal["auto", "free", "fixed"]
_LENGTHS = {
    "origin": ("xyz",), "landmark": ("xyz", "keypoint", "keypoint_std"), "marker": ("xyz", "std"),
    "flesh": ("xyz", "radii", "radius", "length", "clearance"),
    "box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length"),
    "mesh": ("scale",),
}  # fmt: skip
"""Attributes that are lengths, or factors on them, by element."""
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


@dataclass(frozen=True, repr=False)
class Subject(Summarised):
    """A validated subject.

    Attributes
    ----------
    name: name of the robot in the file.
    source: the request: a built-in name or a path.
    urdf: the whole URDF as text, extra elements included, meshes by absolute path; `subject_from_text` gives the same
        subject from it, wherever it is kept.
    base: "free" (root xyz + quaternion xyzw lead q) or "fixed".
    model: Pinocchio model; shared, never changed.
    landmarks, markers, zeros, flesh, stabilisers, proportions, upright: the extra elements (see
        `humanoid.subject.urdf_elements`).
    mimics: joints that follow others; they are joints of the model, but have no entries in q and in the tangent space.
    notes: what was done to the file that a user should know, one sentence each.
    """

    name: str
    source: str
    urdf: str
    base: Literal["free", "fixed"]
    model: pin.Model
    landmarks: tuple[Landmark, ...] = ()
    flesh: tuple[Flesh, ...] = ()
    stabilisers: tuple[Stabiliser, ...] = ()
    proportions: tuple[Proportion, ...] = ()
    upright: UprightElement | None = None
    notes: tuple[str, ...] = ()
    mimics: tuple[Mimic, ...] = ()
    markers: tuple[Marker, ...] = ()
    zeros: tuple[Zero, ...] = ()

    def _called(self) -> str:
        return self.name

    def _facts(self) -> Facts:
        facts = [("degrees of freedom", self.model.nv), ("root", self.base), ("landmarks", len(self.landmarks))]
        return [*facts, ("parts of flesh", len(self.flesh)), ("source", self.source)]

    def __reduce_ex__(self, protocol: Any) -> str | tuple[Any, ...]:
        """Rebuilt from its text in another process where joints follow others: Pinocchio cannot pickle such models."""
        if not self.mimics:
            return super().__reduce_ex__(protocol)
        return _remade, (self.urdf, self.source, self.base, self.notes)

    def scaled(self, scales: Mapping[str, float]) -> Subject:
        """This subject with some proportions changed.

        scales: keys are `Proportion.joint`, values multiply this subject's lengths; see `urdf_elements.scaled_urdf`.
        Raises InputError for an unknown key or a value outside the hard range.
        """
        text = urdf_elements.scaled_urdf(self.urdf, self.source, scales)
        return subject_from_text(text, source=self.source, base=self.base, notes=self.notes)

    def resized(self, factor: float) -> Subject:
        """This subject larger or smaller as a whole, all lengths times a factor; angles and proportions stay."""
        document = read_document(self.urdf, self.source)
        resize(document, factor)
        return subject_from_text(document.text(), source=self.source, base=self.base, notes=self.notes)

    def reshaped(self, shapes: Mapping[int | str, Sequence[float]]) -> Subject:
        """This subject with other flesh on some parts; their places stay.

        shapes: the nine parameters of `humanoid.subject.superquadric`, by the part's index in `flesh`, or by the name
        of its link if it is the only part there. Raises InputError for an unknown part, or parameters that are no
        surface.
        """
        document = read_document(self.urdf, self.source)
        reshape(document, shapes)
        return subject_from_text(document.text(), source=self.source, base=self.base, notes=self.notes)

    def with_keypoint_places(
        self, places: Mapping[str, tuple[np.ndarray, float]], zeros: Sequence[Zero] = ()
    ) -> Subject:
        """This subject with the places at which keypoints are marked, by landmark: offset from the landmark (3,) in its
        link's frame, and its standard deviation [m], those of other landmarks stay; and with the zeros of its joints
        that follow from them."""
        text = urdf_elements.with_keypoint_places(self.urdf, self.source, places, zeros)
        return subject_from_text(text, source=self.source, base=self.base, notes=self.notes)

    def with_markers(self, markers: Sequence[Marker], zeros: Sequence[Zero] = ()) -> Subject:
        """This subject with these markers in place of its own, and with what is known by them of its joints' zeros.
        Raises InputError for a link or joint that it does not have, a name given twice, or a deviation that is not
        positive."""
        text = urdf_elements.with_markers(self.urdf, self.source, markers, zeros)
        return subject_from_text(text, source=self.source, base=self.base, notes=self.notes)

    def write(self, path: str | Path) -> None:
        """Write the URDF; `load_subject(path)` gives the same subject. Raises InputError if it cannot be written."""
        with replacing(path) as temporary:
            temporary.write_text(self.urdf, encoding="utf-8")


@dataclass(frozen=True)
class SubjectName:
    """Subjects that can be loaded by name: the name, one line about it, its degrees of freedom."""

    name: str
    about: str
    dof: int


def subject_names() -> tuple[SubjectName, ...]:
    """Everything `load_subject` finds by name on this machine."""
    about = {**BUILT_IN, **{example_robots.PREFIX + n: r.about for n, r in example_robots.installed().items()}}
    return tuple(SubjectName(name, text, load_subject(name).model.nv) for name, text in about.items())


def subject_from_text(text: str, *, source: str, base: Base = "auto", notes: tuple[str, ...] = ()) -> Subject:
    """Build a Subject from URDF text; `source` names it in errors. Meshes are not read.

    Raises
    ------
    InputError: see `humanoid.subject.urdf_check.check_urdf` and `humanoid.subject.urdf_elements.read_elements`.
    """
    document = read_document(text, source)
    check_urdf(document)
    if read_mimics(document):
        settle_mimics(document)
        text = document.text()
    return _subject(document, text, source, base, notes)


def _remade(text: str, source: str, base: Base, notes: tuple[str, ...]) -> Subject:
    return subject_from_text(text, source=source, base=base, notes=notes)


def _base_of(document: Document, base: Base) -> Literal["free", "fixed"]:
    """The requested base, or the file's own, or the natural one."""
    own = document.root.find("subject")
    if base == "auto":
        return "free" if (natural_base(document) if own is None else own.get("base")) == "free" else "fixed"
    return base


def _subject(document: Document, text: str, source: str, base: Base, notes: tuple[str, ...]) -> Subject:
    read = urdf_elements.read_elements(document)
    floating = _base_of(document, base)
    model = with_mimics(_build_model(read.plain_urdf, source, free=floating == "free"), read.mimics, source)
    return Subject(
        name=model.name,
        source=source,
        urdf=text,
        base=floating,
        model=model,
        landmarks=read.landmarks,
        flesh=read.flesh,
        stabilisers=read.stabilisers,
        proportions=read.proportions,
        upright=read.upright,
        notes=notes,
        mimics=read.mimics,
        markers=read.markers,
        zeros=read.zeros,
    )


def _build_model(plain_urdf: str, source: str, *, free: bool) -> pin.Model:
    try:
        with quiet():
            if free:
                model = pin.buildModelFromXML(plain_urdf, pin.JointModelFreeFlyer())
            else:
                model = pin.buildModelFromXML(plain_urdf)
    except (ValueError, RuntimeError) as error:
        problem = f"Pinocchio cannot build it: {' '.join(str(error).split())}"
        raise InputError(source, problem, remedy="compare with a URDF that loads, such as human34") from error
    if model.nv == 0:
        raise InputError(source, "nothing in it can move", remedy='add a movable joint, or load it with base="free"')
    return model


def is_built_in(subject: Subject) -> bool:
    """Whether this is a built-in subject with the proportions and flesh it was shipped with, fitted to no person."""
    if subject.source not in BUILT_IN:
        return False
    shipped = load_subject(subject.source)
    return (subject.proportions, subject.flesh) == (shipped.proportions, shipped.flesh)


def load_subject(
    source: str | Path,
    *,
    base: Base = "auto",
    landmarks: str | Path | None = None,
    lock: Sequence[str] = (),
    meshes: Meshes = "ignore",
    package_dirs: Sequence[str | Path] = (),
) -> Subject:
    """Load a built-in subject or a robot of example-robot-data by name (`subject_names`), or any URDF by path.

    Parameters
    ----------
    source:
        A name or a path; a built-in name goes before a file of that name.
    base:
        "auto" takes the file's <subject base="...">; a file without one is free if several movable joints leave its
        root link and fixed if one does, as in a serial arm, or if its root link is called "world".
    landmarks:
        A landmark file (`humanoid.subject.landmark_file`). By default the one next to the URDF, <stem>.landmarks.toml,
        if the URDF has no <landmark> of its own. A URDF with neither gets a landmark at the origin of every link that
        hangs on a movable joint, named after the link.
    lock:
        Joints to fix at their rest (the stabiliser's, else zero, moved into the limits).
    meshes:
        "ignore": shapes whose mesh file is missing are left out, with a note, and kinematics are the same; "require": a
        missing mesh is an error, for what draws or collides.
    package_dirs:
        Folders that package:// names start in, before those above the URDF and in ROS_PACKAGE_PATH.

    Raises
    ------
    InputError: anything is wrong with the file, with the place and a remedy.
    """
    if not isinstance(source, (str, Path)):
        raise misplaced("subject", source, "a built-in name, or the path of a URDF")
    _check_choice("base", base, ("auto", "free", "fixed"))
    _check_choice("meshes", meshes, ("ignore", "require"))
    name, packages = str(source), [Path(p) for p in package_dirs]
    if name in BUILT_IN and base == "auto" and landmarks is None and not lock:
        return _built_in(name)
    return _loaded(name, base, None if landmarks is None else Path(landmarks), lock, meshes, packages)


@cache  # they cannot change, and one object for all lets what is worked out of it be kept with it
def _built_in(name: str) -> Subject:
    return _loaded(name, "auto", None, (), "require", [])


def _loaded(
    name: str, base: Base, landmark_file: Path | None, lock: Sequence[str], meshes: Meshes, packages: list[Path]
) -> Subject:
    """See `load_subject`."""
    whole, locked = _LOCKED.get(name, (name, ()))
    path = URDF_FOLDER / f"{whole}.urdf" if name in BUILT_IN else Path(name)
    own_landmarks = None
    if name.startswith(example_robots.PREFIX):
        path, share, own_landmarks = example_robots.find(name)
        packages = [*packages, share]
    document = read_document(read_bytes(path, remedy=_known_names(name)), name)
    check_urdf(document)
    read = urdf_elements.read_elements(document)  # faults are reported with the file's lines, before it is changed
    if name not in BUILT_IN:
        check_with_yourdfpy(read.plain_urdf, name)
    landmark_file = landmark_file or own_landmarks or _beside(document, path)
    notes = resolve_meshes(document, path.resolve().parent, packages, meshes)
    if landmark_file is not None:
        merge_landmark_file(document, landmark_file)
    notes += settle_mimics(document)
    if document.root.find("landmark") is None:
        notes += add_link_landmarks(document)
    base = _base_of(document, base)  # of the unchanged file, before joints are locked
    set_base(document, base)
    lock_joints(document, [*locked, *([lock] if isinstance(lock, str) else lock)])
    if name in _LOCKED:
        document.root.set("name", name)
    return _subject(document, document.text(), name, base, notes)


def _check_choice(option: str, value: str, valid: tuple[str, ...]) -> None:
    if value not in valid:
        raise InputError(repr(value), f"is not a valid {option}", remedy="one of " + ", ".join(valid))


def _known_names(name: str) -> str:
    names = [*BUILT_IN, *(example_robots.PREFIX + n for n in example_robots.installed())]
    return "give a path to a URDF, or a name: " + nearest(name, names, "names").replace("valid names: ", "")


def _beside(document: Document, path: Path) -> Path | None:
    """The landmark file next to a URDF without landmarks of its own; one that kinemode wrote is complete in itself."""
    beside = path.with_name(path.stem + SUFFIX)
    return beside if beside.is_file() and document.root.find("landmark") is None else None


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
