"""Proposals: within the limits, densities that integrate to one, scales, volumes, tails and regular patterns."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from builders import body_of, inside, random_pose

from estimator.search.proposals import (
    HELD_STD,
    CovarianceScaledProposal,
    LimbProposal,
    Proposal,
    SphericalProposal,
    WeakestDirections,
)
from humanoid.kinematics.body import Body
from humanoid.subject.subject import subject_from_text

Make = Callable[[Body, np.ndarray, np.ndarray], Proposal]
FAMILY: dict[str, Make] = {
    "covariance scaled": lambda body, q, c: CovarianceScaledProposal(body, q, c, 2.0),
    "covariance scaled, t": lambda body, q, c: CovarianceScaledProposal(body, q, c, 2.0, 3.0),
    "spherical": lambda body, q, c: SphericalProposal(body, q, c, 2.0),
    "spherical, t": lambda body, q, c: SphericalProposal(body, q, c, 2.0, 3.0),
    "weakest directions": lambda body, q, c: WeakestDirections(body, q, c, 2, (1.0, 3.0)),
}


@cache
def sliders(count: int) -> Body:
    """A chain of sliding joints with far limits: its configurations are a plain vector space."""
    links = "".join(f'<link name="l{k}"/>' for k in range(count + 1))
    joints = "".join(
        f'<joint name="j{k}" type="prismatic"><parent link="l{k}"/><child link="l{k + 1}"/><axis xyz="1 0 0"/>'
        '<limit lower="-1000" upper="1000" effort="1" velocity="1"/></joint>'
        for k in range(count)
    )
    return Body(subject_from_text(f'<robot name="r">{links}{joints}</robot>', source="sliders", base="fixed"))


def covariance_of(size: int, rng: np.random.Generator) -> np.ndarray:
    root = rng.normal(size=(size, size)) * np.geomspace(0.5, 0.05, size)
    made: np.ndarray = root @ root.T + 1e-4 * np.eye(size)
    return made


def drawn(proposal: Proposal, count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.array([proposal.sample(rng) for _ in range(count)])


@pytest.mark.parametrize("name", FAMILY)
def test_samples_are_within_the_limits_and_have_a_density(name: str) -> None:
    body, rng = body_of("human34"), np.random.default_rng(1)
    q = random_pose(body, rng)
    proposal = FAMILY[name](body, q, covariance_of(body.nv, rng))
    samples = drawn(proposal, 200)
    assert inside(body, samples)
    np.testing.assert_allclose(np.linalg.norm(samples[:, 3:7], axis=1), 1.0, atol=1e-12)
    assert np.isfinite([proposal.log_density(x) for x in samples]).all()
    np.testing.assert_array_equal(samples, drawn(proposal, 200))


@pytest.mark.parametrize("name", FAMILY)
@pytest.mark.parametrize("size", [1, 2])
def test_densities_integrate_to_one_and_are_the_samples_own(name: str, size: int) -> None:
    """On a grid the density sums to one, and to the share of samples in a box about the mode."""
    body = sliders(size)
    covariance = np.array([[0.04, 0.018], [0.018, 0.01]])[:size, :size]
    proposal = FAMILY[name](body, np.zeros(size), covariance)
    reach, bins = (60.0, 2001) if size == 1 else (6.0, 101)
    # points crowd at the mode, where the density is narrow; cell sizes follow the map's slope
    u = np.linspace(-1.0, 1.0, bins)
    x, cell = reach * u**3, reach * 3.0 * u**2 * (u[1] - u[0])
    grid = np.stack(np.meshgrid(*[x] * size, indexing="ij"), axis=-1).reshape(-1, size)
    volume = np.prod(np.stack(np.meshgrid(*[cell] * size, indexing="ij"), axis=-1).reshape(-1, size), axis=1)
    mass = np.exp([proposal.log_density(q) for q in grid]) * volume
    assert mass.sum() == pytest.approx(1.0, abs=0.01)
    near = np.abs(grid).max(axis=1) < 0.3
    share = np.mean(np.abs(drawn(proposal, 4000)).max(axis=1) < 0.3)
    assert mass[near].sum() == pytest.approx(share, abs=0.04)


def test_scales_multiply_standard_deviations() -> None:
    body, rng = sliders(3), np.random.default_rng(2)
    covariance = covariance_of(3, rng)
    for scale in (0.5, 4.0):
        samples = drawn(CovarianceScaledProposal(body, np.zeros(3), covariance, scale), 20000)
        np.testing.assert_allclose(np.cov(samples.T) / scale**2, covariance, atol=0.05 * covariance.max())


def test_spheres_have_the_volume_of_the_ellipsoid() -> None:
    """Densities at the mode are inverse volumes; a direction held by a limit belongs to neither."""
    body, rng = sliders(3), np.random.default_rng(3)
    covariance = covariance_of(3, rng)
    covariance[1] = covariance[:, 1] = 0.0
    for scale in (1.0, 8.0):
        ellipsoid = CovarianceScaledProposal(body, np.zeros(3), covariance, scale)
        sphere = SphericalProposal(body, np.zeros(3), covariance, scale)
        assert sphere.log_density(np.zeros(3)) == pytest.approx(ellipsoid.log_density(np.zeros(3)))
        std = drawn(sphere, 4000).std(axis=0)
        expected = scale * np.linalg.det(covariance[np.ix_([0, 2], [0, 2])]) ** 0.25
        np.testing.assert_allclose(std, [expected, HELD_STD, expected], rtol=0.05)


def test_student_tails_are_heavier_and_end_in_the_gaussian() -> None:
    body, covariance, degrees = sliders(1), np.array([[0.04]]), 3.0
    gaussian = CovarianceScaledProposal(body, np.zeros(1), covariance, 1.0)
    heavy = CovarianceScaledProposal(body, np.zeros(1), covariance, 1.0, degrees)
    light = CovarianceScaledProposal(body, np.zeros(1), covariance, 1.0, 1e7)
    far = np.array([0.2 * 4.0])
    assert heavy.log_density(far) > gaussian.log_density(far) + 3.0
    assert light.log_density(far) == pytest.approx(gaussian.log_density(far), abs=1e-4)
    # beyond four standard deviations: 2.8 % of a t of three degrees, 0.006 % of a Gaussian
    assert np.mean(np.abs(drawn(heavy, 20000)) > far) == pytest.approx(0.028, abs=0.005)
    closed = math.gamma(2.0) / math.gamma(1.5) / math.sqrt(degrees * math.pi) / 0.2 * (1.0 + 16.0 / degrees) ** -2
    assert math.exp(heavy.log_density(far)) == pytest.approx(closed)


def test_weakest_directions_are_lines_along_the_largest_variances() -> None:
    body, rng = sliders(3), np.random.default_rng(4)
    covariance = covariance_of(3, rng)
    values, vectors = np.linalg.eigh(covariance)
    points = WeakestDirections(body, np.zeros(3), covariance, 2, (2.0, 4.0)).points
    assert points.shape == (8, 3)
    along = points @ vectors / np.sqrt(values)
    np.testing.assert_allclose(np.abs(along[[0, 1, 4, 5]]), np.outer([2, 2, 4, 4], [0, 0, 1]), atol=1e-9)
    np.testing.assert_allclose(np.abs(along[[2, 3, 6, 7]]), np.outer([2, 2, 4, 4], [0, 1, 0]), atol=1e-9)
    np.testing.assert_allclose(points[0::2], -points[1::2])


def test_limits_hold_directions_and_samples_alike() -> None:
    """A mode on a limit: samples hardly leave the held direction at any scale."""
    body = body_of("arm8")
    q = body.clamp(np.where(np.arange(body.nq) == 2, body.upper, body.neutral))
    covariance = 0.01 * np.eye(body.nv)
    covariance[2] = 0.0
    for proposal in (CovarianceScaledProposal(body, q, covariance, 8.0), SphericalProposal(body, q, covariance, 8.0)):
        samples = drawn(proposal, 100)
        assert inside(body, samples)
        assert np.abs(samples[:, 2] - q[2]).max() < 5.0 * HELD_STD
        assert np.abs(samples[:, 3] - q[3]).max() > 0.3


def test_a_limb_moves_alone() -> None:
    body, rng = body_of("human34"), np.random.default_rng(5)
    q = random_pose(body, rng)
    proposal = LimbProposal(body)
    for _ in range(50):
        moved = np.flatnonzero(body.difference(q, proposal.sample(rng, q)))
        assert moved.size < body.nv - 6
        assert np.all(moved >= 6)
