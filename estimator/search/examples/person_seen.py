"""The person as seen by one camera, for a lookup in an index: by depth, or by the silhouette alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from estimator.data.image_cues import ImageCues
from estimator.data.observation import Observation
from estimator.energy.gravity_prior import world_up
from estimator.vision.cues.depth.cue import Depth, PersonPoints
from estimator.vision.cues.silhouette.cue import Outline
from estimator.vision.person_view import ViewFrame, described
from estimator.vision.standing import LEAST_SHARE, largest_part, standing_places

CUES = (Depth.name, Outline.name)
"""Of which one is needed, the first of those that are used: what separates a person from the rest of a picture."""


class PersonEvidence(NamedTuple):
    """What a person is seen by: which of `CUES`, and their height [m], of use to the silhouette."""

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
    """Whether some camera has points of the person's surface, or somebody's silhouette, and a picture."""
    return any(_shown(cues, evidence.cue) for cues in observation.cues)


def can_look_up(observation: Observation, evidence: PersonEvidence) -> bool:
    """Whether some camera sees the person, and where they are."""
    return any(True for _ in persons(observation, evidence))


def person_views(observation: Observation, side: float, evidence: PersonEvidence) -> list[PersonView]:
    """Of every camera that has points of the person's surface or, where it uses that, their silhouette from head to
    feet. side [m]: of the square that is cut out."""
    views = []
    for c, frame, mask in persons(observation, evidence):
        cues = observation.cues[c]
        assert cues.picture is not None
        grey = cv2.cvtColor(cues.picture, cv2.COLOR_BGR2GRAY)
        description, square, where = described(grey, mask, cues.camera, frame, side)
        views.append(PersonView(c, frame, square, where, description))
    return views


def persons(observation: Observation, evidence: PersonEvidence) -> Iterator[tuple[int, ViewFrame, np.ndarray]]:
    """Number, frame at the person, and mask (H, W) bool of the cameras that know where the person is."""
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
