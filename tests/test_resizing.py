"""Subjects of another size: all lengths scale, no angle does."""

from __future__ import annotations

import numpy as np
import pytest
from builders import body_of, random_pose

from humanoid.kinematics.body import Body, points_in_world
from humanoid.shape.solids import farthest, solids_of
from humanoid.shape.surface import surface_of
from humanoid.subject.subject import load_subject

SUBJECTS = ("human34", "arm8", "example-robot-data:panda")
FACTOR = 0.7


def moved(body: Body, q: np.ndarray) -> np.ndarray:
    """The same pose of a body scaled by a factor: sliding joints scale too."""
    q = q.copy()
    for joint in range(1, body.njoints):
        at, kind = body.model.idx_qs[joint], body.model.joints[joint].shortname()
        count = 3 if kind == "JointModelFreeFlyer" else int(kind.startswith("JointModelP"))
        q[at : at + count] *= FACTOR
    return q


@pytest.mark.parametrize("name", SUBJECTS)
def test_a_resized_body_is_the_same_in_other_units(name: str) -> None:
    body = Body(load_subject(name))
    resized = Body(body.subject.resized(FACTOR))
    q = random_pose(body, np.random.default_rng(1), share=0.6)
    here, there = body.at(q), resized.at(moved(body, q))
    np.testing.assert_allclose(resized.landmarks(there), FACTOR * body.landmarks(here), atol=1e-12)
    np.testing.assert_allclose(there.placements[:, :9], here.placements[:, :9], atol=1e-12)
    for direction in np.eye(3):
        reach = [[farthest(solid, direction) for solid in solids_of(b)] for b in (body, resized)]
        np.testing.assert_allclose(reach[1], FACTOR * np.array(reach[0]), atol=1e-6)
    scaled = [(p.scale_min, p.scale_max, p.mean, p.std) for p in resized.subject.proportions]
    assert scaled == [(p.scale_min, p.scale_max, p.mean, p.std) for p in body.subject.proportions]
    back = resized.subject.resized(1.0 / FACTOR)
    np.testing.assert_allclose(Body(back).landmarks(Body(back).at(q)), body.landmarks(here), atol=1e-12)


def test_flesh_is_as_large() -> None:
    """Bent and tapered parts too."""
    body = body_of("human34")
    resized = Body(body.subject.resized(FACTOR))
    q = body.neutral
    places = []
    for b in (body, resized):
        surface = surface_of(b, nodes=400)
        places.append(points_in_world(b.at(moved(body, q) if b is resized else q), surface.joint, surface.local))
    low, high = (np.stack([end(p, axis=0) for p in places]) for end in (np.min, np.max))
    np.testing.assert_allclose(low[1], FACTOR * low[0], atol=2e-3)
    np.testing.assert_allclose(high[1], FACTOR * high[0], atol=2e-3)
