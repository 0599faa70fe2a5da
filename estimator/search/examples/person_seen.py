"""The person as seen by one camera, for a lookup in an index: by depth, or by the silhouette alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.image_cues import ImageCues
from estimator.data.media.threads import one_thread
from estimator.data.observation import Observation
from estimator.energy.priors import world_up
from estimator.vision.cues.depth import Depth, PersonPoints
from estimator.vision.cues.silhouette import Outline
from estimator.vision.person_view import ViewFrame, described

CUES = (Depth.name, Outline.name)
"""Cues that separate a person from the rest of a picture; one is needed, and the first enabled one is used."""
LEAST_SHARE = 0.2  # of the picture's height; a smaller silhouette may be a part, such as an arm that alone has moved
_HEAD = 0.06  # of the height, to either side of the middle: where the head is, and no raised arm
_FEET = 0.04  # of the height: part that depth cues count as floor
_FRONT = 0.06  # of the height: by how much what is seen of a trunk is nearer than its middle
_MOST = 4000  # pixels that are placed


class PersonEvidence(NamedTuple):
    """Settings of locating a person: by which of `CUES`, and with which height [m], for the silhouette."""

    cue: str
    stature: float


class PersonView(NamedTuple):
    """A person in the picture of one camera, its number: the frame at them, the cut-out (200, 200) uint8, where its
    edges count (200, 200) bool, and their histogram (bins,)."""

    camera: int
    frame: ViewFrame
    square: np.ndarray
    where: np.ndarray
    description: np.ndarray


def sees_person(observation: Observation, evidence: PersonEvidence) -> bool:
    """Whether some camera has points of the person's surface, or a silhouette, and a picture."""
    return any(_shown(cues, evidence.cue) for cues in observation.cues)


def can_look_up(observation: Observation, evidence: PersonEvidence) -> bool:
    """Whether some camera sees the person, and where they are."""
    return any(True for _ in persons(observation, evidence))


def person_views(observation: Observation, side: float, evidence: PersonEvidence) -> list[PersonView]:
    """Views of every camera that has points of the person's surface or, where it uses that, their silhouette from head
    to feet. side [m]: of the square that is cut out."""
    views = []
    for c, frame, mask in persons(observation, evidence):
        cues = observation.cues[c]
        assert cues.picture is not None
        grey = cv2.cvtColor(cues.picture, cv2.COLOR_BGR2GRAY)
        description, square, where = described(grey, mask, cues.camera, frame, side)
        views.append(PersonView(c, frame, square, where, description))
    return views


def persons(observation: Observation, evidence: PersonEvidence) -> Iterator[tuple[int, ViewFrame, np.ndarray]]:
    """Number, frame at the person, and mask (H, W) bool of the cameras in which the person is located."""
    up = world_up(observation.cameras)
    for c, cues in enumerate(observation.cues):
        if not _shown(cues, evidence.cue):
            continue
        assert cues.picture is not None
        if evidence.cue == Depth.name:
            person: PersonPoints = cues[Depth.name]
            frame = ViewFrame.at(person.points.places, cues.camera, up)
            yield c, frame, person.mask(cues.picture.shape)
            continue
        mask = largest_part(cues[evidence.cue].mask)
        places = standing_places(mask, cues.camera, up, evidence.stature)
        if places is not None:
            yield c, ViewFrame.at(places, cues.camera, up), mask


def _shown(cues: ImageCues, name: str) -> bool:
    if name not in cues or cues.picture is None:
        return False
    if name == Depth.name:
        return True
    mask = cues[name].mask
    return bool(np.count_nonzero(mask.any(axis=1)) >= LEAST_SHARE * len(mask))


@one_thread()
def largest_part(mask: np.ndarray) -> np.ndarray:
    """The largest connected part of a mask (H, W) bool, itself a mask; all False where that is none."""
    count, label, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if count < 2:
        return np.zeros_like(mask)
    return np.asarray(label == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


def standing_places(mask: np.ndarray, camera: Camera, up: np.ndarray, stature: float) -> np.ndarray | None:
    """Places (N, 3) in the world [m] of the surface of a standing person, without the feet, like those of depth: on an
    upright plane that faces the camera, at the distance at which the person has the known height.

    mask (H, W) bool: of one person, in the camera's picture. up (3,): of the world, which the camera's place has to be
    known in. stature [m]: from the soles to the top of the head. The top is searched above the middle of the person, so
    that raised arms do not count; a person who bends or sits is placed farther away.

    None where their height is not seen: head or feet leave the picture, or too little of them is visible.
    """
    rows, columns = np.nonzero(mask)
    if not len(rows) or np.ptp(rows) < LEAST_SHARE * len(mask):
        return None
    step = max(1, len(rows) // _MOST)
    pixels = np.stack([columns, rows], axis=1)
    rays = camera.directions(pixels.astype(float)) @ camera.R_camera_world
    forward = np.median(rays, axis=0)
    forward = forward - (forward @ up) * up
    length = float(np.linalg.norm(forward))
    if length < 0.2 * float(np.linalg.norm(np.median(rays, axis=0))):  # seen from above or below: no height to see
        return None
    forward = forward / length
    ahead = rays @ forward
    if ahead.min() <= 0.0:
        return None
    height, beside = (rays @ axis / ahead for axis in (up, np.cross(up, forward)))
    low = float(height.min())
    middle = np.abs(beside - np.median(beside)) < _HEAD * (float(height.max()) - low)
    top = float(height[middle].max())
    ends = (height == low) | (middle & (height == top))
    if np.any(_on_border(pixels[ends], mask.shape)):
        return None
    distance = stature / (top - low)
    seen = np.flatnonzero(height > low + _FEET * (top - low))[::step]
    at = distance - _FRONT * stature
    return np.asarray(camera.centre_world + rays[seen] * (at / ahead[seen])[:, None])


def _on_border(pixels: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Which of some pixels (N, 2) lie on the upper or lower border of a picture of some (height, width)."""
    return np.asarray((pixels[:, 1] <= 0) | (pixels[:, 1] >= shape[0] - 1))
