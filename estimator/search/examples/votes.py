"""Several cameras together: each votes for the poses that the others propose, as it sees them itself."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from estimator.search.examples.index import ExampleIndex
from estimator.search.examples.person_seen import PersonView
from estimator.vision.person_view import ViewFrame
from humanoid.kinematics.body import ROOT_JOINT, Body, PlacedBodies

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
