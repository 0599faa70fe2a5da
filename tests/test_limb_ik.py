"""Arms sampled from an image: they project to their targets, and the stated density is that of the samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.papers_dual_chain.limb_ik import cameras, p_value
from estimator.data.cameras.camera import Camera
from estimator.inference.chains.feature_density import FeatureDensity, gaussian, uniform
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.jumps.descent import placed
from estimator.trackers.dual_chain.limb_ik import Arms, ImageProposal, LimbIK
from estimator.trackers.dual_chain.limb_ik_kernels import swivel_of
from humanoid.kinematics.body import Body, PlacedBodies
from humanoid.support.errors import InputError
from tests.builders import body_of
from tests.tiers import later

LIMBS = {
    "upper13": 0,
    "human34": 1,
    "arm8": 0,
    "example-robot-data:talos": 2,  # three axes, no swivel
    "example-robot-data:g1": 2,  # axes that miss each other by 14 mm
}
BENT = np.array([-0.25, 0.08, 1e-3, -1e-3, -0.01])  # a lens


def ik_of(body: Body, number: int) -> LimbIK:
    """The chain of a limb to 30 % beyond its end landmark, as if to a hand's middle."""
    limb = anatomy_of(body).limbs[number]
    end = int(limb.landmarks[2])
    return LimbIK.of(body, limb, int(body.landmark_joint[end]), body.landmark_local[end] * 1.3)


def some_angles(ik: LimbIK, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(ik.low + ik.rest, ik.high + ik.rest, (count, len(ik.rest)))


def swivels_of(ik: LimbIK, angles: np.ndarray) -> np.ndarray:
    m = len(ik.rest)
    w, s, p = np.empty((m, 3)), np.empty((m, 3)), np.empty((2, 3))
    out = np.zeros(len(angles))
    for n, each in enumerate(angles):
        placed(ik.axes, ik.through, ik.points[1:], np.array([m - 1, m]), each - ik.rest, w, s, p)
        out[n] = swivel_of(ik.points[0], p) if ik.swivels else 0.0
    return out


@pytest.mark.parametrize("name", LIMBS)
def test_an_end_is_at_its_target_within_the_limits(name: str) -> None:
    """From the end and swivel of a pose inside the limits, that pose is among the equally likely solutions."""
    ik = ik_of(body_of(name), LIMBS[name])
    angles = some_angles(ik, 400)
    ends, before = ik.forward(angles)
    assert before.ok.mean() > 0.8
    swivels = swivels_of(ik, angles)
    nearest = np.full(len(ends), np.inf)
    for level in np.arange(0.5 / 12, 1.0, 1.0 / 12):  # twelfths cover each of one to four solutions
        again = ik.solved(ends, swivels, np.full(len(ends), level))
        there, forward_arms = ik.forward(again.angles)
        assert np.abs(there - ends)[again.ok].max() < 1e-9
        assert (again.angles >= ik.low + ik.rest - 1e-15).all()
        assert (again.angles <= ik.high + ik.rest + 1e-15).all()
        np.testing.assert_allclose(forward_arms.log_density[again.ok], again.log_density[again.ok], rtol=0.0, atol=1e-6)
        nearest = np.minimum(nearest, np.where(again.ok, np.abs(again.angles - angles).max(axis=1), np.inf))
    assert (nearest[before.ok] < 1e-6).all()


@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("camera", ["perspective", "parallel"])
@pytest.mark.parametrize("name", LIMBS)
def test_the_density_is_by_finite_differences_of_place_depth_and_swivel(name: str, camera: str, bent: bool) -> None:
    if bent and camera == "parallel":
        return  # has no lens
    body = body_of(name)
    made = proposal(body, ik_of(body, LIMBS[name]), cameras()[camera])
    if bent:
        made = replace(made, camera=replace(made.camera, distortion=BENT))
    ik, h, compared = made.ik, 1e-6, 0
    for angles in some_angles(ik, 20, seed=1):
        several = np.concatenate([[angles], angles + h * np.eye(len(angles)), angles - h * np.eye(len(angles))])
        dense = made.log_density(several[:1], trunks(body, 1))[0]
        if not np.isfinite(dense):
            continue
        ends = in_world(ik, several, body)
        pixels, (origins, ways) = made.camera.project(ends), made.camera.sight_lines(ends)
        depth = np.einsum("ni,ni->n", ends - origins, ways)
        what = np.column_stack([pixels, depth, *([swivels_of(ik, several)] if ik.swivels else [])])
        n = len(angles)
        change = what[1 : n + 1] - what[n + 1 :]
        change[:, 3:] = (change[:, 3:] + np.pi) % (2.0 * np.pi) - np.pi
        volume = abs(np.linalg.det(change / (2.0 * h)))
        share = volume * np.exp(made.seen.log_density(pixels[:1, None]))[0] / length(ik, origins[0], ways[0], body)
        some_ways = share / (2.0 * np.pi if ik.swivels else 1.0) / np.exp(dense)
        assert some_ways == pytest.approx(round(some_ways), rel=1e-4)
        assert 1 <= round(some_ways) <= 4
        compared += 1
    assert compared >= 8


def length(ik: LimbIK, origin: np.ndarray, way: np.ndarray, body: Body) -> float:
    """Length of a line inside the shell of the limb's reach [m], by fine sampling, for the neutral trunk."""
    off = origin - ik.points[0] @ parent_of(ik, body)[:, :9].reshape(3, 3) - parent_of(ik, body)[0, 9:]
    depth = np.linspace(-ik.far, ik.far, 200_001) - off @ way
    square = off @ off + 2.0 * depth * (off @ way) + depth**2
    return float(((square > ik.near**2) & (square < ik.far**2)).sum() * (depth[1] - depth[0]))


def parent_of(ik: LimbIK, body: Body) -> np.ndarray:
    return np.asarray(trunks(body, 1).placements[:, ik.parent])


def in_world(ik: LimbIK, angles: np.ndarray, body: Body) -> np.ndarray:
    M = parent_of(ik, body)[0]
    return np.asarray(ik.forward(angles)[0] @ M[:9].reshape(3, 3) + M[9:])


def trunks(body: Body, count: int) -> PlacedBodies:
    return body.placed(np.tile(body.neutral, (count, 1)))


def test_the_density_of_an_arm_in_closed_form() -> None:
    """|p| L1 L2 |sin elbow| |cos middle shoulder angle| and a parallel image's scale; p from shoulder to hand."""
    body = body_of("upper13")
    made = proposal(body, ik_of(body, 0), cameras()["parallel"])
    ik = made.ik
    angles = some_angles(ik, 300, seed=2)
    dense = made.log_density(angles, trunks(body, 300))
    ends, arms = ik.forward(angles)
    assert (np.isfinite(dense) == arms.ok).all()
    lengths = np.linalg.norm(np.diff(ik.points, axis=0), axis=1)
    reach = ends - ik.points[0]
    volume = np.linalg.norm(reach, axis=1) * lengths.prod() * np.abs(np.sin(angles[:, 3]) * np.cos(angles[:, 1]))
    seen = in_world(ik, angles, body)
    way = made.camera.R_camera_world[2] @ parent_of(ik, body)[:, :9].reshape(3, 3).T
    square = np.square(reach).sum(axis=1) - (reach @ way) ** 2
    shell = 2.0 * (np.sqrt(ik.far**2 - square) - np.sqrt(np.maximum(ik.near**2 - square, 0.0)))
    image = np.exp(made.seen.log_density(made.camera.project(seen)[:, None])) * made.camera.K[0, 0] ** 2
    ways = (volume * image / shell / (2.0 * np.pi))[arms.ok] / np.exp(dense[arms.ok])
    np.testing.assert_allclose(ways, np.round(ways), rtol=1e-6)
    assert set(np.round(ways)) <= {1.0, 2.0, 3.0, 4.0}


def proposal(body: Body, ik: LimbIK, camera: Camera) -> ImageProposal:
    """Two places, both partly within the limb's reach."""
    M = parent_of(ik, body)[0]
    root = camera.project(ik.points[0] @ M[:9].reshape(3, 3) + M[9:])
    scale = camera.K[0, 0] * ik.far / (1.0 if camera.parallel else 3.0)
    mean = root + scale * np.array([[[0.2, 0.4]], [[0.4, -0.2]]])
    covariance = np.array([0.3, 0.2])[:, None, None] ** 2 * scale**2 * np.eye(2)
    density = FeatureDensity(("end",), np.log([0.7, 0.3]), np.ones((2, 1), bool), mean, covariance)
    return ImageProposal(ik, camera, density)


@pytest.mark.parametrize(
    "name", later(["upper13", "example-robot-data:talos", "example-robot-data:g1"], "example-robot-data:g1")
)
def test_sampled_and_evaluated_densities_agree_and_integrate_to_the_accepted_share(name: str) -> None:
    """Trunks differ between samples and the lens distorts: hands are still met to 1e-9 m."""
    body, count = body_of(name), 20_000
    made = proposal(body, ik_of(body, LIMBS[name]), replace(cameras()["perspective"], distortion=BENT))
    ik, rng = made.ik, np.random.default_rng(5)
    q = np.tile(body.neutral, (count, 1))
    q[:, body.bounded_q] += 0.05 * rng.standard_normal((count, len(body.bounded_q)))
    some = body.placed(q)
    arms = made.sample(np.random.default_rng(6), some)
    assert 0.1 < arms.ok.mean() < 0.9
    np.testing.assert_allclose(made.log_density(arms.angles, some)[arms.ok], arms.log_density[arms.ok], atol=1e-6)
    assert np.isfinite(arms.angles).all()
    pixels = made.seen.sample(np.random.default_rng(6), count)[0][:, 0]
    ends = ik.forward(arms.angles)[0]
    M = some.placements[:, ik.parent]
    seen = made.camera.project(np.einsum("nki,nk->ni", M[:, :9].reshape(-1, 3, 3), ends) + M[:, 9:])
    assert np.abs(seen - pixels)[arms.ok].max() < 1e-9 * made.camera.K[0, 0] / 3.0 * 10.0
    even = some_angles(ik, count, seed=7)
    mass = np.exp(made.log_density(even, some)) * np.prod(ik.high - ik.low)
    spread = mass.std() / np.sqrt(count) + np.sqrt(arms.ok.mean() / count)
    assert abs(mass.mean() - arms.ok.mean()) < 4.0 * spread < 0.1 * arms.ok.mean()


def test_weighed_by_one_over_the_density_arms_are_uniform_and_not_without_the_volume() -> None:
    """As in the benchmark, with fewer arms."""
    body, count = body_of("upper13"), 60_000
    ik = ik_of(body, 0)
    made = proposal(body, ik, cameras()["perspective"])
    arms = made.sample(np.random.default_rng(3), trunks(body, count))
    assert p_value(made, arms, arms.log_density, body, np.random.default_rng(4)).p > 0.01
    density = ik.forward(arms.angles)[1].log_density
    without = arms.log_density - np.where(arms.ok, density, 0.0)
    assert p_value(made, arms, without, body, np.random.default_rng(4)).p < 1e-6


def test_unreachable_places_have_no_arm_and_no_nan() -> None:
    """For a place at the shoulder, none, and far away; for a camera within the arm's reach, which sees half of it."""
    body = body_of("upper13")
    ik = ik_of(body, 0)
    places = np.array([ik.points[0], [np.nan, 0.0, 0.0], [9.0, 0.0, 0.0], [np.inf, 0.0, 0.0]])
    for level in (0.0, 1.0):
        arms = ik.solved(places, np.zeros(4), np.full(4, level))
        _without_arms(arms)
    _without_arms(ik.forward(np.tile(ik.rest + ik.high + 0.1, (2, 1)))[1])
    assert not len(ik.solved(np.zeros((0, 3)), np.zeros(0), np.zeros(0)).ok)
    camera = cameras()["perspective"]
    M = parent_of(ik, body)[0]
    shoulder = ik.points[0] @ M[:9].reshape(3, 3) + M[9:]
    near = replace(camera, t_camera_world=-camera.R_camera_world @ (shoulder + np.array([0.1, 0.0, -0.1])))
    middle = np.array([[0.5 * size for size in near.image_size]])
    made = ImageProposal(ik, near, gaussian(("end",), middle, 4e5 * np.eye(2)))
    arms = made.sample(np.random.default_rng(8), trunks(body, 5000))
    assert arms.ok.any()
    np.testing.assert_allclose(
        made.log_density(arms.angles, trunks(body, 5000))[arms.ok], arms.log_density[arms.ok], atol=1e-6
    )
    far = replace(made, seen=gaussian(("end",), middle + 1e7, np.eye(2)))
    _without_arms(far.sample(np.random.default_rng(8), trunks(body, 5)))


def _without_arms(arms: Arms) -> None:
    assert not arms.ok.any()
    assert np.isfinite(arms.angles).all()
    assert (arms.log_density == -np.inf).all()


def test_an_image_without_information_on_the_end_is_refused() -> None:
    body = body_of("upper13")
    with pytest.raises(InputError, match="does not locate the end of a limb"):
        ImageProposal(ik_of(body, 0), cameras()["parallel"], uniform(("end",)))
