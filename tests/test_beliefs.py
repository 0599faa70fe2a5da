"""Kernels, potentials and products on R^n and on placements: closed forms, integrals, another library's rotations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from estimator.inference.annealing import effective_count
from estimator.inference.beliefs.labels import Stacked
from estimator.inference.beliefs.mixture import KernelMixture, UniformBox, mixture_of
from estimator.inference.beliefs.potential import Potential, potential_of
from estimator.inference.beliefs.products import METHODS, ProductSettings, candidates, draw_products
from estimator.inference.beliefs.space import PLACEMENTS, TURNS_VOLUME, Space, placements_of, points_of
from estimator.inference.clusters import mean_and_covariance
from humanoid.support.errors import InputError

LINE, TURNS, PLANE_AND_TURNS = Space(1, False), Space(0, True), Space(2, True)
ORIGIN = np.eye(7)[6]


def placed(rng: np.random.Generator, count: int, metres: float = 1.0, radians: float = 1.0) -> np.ndarray:
    return PLACEMENTS.moved(ORIGIN, np.repeat([metres, radians], 3) * rng.standard_normal((count, 6)))


def covariances(rng: np.random.Generator, count: int, scale: np.ndarray) -> np.ndarray:
    """Random ones (count, D, D) of standard deviations near `scale` (D,)."""
    A = np.eye(len(scale)) + 0.3 * rng.standard_normal((count, len(scale), len(scale)))
    return scale[:, None] * (A @ A.transpose(0, 2, 1)) * scale


def other_sign(points: np.ndarray) -> np.ndarray:
    flipped = points.copy()
    flipped[:, -4:] *= -1.0
    return flipped


def potentials(rng: np.random.Generator, share: float = 0.05) -> Potential:
    covariance = covariances(rng, 3, np.repeat([0.02, 0.1], 3))
    outlier = mixture_of(PLACEMENTS, ORIGIN[None], np.array([[1.0, 1.0, 1.0, 4.0, 4.0, 4.0]]))
    return potential_of(
        PLACEMENTS, placed(rng, 3, 0.3), covariance, np.array([3.0, 2.0, 1.0]), outlier=outlier, share=share
    )


def test_rotations_are_those_of_another_library() -> None:
    rng = np.random.default_rng(0)
    a, b = placed(rng, 200, 1.0, 2.0), placed(rng, 200, 1.0, 2.0)
    b[:3] = np.concatenate([a[:3, :3], Rotation.from_quat(a[:3, 3:]).as_quat()], axis=1)  # no rotation between them
    first, second = Rotation.from_quat(a[:, 3:]), Rotation.from_quat(b[:, 3:])
    tangent = np.hstack([first.inv().apply(b[:, :3] - a[:, :3]), (first.inv() * second).as_rotvec()])
    np.testing.assert_allclose(PLACEMENTS.differences(a, b), tangent, atol=1e-12)
    np.testing.assert_allclose(placements_of(PLACEMENTS.moved(a, tangent))[1], second.as_matrix(), atol=1e-12)
    chained = np.concatenate([PLACEMENTS.composed(x[None], y[None])[0] for x, y in zip(a, b, strict=True)])
    np.testing.assert_allclose(placements_of(chained)[1], (first * second).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(chained[:, :3], a[:, :3] + first.apply(b[:, :3]), atol=1e-12)
    R = placements_of(a)[1]
    half = Rotation.from_rotvec(np.pi * np.eye(3)).as_matrix()  # where quaternions have no real part
    R = np.concatenate([R, half])
    np.testing.assert_allclose(placements_of(points_of(np.zeros((203, 3)), R))[1], R, atol=1e-12)


def test_a_narrow_kernel_is_a_normal_density_of_the_tangent() -> None:
    rng = np.random.default_rng(1)
    covariance = covariances(rng, 1, np.repeat([0.2, 0.15], 3))
    mean = placed(rng, 1)
    points = PLACEMENTS.moved(mean, 0.2 * rng.standard_normal((50, 6)))
    tangent = PLACEMENTS.differences(mean, points)
    half = 0.5 * np.linalg.norm(tangent[:, 3:], axis=1)
    expected = multivariate_normal(np.zeros(6), covariance[0]).logpdf(tangent) - 2.0 * np.log(np.sin(half) / half)
    kernel = mixture_of(PLACEMENTS, mean, covariance)
    np.testing.assert_allclose(kernel.log_density(points), expected, atol=1e-6)
    np.testing.assert_allclose(kernel.log_density(other_sign(points)), expected, atol=1e-6)
    flipped = mixture_of(PLACEMENTS, other_sign(mean), covariance)
    np.testing.assert_allclose(flipped.log_density(points), expected, atol=1e-6)


@pytest.mark.parametrize("std", [(0.3, 0.3, 0.3), (2.0, 2.0, 2.0), (0.2, 0.8, 3.0)])
@pytest.mark.parametrize("space", [TURNS, PLANE_AND_TURNS, PLACEMENTS])
def test_densities_integrate_to_one(space: Space, std: tuple[float, float, float]) -> None:
    """Over all rotations, also where half of a normal density would be beyond 180 degrees; samples have that
    density."""
    rng = np.random.default_rng(2)
    mean = np.zeros((2, space.size))
    mean[:, space.n :] = Rotation.from_rotvec([[3.0, 0.0, 0.0], [0.5, 1.0, 0.0]]).as_quat()
    mixture = mixture_of(space, mean, np.square([*([0.3] * space.n), *std])[None], np.array([1.0, 2.0]))
    box = UniformBox(space, np.full(space.n, -1.8), np.full(space.n, 1.8))
    mixed = KernelMixture(mixture.log_weight, mean, mixture.shape, mixture.shapes, box, 0.25)
    points = np.concatenate([box.sample(rng, 20_000), mixture.sample(rng, 20_000)])
    p, even = np.exp(mixture.log_density(points)), np.exp(box.log_density(points))
    ratio = p / (0.5 * p + 0.5 * even)  # both sources have equal numbers of points
    assert ratio.mean() == pytest.approx(1.0, abs=4.0 * ratio.std() / 200.0)
    by_box = p[:20_000] / even[:20_000]
    assert by_box.mean() == pytest.approx(1.0, abs=4.0 * by_box.std() / 141.0)
    np.testing.assert_allclose(np.exp(mixed.log_density(points)), 0.75 * p + 0.25 * even, rtol=1e-9)
    assert math.exp(-UniformBox(TURNS, np.zeros(0), np.zeros(0)).log_density(points[:1, -4:])[0]) == pytest.approx(
        TURNS_VOLUME
    )


def test_the_mean_near_half_a_turn() -> None:
    """Of rotations on both sides of 180 degrees, their quaternions of either sign."""
    rng = np.random.default_rng(3)
    mean = PLACEMENTS.moved(ORIGIN, np.array([1.0, 2.0, 3.0, np.pi - 0.01, 0.0, 0.0]))
    steps = 0.3 * rng.standard_normal((40, 6))
    points = PLACEMENTS.moved(mean, np.concatenate([steps, -steps]))
    points[::3] = other_sign(points[::3])
    middle, covariance = mean_and_covariance(PLACEMENTS, points, np.full(80, 1.0 / 80))
    np.testing.assert_allclose(PLACEMENTS.differences(mean, middle[None]), 0.0, atol=1e-9)
    np.testing.assert_allclose(covariance, steps.T @ steps / 40, atol=1e-9)


def test_potentials_round_trip() -> None:
    """F_ij o F_ji is the identity, and to first order both directions are the same function."""
    rng = np.random.default_rng(4)
    covariance = covariances(rng, 3, np.repeat([0.0005, 0.0025], 3))
    forth = potential_of(PLACEMENTS, placed(rng, 3, 0.3), covariance)
    back, x = forth.inverse(), placed(rng, 20)
    there = forth.placed(x)
    for m in range(3):
        again = back.placed(there[:, m])[:, m]
        np.testing.assert_allclose(PLACEMENTS.differences(x, again), 0.0, atol=1e-12)
    y = np.concatenate([forth.message(a[None], np.zeros(1)).sample(rng, 1) for a in x])
    np.testing.assert_allclose(forth.log_value(x, y), back.log_value(y, x), atol=0.15)
    np.testing.assert_allclose(forth.inverse().inverse().relative.shapes.covariance, covariance, atol=1e-12)


def test_turning_or_moving_the_world_changes_nothing() -> None:
    rng = np.random.default_rng(5)
    potential, world = potentials(rng, 0.0 + 1e-9), placed(rng, 1)
    x, log_weight = placed(rng, 30, 0.1, 0.3), np.log(np.full(30, 1.0 / 30))
    message = potential.message(x, log_weight)
    y = message.sample(rng, 100)
    elsewhere = potential.message(PLACEMENTS.composed(world, x)[0], log_weight)
    np.testing.assert_allclose(
        message.log_density(y), elsewhere.log_density(PLACEMENTS.composed(world, y)[0]), atol=1e-5
    )
    pairs = np.stack([potential.log_value(np.tile(a, (len(y), 1)), y) for a in x])  # eq. 1, point by point
    np.testing.assert_allclose(message.log_density(y), np.log(np.exp(pairs).mean(axis=0)), atol=1e-6)


def test_covariances_along_the_first_node_s_axes() -> None:
    rng = np.random.default_rng(6)
    mean, variance = placed(rng, 1), np.array([[1e-2, 1e-4, 1e-6, 1e-3, 1e-3, 1e-3]])
    potential = potential_of(PLACEMENTS, mean, variance, in_first=True)
    drawn = potential.message(ORIGIN[None], np.zeros(1)).sample(rng, 20_000)[:, :3] - mean[0, :3]
    np.testing.assert_allclose(drawn.std(axis=0), np.sqrt(variance[0, :3]), rtol=0.03)


def line_mixtures(rng: np.random.Generator, count: int, kernels: int, apart: float) -> list[KernelMixture]:
    mixtures = []
    for _ in range(count):
        mean = apart * rng.standard_normal() + 0.05 * rng.standard_normal((kernels, 1))
        variance = np.full((kernels, 1), 0.02**2)
        variance[0] = 1.0
        mixtures.append(mixture_of(LINE, mean, variance, rng.exponential(size=kernels)))
    return mixtures


@pytest.mark.parametrize("apart", [0.0, 0.08])
@pytest.mark.parametrize(
    ("method", "most"), [("importance", 0.05), pytest.param("gibbs", 0.1, marks=pytest.mark.paper), ("exact", 0.05)]
)
def test_products_are_those_of_quadrature(method: str, most: float, apart: float) -> None:
    rng = np.random.default_rng(7)
    factors = line_mixtures(rng, 3, 12, apart)
    grid = np.linspace(-1.5, 1.5, 20_001)[:, None]
    density = np.exp(sum(f.log_density(grid) for f in factors))
    cumulative = np.cumsum(density) / density.sum()
    settings = ProductSettings(method, sweeps=8, exact_below=2000 if method == "exact" else 0)
    (draws,) = draw_products(rng, factors, [range(3)], [4000], settings)
    share = np.histogram(np.interp(draws.points[:, 0], grid[:, 0], cumulative), 20, (0.0, 1.0))[0] / 4000
    assert 0.5 * np.abs(share - 0.05).sum() < most
    if draws.log_factors is not None:
        np.testing.assert_allclose(draws.log_factors, [f.log_density(draws.points) for f in factors])


@pytest.mark.parametrize("method", METHODS)
def test_products_of_placements(method: str) -> None:
    """Of all, and of all but one of three messages: means within 3 mm and 1 degree of those of many weighted
    candidates."""
    rng = np.random.default_rng(9)
    factors = [mixture_of(PLACEMENTS, placed(rng, 8, 0.02, 0.1), covariances(rng, 8, np.repeat([0.02, 0.1], 3)))
               for _ in range(3)]  # fmt: skip
    targets = [(0, 1, 2), (0, 2)]
    truth = candidates(rng, factors, targets, 20_000, 1)
    settings = ProductSettings(method, sweeps=8, exact_below=600 if method == "exact" else 0)
    for target, draws in zip(targets, draw_products(rng, factors, targets, [500, 500], settings), strict=True):
        weights = truth.weights(target)[0]
        assert effective_count(weights) > 1000.0
        mean, _ = mean_and_covariance(PLACEMENTS, truth.points, weights)
        off = PLACEMENTS.differences(mean, draws.points).mean(axis=0)
        assert np.linalg.norm(off[:3]) < 0.003
        assert np.linalg.norm(off[3:]) < math.radians(1.0)


def test_a_product_of_two_kernels_is_known() -> None:
    space, rng = Space(2, False), np.random.default_rng(10)
    (a, b), mean = covariances(rng, 2, np.array([1.0, 0.3])), rng.standard_normal((2, 2))
    stacked = Stacked.of([mixture_of(space, m[None], c[None]) for m, c in zip(mean, (a, b), strict=True)])
    product, covariance, log_weight = stacked.products(np.array([[0, 1]]), np.ones((1, 2), dtype=bool))
    expected = np.linalg.inv(np.linalg.inv(a) + np.linalg.inv(b))
    np.testing.assert_allclose(covariance[0], expected)
    np.testing.assert_allclose(product[0], expected @ (np.linalg.solve(a, mean[0]) + np.linalg.solve(b, mean[1])))
    assert log_weight[0] == pytest.approx(multivariate_normal(mean[1], a + b).logpdf(mean[0]))


def test_invalid_arguments_are_refused() -> None:
    rng = np.random.default_rng(11)
    factors = line_mixtures(rng, 3, 12, 0.0)
    for wrong, message in (
        (lambda: mixture_of(LINE, np.zeros((3, 2)), np.ones((1, 1))), r"\(K, 1\)"),
        (lambda: mixture_of(LINE, np.zeros((3, 1)), -np.ones((1, 1, 1))), "positive definite"),
        (lambda: mixture_of(LINE, np.zeros((3, 1)), np.ones((1, 1)), np.zeros(3)), "all zero"),
        (
            lambda: potential_of(LINE, np.zeros((1, 1)), np.ones((1, 1)), outlier=factors[0], share=1.5),
            "between 0 and 1",
        ),
        (lambda: draw_products(rng, factors, [range(3)], [10], ProductSettings("exact")), "1728 combinations"),
        (lambda: ProductSettings("best"), "gibbs"),
    ):
        with pytest.raises(InputError, match=message):
            wrong()
