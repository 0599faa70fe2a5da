"""The queries of the measure of an index: pictures of poses that are not in it, and how far each example is from
each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.papers_elmo.elmo_clips import JOINTS
from estimator.search.examples.index import ExampleIndex
from estimator.synthesis.pictures import Example, ExamplePainter, variants
from estimator.synthesis.poses import sampler_of
from humanoid.kinematics.body import Body

_BODIES = 6  # of other lengths and girth than the index's


@dataclass(frozen=True)
class Asked:
    """Queries, Q, to an index of N examples.

    values (Q, M) bool: their bits. away (Q, N) [mm]: how far each example is from the pose in the picture, mean over
    `JOINTS`.
    """

    values: np.ndarray
    away: np.ndarray


def painted(body: Body, index: ExampleIndex, count: int, rng: np.random.Generator) -> list[Example]:
    """Pictures of poses drawn as those of the index, of bodies that it has not seen, in other clothes and light."""
    recipe = index.recipe
    painter = ExamplePainter(body, variants(body.subject, _BODIES, rng), recipe.elevation, index.side)
    sampler = sampler_of(body, recipe)
    return [painter.example(sampler.draw(rng), rng) for _ in range(count)]


def asked(body: Body, index: ExampleIndex, made: list[Example], *, aligned: bool) -> Asked:
    """Queries by pictures. aligned: distances about the mean of the joints; without, as the poses are put before the
    camera."""
    joints = [body.landmark_names.index(name) for name in JOINTS if name in body.landmark_names]

    def places(q: np.ndarray) -> np.ndarray:
        points = body.landmarks(body.at(q.astype(float)))[joints]
        return points - points.mean(axis=0) if aligned else points

    known = np.array([places(q) for q in index.q])
    away = np.array([1e3 * np.linalg.norm(known - places(e.q), axis=2).mean(axis=1) for e in made])
    return Asked(index.bits.of(np.array([e.description for e in made])), away)
