"""Particle filters on problems with known answers: Kalman's, counted draws, two wells, particle sets on the
manifold."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from builders import body_of, random_pose

from estimator.inference.annealing import (
    Annealing,
    Particles,
    anneal,
    annealing_power,
    bootstrap_step,
    effective_count,
    normalised,
    systematic,
)
from estimator.inference.clusters import clusters, mean_and_covariance


def test_the_bootstrap_filter_is_kalmans_where_all_is_linear_and_normal() -> None:
    """Position and velocity, noisy positions: mean, covariance and evidence of every frame."""
    rng = np.random.default_rng(90)
    F, Q, H, R = np.array([[1.0, 0.5], [0.0, 0.9]]), np.diag([0.04, 0.09]), np.array([[1.0, 0.0]]), 0.25
    count, steps, truth = 40_000, 12, np.zeros(2)
    mean, P = np.zeros(2), np.eye(2)
    states, weights = rng.multivariate_normal(mean, P, size=count), np.full(count, 1.0 / count)
    factor = np.linalg.cholesky(Q)
    for _ in range(steps):
        truth = F @ truth + factor @ rng.standard_normal(2)
        seen = float(truth[0] + np.sqrt(R) * rng.standard_normal())
        mean, P = F @ mean, F @ P @ F.T + Q
        S = float((H @ P @ H.T)[0, 0] + R)
        surprise = seen - mean[0]
        expected_evidence = -0.5 * (surprise**2 / S + np.log(2.0 * np.pi * S))
        gain = (P @ H.T)[:, 0] / S
        mean, P = mean + gain * surprise, P - np.outer(gain, gain) * S

        states, weights, ancestor, evidence = bootstrap_step(
            rng,
            states,
            weights,
            lambda old: old @ F.T + rng.standard_normal(old.shape) @ factor.T,
            lambda new, _, seen=seen: -0.5 * ((seen - new[:, 0]) ** 2 / R + np.log(2.0 * np.pi * R)),
        )
        average = weights @ states
        apart = states - average
        assert ancestor.shape == (count,)
        assert np.abs(average - mean).max() < 0.03
        assert np.abs((weights[:, None] * apart).T @ apart - P).max() < 0.03
        assert evidence == pytest.approx(expected_evidence, abs=0.06)


def test_systematic_resampling_counts_to_within_one() -> None:
    rng = np.random.default_rng(91)
    weights = rng.exponential(size=50) ** 3
    weights /= weights.sum()
    weights[7] = 0.0
    weights /= weights.sum()
    drawn = np.array([np.bincount(systematic(rng, weights, 333), minlength=50) for _ in range(2000)])
    assert np.all(np.abs(drawn - 333 * weights) < 1.0)
    assert np.all(drawn[:, 7] == 0)
    assert np.abs(drawn.mean(axis=0) - 333 * weights).max() < 0.06  # without bias


def test_log_weights_of_any_size() -> None:
    weights, evidence = normalised(np.log([1.0, 2.0, 5.0]) - 1e5)
    assert weights == pytest.approx([0.125, 0.25, 0.625])
    assert evidence == pytest.approx(np.log(8.0 / 3.0) - 1e5)
    assert effective_count(np.full(9, 1.0 / 9.0)) == pytest.approx(9.0)


@pytest.mark.parametrize("survival", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_the_power_leaves_the_requested_share(survival: float, size: float) -> None:
    energies = 1e4 + size * np.random.default_rng(92).exponential(size=400)
    power = annealing_power(energies, survival)
    assert effective_count(normalised(-power * energies)[0]) == pytest.approx(survival * 400, rel=1e-4)


def test_the_power_where_no_value_suffices() -> None:
    assert annealing_power(np.full(20, 3.0), 0.5) > 0.0  # all equal
    tied = np.repeat([0.0, 1.0], [15, 5])
    assert np.isfinite(annealing_power(tied, 0.5))  # 15 of 20 are equal


def test_annealing_finds_the_better_of_two_wells_where_condensation_does_not() -> None:
    """Eight dimensions, wells of 0.1; the set starts in the worse, the better is two noise widths away. Equal
    evaluations."""
    size, layers, noise, well, dims = 200, 10, 0.5, 0.1, 8
    better = np.eye(dims)[0]

    def energies(x: np.ndarray, _: np.ndarray) -> np.ndarray:
        worse = 4.0 + 0.5 * np.square(x / well).sum(axis=1)
        return np.minimum(worse, 0.5 * np.square((x - better) / well).sum(axis=1))

    def spread(x: np.ndarray, w: np.ndarray) -> np.ndarray:
        return np.sqrt(w @ np.square(x - w @ x))

    annealed, condensed = [], []
    for seed in range(20):
        rng = np.random.default_rng((93, seed))
        start = well * rng.standard_normal((size * layers, dims))
        few = Particles(start[:size], np.full(size, 1.0 / size), np.zeros(size, dtype=np.int64))
        end, went = anneal(
            rng,
            few,
            Annealing(layers, survival=0.5, diffusion=0.5),
            lambda x, scale, rng=rng: x + noise * scale * rng.standard_normal(x.shape),
            energies,
            spread,
        )
        assert went.power.shape == (layers,)
        assert np.allclose(went.effective_count, 0.5 * size, rtol=1e-3)  # the requested survival
        annealed.append(np.linalg.norm(end.weights @ end.states - better))
        states, weights, _, _ = bootstrap_step(
            rng,
            start,
            np.full(len(start), 1.0 / len(start)),
            lambda x, rng=rng: x + noise * rng.standard_normal(x.shape),
            lambda x, old: -energies(x, old),
        )
        condensed.append(np.linalg.norm(weights @ states - better))
    assert np.mean(np.array(annealed) < 0.3) >= 0.75
    assert np.mean(np.array(condensed) < 0.3) <= 0.25


def test_clusters_are_separated_and_a_cloud_stays_whole() -> None:
    rng = np.random.default_rng(94)
    centres = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    true = np.repeat([0, 1, 2], [60, 30, 10])
    points = centres[true] + 0.03 * rng.standard_normal((100, 3))
    even = np.full(100, 0.01)
    assert np.array_equal(clusters(points, even, 0.3, 7), true)
    heavy = np.where(true == 2, 10.0, 1.0)
    assert np.array_equal(clusters(points, heavy / heavy.sum(), 0.3, 7), np.array([1, 2, 0])[true])
    assert np.array_equal(clusters(points, even, 0.3, 2), np.array([0, 1, 0])[true])  # to the nearest leader
    assert not clusters(points, even, 0.3, 1).any()
    assert not clusters(points, np.eye(100)[40], 0.3, 7).any()  # one particle with all the weight


def test_clusters_are_those_of_all_distances_and_need_no_room_for_them() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(300, 6)) + 2.0 * rng.integers(0, 3, size=(300, 1))
    weights = rng.random(300)
    near = np.linalg.norm(points[:, None] - points, axis=2) <= 2.5
    free, leaders = weights.copy(), []
    while len(leaders) < 5 and free.any():
        leaders.append(int(np.argmax(np.where(free > 0.0, near @ free, -1.0))))
        free[near[leaders[-1]]] = 0.0
    nearest = np.argmin(np.linalg.norm(points[:, None] - points[leaders], axis=2), axis=1)
    order = np.argsort(-np.bincount(nearest, weights=weights))
    assert np.array_equal(order[clusters(points, weights, 2.5, 5)], nearest)
    # as a resampled set has them: some points many times, in any order
    copies = rng.permutation(np.repeat(np.arange(300), 1 + 3 * (weights > 0.8)))
    several = weights[copies] / np.bincount(copies)[copies]
    assert np.array_equal(order[clusters(points[copies], several, 2.5, 5)], nearest[copies])
    many = rng.normal(size=(6000, 6))
    tracemalloc.start()
    clusters(many, np.full(6000, 1.0 / 6000), 2.5, 5)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.05 * 8.0 * 6000**2  # of a full distance matrix


def test_the_mean_of_turned_bodies_is_on_the_manifold() -> None:
    """Pairs of opposite steps of up to two radians have their midpoint as mean, and the covariance of the steps."""
    body, rng = body_of("human34"), np.random.default_rng(95)
    q = random_pose(body, rng, share=0.2)
    steps = 0.05 * rng.standard_normal((30, body.nv))
    steps[:, 3:6] *= 20.0
    low, high = body.tangent_bounds(q)
    steps = np.clip(steps, -0.9 * np.minimum(-low, high), 0.9 * np.minimum(-low, high))
    particle_q = np.array([body.integrate(q, s) for step in steps for s in (step, -step)])
    weights = np.repeat(rng.uniform(0.5, 1.5, size=30), 2)
    mean, covariance = mean_and_covariance(body, particle_q, weights)
    assert np.abs(body.difference(q, mean)).max() < 1e-9
    assert np.linalg.norm(mean[3:7]) == pytest.approx(1.0, abs=1e-12)
    expected = np.einsum("n,ni,nj->ij", weights[::2] / weights[::2].sum(), steps, steps)
    assert np.abs(covariance - expected).max() < 1e-8
