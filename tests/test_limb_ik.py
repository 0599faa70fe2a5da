"""Arms drawn from an image: they are seen where they were drawn for, and their density is that of what is drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from estimator.cameras.camera import Camera, guessed_camera
from estimator.inference.chains.feature_density import FeatureDensity, gaussian
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.jumps.descent import placed
from estimator.search.proposals.limb_ik import Arms, ImageProposal, LimbIK
from estimator.search.proposals.limb_ik_kernels import swivel_of
from humanoid.kinematics.body import Body, PlacedBodies
from tests.builders import body_of

SUBJECTS = ("upper13", "human34", "arm8", "example-robot-data:talos")


def ik_of(body: Body, number: int = 0) -> LimbIK:
    """Of a limb to its end landmark, or to 8 cm beyond the wrist."""
    limb = anatomy_of(body).limbs[number]
    end = int(limb.landmarks[2])
    beyond = body.landmark_local[end] * 1.3
    return LimbIK.of(body, limb, int(body.landmark_joint[end]), beyond)


def some_angles(ik: LimbIK, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(ik.low + ik.rest, ik.high + ik.rest, (count, len(ik.rest)))


def facing() -> Camera:
    """A perspective camera 3 m in front of a person who looks at it."""
    camera = guessed_camera("k", (640, 480))
    R = camera.R_camera_world @ np.diag([-1.0, -1.0, 1.0])
    return replace(camera, R_camera_world=R, t_camera_world=-R @ np.array([3.0, 0.0, 0.3]))


@pytest.mark.parametrize("name", SUBJECTS)
def test_an_end_is_where_it_was_asked_for_and_no_limit_is_left(name: str) -> None:
    """From the end and swivel of any pose inside the limits, that pose is among the ways back."""
    body = body_of(name)
    ik = ik_of(body)
    angles = some_angles(ik, 400)
    ends, before = ik.looked_at(angles)
    assert before.ok.mean() > 0.8
    swivels = swivels_of(ik, angles)
    for level in (0.0, 0.4, 0.999):
        again = ik.solved(ends, swivels, np.full(len(ends), level))
        assert (again.ok[before.ok]).mean() > 0.995
        there, _ = ik.looked_at(again.angles)
        assert np.abs(there - ends)[again.ok].max() < 1e-9
        assert (again.angles >= ik.low + ik.rest - 1e-12).all()
        assert (again.angles <= ik.high + ik.rest + 1e-12).all()


def swivels_of(ik: LimbIK, angles: np.ndarray) -> np.ndarray:
    m = len(ik.rest)
    w, s, p = np.empty((m, 3)), np.empty((m, 3)), np.empty((2, 3))
    out = np.zeros(len(angles))
    for n, each in enumerate(angles):
        placed(ik.axes, ik.through, ik.points[1:], np.array([m - 1, m]), each - ik.rest, w, s, p)
        out[n] = swivel_of(ik.points[0], p) if ik.swivels else 0.0
    return out


@pytest.mark.parametrize("name", SUBJECTS)
def test_the_volume_is_that_of_finite_differences(name: str) -> None:
    body = body_of(name)
    ik = ik_of(body)
    h = 1e-6
    for angles in some_angles(ik, 20, seed=1):
        _, arms = ik.looked_at(angles[None])
        if not arms.ok[0]:
            continue
        columns = []
        for a in range(len(angles)):
            both = np.array([angles + h * np.eye(len(angles))[a], angles - h * np.eye(len(angles))[a]])
            there, swivel = ik.looked_at(both)[0], swivels_of(ik, both)
            turned = (swivel[0] - swivel[1] + np.pi) % (2.0 * np.pi) - np.pi
            columns.append(np.append(there[0] - there[1], turned if ik.swivels else []) / (2.0 * h))
        ways = np.exp(arms.log_density[0]) / abs(np.linalg.det(np.array(columns)))
        assert 1.0 / ways == pytest.approx(round(1.0 / ways), rel=1e-5)  # one of so many ways


def test_the_volume_of_an_arm_in_closed_form() -> None:
    """|p| L1 L2 |sin elbow| |cos middle shoulder angle|, p from shoulder to hand, L2 to the hand."""
    body = body_of("upper13")
    ik = ik_of(body)
    angles = some_angles(ik, 300, seed=2)
    ends, arms = ik.looked_at(angles)
    hand = ik.points[2] - ik.points[1]
    lengths = np.linalg.norm(ik.points[1] - ik.points[0]) * np.linalg.norm(hand)
    size = np.linalg.norm(ends - ik.points[0], axis=1)
    volume = size * lengths * np.abs(np.sin(angles[:, 3]) * np.cos(angles[:, 1]))
    ways = volume[arms.ok] / np.exp(arms.log_density[arms.ok])
    np.testing.assert_allclose(ways, np.round(ways), rtol=1e-6)
    assert set(np.round(ways)) <= {1.0, 2.0, 3.0, 4.0}


def proposal(body: Body, ik: LimbIK, camera: Camera) -> ImageProposal:
    """Two places, of which the arm can reach both in part."""
    q = body.neutral.copy()
    q[ik.entries] = ik.rest
    root = camera.project(body.landmarks(body.at(q))[list(body.landmark_names).index("left_shoulder")])
    first = gaussian(("hand",), root[None] + [[20.0, 40.0]], 900.0 * np.eye(2))
    mean = np.stack([first.mean[0], first.mean[0] + [30.0, -60.0]])
    covariance = np.stack([first.covariance[0], 400.0 * np.eye(2)])
    return ImageProposal(
        ik, camera, FeatureDensity(("hand",), np.log([0.7, 0.3]), np.ones((2, 1), bool), mean, covariance)
    )


def drawn(count: int, seed: int = 0) -> tuple[ImageProposal, PlacedBodies, Arms]:
    body = body_of("upper13")
    ik = ik_of(body)
    made = proposal(body, ik, facing())
    trunks = body.placed(np.tile(body.neutral, (count, 1)))
    return made, trunks, made.drawn(np.random.default_rng(seed), trunks)


def test_both_ways_to_the_density_agree() -> None:
    made, trunks, arms = drawn(2000)
    assert arms.ok.mean() > 0.2
    again = made.log_density(arms.angles, trunks)
    np.testing.assert_allclose(again[arms.ok], arms.log_density[arms.ok], rtol=1e-7, atol=1e-7)


def test_weighed_by_one_over_the_density_arms_are_uniform_where_the_image_allows() -> None:
    """Inside of a box of angles and of the image every pose is as likely: beside an even draw, by chi-square.

    Without the volume in the density the same test fails.
    """
    made, _, arms = drawn(300_000, seed=3)
    ik, rng = made.ik, np.random.default_rng(4)
    box = np.array([[0.2, -0.5, -0.8, 0.4], [1.6, 1.0, 0.8, 1.8]])

    def inside(angles: np.ndarray, count: int) -> np.ndarray:
        body = body_of("upper13")
        trunks = body.placed(np.tile(body.neutral, (count, 1)))
        dense = made.log_density(angles, trunks)
        return np.asarray((angles > box[0]).all(axis=1) & (angles < box[1]).all(axis=1) & (dense > -4.0))

    good = arms.ok & inside(arms.angles, len(arms.angles))
    even = rng.uniform(box[0], box[1], (150_000, 4))
    even = even[inside(even, len(even))]

    def p_value(log_density: np.ndarray) -> float:
        log_weight = -log_density - (-log_density).max()
        kept = arms.angles[good][rng.random(good.sum()) < np.exp(log_weight)]
        middle = 0.5 * (box[0] + box[1])
        codes = [(a > middle) @ np.array([1, 2, 4, 8]) for a in (kept, even)]
        counts = [np.bincount(c, minlength=16).astype(float) for c in codes]
        some = counts[1] > 100
        expected = counts[1][some] / counts[1][some].sum() * counts[0][some].sum()
        # the even draw has noise of its own, which makes the statistic larger by this factor
        factor = 1.0 + counts[0][some].sum() / counts[1][some].sum()
        statistic = ((counts[0][some] - expected) ** 2 / expected).sum() / factor
        return float(chi2.sf(statistic, some.sum() - 1))

    assert p_value(arms.log_density[good]) > 0.01
    _, looked = ik.looked_at(arms.angles[good])
    assert p_value(arms.log_density[good] - looked.log_density) < 1e-4
