"""One clip being annotated: what the page shows, what it saves, and what a person who clicks landmarks has to know of
each.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Literal

import cv2

from estimator.data.formats.checked_json import mapping, member
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.data.media.clip import Clip
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import mirror_index
from kinemode.annotation.clicks import clicks_for_page, clicks_from_page
from viz.palette import SIDES

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
    """The guide to a body's landmarks; a landmark without a description is described by its link."""
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


_POINT_BYTES = 90  # three numbers and the signs around them as JSON writes them, generously


class Annotation:
    """The session that `annotate_server` serves; requests may come at the same time.

    Attributes
    ----------
    clip, guide: the frames, and the landmarks to click.
    track: the points there are: at first those found in files, then those last saved.
    frame, camera: shown first; name of the view.
    out: the file to write. command: what to do with it next.
    saves: how often the page has saved.
    largest_post: bytes of every landmark in every frame.
    """

    def __init__(
        self, clip: Clip, guide: LandmarkGuide, track: KeypointTrack, frame: int, camera: str, out: Path, command: str
    ) -> None:
        self.clip, self.guide, self.track = clip, guide, track
        self.frame, self.camera, self.out, self.command = frame, camera, out, command
        self.saves = 0
        points = sum(len(name.encode("utf-8")) + _POINT_BYTES for name in guide.names)
        self.largest_post = 4096 + track.frame_count * (16 + points)
        self._reading, self._writing = Lock(), Lock()

    def state(self) -> dict[str, Any]:
        """Everything the page needs at its start, for JSON; points as `clicks_for_page` gives them."""
        guide, track = self.guide, self.track
        landmarks = zip(guide.names, guide.sides, guide.about, strict=True)
        return {
            "clip": self.clip.path.name,
            "camera": self.camera,
            "out": str(self.out),
            "image_size": track.image_size,
            "frame_count": track.frame_count,
            "frame": self.frame,
            "landmarks": [{"name": name, "side": side, "about": about} for name, side, about in landmarks],
            "edges": guide.edges,
            "colours": {side: "rgb({}, {}, {})".format(*colour) for side, colour in SIDES.items()},
            "frames": clicks_for_page(track),
        }

    def picture(self, index: int) -> bytes:
        """Frame `index` as PNG, every pixel as decoded; raises IndexError where the clip has none."""
        with self._reading:
            image = self.clip.frame(index)
        return cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()

    def save(self, posted: Any) -> dict[str, Any]:
        """Write what the page sent, {"frames": see `clicks_from_page`}, and return the answer.

        Raises InputError where anything in it is wrong, or the file cannot be written; then the file stays as it was.
        """
        frames = member(mapping(posted, "the page"), "frames", "the page", "")
        with self._writing:
            track = clicks_from_page(frames, self.track)
            write_keypoints(self.out, track)
            self.track = track
            self.saves += 1
        there = track.confidence > 0.0
        counts = {"points": int(there.sum()), "frames": int(there.any(axis=1).sum())}
        return {"out": str(self.out), "command": self.command, **counts}
