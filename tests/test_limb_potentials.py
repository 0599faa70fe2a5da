"""Laws of learned potentials between limbs: expectation maximisation on placements, mirror images, the file."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from builders import body_of, random_pose
from scipy.spatial.transform import Rotation

from benchmarks.support.pose_prior_clips import captured_files, trial_of
from benchmarks.training.limb_learning import unseen_by
from estimator.inference.beliefs.learning import (
    LearnSettings,
    RelativePlacements,
    learned_mixture,
    mirrored_points,
    quaternion_covariance,
    quaternion_mean,
    tangents,
)
from estimator.inference.beliefs.space import PLACEMENTS
from estimator.trackers.loose_limbed.limbs.potential_learning import (
    LimbPoses,
    backward_points,
    captured_poses,
    has_sides,
    learned_potentials,
    limb_poses,
    log_densities,
    random_poses,
)
from estimator.trackers.loose_limbed.limbs.potentials import LimbPotentials, load_potentials, shipped_potentials
from humanoid.kinematics.body import Body
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph, limb_placements
from humanoid.subject.example_robots import installed
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from tests.tiers import later

STEP = 1.0 / 30.0


@cache
def graph_of(name: str, detail: str = "paper") -> LimbGraph:
    return limb_graph(body_of(name), detail)  # type: ignore[arg-type]


@cache
def drawn(name: str, count: int = 150) -> LimbPoses:
    body = body_of(name)
    return random_poses(body, graph_of(name), count, (STEP,), np.full(body.nv, 2.0), np.random.default_rng(5))


@cache
def learned(name: str) -> LimbPotentials:
    return learned_potentials(graph_of(name), body_of(name), drawn(name), LearnSettings())


def known(rng: np.random.Generator, full: bool = True) -> RelativePlacements:
    """Three kernels far from each other, one of them turned by 180 degrees."""
    turn = Rotation.from_rotvec([[0.0, 0.0, np.pi], [0.4, -1.2, 0.3], [1.5, 0.2, 0.9]]).as_quat()
    mean = np.concatenate([0.3 * rng.normal(size=(3, 3)), turn], axis=1)
    factor = np.array([0.03] * 3 + [0.15] * 3)[:, None] * rng.normal(size=(3, 6, 6)) / np.sqrt(6.0)
    covariance = factor @ factor.transpose(0, 2, 1) + np.diag([0.02**2] * 3 + [0.1**2] * 3)
    if not full:
        covariance *= np.eye(6)
    return RelativePlacements(np.array([0.5, 0.3, 0.2]), mean, covariance)


def test_quaternion_moments_are_those_of_the_rotations() -> None:
    """Eq. 4 and 5 against the exact mean and rotation vectors, also about half a turn."""
    rng = np.random.default_rng(0)
    std = np.array([0.02, 0.05, 0.03])
    for centre in (Rotation.identity(), Rotation.from_rotvec([0.0, np.pi, 0.0]), Rotation.random(rng=rng)):
        around = centre * Rotation.from_rotvec(std * rng.normal(size=(4000, 3)))
        weight = rng.uniform(size=4000)
        q = around.as_quat() * rng.choice([-1.0, 1.0], size=(4000, 1))
        mean = quaternion_mean(q, weight)
        assert np.linalg.norm(mean) == pytest.approx(1.0, abs=1e-12)
        off = around.mean(weights=weight).inv() * Rotation.from_quat(mean)
        assert off.magnitude() < 1e-4
        covariance = quaternion_covariance(q, mean, weight)
        np.testing.assert_allclose(np.sqrt(np.diag(covariance)), std, rtol=0.05)


@pytest.mark.parametrize("full", [False, True])
def test_a_known_mixture_is_found_again(full: bool) -> None:
    rng = np.random.default_rng(1)
    truth = known(rng, full)
    points = truth.sample(rng, 4000)
    mixture, _ = learned_mixture(points, LearnSettings(full=full, starts=4), rng)
    for w, mean, covariance in zip(truth.weight, truth.mean, truth.covariance, strict=True):
        k = int(np.argmin([np.abs(tangents(m, mean[None])).max() for m in mixture.mean]))
        assert mixture.weight[k] == pytest.approx(w, abs=0.02)
        away = tangents(mixture.mean[k], mean[None])[0] / np.sqrt(np.diag(covariance))
        assert np.abs(away).max() < 0.2
        size = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
        np.testing.assert_allclose(mixture.covariance[k] / size, covariance / size, atol=0.15)


@pytest.mark.parametrize("full", [False, True])
def test_the_likelihood_never_falls(full: bool) -> None:
    """Overlapping wide kernels, where the mean of eq. 4 is not the most likely one."""
    for seed in range(2):
        rng = np.random.default_rng(seed)
        wide = known(rng)
        wide = RelativePlacements(wide.weight, wide.mean, 25.0 * wide.covariance)
        settings = LearnSettings(kernels=4, full=full, iterations=25, enough=0.0)
        mixture, likelihood = learned_mixture(wide.sample(rng, 300), settings, rng)
        assert len(likelihood) == 25
        assert np.diff(likelihood).min() > -1e-9
        assert np.isfinite(mixture.covariance).all()


def test_signs_of_quaternions_do_not_matter() -> None:
    rng = np.random.default_rng(3)
    points = known(rng).sample(rng, 800)
    other = points.copy()
    other[:, 3:] *= rng.choice([-1.0, 1.0], size=(800, 1))
    a, b = (learned_mixture(p, LearnSettings(), np.random.default_rng(0))[0] for p in (points, other))
    np.testing.assert_allclose(a.log_density(points), b.log_density(other), atol=1e-6)


def test_densities_integrate_to_one_and_are_the_engine_s() -> None:
    rng = np.random.default_rng(4)
    mixture = known(rng)
    centre = np.array([*mixture.mean[:, :3].mean(axis=0), 0.0, 0.0, 0.0, 1.0])
    points = PLACEMENTS.composed(centre[None], mixture.sample(rng, 200))[0]
    at = np.repeat(centre[None], 200, axis=0)
    back = PLACEMENTS.composed(PLACEMENTS.inverse(centre[None]), points)[0]
    np.testing.assert_allclose(mixture.potential().log_value(at, points), mixture.log_density(back), atol=1e-6)
    draws = mixture.sample(rng, 40_000)
    wide = RelativePlacements(mixture.weight, mixture.mean, 2.0 * mixture.covariance)
    ratio = np.exp(wide.log_density(draws) - mixture.log_density(draws))  # the mean of p / q over q
    assert ratio.mean() == pytest.approx(1.0, abs=4.0 * ratio.std() / 200.0)


@pytest.mark.parametrize("full", [False, True])
def test_rigid_links_keep_the_floors_and_are_undone_by_the_way_back(full: bool) -> None:
    """F_ij o F_ji is the identity for a rigid link."""
    rng = np.random.default_rng(6)
    place = np.append(rng.normal(size=3), Rotation.random(rng=rng).as_quat())
    points = np.repeat(place[None], 50, axis=0)
    settings = LearnSettings(full=full)
    there, back = (learned_mixture(p, settings, rng)[0] for p in (points, backward_points(points)))
    both = PLACEMENTS.composed(there.mean, back.mean).reshape(-1, 7)
    assert np.abs(tangents(np.eye(7)[6], both)).max() < 1e-9
    for mixture in (there, back):
        np.testing.assert_allclose(mixture.covariance, np.repeat(25e-6 * np.eye(6)[None], 3, axis=0), atol=1e-12)


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(InputError, match="2 samples for 3 kernels"):
        learned_mixture(np.eye(7)[[6, 6]], LearnSettings(), np.random.default_rng(0))


def test_the_mirrored_body_has_mirrored_placements() -> None:
    """With equal angles left and right and the trunk at rest, mirroring a pose mirrors its relative placements."""
    body, graph = body_of("human34"), graph_of("human34")
    assert has_sides(graph, body)
    q = random_pose(body, np.random.default_rng(7))
    other, names = q.copy(), list(body.q_names)
    for k, name in enumerate(names):
        if name.startswith("left_"):
            twin = names.index("right_" + name.removeprefix("left_"))
            other[k], other[twin] = q[twin], q[k]
        elif not name.startswith("right_") and k in body.bounded_q:
            q[k] = other[k] = body.neutral[k]
    here, there = (limb_poses(graph, body, pose[None], {}).spatial for pose in (q, other))
    for i, j in graph.directed:
        image = mirrored_points(here[i, j])
        twin = there[graph.mirror[i], graph.mirror[j]]
        assert np.abs(PLACEMENTS.differences(image, twin)).max() < 1e-6


def test_both_sides_learn_the_same() -> None:
    potentials, graph = learned("human34"), graph_of("human34")
    for i, j in graph.directed:
        points = drawn("human34").spatial[i, j]
        twin = potentials.spatial[graph.mirror[i], graph.mirror[j]]
        if graph.mirror[i] != i or graph.mirror[j] != j:
            want = potentials.spatial[i, j].log_density(points)
            np.testing.assert_allclose(twin.log_density(mirrored_points(points)), want, atol=1e-6)


@pytest.mark.parametrize(
    "name", later(["human34", "arm8", "upper13", "example-robot-data:g1"], "example-robot-data:g1")
)
def test_any_subject_s_potentials_explain_its_poses(name: str) -> None:
    """Better than impossible poses, and equal seeds give equal bits; poses are within limits."""
    if name.startswith("example") and "g1" not in installed():
        pytest.skip("example-robot-data is not installed")
    body = body_of(name)
    graph = limb_graph(body)
    rng, speed = np.random.default_rng(8), np.full(body.nv, 2.0)
    poses, others = (random_poses(body, graph, 80, (STEP,), speed, rng) for _ in range(2))
    settings = LearnSettings(kernels=2)
    potentials = learned_potentials(graph, body, poses, settings)
    space, time = log_densities(potentials, others)
    if name == "arm8":
        again = learned_potentials(graph, body, poses, settings)
        assert log_densities(again, others) == (space, time)
    shifted = {e: p + np.eye(7)[0] * 0.3 for e, p in others.spatial.items()}
    assert space > log_densities(potentials, LimbPoses(shifted, {}))[0] + 5.0
    # an arm is not its own mirror image; the section of a G1's shoulder is turned by 7 degrees from the other's
    assert has_sides(graph, body) == (name in ("human34", "upper13"))
    q = poses_within(body)
    assert (q >= body.lower - 1e-9).all()
    assert (q <= body.upper + 1e-9).all()


def poses_within(body: Body) -> np.ndarray:
    """Sampled poses (N, nq), captured at the call of `limb_poses`."""
    kept: list[np.ndarray] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "estimator.trackers.loose_limbed.limbs.potential_learning.limb_poses", lambda g, b, q, p: kept.append(q)
        )
        random_poses(body, graph_of("arm8"), 50, (), np.zeros(body.nv), np.random.default_rng(0))
    return kept[0]


def test_pairs_are_as_far_apart_as_the_time_step() -> None:
    """For an evenly moving body half a frame is half the motion; poor poses are excluded."""
    body, graph = body_of("human34"), graph_of("human34")
    step = 0.01 * np.random.default_rng(9).normal(size=body.nv)
    q = [body.neutral]
    for _ in range(6):
        q.append(body.integrate(q[-1], step))
    good = np.array([True] * 5 + [False] * 2)
    poses = captured_poses(graph, body, [(np.array(q), good)], STEP, (0.5 * STEP, STEP, 2.0 * STEP))
    assert poses.count == 5
    assert [len(of[0]) for of in poses.forward.values()] == [4, 4, 3]
    half, whole, two = (of[0][0] for of in poses.forward.values())
    chained = PLACEMENTS.composed(poses.forward[STEP][0][:1], poses.forward[STEP][0][1:2])[0, 0]
    np.testing.assert_allclose(chained, two, atol=1e-12)
    turn = [np.linalg.norm(PLACEMENTS.differences(np.eye(7)[6], p[None])[0, 3:]) for p in (half, whole)]
    assert turn[0] == pytest.approx(0.5 * turn[1], rel=0.05)


def test_half_a_step_is_half_the_motion_and_twice_as_certain() -> None:
    potentials = learned("arm8")
    whole, half = (potentials.steps(dt) for dt in (STEP, 0.5 * STEP))
    assert half.dt == 0.5 * STEP
    for all_of_it, part in zip(whole.forward + whole.backward, half.forward + half.backward, strict=True):
        np.testing.assert_allclose(2.0 * part.mean[:, :3], all_of_it.mean[:, :3])
        turn = Rotation.from_quat(part.mean[:, 3:])
        assert (turn * turn).approx_equal(Rotation.from_quat(all_of_it.mean[:, 3:]), atol=1e-9).all()
        np.testing.assert_allclose(4.0 * part.covariance, all_of_it.covariance)


def test_a_file_keeps_what_was_learned(tmp_path: Path) -> None:
    path, poses = tmp_path / "p.json", drawn("arm8")
    for full in (False, True):
        potentials = learned_potentials(graph_of("arm8"), body_of("arm8"), poses, LearnSettings(full=full))
        potentials.save(path, "a test")
        again = load_potentials(path)
        assert again.limbs == potentials.limbs
        before, after = log_densities(potentials, poses), log_densities(again, poses)
        assert after[0] == pytest.approx(before[0], abs=1e-3)
        assert after[1][STEP] == pytest.approx(before[1][STEP], abs=1e-3)
        assert again.of_graph(graph_of("arm8"), body_of("arm8")).spatial.keys() == potentials.spatial.keys()
        for edge, p in potentials.spatial.items():
            np.testing.assert_allclose(again.spatial[edge].mean, p.mean, atol=1e-5)
            np.testing.assert_allclose(again.spatial[edge].covariance, p.covariance, rtol=1e-5)


def test_potentials_of_another_graph_are_refused() -> None:
    shipped = shipped_potentials()
    for graph, name in ((graph_of("human34", "fine"), "human34"), (graph_of("arm8"), "arm8")):
        with pytest.raises(InputError, match=r"another graph.*limb_learning"):
            shipped.of_graph(graph, body_of(name))
    with pytest.raises(InputError, match="of 1 s: learned are"):
        shipped.steps(1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("spatial"), "spatial: is missing"),
        (lambda c: c["spatial"].pop(), "both directions"),
        (lambda c: c["spatial"][1].update(to="tail"), "'tail' is not one of the limbs"),
        (lambda c: c["spatial"][1].update(weight=[-1, 1, 1]), "not shares"),
        (lambda c: c["spatial"][1].update(t=[[0, 0]]), "3 x 3 numbers"),
        (lambda c: c["spatial"][1].update(quaternion=[[0, 0, 0, 2]] * 3), "length 1"),
        (lambda c: c["spatial"][1].update(covariance=[[0] * 6] * 3), "positive definite"),
        (lambda c: c["spatial"][1].update(covariance=[[1e-4] * 5 + [1e-300]] * 3), "positive definite"),
        (lambda c: c["temporal"].pop(), "lacks a limb"),
        (lambda c: c["temporal"][0].update(dt=-1), "not a time step"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, change, message: str) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "p.json"
    learned("arm8").save(path, "a test")
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        load_potentials(path)


def test_another_person_s_joints_are_where_they_are() -> None:
    """Potentials transferred to longer or shorter bones give the same poses the values of the first body."""
    proportions = ProportionedBody(load_subject("human34"))
    body, potentials, graph = body_of("human34"), learned("human34"), graph_of("human34")
    rng = np.random.default_rng(10)
    q = np.array([body.neutral, *(random_pose(body, rng, share=0.3) for _ in range(20))])
    before = log_densities(potentials, limb_poses(graph, body, q, {}))[0]
    for size in (0.85, 1.15):
        other = proportions.at(np.full(len(proportions.mean), size))
        own = limb_graph(other, like=graph)
        poses = limb_poses(own, other, q, {})
        carried = log_densities(potentials.of_graph(own, other), poses)[0]
        assert carried == pytest.approx(before, abs=3.0)
        assert carried > log_densities(potentials, poses)[0] + 10.0


def test_shipped_potentials_suit_the_adult_and_saw_no_test_clip() -> None:
    body, graph, potentials = body_of("human34"), graph_of("human34"), shipped_potentials()
    own = potentials.of_graph(graph, body)
    t, R = limb_placements(graph, body, body.neutral)
    assert len(own.spatial) == 18
    assert {len(p.weight) for p in own.spatial.values()} == {3}
    standing = limb_poses(graph, body, body.neutral[None], {})
    assert log_densities(own, standing)[0] > 10.0
    assert np.isfinite(t).all()
    assert np.isfinite(R).all()


def test_what_trackers_are_measured_on_is_not_learned() -> None:
    files = captured_files(None)
    if not files:
        pytest.skip("no motion capture here")
    seen = unseen_by(None, [f.stem for f in files])
    assert len(seen) == len(files) - 8
    assert not {"07_01", "02_05", "16_01", "26_01", "05_10"} & {trial_of(name) for name in seen}
    about = json.loads(
        Path(__file__).parents[1].joinpath("estimator/trackers/loose_limbed/limbs/potentials.json").read_text()
    )["about"]
    learned_of = about.split("Clips ")[1].split(". Not seen")[0].split(", ")
    assert learned_of == seen
