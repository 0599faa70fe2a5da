"""A landmark file to start from, for a URDF without landmarks: every joint, the ends of its chains, rests to fill in.

Links whose names, or whose joints' names, contain a side and a joint of the body ("l_elbow_flex_link", "LHipPitch",
"left_knee") are given COCO's names. Several joints at one part of the body, such as the three of a hip, share one
landmark, at the middle one.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body, PosedBody
from humanoid.shape.solids import ConvexSolid, Geometry, farthest, solids_of
from humanoid.subject.landmarks import COCO17
from humanoid.subject.subject import Subject
from humanoid.subject.urdf_document import elements, read_document
from humanoid.support.errors import InputError

FEWEST_NAMED = 4
"""COCO names below which the links keep their own names: a body with so few of them is not a person's."""
_SIDES = {"left": "left", "l": "left", "right": "right", "r": "right"}
_PARTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_FROM_END = 0.1
_SOLES = "soles: under the ends of what hangs on an ankle"
_DEVIATIONS = 4.0  # assumed width of a joint's range, in standard deviations
_TIPS = "tips of the last links: where the line from their joint through their middle leaves them"
_NO_WIDTH = 1e-3  # m: of parts that are on no side
_ALONG_AXIS = 0.98  # cosine from which left is along an axis: about 10 degrees
_BARE = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True)
class LandmarkCandidate:
    """A possible landmark: `xyz` [m] in the frame of `link`.

    active: whether the file gives it, or only mentions it. about: a remark for the reader. kind: what it is.
    """

    name: str
    link: str
    xyz: tuple[float, float, float]
    active: bool
    about: str = ""
    kind: str = "joints"


def landmark_start(subject: Subject) -> str:
    """The text of a landmark file (`humanoid.subject.landmark_file`) for a subject whose own landmarks do not count.

    It loads unchanged. Inactive entries are comments.

    Raises
    ------
    InputError: no link on a joint has a name that a landmark file can hold.
    """
    body = Body(subject)
    landmarks = candidates(body)
    if not any(landmark.active for landmark in landmarks):
        remedy = "give the links names of printable characters"
        raise InputError(subject.source, "has no link that a landmark could be named after", remedy=remedy)
    lines = [
        f"# Landmarks of {_printable(subject.name)}, begun by `kinemode subjects --landmarks`: look through them.",
        "# Landmarks need the names that the keypoint file has for them; four or more. Lengths are in metres.",
        "",
        "[subject]",
        f'base = "{subject.base}"  # "free" moves in space, "fixed" is bolted down',
        "",
        "[landmarks]  # name = {link, place in the link's frame}",
        *_landmark_lines(landmarks),
        "",
        "[stabilisers]  # where a joint rests, and how far from it it usually is: radians, metres where it slides",
        *_stabiliser_lines(body),
    ]
    endless = [name for name, _, unlimited in _joints(body) if unlimited]
    if endless:
        lines += ["", "[limits]  # of joints that turn without end", *(f"# {_key(n)} = [-3.14, 3.14]" for n in endless)]
    return "\n".join(lines) + "\n"


def candidates(body: Body) -> list[LandmarkCandidate]:
    """All landmarks that the file names: those of a person first, then of the links, then the ends of the chains."""
    links = [(link, joint) for link, joint in _moving_links(body) if link.isprintable() and link.strip()]
    named = _of_a_person(links)
    person = len(named) >= FEWEST_NAMED
    coco = [LandmarkCandidate(name, link, (0.0, 0.0, 0.0), True) for name, link in named.items()] if person else []
    taken = {landmark.link for landmark in coco}
    own = [LandmarkCandidate(link, link, (0.0, 0.0, 0.0), not person) for link, _ in links if link not in taken]
    feet = _soles(body, named) if person else ()
    return [*coco, *feet, *own, *_ends(body, dict(links), active=not person), *_fixed_ends(body)]


def _moving_links(body: Body) -> Iterator[tuple[str, str]]:
    """The links that hang on a joint, with the joint, in the order of the joints."""
    model = body.model
    for j in range(2 if body.has_free_root else 1, model.njoints):
        frame = model.frames[model.getFrameId(model.names[j], pin.FrameType.JOINT)]
        place = model.getFrameId(model.names[j], pin.FrameType.JOINT)
        on_it = (f for f in model.frames if f.type == pin.FrameType.BODY and f.parentFrame == place)
        link = next((f.name for f in on_it if f.parentJoint == frame.parentJoint), None)
        if link is not None:
            yield link, model.names[j]


def _of_a_person(links: list[tuple[str, str]]) -> dict[str, str]:
    """The link of each of COCO's names that is found, in COCO's order."""
    groups: dict[str, list[str]] = {}
    for link, joint in links:
        name = body_part(link) or body_part(joint)
        if name is not None:
            groups.setdefault(name, []).append(link)
    return {name: groups[name][len(groups[name]) // 2] for name in COCO17 if name in groups}


def _soles(body: Body, named: dict[str, str]) -> Iterator[LandmarkCandidate]:
    """Heels and toes of a person whose ankles are named: on the middle line of what hangs on an ankle's joint, as low
    as that reaches with all joints at zero, z up, a tenth of its length from its ends; ahead follows from left and
    right.
    """
    model, posed = body.model, body.at(pin.neutral(body.model))
    R_front_world = _front(body, named)
    for side in ("left", "right"):
        link = named.get(f"{side}_ankle")
        if link is None:
            continue
        frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
        R_front_joint = R_front_world @ posed.rotations[frame.parentJoint]
        shapes, _ = _geometry(body.subject, {frame.parentJoint})
        solids = next(
            (own for every in reversed(shapes) if (own := [s for s in every if s.joint == frame.parentJoint])), []
        )
        if not solids:
            continue
        high, low = (
            sign * np.array([max(farthest(s, sign * axis) for s in solids) for axis in R_front_joint])
            for sign in (1, -1)
        )
        margin = _FROM_END * (high[0] - low[0])
        for part, along in (("heel", low[0] + margin), ("big_toe", high[0] - margin)):
            place = frame.placement.actInv(R_front_joint.T @ np.array([along, 0.5 * (high[1] + low[1]), low[2]]))
            yield LandmarkCandidate(f"{side}_{part}", link, tuple(place.round(4).tolist()), True, "", _SOLES)


def _front(body: Body, named: dict[str, str]) -> np.ndarray:
    """R_front_world (3, 3), whose rows are ahead, left and up [z] with all joints at zero: left is where most of a
    person's left parts are beside the right ones, x is ahead where that is unknown."""
    posed, across = body.at(pin.neutral(body.model)), np.zeros(3)
    for part in _PARTS:
        ends = [named.get(f"{side}_{part}") for side in ("left", "right")]
        if None not in ends:
            left, right = (_place(body, posed, str(link)) for link in ends)
            across += (left - right) * [1.0, 1.0, 0.0]
    length = float(np.linalg.norm(across))
    if length < _NO_WIDTH:
        return np.eye(3)
    left = across / length
    if np.abs(left).max() > _ALONG_AXIS:
        left = np.round(left)
    up = np.array([0.0, 0.0, 1.0])
    return np.stack([np.cross(left, up), left, up])


def _place(body: Body, posed: PosedBody, link: str) -> np.ndarray:
    """Place of a link (3,) [m], in the world."""
    frame = body.model.frames[body.model.getFrameId(link, pin.FrameType.BODY)]
    return np.asarray(
        posed.translations[frame.parentJoint] + posed.rotations[frame.parentJoint] @ frame.placement.translation
    )


def body_part(name: str) -> str | None:
    """COCO's name for a link's or joint's name, None where it contains no side or no joint of the body."""
    words = [word.lower() for word in _WORDS.findall(name)]
    sides = {_SIDES[word] for word in words if word in _SIDES}
    parts = [part for part in _PARTS if part in words or part + "s" in words]
    return f"{sides.pop()}_{parts[0]}" if len(sides) == 1 and len(parts) == 1 else None


def _ends(body: Body, links: dict[str, str], *, active: bool) -> Iterator[LandmarkCandidate]:
    """The tips of links that carry no joint: how far their geometry reaches along the line to its middle."""
    model = body.model
    parents = set(list(model.parents)[1:])
    last = {link: model.getJointId(joint) for link, joint in links.items() if model.getJointId(joint) not in parents}
    shapes, trouble = _geometry(body.subject, set(last.values()))
    for link, j in last.items():
        tip = next((tip for solids in shapes if (tip := _tip([s for s in solids if s.joint == j])) is not None), None)
        if tip is None:
            about = trouble or "it has no geometry: set its place"
            yield LandmarkCandidate(link + "_tip", link, (0.0, 0.0, 0.1), False, about, _TIPS)
        else:
            yield LandmarkCandidate(link + "_tip", link, tip, active, "", _TIPS)


def _geometry(subject: Subject, joints: set[int]) -> tuple[list[tuple[ConvexSolid, ...]], str]:
    """Visual and collision shapes of some joints' links, and problems of those that cannot be read."""
    body, trouble = Body(_with_shapes_on(subject, joints)), ""
    shapes = []
    kinds: tuple[Geometry, ...] = ("visual", "collision")
    for kind in kinds:
        try:
            shapes.append(solids_of(body, kind))
        except InputError as error:
            trouble = f"its geometry cannot be read ({_printable(error.problem)[:80]}): set its place"
    return shapes, trouble


def _with_shapes_on(subject: Subject, joints: set[int]) -> Subject:
    """The same subject without the shapes of other joints' links: the hulls of all meshes would take long."""
    document, model = read_document(subject.urdf, subject.source), subject.model
    for link in elements(document.root, "link"):
        frame = model.frames[model.getFrameId(link.get("name", ""), pin.FrameType.BODY)]
        for shape in list(elements(link)) if frame.parentJoint not in joints else ():
            link.remove(shape)
    return replace(subject, urdf=document.text())


def _tip(solids: list[ConvexSolid]) -> tuple[float, float, float] | None:
    """Point at which the line from a joint through the middle of its solids leaves them, in the joint's frame [m]."""
    if not solids:
        return None
    along = np.mean([solid.rotation @ solid.core_centre + solid.translation for solid in solids], axis=0)
    length = float(np.linalg.norm(along))
    if length < 1e-6:
        return None
    direction = along / length
    reach = max(farthest(solid, direction) for solid in solids)
    x, y, z = (float(v) for v in np.round(reach * direction, 4) + 0.0)
    return x, y, z


def _fixed_ends(body: Body) -> Iterator[LandmarkCandidate]:
    """Links that are fixed to others and carry nothing: tools, soles, cameras."""
    model = body.model
    carrying = {frame.parentFrame for frame in model.frames if frame.name != "universe"}
    for i, frame in enumerate(model.frames):
        parent = model.frames[frame.parentFrame]
        fixed = frame.type == pin.FrameType.BODY and parent.type == pin.FrameType.FIXED_JOINT
        if fixed and i not in carrying and frame.name.isprintable() and frame.name.strip():
            yield LandmarkCandidate(frame.name, frame.name, (0.0, 0.0, 0.0), False, "", "links fixed to others")


def _joints(body: Body) -> Iterator[tuple[str, float | None, bool]]:
    """Joints of one degree of freedom that follow none: name, place in q or None without limits, whether endless."""
    model = body.model
    places = dict(zip(body.bounded_v.tolist(), body.bounded_q.tolist(), strict=True))
    for j in range(1, model.njoints):
        if model.nvs[j] == 1:
            yield model.names[j], places.get(int(model.idx_vs[j])), int(model.nqs[j]) == 2


def _stabiliser_lines(body: Body) -> Iterator[str]:
    """Rests at zero, or in the middle of a range without it; deviations that make the range four of them."""
    for name, place, _ in _joints(body):
        if place is None or not name.isprintable():
            continue
        low, high = float(body.lower[int(place)]), float(body.upper[int(place)])
        rest = 0.0 if low <= 0.0 <= high else 0.5 * (low + high)
        std = max((high - low) / _DEVIATIONS, 0.001)
        yield f"# {_key(name)} = {{rest = {rest:.4g}, std = {std:.3g}}}"


def _landmark_lines(landmarks: list[LandmarkCandidate]) -> Iterator[str]:
    kind = landmarks[0].kind
    for landmark in landmarks:
        if landmark.kind != kind:
            kind = landmark.kind
            yield f"# {kind}:"
        yield _landmark_line(landmark)


def _landmark_line(landmark: LandmarkCandidate) -> str:
    place = ", ".join(f"{v:g}" for v in landmark.xyz)
    line = f"{_key(landmark.name)} = {{link = {_quoted(landmark.link)}, xyz = [{place}]}}"
    about = f"  # {landmark.about}" if landmark.about else ""
    return ("" if landmark.active else "# ") + line + about


def _key(name: str) -> str:
    """A name as a TOML key."""
    return name if _BARE.fullmatch(name) else _quoted(name)


def _quoted(text: str) -> str:
    """A printable text as a TOML string, which JSON's escapes are too."""
    return json.dumps(text, ensure_ascii=False)


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in text)
