"""Cameras placed by a body instead of points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from estimator.data.rigs.bundle import RigRays, RigState
from estimator.data.rigs.lengths import SegmentLengths
from estimator.data.rigs.person import FilmedBody, PersonProblem
from estimator.data.rigs.posing import posed_rig
from estimator.data.rigs.search import RigViews, rig_near
from estimator.data.rigs.views import JointView
from humanoid.kinematics.body import Body
from humanoid.kinematics.proportions import ProportionedBody
from tests.builders import body_of
from tests.test_rigs import Filmed


@pytest.fixture(scope="module")
def filmed() -> Filmed:
    return Filmed()


def rig_of(filmed: Filmed) -> RigState:
    """The true one, in the first camera's frame."""
    first, *_ = cameras = list(filmed.cameras.values())
    R = np.array([camera.R_camera_world @ first.R_camera_world.T for camera in cameras])
    t = np.array([camera.t_camera_world for camera in cameras]) - R @ first.t_camera_world
    none = np.zeros((0, 0, 3))
    return RigState(R, t, np.zeros(len(cameras)), np.ones(len(cameras)), np.zeros(len(cameras)), np.zeros(0), none)


def test_gradients_are_those_of_the_cost(filmed: Filmed) -> None:
    body, rng = ProportionedBody(body_of("human34").subject), np.random.default_rng(0)
    lengths = SegmentLengths.of(body.base, next(iter(filmed.tracks.values())).names)
    some, rig = [3, 40], rig_of(filmed)
    first = next(iter(filmed.cameras.values()))
    points = filmed.points[some][:, lengths.landmark] @ first.R_camera_world.T + first.t_camera_world
    rays = np.stack([(p := points @ R.T + t)[..., :2] / p[..., 2:] for R, t in zip(rig.R, rig.t, strict=True)])
    rays[1, 0, 2] = np.nan
    std = np.full((3, rays.shape[2]), 0.01)
    problem = PersonProblem(
        body,
        RigRays(rays, np.zeros_like(rays), std, np.array([0.0, 0.1, 0.1]), np.array([0.1, 0.0, 0.1]), np.zeros(3)),
        lengths,
    )
    T_rig_world = pin.SE3(first.R_camera_world, first.t_camera_world)
    q = filmed.q[some].copy()
    for pose in q:
        pose[:7] = pin.SE3ToXYZQUAT(T_rig_world * pin.XYZQUATToSE3(pose[:7]))
    at = FilmedBody(rig, q, body.mean.copy(), np.zeros((rays.shape[2], 3)))
    size = len(problem.system(at).g)
    at = replace(at, rig=replace(rig, radial=np.array([-0.1, 0.0, 0.2])))
    at = problem.moved(at, 0.01 * rng.normal(size=size), 0.05 * rng.normal(size=(2, body.base.nv)))
    system = problem.system(at)
    gradient = np.concatenate([system.g, system.h.ravel()])
    for _ in range(20):
        step = 1e-6 * rng.normal(size=len(gradient))
        ahead, back = (problem.moved(at, way[:size], way[size:].reshape(2, -1)) for way in (step, -step))
        assert problem.cost(ahead) - problem.cost(back) == pytest.approx(2.0 * gradient @ step, rel=1e-4, abs=1e-9)
    scaled = at.scales.copy()
    scaled[0] += 1e-5  # its size as the scales change, in the neutral pose
    sizes = [_size(body.at(scales), at.marks, lengths) for scales in (scaled, at.scales)]
    at_scales = size - at.marks.size - len(at.scales)
    assert (sizes[0] - sizes[1]) / 1e-5 == pytest.approx(problem.size_slope(at)[at_scales], rel=1e-3)


def _size(body: Body, marks: np.ndarray, lengths: SegmentLengths) -> float:
    posed = body.at(body.neutral)
    turned = posed.rotations[body.landmark_joint[lengths.landmark]] @ marks[..., None]
    points = body.landmarks(posed)[lengths.landmark] + turned[..., 0]
    return float(np.log(np.linalg.norm(points[lengths.first] - points[lengths.second], axis=1)).mean())


def test_exact_rays_of_a_body_bring_a_camera_back(filmed: Filmed) -> None:
    """From two degrees off, and not beyond the limits of the body's joints."""
    names = list(filmed.cameras)[:2]
    lengths = SegmentLengths.of(filmed.body, next(iter(filmed.tracks.values())).names)
    points = filmed.points[:, lengths.landmark]
    joints = [filmed.body.landmark_names[i] for i in lengths.landmark]
    seen = [filmed.cameras[name] for name in names]
    views = [JointView(camera, camera.project(points), filmed.times[camera.name]) for camera in seen]
    truth = rig_of(filmed)
    state = replace(
        truth,
        R=truth.R[:2],
        t=truth.t[:2],
        late=np.zeros(2),
        focal=np.ones(2),
        radial=np.zeros(2),
        lengths=lengths.mean.copy(),
    )
    fit = rig_near(RigViews.of(views, joints, clocks_known=True), lengths, np.zeros(2), state)
    off = fit.state.R.copy()
    off[1] = pin.exp3(np.array([0.0, 0.035, 0.0])) @ off[1]
    late_std = np.array([0.0, 0.01])  # of clocks, which the body does not change
    beside = replace(fit, state=replace(fit.state, R=off), unsure=replace(fit.unsure, late_std=late_std))
    posed = posed_rig(filmed.body, beside, lengths)
    assert turn_between(posed.state.R[1], truth.R[1]) < 0.3
    assert np.all(posed.unsure.covariance[0, :6] == 0.0)
    assert np.array_equal(posed.unsure.late_std, late_std)
    assert 0.0 < np.trace(posed.unsure.own(1)[:3, :3]) < np.radians(3.0) ** 2


def turn_between(a: np.ndarray, b: np.ndarray) -> float:
    """In degrees."""
    return float(np.degrees(np.linalg.norm(pin.log3(a @ b.T))))
