"""Poses of an index that look like the pictures of a frame."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from estimator.cues.depth.cue import Depth, PersonPoints
from estimator.imaging.image_cues import ImageCues
from estimator.imaging.observation import Observation
from estimator.imaging.person_view import ViewFrame, described
from estimator.search.examples.hashing import Neighbours
from estimator.search.examples.index import ExampleIndex
from estimator.terms.upright import world_up


class Looked(NamedTuple):
    """What one camera's picture was looked up by, and found: the number of the camera, the frame at the person, the
    cut-out (200, 200) uint8 and where it shows them (200, 200) bool, the nearest examples, and their poses (K, nq) in
    the world."""

    camera: int
    frame: ViewFrame
    square: np.ndarray
    where: np.ndarray
    neighbours: Neighbours
    q: np.ndarray


def sees_person(observation: Observation) -> bool:
    """Whether some camera has points of the person's surface and a picture."""
    return any(_shown(cues) for cues in observation.cues)


def looked_up(index: ExampleIndex, observation: Observation, count: int) -> list[Looked]:
    """By every camera that has points of the person's surface, the `count` examples that look most like its picture."""
    up = world_up(observation.cameras)
    looks = []
    for c, cues in enumerate(observation.cues):
        if not _shown(cues):
            continue
        person: PersonPoints = cues[Depth.name]
        assert cues.picture is not None
        frame = ViewFrame.at(person.points.places, cues.camera, up)
        grey = cv2.cvtColor(cues.picture, cv2.COLOR_BGR2GRAY)
        mask = person.mask(grey.shape)
        description, square, where = described(grey, mask, cues.camera, frame, index.side)
        neighbours = index.nearest(description, count)
        looks.append(Looked(c, frame, square, where, neighbours, index.poses(neighbours.numbers, frame)))
    return looks


def _shown(cues: ImageCues) -> bool:
    return Depth.name in cues and cues.picture is not None
