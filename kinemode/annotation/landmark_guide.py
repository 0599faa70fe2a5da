"""What a person who clicks landmarks has to know of each: where it lies, on which side, and what it hangs on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import mirror_index

Side = Literal["left", "right", "trunk"]

_PLACES = {
    "nose": "tip of the nose",
    "eye": "middle of the eye",
    "ear": "opening of the ear",
    "head_top": "highest point of the skull, under the hair",
    "neck": "base of the neck, midway between the shoulders",
    "shoulder": "centre of the shoulder joint, inside the upper arm and below the shoulder's top",
    "elbow": "centre of the elbow joint, between its two bony sides",
    "wrist": "centre of the wrist joint",
    "index": "knuckle of the index finger",
    "pinky": "knuckle of the little finger",
    "thumb": "knuckle of the thumb",
    "mid_hip": "midway between the two hip joints",
    "hip": "centre of the hip joint: the crease of the groin from the front, the bony knob of the thigh from the side",
    "knee": "centre of the knee joint, behind the kneecap",
    "ankle": "centre of the ankle joint, between the two ankle bones",
    "heel": "back of the heel, close to the sole",
    "big_toe": "tip of the big toe",
    "small_toe": "tip of the little toe",
}


@dataclass(frozen=True)
class LandmarkGuide:
    """A subject's landmarks for people.

    names (L): the subject's own. sides (L): whose half of the body. about (L): where to click.
    edges: pairs of indices to join by a line.
    """

    names: tuple[str, ...]
    sides: tuple[Side, ...]
    about: tuple[str, ...]
    edges: tuple[tuple[int, int], ...]


def landmark_guide(body: Body) -> LandmarkGuide:
    """The guide to a body's landmarks; a landmark it knows no description of is described by its link."""
    names = body.landmark_names
    links = [landmark.link for landmark in body.subject.landmarks]
    about = tuple(_PLACES.get(_part(n), f"a point of the link {k}") for n, k in zip(names, links, strict=True))
    return LandmarkGuide(names, tuple(_side(n) for n in names), about, landmark_edges(body))


def landmark_edges(body: Body) -> tuple[tuple[int, int], ...]:
    """Lines that make landmarks a stick figure, as pairs of their indices.

    Each landmark hangs on the first one of its joint, and that one on the first of the nearest joint towards the root
    that has any. Where there is none, a landmark is joined to its mirror image: hips without a point between them.
    """
    parent = body.tree.joint_parent
    first: dict[int, int] = {}
    for i, joint in enumerate(body.landmark_joint.tolist()):
        first.setdefault(joint, i)
    mirror = mirror_index(body.landmark_names)
    edges = []
    for i, joint in enumerate(body.landmark_joint.tolist()):
        while first.get(joint, i) == i and joint != 0:
            joint = int(parent[joint])
        on = first.get(joint, i)
        if on != i:
            edges.append((on, i))
        elif i < mirror[i]:
            edges.append((i, int(mirror[i])))
    return tuple(edges)


def _part(name: str) -> str:
    return name.removeprefix("left_").removeprefix("right_")


def _side(name: str) -> Side:
    if name.startswith("left_"):
        return "left"
    return "right" if name.startswith("right_") else "trunk"
