"""Poses of an index that look like the pictures of a frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.search.examples.hashing import Neighbours
from estimator.search.examples.index import ExampleIndex
from estimator.search.examples.person_seen import PersonEvidence, PersonView, person_views
from estimator.search.examples.votes import Votes
from estimator.vision.person_view import ViewFrame
from humanoid.support.errors import InputError

ELEVATION = 15.0  # degrees by which a camera may look down more, or less, than the examples' does
_PROPOSED = 2  # times as many poses as are kept are proposed by each of several cameras


class Lookup(NamedTuple):
    """The lookup of one camera's picture: the number of the camera, the frame at the person, the cut-out (200, 200)
    uint8 and where it shows them (200, 200) bool, the nearest examples, and their poses (K, nq) in the world."""

    camera: int
    frame: ViewFrame
    square: np.ndarray
    where: np.ndarray
    neighbours: Neighbours
    q: np.ndarray


def lookups(
    index: ExampleIndex, observation: Observation, count: int, evidence: PersonEvidence, votes: Votes | None = None
) -> list[Lookup]:
    """By every camera that sees the person (see `person_views`) the `count` examples that look most like its picture;
    with votes, the `count` that several cameras choose together, each with those that it has proposed.

    Of several cameras those count that look down about as far as the examples' camera does, if any does.
    """
    views = person_views(observation, index.side, evidence)
    if len(views) > 1:
        views = [v for v in views if _off(index, observation, v.camera, v.frame) <= ELEVATION] or views
    if votes is None or len(views) < 2:
        return [_lookup(index, view, count) for view in views]
    proposed = [_lookup(index, view, _PROPOSED * count) for view in views]
    names = [observation.cameras[view.camera].name for view in views]
    numbers, q = [lookup.neighbours.numbers for lookup in proposed], [lookup.q for lookup in proposed]
    kept = votes.elected(views, names, numbers, q, count)
    return [_only(lookup, chosen) for lookup, chosen in zip(proposed, kept, strict=True)]


def check_elevation(index: ExampleIndex, observation: Observation, frames: Mapping[int, ViewFrame]) -> None:
    """Raise InputError where all cameras that see the person, by number with their frames at them, look down on them
    much more, or less, than the camera of the examples does."""
    off = {c: _off(index, observation, c, frame) for c, frame in frames.items()}
    if not off or min(off.values()) <= ELEVATION:
        return
    least = min(off, key=lambda c: off[c])
    camera = observation.cameras[least]
    seen = frames[least].elevation(camera)
    known = index.recipe.elevation
    problem = f"its camera looks down by {known:.0f} degrees, {camera.name} by {seen:.0f}: too little would look alike"
    remedy = f"kinemode train-index SUBJECT --elevation {seen:.0f} --out FILE makes one for it"
    raise InputError("index", problem, remedy=remedy)


def _off(index: ExampleIndex, observation: Observation, camera: int, frame: ViewFrame) -> float:
    """Difference of a camera's elevation [degrees], by its number and frame at the person, from the examples'."""
    return abs(frame.elevation(observation.cameras[camera]) - index.recipe.elevation)


def _lookup(index: ExampleIndex, view: PersonView, count: int) -> Lookup:
    neighbours = index.nearest(view.description, count)
    q = index.poses(neighbours.numbers, view.frame)
    return Lookup(view.camera, view.frame, view.square, view.where, neighbours, q)


def either_way(lookup: Lookup, away: np.ndarray, count: int) -> Lookup:
    """`count` of its examples, the first as it ranks them: half that face the camera and half that turn away (K,) bool,
    as far as there are."""
    rank = np.empty(len(away), int)
    for side in (away, ~away):
        rank[side] = np.arange(np.count_nonzero(side))
    return _only(lookup, np.sort(np.argsort(rank, kind="stable")[:count]))


def _only(lookup: Lookup, chosen: np.ndarray) -> Lookup:
    """The same with some of its examples, by their places among them."""
    numbers, distance = lookup.neighbours.numbers[chosen], lookup.neighbours.distance[chosen]
    return lookup._replace(
        neighbours=lookup.neighbours._replace(numbers=numbers, distance=distance), q=lookup.q[chosen]
    )
