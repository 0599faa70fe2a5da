"""Poses of an index that look like the pictures of a frame; each of several cameras votes for the poses of the
others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.search.examples.hashing import Neighbours
from estimator.search.examples.index import ExampleIndex
from estimator.search.examples.person_seen import PersonEvidence, PersonView, person_views
from estimator.vision.person_view import ViewFrame
from humanoid.kinematics.body import ROOT_JOINT, Body, PlacedBodies
from humanoid.support.errors import InputError

_AT_ONCE = 4096  # examples that are posed together
_TYPICAL = 2000  # examples whose distances from a picture are the usual ones
_BEYOND = 5.0  # degrees beyond the headings of the examples that a pose may turn away and still look like one of them


class Votes:
    """Joint votes of cameras on poses in the world.

    In every camera a pose corresponds to a different example: the one whose landmarks about their mean are nearest to
    its own, as that camera sees them (squared distances, summed). A camera's vote is the number of bits by which this
    example differs from its picture less than usual, in standard deviations of the usual number. A camera to which a
    pose is turned farther than any example has no vote on it. Votes are summed and divided by the root of their number,
    as deviations of independent measurements are (Stouffer): the plain sum would prefer the poses on which many cameras
    vote, the mean those with one vote. Cameras vote in the order of their names.

    index: read. body: whose poses they are.
    """

    def __init__(self, index: ExampleIndex, body: Body) -> None:
        self.index, self.body = index, body

    def elected(
        self,
        views: Sequence[PersonView],
        names: Sequence[str],
        numbers: Sequence[np.ndarray],
        q: Sequence[np.ndarray],
        count: int,
    ) -> list[np.ndarray]:
        """Which of its proposals each of some views keeps (K,), the best first: together the best `count` of all, of
        which none are the same example in every camera.

        names: of the cameras. numbers, q: of the proposals of each view, examples (N,) and poses (N, nq) in the world.
        """
        order = sorted(range(len(views)), key=lambda c: names[c])
        by = np.repeat(order, [len(numbers[c]) for c in order])
        place = np.concatenate([np.arange(len(numbers[c])) for c in order])
        proposed = np.concatenate([q[c] for c in order])
        example, votes = np.empty((2, len(views), len(by)))
        for row, c in enumerate(order):
            seen, others = np.empty(len(by), int), by != c
            seen[~others] = numbers[c]
            seen[others] = self.examples(proposed[others], views[c].frame)
            example[row], votes[row] = seen, self._votes(views[c], seen)
        _, first = np.unique(example, axis=1, return_index=True)
        first = np.sort(first)
        together = votes.sum(axis=0) / np.sqrt((example >= 0).sum(axis=0))
        best = first[np.argsort(together[first], kind="stable")[:count]]
        return [place[best[by[best] == c]] for c in range(len(views))]

    def examples(self, q: np.ndarray, frame: ViewFrame) -> np.ndarray:
        """The example (N,) that is most similar to each of some poses q (N, nq) in the world, as seen in a frame; -1
        where it turns away too far."""
        placed = self.body.placed(q)
        numbers = np.full(len(q), -1)
        near = np.flatnonzero(turned_away(self.body, placed, frame) <= 0.5 * self.index.recipe.headings + _BEYOND)
        if len(near):
            shapes = self._about_mean(placed.of(near), frame.R_world_view)
            known, squared = self._known
            # all of them at once: in so many dimensions a tree takes ten times as long
            numbers[near] = (squared - 2.0 * (shapes @ known.T)).argmin(axis=1)
        return numbers

    def _votes(self, view: PersonView, examples: np.ndarray) -> np.ndarray:
        """Votes of one camera on examples (N,), negative without a vote: the lower, the more similar."""
        some = np.arange(0, len(self.index.q), max(1, len(self.index.q) // _TYPICAL))
        usual = self.index.distances(view.description, some)
        votes = np.zeros(len(examples))
        has_example = examples >= 0
        off = self.index.distances(view.description, examples[has_example]) - usual.mean()
        votes[has_example] = off / max(float(usual.std()), 1.0)
        return votes

    def _about_mean(self, placed: PlacedBodies, R_world_view: np.ndarray) -> np.ndarray:
        """Landmarks of poses about their mean, in the frame of a view, as rows (N, 3 L) float32 [m]."""
        places = self.body.landmarks_of(placed)
        places = places - places.mean(axis=1, keepdims=True)
        if self.body.has_free_root:  # else it is as it is in every view
            places = places @ R_world_view
        return places.reshape(len(places), -1).astype(np.float32)

    @cached_property
    def _known(self) -> tuple[np.ndarray, np.ndarray]:
        """Landmarks of all examples (E, 3 L), and their squared lengths (E,)."""
        everything = np.arange(len(self.index.q))
        here = ViewFrame(np.zeros(3), np.eye(3))
        parts = [everything[k : k + _AT_ONCE] for k in range(0, len(everything), _AT_ONCE)]
        known = np.concatenate(
            [self._about_mean(self.body.placed(self.index.poses(part, here)), np.eye(3)) for part in parts]
        )
        return known, np.square(known).sum(axis=1)


def turned_away(body: Body, placed: PlacedBodies, frame: ViewFrame) -> np.ndarray:
    """Angles (N,) [degrees] by which poses turn away from facing a camera; 0 if their root cannot turn."""
    if not body.has_free_root:
        return np.zeros(len(placed.q))
    ahead = placed.placements[:, ROOT_JOINT, :3] @ frame.R_world_view
    return np.asarray(np.degrees(np.abs(np.arctan2(ahead[:, 1], -ahead[:, 0]))))


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
