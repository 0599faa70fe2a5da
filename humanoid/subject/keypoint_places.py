"""Offsets of a layout's keypoints from a subject's landmarks.

    [places]
    subject = "human34"
    [keypoints]
    heel = {offset = [0.02, 0, -0.015], std = 0.02}    # [m], of the left side and mirrored of the right

A keypoint is a marker: what is called a heel or a toe is another point for every detector, and the same in all frames
of a person. The offset is the mean of people, the std how far one person in one view is from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from humanoid.subject.landmarks import without_side
from humanoid.subject.subject import Subject, is_built_in
from humanoid.support.files import read_toml

PLACES_FOLDER = Path(__file__).parent / "layout_places"
UNKNOWN_STD = 0.02
"""[m] How far from a landmark a detector may mark it of which nothing is known: as far as the places of the keypoints
of two people were, whose joints are known from markers, and a third more."""
MIRROR_Y = np.array([1.0, -1.0, 1.0])


def with_layout_places(subject: Subject, layout: str) -> Subject:
    """A built-in subject with the places of a layout's keypoints. Unknown ones are at the landmarks, with a note.
    Unchanged where it has places already. An empty layout is of several, or of none."""
    if not is_built_in(subject) or any(landmark.keypoint_std is not None for landmark in subject.landmarks):
        return subject
    places, of_landmarks = _places(layout, subject.name), {}
    for landmark in subject.landmarks:
        offset, std = places.get(without_side(landmark.name), (np.zeros(3), UNKNOWN_STD))
        of_landmarks[landmark.name] = offset * MIRROR_Y if landmark.name.startswith("right_") else offset, std
    placed = subject.with_keypoint_places(of_landmarks)
    if places or not layout:
        return placed
    note = f"where a detector of {layout} marks the body is not known: {1e3 * UNKNOWN_STD:.0f} mm about the landmarks"
    return replace(placed, notes=(*placed.notes, f"{note} is assumed"))


@cache
def _places(layout: str, subject: str) -> Mapping[str, tuple[np.ndarray, float]]:
    """By part of the body the offset (3,) and its deviation [m]; empty where none are known."""
    path = PLACES_FOLDER / f"{layout}.toml"
    if layout not in {known.stem for known in PLACES_FOLDER.glob("*.toml")}:
        return {}
    content = read_toml(path, remedy="entries look like heel = {offset = [0, 0, 0], std = 0.02}")
    if content["places"]["subject"] != subject:
        return {}
    return {name: (np.array(e["offset"], dtype=float), float(e["std"])) for name, e in content["keypoints"].items()}
