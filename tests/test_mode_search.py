"""Laws of what passes from frame to frame: modes, mixtures, first poses, and paths through the hypotheses."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from builders import bent, body_of, camera_at, inside, observe, random_pose
from scipy.stats import chi2

from estimator.data.observation import Observation, PoseEstimate
from estimator.inference.mixture import Mixture, Mode, best_distinct, bhattacharyya, body_size, mixture_of
from estimator.inference.origin import Family, Origin, PreviousPose
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from estimator.search.first_pose import random_configuration, start_modes, view_sphere
from estimator.search.frame_search import FrameProblem
from estimator.search.hypothesis import Hypothesis
from estimator.search.mode_search import ModeSearch
from estimator.search.settings import ModeSearchSettings
from estimator.search.volumes import Surroundings
from estimator.trackers.frame_result import backtrack
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body

CAMERA = camera_at(0.0, height=0.2)


@pytest.fixture(scope="module")
def search() -> ModeSearch:
    body = body_of("human34")
    return ModeSearch(CostModel(body, CostSettings(), SelfCollision(body)))


def walking(body: Body, heading: float) -> np.ndarray:
    """A pose whose sides differ, turned by `heading` [rad] about the vertical."""
    q = bent(
        body, left_shoulder_elevation=0.9, left_elbow_flexion=0.6, right_shoulder_flexion=0.7, left_hip_flexion=0.5,
        left_knee_flexion=0.7, lumbar_flexion=0.2,
    )  # fmt: skip
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, 0.0, heading)).coeffs()
    return q


def heading_error(body: Body, q: np.ndarray, heading: float) -> float:
    R_world_root = body.at(q).rotations[1]
    difference = np.arctan2(R_world_root[1, 0], R_world_root[0, 0]) - heading
    return float(np.degrees(np.abs((difference + np.pi) % (2.0 * np.pi) - np.pi)))


def reprojection_rms(body: Body, mode: Mode, seen: Observation, mirror: np.ndarray) -> float:
    read = seen if mode.association == "as_detected" else seen.exchanged(mirror)
    off = read.cameras[0].project(body.landmarks(body.at(mode.q))) - read.pixels[0]
    return float(np.sqrt(np.square(off).sum(axis=1).mean()))


@pytest.mark.parametrize("heading", np.arange(8) * np.pi / 4.0 + 0.1)
def test_first_poses_from_every_side(search: ModeSearch, heading: float) -> None:
    """One camera, no pose given: the best of seven modes faces the right way, and all of them fit the picture."""
    body = search.body
    truth = walking(body, heading)
    seen = observe(body, truth, [CAMERA])
    mixture = start_modes(search, np.random.default_rng(0), seen, 7)
    best = mixture.modes[0]
    assert best.status == "converged"
    assert best.association == "as_detected"
    assert heading_error(body, best.q, heading) < 10.0
    assert reprojection_rms(body, best, seen, search.mirror) < 2.0
    # depth is always slightly undetermined
    apart = np.linalg.norm(body.landmarks(body.at(best.q)) - body.landmarks(body.at(truth)), axis=1)
    assert apart.mean() < 0.12
    extent = np.sqrt(np.square(seen.pixels[0] - seen.pixels[0].mean(axis=0)).sum(axis=1).mean())
    for mode in mixture.modes:
        assert reprojection_rms(body, mode, seen, search.mirror) < 0.08 * extent
        assert (mode.kkt_residual < 1e-6) == (mode.status == "converged")
        assert mode.penetration <= search.settings.contact.tolerance
        assert inside(body, mode.q)


def test_view_sphere_is_placed_by_the_picture() -> None:
    body = body_of("human34")
    for distance in (2.5, 6.0):
        camera = camera_at(30.0, distance=distance)
        seen = observe(body, body.neutral, [camera])
        starts = view_sphere(body, body.neutral, seen)
        assert len(starts) >= 24
        depths, headings = [], []
        for q in starts:
            assert np.array_equal(q[7:], body.neutral[7:])
            assert np.linalg.norm(q[3:7]) == pytest.approx(1.0)
            depths.append((camera.R_camera_world @ q[:3] + camera.t_camera_world)[2])
            headings.append(heading_error(body, q, 0.0))
        nearest = starts[int(np.argmin([np.abs(body.difference(q, body.neutral)[:6]).max() for q in starts]))]
        assert np.abs(body.difference(nearest, body.neutral)[3:6]).max() < np.pi / 12 + 0.2
        assert np.linalg.norm(nearest[:3]) < 0.1 * distance
        assert 0.8 * distance < np.median(depths) < 1.25 * distance
        assert max(headings) > 150.0


def test_a_fixed_base_starts_from_all_over_the_limits() -> None:
    body = body_of("upper13")
    rng = np.random.default_rng(71)
    drawn = np.array([random_configuration(rng, body) for _ in range(400)])
    assert inside(body, drawn)
    spread = (np.ptp(drawn, axis=0) / (body.upper - body.lower))[body.bounded_q]
    assert spread.min() > 0.95
    search = ModeSearch(CostModel(body, CostSettings(interpenetration_weight=0.0)))
    truth = random_pose(body, rng, share=0.5)
    mixture = start_modes(search, rng, observe(body, truth, [camera_at(10.0), camera_at(80.0)]), 3)
    assert (
        np.linalg.norm(body.landmarks(body.at(mixture.modes[0].q)) - body.landmarks(body.at(truth)), axis=1).mean()
        < 0.02
    )


def test_modes_are_distinct_and_in_order(search: ModeSearch) -> None:
    body = search.body
    seen = observe(body, walking(body, 0.3), [CAMERA], noise=3.0, rng=np.random.default_rng(72))
    for count in (1, 4):
        mixture = start_modes(search, np.random.default_rng(0), seen, count)
        assert len(mixture.modes) <= count
        assert mixture.weights.sum() == pytest.approx(1.0, abs=1e-12)
        assert np.all(np.diff(mixture.log_scores) <= 0.0)
        assert np.all(np.diff([m.energy for m in mixture.modes]) >= 0.0)
        shapes = [body.landmarks(body.at(m.q)) for m in mixture.modes]
        for i, j in product(range(len(shapes)), repeat=2):
            if i < j:
                apart = np.linalg.norm(shapes[i] - shapes[j], axis=1).max()
                assert apart > search.settings.distinct * body_size(body)
        for m in mixture.modes:
            assert np.linalg.eigvalsh(m.covariance)[0] > -1e-10


def test_a_modes_certificates_can_be_recomputed(search: ModeSearch) -> None:
    body = search.body
    seen = observe(body, walking(body, 0.3), [CAMERA], noise=3.0, rng=np.random.default_rng(73))
    associations = search.associations(seen)
    q_previous = walking(body, 0.25)
    kept = Origin(Family.KEPT, PreviousPose(q_previous))
    hypotheses = [Hypothesis(q_previous, k, kept, 2, -1.5) for k in range(2)]
    mixture = search.best_modes(hypotheses, FrameProblem(associations, 0.04), 2)
    assert search.self_collision is not None
    free = 0
    for mode, score in zip(mixture.modes, mixture.log_scores - mixture.log_scores[0], strict=True):
        association = next(a for a in associations if a.name == mode.association)
        quadratic = search.model.cost(association.term, q_previous, 0.04).at(mode.q)
        assert mode.energy == pytest.approx(quadratic.value + association.penalty, rel=1e-14)
        assert mode.origin is kept
        assert score == pytest.approx(mixture.modes[0].energy - mode.energy, abs=1e-9)
        assert mode.penetration == search.self_collision.penetration(body.at(mode.q))
        assert mode.parent == 2
        if mode.status == "converged" and mode.penetration == 0.0:
            assert search.seeker.kkt_residual(quadratic) < 1e-6
            free += 1
    assert free > 0


def test_by_volume_a_mode_counts_its_height_times_its_volume() -> None:
    body, rng = body_of("arm8"), np.random.default_rng(5)
    search = ModeSearch(CostModel(body), ModeSearchSettings(weigh="volume"))
    seen = observe(body, random_pose(body, rng, share=0.5), [camera_at(20.0)], noise=2.0, rng=rng)
    associations = search.associations(seen)
    starts = [Hypothesis(random_pose(body, rng), k % len(associations)) for k in range(24)]
    mixture = search.best_modes(starts, FrameProblem(associations), 4)
    costs = {a.name: search.model.cost(a.term) for a in associations}
    volumes = [Surroundings(body, costs[mode.association].at(mode.q)).log_volume for mode in mixture.modes]
    assert np.ptp(volumes) > 0.5
    expected = volumes - np.array([mode.energy for mode in mixture.modes])
    np.testing.assert_allclose(mixture.log_scores - mixture.log_scores[0], expected - expected[0], atol=1e-9)


def test_a_swapped_frame_is_associated_exchanged(search: ModeSearch) -> None:
    body = search.body
    truth = walking(body, 0.2)
    seen = observe(body, truth, [CAMERA])
    swapped = seen.exchanged(search.mirror)
    plain, exchanged = search.associations(swapped)
    assert (plain.penalty, exchanged.penalty) == (0.0, search.model.settings.exchange_penalty)
    assert np.array_equal(swapped.exchanged(search.mirror).pixels, seen.pixels)
    cost = search.model.cost(search.associations(seen)[0].term).at(truth).value
    assert search.model.cost(exchanged.term).at(truth).value == pytest.approx(cost, rel=1e-12)
    start = [Hypothesis(truth, k, Origin(Family.KEPT, PreviousPose(truth)), 0) for k in range(2)]
    assert search.best_modes(start, FrameProblem((plain, exchanged), 0.04), 1).modes[0].association == "exchanged"
    assert (
        search.best_modes(start, FrameProblem(search.associations(seen), 0.04), 1).modes[0].association == "as_detected"
    )
    arm = body_of("arm8")
    one_sided = ModeSearch(CostModel(arm))
    assert len(one_sided.associations(observe(arm, arm.neutral, [CAMERA]))) == 1
    assert len(ModeSearch(search.model, ModeSearchSettings(exchange=False)).associations(seen)) == 1


def test_mixtures_are_ordered_and_normalised() -> None:
    modes = tuple(Mode(np.array([float(k)]), np.eye(1), 0.0, "converged", np.zeros(1)) for k in range(4))
    scores = np.array([-1005.0, -1000.0, -1001.0, -1000.0])
    mixture = mixture_of(modes, scores)
    assert [m.q[0] for m in mixture.modes] == [1.0, 3.0, 2.0, 0.0]
    assert np.allclose(mixture.weights, np.exp([0.0, 0.0, -1.0, -5.0]) / np.exp([0.0, 0.0, -1.0, -5.0]).sum())
    assert np.array_equal(mixture.log_scores, [0.0, 0.0, -1.0, -5.0])
    shifted = mixture_of(modes, scores + 777.0)
    assert np.array_equal(shifted.weights, mixture.weights)


def test_the_best_of_every_cluster_is_kept() -> None:
    places = np.array([0.0, 0.05, 1.0, 1.05, 0.11, 2.0])
    scores = {0.0: 1.0, 0.05: 3.0, 1.0: 2.0, 1.05: 1.5, 0.11: 0.5, 2.0: 0.1}

    def kept(count: int) -> list[float]:
        return best_distinct(list(places), scores.__getitem__, lambda x: np.array([[x, 0.0, 0.0]]), 0.08, count)

    assert kept(10) == [0.05, 1.0, 2.0]
    assert kept(2) == [0.05, 1.0]
    # one differing landmark is enough
    far = best_distinct([0.0, 1.0], float, lambda x: np.array([[0.0, 0.0, 0.0], [x, 0.0, 0.0]]), 0.5, 5)
    assert len(far) == 2


def test_bhattacharyya_distance() -> None:
    """Zero for equal arguments, symmetric on a vector space, the known form in one dimension."""
    body = body_of("arm8")
    rng = np.random.default_rng(74)
    q = random_pose(body, rng, share=0.2)
    other = body.integrate(q, np.full(body.nv, 0.05))
    root = rng.normal(size=(body.nv, body.nv))
    a, b = np.eye(body.nv) * 0.3, 0.1 * (root @ root.T + np.eye(body.nv))
    assert bhattacharyya(body, q, a, q, a) == pytest.approx(0.0, abs=1e-12)
    assert bhattacharyya(body, q, a, other, b) == pytest.approx(bhattacharyya(body, other, b, q, a), rel=1e-9)
    assert bhattacharyya(body, q, a, other, b) > bhattacharyya(body, q, a, q, b) > 0.0
    assert bhattacharyya(body, q, a, other, a) == pytest.approx(body.nv * 0.05**2 / 0.3 / 8.0, rel=1e-5)
    # -ln of the overlap of two one-dimensional Gaussians, in each direction
    wide = bhattacharyya(body, q, a, q, 4.0 * a)
    assert wide == pytest.approx(body.nv * 0.5 * np.log(2.5 / 2.0), rel=1e-5)


def brute_path(parent: np.ndarray, weight: np.ndarray) -> list[int]:
    path, k = [], int(np.nanargmax(weight[-1]))
    for t in range(len(parent) - 1, -1, -1):
        path.append(k)
        k = int(parent[t, k])
        if k < 0 and t > 0:
            k = int(np.nanargmax(weight[t - 1]))
    return path[::-1]


def test_paths_follow_the_parents() -> None:
    rng = np.random.default_rng(75)
    for _ in range(20):
        weight = rng.random((8, 4))
        parent = rng.integers(-1, 4, size=(8, 4))
        assert backtrack(parent, weight).tolist() == brute_path(parent, weight)
    # a frame without hypotheses is skipped: the path continues from the best one before it
    weight = np.array([[0.2, 0.8], [0.6, 0.4], [np.nan, np.nan], [0.9, 0.1]])
    parent = np.array([[-1, -1], [0, 1], [-1, -1], [-1, -1]])
    assert backtrack(parent, weight).tolist() == [0, 0, -1, 0]
    assert backtrack(np.zeros((3, 0), dtype=int), np.zeros((3, 0))).tolist() == [-1, -1, -1]


def test_a_free_roots_search_does_not_depend_on_where_the_world_is(search: ModeSearch) -> None:
    """Rotating and moving the world with its cameras rotates and moves the pose."""
    body = search.body
    camera = CAMERA
    R, t = pin.rpy.rpyToMatrix(0.0, 0.0, 1.1), np.array([0.3, -2.0, 0.4])
    moved = replace(
        camera,
        R_camera_world=camera.R_camera_world @ R.T,
        t_camera_world=camera.t_camera_world - camera.R_camera_world @ R.T @ t,
    )
    seen = observe(body, walking(body, 0.4), [camera])
    first = start_modes(search, np.random.default_rng(0), seen, 1).modes[0]
    second = start_modes(search, np.random.default_rng(0), replace(seen, cameras=(moved,)), 1).modes[0]
    assert second.energy == pytest.approx(first.energy, abs=1e-6)
    expected = body.landmarks(body.at(first.q)) @ R.T + t
    assert np.abs(body.landmarks(body.at(second.q)) - expected).max() < 1e-4


@pytest.mark.parametrize("fitted", [True, False])
def test_the_first_hypotheses_are_drawn_by_the_covariance(fitted: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """CSS section 5: by that of the fit's pose where the person was fitted, else by the first modes' own."""
    body, count = body_of("arm8"), 400
    truth = random_pose(body, np.random.default_rng(33), share=0.3)
    covariance = np.diag(np.linspace(1e-5, 1e-4, body.nv))
    seen = replace(observe(body, truth, [CAMERA]), estimate=PoseEstimate(truth, covariance) if fitted else None)
    asked: list[list[Hypothesis]] = []
    best_modes = ModeSearch.best_modes

    def spied(self: ModeSearch, hypotheses: Iterable[Hypothesis], *args: Any, **how: Any) -> Mixture:
        asked.append(list(hypotheses))
        return best_modes(self, asked[-1][:40], *args, **how)

    monkeypatch.setattr(ModeSearch, "best_modes", spied)
    plain, sampled = (
        start_modes(ModeSearch(CostModel(body), ModeSearchSettings(start_samples=n)), np.random.default_rng(0), seen, 3)
        for n in (0, count)
    )
    assert sampled.modes[0].energy <= plain.modes[0].energy + 1e-9
    drawn = asked[-1][-count:]
    centre = PoseEstimate(truth, covariance) if fitted else PoseEstimate(plain.modes[0].q, plain.modes[0].covariance)
    near = np.array([body.difference(centre.q, h.q) for h in drawn])
    if fitted:
        np.testing.assert_allclose(near.std(axis=0), np.sqrt(8.0 * np.diag(covariance)), rtol=0.15)
    else:
        assert plain.weights[0] > 0.99
        distance = np.sqrt(np.einsum("ni,ij,nj->n", near, np.linalg.pinv(centre.covariance), near))
        assert np.median(distance) == pytest.approx(np.sqrt(8.0 * chi2.median(body.nv)), rel=0.25)  # some are clamped
