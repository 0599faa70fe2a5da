"""The compiled kinematics is Pinocchio's, on every supported subject and robot."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
import pytest
from builders import SUBJECTS, random_pose

from humanoid.kinematics.body import Body
from humanoid.kinematics.compiled_tree import CompiledTree, compiled_tree, difference, integrate, place_joints
from humanoid.subject.subject import load_subject, subject_names

ROUNDING = 1e-12


def compiled_bodies() -> Iterator[tuple[Body, CompiledTree]]:
    for subject in subject_names():
        body = Body(load_subject(subject.name))
        if body.compiled is not None:
            yield body, body.compiled


def test_placements_jacobians_and_steps_are_those_of_pinocchio() -> None:
    rng, names = np.random.default_rng(0), set()
    for body, tree in compiled_bodies():
        names.add(body.subject.name)
        for _ in range(3):
            q = random_pose(body, rng)
            posed = body.at(q)
            placements, columns = np.empty_like(posed.placements), np.empty_like(posed.spatial_jacobian)
            place_joints(tree, q, placements, columns)
            np.testing.assert_allclose(placements, posed.placements, atol=ROUNDING)
            np.testing.assert_allclose(columns, posed.spatial_jacobian, atol=ROUNDING)
            moved = np.empty(body.nq)
            step = rng.normal(size=body.nv)
            integrate(tree, q, step, moved)
            np.testing.assert_allclose(moved, body.integrate(q, step), atol=ROUNDING)
    assert names >= set(SUBJECTS)


@pytest.mark.parametrize("turn", [0.0, 1e-9, 1e-5, 1e-3, 0.05, 0.5, 0.999, 1.001, 2.0, 3.1])
def test_differences_and_their_slopes_are_those_of_pinocchio(turn: float) -> None:
    body = Body(load_subject("human34"))
    assert body.compiled is not None
    rng = np.random.default_rng(int(1e6 * turn))
    q0 = random_pose(body, rng)
    step = rng.normal(size=body.nv)
    step[3:6] *= turn / np.linalg.norm(step[3:6])
    q1 = pin.integrate(body.model, q0, step)
    change, slope = np.empty(body.nv), np.zeros((body.nv, body.nv))
    difference(body.compiled.indices, q0, q1, change, slope)
    np.testing.assert_allclose(change, step, atol=1e-9 if turn > 3.0 else 1e-11)
    # the differences of a step along each direction: the slope as its definition has it
    width = 1e-5
    for d in range(6):
        ends = []
        for sign in (1.0, -1.0):
            aside = np.zeros(body.nv)
            aside[d] = sign * width
            end = np.empty(body.nv)
            difference(body.compiled.indices, q0, pin.integrate(body.model, q1, aside), end, np.zeros_like(slope))
            ends.append(end[:6])
        np.testing.assert_allclose(slope[:6, d], (ends[0] - ends[1]) / (2 * width), atol=1e-8)


def test_models_with_other_joints_are_left_to_pinocchio() -> None:
    model = pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    nothing = np.zeros(0, dtype=np.int64)

    assert compiled_tree(model, nothing, np.full(4, -np.inf), np.full(4, np.inf)) is None
    followed = Body(load_subject("human34")).model
    assert compiled_tree(followed, nothing, *np.full((2, followed.nq), np.inf)) is not None
