"""The posterior over configurations: closed forms, nominal coverage of its intervals, and limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import chi2, norm, truncnorm

from benchmarks.training import credible_levels
from estimator.data.cameras.camera import Camera, guessed_camera
from estimator.energy.priors import Stabilisers
from estimator.runs.lasting_spread import _moves
from estimator.runs.marginals import Marginals, _cut_gaussian
from estimator.runs.posterior import Posterior, PosteriorCalibration
from estimator.trackers.frame_result import FrameResult
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import landmark_spread
from humanoid.subject.marker_set import marker_set
from humanoid.subject.subject import Subject, Zero, load_subject
from humanoid.support.errors import InputError
from kinemode.testing.calibration import calibration_error, coverage
from tests.builders import bent, body_of, inside, random_pose

SIDEWAYS = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
CENTRE = np.array([[0.0, 0.0, 319.5], [0.0, 0.0, 239.5], [0.0, 0.0, 0.0]])
AS_IT_IS = PosteriorCalibration(1.0, 0.0, 1.0, 1.0, 0.1, 0.0, 0.0)


def frame(q: Sequence[np.ndarray], covariance: Sequence[np.ndarray], weight: Sequence[float] = (1.0,)) -> FrameResult:
    count = len(q)
    none = np.zeros(count)
    return FrameResult(
        0, 0.0, "tracked", np.array(q), np.array(weight), none, np.array(covariance), none.astype(int), none, none,
        ("as_detected",) * count,
    )  # fmt: skip


def random_covariance(nv: int, rng: np.random.Generator, std: float) -> np.ndarray:
    root = rng.normal(size=(nv, nv)) + 2.0 * np.eye(nv)
    covariance = root @ root.T
    scale = std / np.sqrt(np.diagonal(covariance))
    return np.asarray(covariance * np.outer(scale, scale))


def gaussian(body: Body, std: float = 0.01, seed: int = 0, calibration: PosteriorCalibration = AS_IT_IS) -> Posterior:
    """One mode, so narrow that it is far from all limits."""
    rng = np.random.default_rng(seed)
    q = random_pose(body, rng, share=0.6)
    return Posterior.of(body, frame([q], [random_covariance(body.nv, rng, std)]), calibration)


def one_dimension(mean: Sequence[float], std: Sequence[float], weight: Sequence[float]) -> Marginals:
    edge = np.array([np.inf])
    return Marginals(np.array(weight), np.array([mean]), np.array([std]), np.zeros((1, len(mean))), -edge, edge)


def test_a_single_gaussian_has_its_closed_forms() -> None:
    posterior = gaussian(body_of("human34"), 0.02)
    marginals = posterior.marginals()
    std = np.sqrt(np.diagonal(posterior.covariance[0]))
    assert np.allclose(marginals.quantile(0.9), std * norm.ppf(0.9), rtol=1e-2)
    mean, spread = marginals.moments()
    assert np.allclose(spread, std, rtol=1e-2)
    assert np.allclose(mean / std, 0.0, atol=1e-6)
    for x in (0.3, -1.0, 2.5):
        assert np.allclose(marginals.credible_level(x * std), 2.0 * norm.cdf(abs(x)) - 1.0, atol=0.02)
    for intervals, deviation in zip(marginals.credible_regions(0.9), std, strict=True):
        assert np.allclose(intervals, [(-1.645 * deviation, 1.645 * deviation)], rtol=0.05)


def test_the_level_of_a_whole_pose_is_that_of_its_mahalanobis_distance() -> None:
    body, rng = body_of("human34"), np.random.default_rng(1)
    posterior = gaussian(body)
    direction = np.linalg.cholesky(posterior.covariance[0]) @ rng.normal(size=body.nv)
    for share in (0.7, 1.0, 1.2):
        step = share * direction
        squared = step @ np.linalg.solve(posterior.covariance[0], step)
        level = posterior.credible_levels(rng, body.integrate(posterior.best, step)[None], 2000)
        assert level[0] == pytest.approx(chi2.cdf(squared, body.nv), abs=0.04)


def test_a_symmetric_mixture_is_symmetric_and_its_region_has_two_parts() -> None:
    marginals = one_dimension([-3.0, 3.0], [0.5, 0.5], [0.5, 0.5])
    assert marginals.quantile(0.5)[0] == pytest.approx(0.0, abs=0.1)
    assert marginals.quantile(0.1)[0] == pytest.approx(-marginals.quantile(0.9)[0], rel=1e-3)
    (left, right), edge = marginals.credible_regions(0.9)[0], 0.5 * norm.ppf(0.95)
    assert np.allclose([left, right], [(-3.0 - edge, -3.0 + edge), (3.0 - edge, 3.0 + edge)], atol=0.05)
    assert marginals.credible_level(np.zeros(1))[0] > 0.99  # almost no probability between the modes
    assert marginals.cdf(np.array([[-3.0, 0.0, 3.0]]))[0] == pytest.approx([0.25, 0.5, 0.75], abs=1e-6)


def many_kinds() -> Marginals:
    """Cut off on one side, on both, a sliver of a Gaussian, all equal, leaning on either limit beside a Gaussian,
    leaning with hardly any room, certain, and far narrower than another."""
    rows = [  # low, high, then mean, std, lean of both components
        (-0.1, 9.0, (0.0, 0.3, 0.0), (0.2, 0.1, 0.0)),
        (-0.5, 0.2, (0.0, 0.3, 0.0), (0.2, 4.0, 0.0)),
        (-1e-4, 2e-4, (0.0, 3.0, 0.0), (1e-4, 1.0, 0.0)),
        (-1.0, 1.0, (0.3, 0.2, 0.0), (0.3, 0.2, 0.0)),
        (0.0, 0.7, (0.0, 0.0, 0.2), (0.3, 0.1, 0.0)),
        (-0.7, 0.0, (0.0, 0.0, -0.2), (-0.3, 0.4, 0.0)),
        (0.0, 1e-5, (0.0, 0.0, 0.3), (1e-5, 0.0, -0.2)),
        (-0.2, 0.6, (0.1, 0.0, 0.0), (0.1, 0.0, 0.0)),
        (-0.9, 0.6, (0.1, 1e-4, 0.0), (-0.2, 0.3, 0.0)),
    ]
    low, high = (np.array([row[i] for row in rows]) for i in (0, 1))
    mean, std, lean = (np.array([[row[2][i], row[3][i]] for row in rows]) for i in range(3))
    return Marginals(np.array([0.7, 0.3]), mean, std, lean, low, high)


def test_moments_are_the_integrals_of_the_distribution() -> None:
    """E x = low + integral of 1 - F; E (x - low)^2 = 2 integral of (x - low) (1 - F)."""
    m = many_kinds()
    mean, std = m.moments()
    for i, (low, high) in enumerate(zip(m.low, m.high, strict=True)):
        near = m.mean[i, :, None] + np.maximum(m.std[i, :, None], 1e-9) * np.linspace(-9.0, 9.0, 4001)
        x = np.unique(np.clip(np.append(np.linspace(low, high, 40001), near), low, high))
        own = Marginals(m.weight, m.mean[[i]], m.std[[i]], m.lean[[i]], m.low[[i]], m.high[[i]])
        above = 1.0 - own.cdf(x[None])[0]
        first, second = np.trapezoid(above, x), 2.0 * np.trapezoid((x - low) * above, x)
        assert mean[i] - low == pytest.approx(first, rel=1e-6)
        assert std[i] == pytest.approx(np.sqrt(max(second - first**2, 0.0)), rel=1e-5, abs=2e-9)


def test_a_quantile_has_its_share_below_it() -> None:
    m = many_kinds()
    levels = (0.0, 1e-4, 0.05, 0.5, 0.9, 1.0)
    x = m.quantiles(*levels)
    certain = (m.std == 0.0).all(axis=1) & (m.lean == 0.0).all(axis=1)
    for p, row in zip(levels, x, strict=True):
        np.testing.assert_allclose(m.cdf(row[:, None])[~certain, 0], p, atol=1e-9)
        np.testing.assert_array_equal(row, m.quantile(p))
    np.testing.assert_allclose(x[2:5, certain], 0.1, atol=1e-8)
    assert (np.diff(x, axis=0) >= 0.0).all()
    assert ((x >= m.low) & (x <= m.high)).all()
    wide = Marginals(m.weight, m.mean, np.maximum(m.std, 0.1), 0.0 * m.lean, np.full(9, -np.inf), np.full(9, np.inf))
    np.testing.assert_allclose(wide.cdf(wide.quantile(0.05)[:, None])[:, 0], 0.05, atol=1e-9)
    np.testing.assert_array_equal(wide.quantiles(0.0, 1.0), np.outer([-np.inf, np.inf], np.ones(9)))


def test_coordinates_are_the_same_alone_and_below_others() -> None:
    body = body_of("human34")
    parts = [many_kinds(), mixture(body).marginals(), gaussian(body).marginals()]
    whole = Marginals.stacked(parts)
    for of_whole, of_parts in (
        (whole.quantile(0.05), [part.quantile(0.05) for part in parts]),
        (whole.moments()[0], [part.moments()[0] for part in parts]),
        (whole.moments()[1], [part.moments()[1] for part in parts]),
        (whole.cdf(np.full((len(whole.low), 1), 0.05)), [p.cdf(np.full((len(p.low), 1), 0.05)) for p in parts]),
    ):
        np.testing.assert_allclose(of_whole, np.concatenate(of_parts), rtol=1e-9, atol=1e-12)


def mixture(body: Body, scale: float = 1.0) -> Posterior:
    """Two modes, one near limits; with stated covariances `scale` times the true ones."""
    rng = np.random.default_rng(3)
    q = body.neutral.copy()
    apart = body.integrate(q, 0.2 * rng.normal(size=body.nv))
    covariance = [random_covariance(body.nv, rng, 0.1) for _ in range(2)]
    result = frame([q, apart], covariance, (0.7, 0.3))
    return Posterior.of(body, result, replace(AS_IT_IS, covariance_scale=scale))


def levels(truth: Posterior, stated: Posterior, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Levels by degree of freedom, landmark and pose of configurations drawn from `truth`."""
    rng, body = np.random.default_rng(4), stated.body
    marginals, drawn = stated.marginals(), truth.sample(rng, count)
    dof = np.array([marginals.credible_level(body.difference(stated.best, q)) for q in drawn])
    places = np.array([body.landmarks(body.at(q)) for q in drawn])
    return dof, stated.landmark_credible_levels(rng, places), stated.credible_levels(rng, drawn, 1000)


def test_truths_drawn_from_the_posterior_have_the_nominal_coverage() -> None:
    body = body_of("human34")
    for reached in levels(mixture(body), mixture(body), 150):
        assert calibration_error(reached) < 0.06
        assert coverage(reached, 0.9)[0] == pytest.approx(0.9, abs=0.06)
    for reached in levels(mixture(body), mixture(body, 0.25), 60):
        assert calibration_error(reached) > 0.1
        assert coverage(reached, 0.9)[0] < 0.8


def test_a_spread_of_scales_covers_truths_of_unknown_scale() -> None:
    body, rng = body_of("arm8"), np.random.default_rng(5)
    spread = gaussian(body, calibration=replace(AS_IT_IS, scale_spread=0.4))
    narrow = gaussian(body)
    factor = np.linalg.cholesky(narrow.covariance[0])
    truths = [
        body.integrate(narrow.best, np.exp(0.4 * rng.normal()) * factor @ rng.normal(size=body.nv)) for _ in range(300)
    ]
    reached = [p.credible_levels(rng, np.array(truths), 1000) for p in (spread, narrow)]
    assert calibration_error(reached[0]) < 0.06
    assert coverage(reached[0], 0.9)[0] > coverage(reached[1], 0.9)[0] + 0.05


def test_samples_and_regions_stay_within_the_limits() -> None:
    body = body_of("human34")
    elbow = body.q_names.index("left_elbow_flexion")
    knee = body.q_names.index("left_knee_flexion")
    q = bent(body, left_elbow_flexion=-9.0)  # on the lower limit
    covariance = 0.3**2 * np.eye(body.nv)
    held = body.bounded_v[body.bounded_q.tolist().index(elbow)]
    bending = body.bounded_v[body.bounded_q.tolist().index(knee)]
    covariance[held] = covariance[:, held] = 0.0
    posterior = Posterior.of(body, frame([q], [covariance]), AS_IT_IS)
    drawn = posterior.sample(np.random.default_rng(6), 400)
    assert inside(body, drawn)
    gaps = drawn[:, elbow] - body.lower[elbow]
    assert gaps.mean() == pytest.approx(0.1, abs=0.02)  # exponential: mean and standard deviation agree
    assert gaps.std() == pytest.approx(0.1, abs=0.03)
    marginals = posterior.marginals()
    ((start, end),) = marginals.credible_regions(0.9)[held]
    assert (start, end) == (pytest.approx(0.0, abs=1e-3), pytest.approx(-0.1 * np.log(0.1), rel=0.05))
    low, high = body.tangent_bounds(q)
    for v in body.bounded_v:
        assert all(low[v] <= a < b <= high[v] for a, b in marginals.credible_regions(0.99)[v])
    mean, std = marginals.moments()
    assert mean[held] == pytest.approx(0.1, rel=0.05)
    assert drawn[:, knee].mean() - q[knee] == pytest.approx(mean[bending], abs=0.04)
    assert drawn[:, knee].std() == pytest.approx(std[bending], rel=0.1)


def test_landmarks_scatter_by_their_covariance() -> None:
    body = body_of("human34")
    posterior = gaussian(body, 0.02, seed=8)
    mean, covariance = posterior.landmark_moments()
    drawn = posterior.sample(np.random.default_rng(9), 1500)
    points = np.array([body.landmarks(body.at(q)) for q in drawn])
    assert np.allclose(points.mean(axis=0), mean, atol=0.004)
    size = np.trace(covariance, axis1=1, axis2=2)
    off = points - points.mean(axis=0)
    assert np.allclose(np.einsum("nli,nlj->lij", off, off) / len(off) / size[:, None, None],
                       covariance / size[:, None, None], atol=0.1)  # fmt: skip


def test_a_body_of_unknown_size_may_be_nearer_or_farther_but_looks_alike() -> None:
    body = body_of("human34")
    centre, certain = np.array([4.0, 1.0, 1.5]), 1e-12 * np.eye(body.nv)
    camera = replace(guessed_camera("c", (640, 480)), t_camera_world=-SIDEWAYS @ centre, R_camera_world=SIDEWAYS)
    posterior = Posterior.of(body, frame([body.neutral], [certain]), replace(AS_IT_IS, size_std=0.05), [camera])
    drawn = posterior.sample(np.random.default_rng(10), 500)[:, :3] - centre
    distance = np.linalg.norm(drawn, axis=1)
    assert distance.std() / distance.mean() == pytest.approx(0.05, rel=0.1)
    assert np.allclose(drawn / distance[:, None], drawn[0] / distance[0], atol=1e-4)


def test_zeros_from_markers_leave_detector_biases_open() -> None:
    subject = load_subject("human34")
    marked = subject.with_markers(marker_set("plug-in-gait").markers, [Zero("left_hip_flexion", 0.05)])
    detected = subject.with_keypoint_places(
        {m.name: (np.zeros(3), 0.01) for m in subject.landmarks}, [Zero("left_hip_flexion", 0.3)]
    )

    def covariance(own: Subject, cameras: int) -> np.ndarray:
        body = Body(own)
        result = frame([body.neutral], [1e-8 * np.eye(body.nv)])
        seen_by = rig_around(body, np.random.default_rng(3))[:cameras]
        return Posterior.of(body, result, PosteriorCalibration(), seen_by).covariance[0]

    hip = Body(subject).v_names.index("left_hip_flexion")
    np.testing.assert_allclose(covariance(marked, 2), covariance(subject, 2))
    assert covariance(detected, 2)[hip, hip] > covariance(subject, 2)[hip, hip]
    assert covariance(marked, 0)[hip, hip] != covariance(subject, 0)[hip, hip]


def rig_around(body: Body, rng: np.random.Generator) -> list[Camera]:
    """Three cameras facing the body, 4 m away."""
    cameras, middle = [], body.landmarks(body.at(body.neutral)).mean(axis=0)
    for k in range(3):
        turn = pin.exp3(np.array([0.0, 0.0, 1.2 * k])) @ pin.exp3(0.1 * rng.normal(size=3))
        R = guessed_camera("c", (640, 480)).R_camera_world @ turn
        t = -R @ middle + [0.0, 0.0, 4.0]
        cameras.append(replace(guessed_camera(f"c{k}", (640, 480)), R_camera_world=R, t_camera_world=t))
    return cameras


def _moved_with_world(camera: Camera, turn: np.ndarray, shift: np.ndarray) -> Camera:
    """A camera with the error of a world rotated and shifted before it."""
    R = camera.R_camera_world
    cause = np.concatenate([R @ turn, R @ (shift + np.cross(turn, camera.centre_world)), [0.0]])
    return replace(camera, deviations=cause[:, None])


def test_cameras_that_are_all_off_by_one_motion_of_the_world_leave_that_motion_open() -> None:
    body, rng = body_of("human34"), np.random.default_rng(3)
    cameras, (turn, shift) = rig_around(body, rng), 0.01 * rng.normal(size=(2, 3))
    off = [_moved_with_world(camera, turn, shift) for camera in cameras]
    q = random_pose(body, rng, share=0.6)
    certain = 1e-14 * np.eye(body.nv)
    covariance = Posterior.of(body, frame([q], [certain]), AS_IT_IS, off).covariance[0]
    R_world_root = body.at(q).rotations[1]
    root = np.concatenate([R_world_root.T @ (shift + np.cross(turn, q[:3])), R_world_root.T @ turn])
    expected = np.zeros((body.nv, body.nv))
    expected[:6, :6] = np.outer(root, root)
    assert np.allclose(covariance, expected, atol=3e-3 * root @ root)
    assert np.allclose(Posterior.of(body, frame([q], [certain]), AS_IT_IS, cameras).covariance[0], certain)


def test_deviations_of_a_camera_move_what_it_sees_as_another_camera_would_see_it() -> None:
    rng = np.random.default_rng(4)
    camera = rig_around(body_of("human34"), rng)[0]
    points, step = rng.normal(size=(5, 3)), 1e-5 * rng.normal(size=7)
    turn = pin.exp3(step[:3])
    other = replace(
        camera, R_camera_world=turn @ camera.R_camera_world, t_camera_world=turn @ camera.t_camera_world + step[3:6],
        K=np.diag([1.0 + step[6], 1.0 + step[6], 1.0]) @ (camera.K - CENTRE) + CENTRE,
    )  # fmt: skip
    place = points @ camera.R_camera_world.T + camera.t_camera_world
    moved = (place + _moves(place) @ step - camera.t_camera_world) @ camera.R_camera_world
    at = camera.project(points)
    assert np.allclose(other.project(points) - at, camera.project(moved) - at, atol=1e-6)


def test_a_body_by_another_focal_length_may_be_farther_and_turned_but_looks_alike() -> None:
    body, share = body_of("human34"), 0.01
    camera = replace(guessed_camera("c", (640, 480)), focal_std=share)
    away = body.neutral.copy()
    away[:3] = camera.R_camera_world.T @ np.array([4.0, -3.0, 12.0])
    certain = 1e-15 * np.eye(body.nv)
    covariance = Posterior.of(body, frame([away], [certain]), AS_IT_IS, [camera], size_known=True).covariance[0]
    variances, ways = np.linalg.eigh(covariance)
    assert variances[-2] < 1e-6 * variances[-1]
    step = np.sqrt(variances[-1]) * ways[:, -1]
    longer = replace(camera, K=np.diag([1.0 + share, 1.0 + share, 1.0]) @ (camera.K - CENTRE) + CENTRE)

    def pixels(by: Camera, v: np.ndarray) -> np.ndarray:
        return by.project(body.landmarks(body.at(pin.integrate(body.model, away, v))))

    seen, still = pixels(camera, np.zeros(body.nv)), pixels(longer, np.zeros(body.nv))
    moved = min((pixels(longer, sign * step) for sign in (1.0, -1.0)), key=lambda p: float(np.abs(p - seen).max()))
    assert np.abs(moved - seen).max() < 0.05 * np.abs(still - seen).max()

    def looked_at_from(v: np.ndarray) -> np.ndarray:
        posed = body.at(pin.integrate(body.model, away, v))
        way = posed.rotations[1].T @ (camera.centre_world - posed.translations[1])
        return np.asarray(way / np.linalg.norm(way))

    straight = np.where(np.arange(body.nv) < 3, step, 0.0)
    before, turned, shifted = looked_at_from(np.zeros(body.nv)), looked_at_from(step), looked_at_from(straight)
    assert np.abs(turned - before).max() < 0.05 * np.abs(shifted - before).max()


def test_temperature_evens_weights_out() -> None:
    body = body_of("arm8")
    rng = np.random.default_rng(11)
    q = [random_pose(body, rng) for _ in range(2)]
    result = frame(q, [0.01 * np.eye(body.nv)] * 2, (0.8, 0.2))
    for temperature, ratio in ((1.0, 4.0), (2.0, 2.0), (1e6, 1.0)):
        weight = Posterior.of(body, result, replace(AS_IT_IS, weight_temperature=temperature)).weight
        assert weight[0] / weight[1] == pytest.approx(ratio, rel=1e-4)


def test_the_prior_counts_the_requested_number_of_times() -> None:
    body, rng = body_of("human34"), np.random.default_rng(12)
    q, covariance = random_pose(body, rng, share=0.6), random_covariance(body.nv, rng, 0.3)
    prior = np.zeros((body.nv, body.nv))
    Stabilisers(body).accumulate(body.at(q), np.zeros(body.nv), prior)
    combined = Posterior.of(body, frame([q], [covariance]), replace(AS_IT_IS, prior_weight=3.0)).covariance[0]
    assert np.allclose(np.linalg.inv(combined), np.linalg.inv(covariance) + 2.0 * prior, rtol=1e-6, atol=1e-4)


def test_the_error_of_a_perfect_calibration_is_zero_and_that_of_certainty_a_half() -> None:
    even = (np.arange(2000) + 0.5) / 2000
    assert calibration_error(even) == pytest.approx(0.0, abs=1e-3)
    assert coverage(even, 0.9)[0] == pytest.approx(0.9, abs=1e-3)
    assert calibration_error(np.ones(10)) == pytest.approx(0.5)


def test_a_detector_that_marks_other_points_moves_the_pose_as_least_squares_does() -> None:
    """Where every landmark has its own bias, the estimated poses scatter by the posterior."""
    body, rng = body_of("human34"), np.random.default_rng(13)
    q, certain, std = random_pose(body, rng, share=0.6), 1e-14 * np.eye(body.nv), 1e-3
    stated = Posterior.of(body, frame([q], [certain]), replace(AS_IT_IS, landmark_std=std)).covariance[0]
    prior = np.zeros((body.nv, body.nv))
    Stabilisers(body).accumulate(body.at(q), np.zeros(body.nv), prior)
    spread = landmark_spread(body.landmark_names) / landmark_spread(body.landmark_names).mean()
    drawn = std * spread[:, None] * rng.normal(size=(400, len(spread), 3))
    at, J = body.landmarks(body.at(q)), body.landmark_jacobians(body.at(q))
    scaled = J / (std * spread)[:, None, None] ** 2
    hessian = np.einsum("lia,lib->ab", scaled, J) + prior
    moved = np.zeros((len(drawn), body.nv))
    for i, bias in enumerate(drawn):
        for _ in range(3):
            off = body.landmarks(body.at(body.integrate(q, moved[i]))) - at - bias
            moved[i] -= np.linalg.solve(hessian, np.einsum("lia,li->a", scaled, off) + prior @ moved[i])
    off = J @ stated @ J.transpose(0, 2, 1)
    shifts = np.array([body.landmarks(body.at(body.integrate(q, v))) - at for v in moved])
    np.testing.assert_allclose(
        np.sqrt(np.mean(np.square(shifts), axis=0).sum(axis=1)), np.sqrt(np.trace(off, axis1=1, axis2=2)), rtol=0.12
    )
    np.testing.assert_allclose(moved.std(axis=0), np.sqrt(np.diagonal(stated)), rtol=0.15)


def test_a_joint_at_its_limit_may_be_as_far_from_it_as_unsure_places_put_it() -> None:
    body = body_of("human34")
    q, knee = body.neutral.copy(), body.v_names.index("left_knee_flexion")
    q[body.q_names.index("left_knee_flexion")] = body.lower[body.q_names.index("left_knee_flexion")]
    covariance = 1e-4 * np.eye(body.nv)
    covariance[knee] = covariance[:, knee] = 0.0
    sure, unsure, vague = (
        Posterior.of(body, frame([q], [covariance]), replace(AS_IT_IS, limit_lean=0.01, landmark_std=std))
        for std in (0.0, 0.005, 0.01)
    )
    assert sure.lean[0, knee] == pytest.approx(0.01)
    assert 0.01 < unsure.lean[0, knee] < vague.lean[0, knee]
    assert vague.covariance[0, knee, knee] == 0.0
    ends = vague.marginals().quantile(0.95)[knee]
    assert ends > 2.0 * sure.marginals().quantile(0.95)[knee]


def test_landmarks_of_no_detector_that_is_known_have_no_bias() -> None:
    body = body_of("gripper")
    known = np.diag(np.full(body.nv, 0.01**2))
    posterior = Posterior.of(body, frame([body.neutral], [known]), replace(AS_IT_IS, landmark_std=0.02))
    np.testing.assert_array_equal(posterior.covariance[0], known)


def test_invalid_input_is_refused() -> None:
    with pytest.raises(InputError, match="covariance_scale is 0"):
        PosteriorCalibration(covariance_scale=0.0)
    with pytest.raises(InputError, match="scale_spread is -1"):
        PosteriorCalibration(scale_spread=-1.0)
    with pytest.raises(InputError, match="prior_weight is"):
        PosteriorCalibration(prior_weight=0.5)
    body = body_of("arm8")
    with pytest.raises(InputError, match="no hypotheses"):
        Posterior.of(body, frame([], [], ()))


def test_the_fit_of_a_calibration_undoes_a_known_wrong_scale(monkeypatch: pytest.MonkeyPatch) -> None:
    def loss(c: PosteriorCalibration, cases: Sequence[object]) -> float:
        return float(np.log(c.covariance_scale / 0.6) ** 2 + np.log(c.weight_temperature / 16.0) ** 2)

    monkeypatch.setattr(credible_levels, "miscoverage", loss)
    monkeypatch.setattr(credible_levels, "_mean_lean", lambda cases: 0.2)
    fitted = credible_levels.fitted_calibration([], 1, lambda line: None)
    assert (fitted.covariance_scale, fitted.weight_temperature) == (0.6, 16.0)


def test_a_normal_cut_off_far_out_has_its_moments() -> None:
    """On either side, where the probability between the ends is zero in double precision."""
    for low, high in ((-1.0, 2.0), (0.5, 3.0), (9.0, 12.0), (-12.0, -9.0), (30.0, 36.0)):
        mean, variance = _cut_gaussian(np.array([low]), np.array([high]))
        assert (float(mean[0]), float(variance[0])) == pytest.approx(truncnorm.stats(low, high), rel=1e-6)
