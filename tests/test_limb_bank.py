"""Limbs of examples on a pose, ranked by the visible surface."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.search.examples.limbs import LimbBank, SeenPoints
from estimator.search.jumps.anatomy import anatomy_of
from estimator.synthesis.poses import PoseSampler
from humanoid.kinematics.body import Body, directions_in_world, points_in_world
from humanoid.shape.surface import Surface, surface_of
from humanoid.subject.subject import load_subject

EYE = np.array([-4.0, 0.0, 1.2])


@pytest.fixture(scope="module")
def body() -> Body:
    return Body(load_subject("human34"))


@pytest.fixture(scope="module")
def surface(body: Body) -> Surface:
    return surface_of(body, nodes=600)


@pytest.fixture(scope="module")
def poses(body: Body) -> np.ndarray:
    rng, sampler = np.random.default_rng(3), PoseSampler(body, headings=60.0)
    return np.array([sampler.draw(rng) for _ in range(60)])


@pytest.fixture(scope="module")
def bank(body: Body, surface: Surface, poses: np.ndarray) -> LimbBank:
    return LimbBank(body, surface, anatomy_of(body).limbs, poses)


def facing(body: Body, surface: Surface, q: np.ndarray) -> np.ndarray:
    """Points (N, 3) of the nodes that face the camera."""
    posed = body.at(q)
    places = points_in_world(posed, surface.joint, surface.local)
    normals = directions_in_world(posed, surface.joint, surface.normal)
    return places[np.einsum("ni,ni->n", normals, places - EYE) < 0.0]


def seen(body: Body, surface: Surface, q: np.ndarray) -> SeenPoints:
    return SeenPoints(facing(body, surface, q), EYE[None], 0.03, 6.0)


def test_limbs_that_hardly_move_are_left_out(bank: LimbBank, body: Body) -> None:
    """The examples are standing: their legs are not tried."""
    moved = {body.v_names[dof] for limb in bank.limbs for dof in limb.dofs}
    assert len(bank.limbs) == 2
    assert not any("knee" in name or "hip" in name for name in moved)


@pytest.mark.parametrize("k", [0, 1])
def test_the_limb_that_is_seen_is_the_best(
    k: int, bank: LimbBank, body: Body, surface: Surface, poses: np.ndarray
) -> None:
    """Of sixty arms and the true one, the true one wins, wherever the arm was; the rest of the pose is unchanged."""
    nothing = poses[:0]
    for true in poses[::10]:
        wrong = bank.with_limb(true, k, poses[7:8])[0]
        (best,) = bank.best(wrong, k, nothing, seen(body, surface, true), 1)
        np.testing.assert_array_equal(best, body.clamp(true))


def test_neighbours_go_with_the_bank(bank: LimbBank, body: Body, surface: Surface) -> None:
    """An arm in the bank replaces one that is not."""
    true = PoseSampler(body, headings=60.0).draw(np.random.default_rng(99))
    (best,) = bank.best(true, 0, true[None], seen(body, surface, true), 1)
    np.testing.assert_array_equal(best, body.clamp(true))


def test_the_energy_is_that_of_the_closest_pairs_both_ways(body: Body, surface: Surface, poses: np.ndarray) -> None:
    """Differences between limbs equal a plain sum over all pairs of nodes and points; with all nodes of a limb, and
    every point that the rest of the body leaves."""
    bank = LimbBank(body, surface, anatomy_of(body).limbs[:], poses)
    bank._nodes = [np.flatnonzero([body.support(j)[limb.dofs[0]] for j in surface.joint]) for limb in bank.limbs]
    bank._thinned = [1.0] * len(bank.limbs)
    points = seen(body, surface, poses[0])._replace(std=1e-9, nu=6.0 * 0.03**2 / 1e-18)
    changed = bank.with_limb(poses[1], 0, poses)

    def plain(q: np.ndarray) -> float:
        """Mean over the limb's nodes that face the camera, among all such nodes, and mean over the points."""
        posed, limb = body.at(q), np.zeros(len(surface.joint), bool)
        limb[bank._nodes[0]] = True
        places = points_in_world(posed, surface.joint, surface.local)
        normals = directions_in_world(posed, surface.joint, surface.normal)
        front = np.einsum("ni,ni->n", normals, places - EYE) < 0.0
        squared = np.square(places[:, None] - points.points).sum(axis=2)
        scale = points.nu * points.std**2
        forth = np.log1p(squared[front & limb].min(axis=1) / scale).sum() / front.sum()
        return float(forth + np.log1p(squared[front].min(axis=0) / scale).mean())

    scores = bank._scores(poses[1], 0, bank._placed(poses[1], 0, poses[:0]), points)
    assert scores == pytest.approx([plain(q) for q in changed], abs=1e-9)


def test_limbs_that_are_tried_are_not_alike(bank: LimbBank, body: Body, surface: Surface, poses: np.ndarray) -> None:
    """An arm with sixty near copies is tried once; the others are the best remaining ones."""
    rng = np.random.default_rng(2)
    same = np.repeat(poses[3][None], 60, axis=0)
    same[:, body.bounded_q] += rng.normal(0.0, 0.005, (60, len(body.bounded_q)))
    tried = bank.best(poses[3], 0, same, seen(body, surface, poses[3]), 5)
    limb = bank.limbs[0].landmarks[1:]
    arms = np.array([body.landmarks(body.at(q))[limb] for q in tried])
    apart = np.linalg.norm(arms[:, None] - arms, axis=3).max(axis=2)
    assert len(tried) == 5
    assert apart[~np.eye(5, dtype=bool)].min() > 0.06
