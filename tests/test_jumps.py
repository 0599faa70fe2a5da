"""Kinematic jumps: the same image at another depth."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from builders import bent, body_of, camera_at, inside, observe, random_pose

from estimator.search.jumps import REACHED, KinematicJumps
from estimator.search.jumps.angles import limb_turns
from estimator.search.jumps.descent import placed
from estimator.search.jumps.jumps import JointPrior
from estimator.search.jumps.limb_solutions import PoseOnRays, limb_solutions, pose_on_rays, turned
from estimator.search.proposals import LimbProposal
from humanoid.kinematics.body import Body
from humanoid.subject.example_robots import installed
from humanoid.subject.subject import load_subject

CAMERA = camera_at(20.0, distance=3.5)
LIMBS = {
    "human34": {"hip knee ankle", "shoulder elbow wrist"},
    "arm8": {"shoulder elbow wrist"},
    "example-robot-data:human": {"hip knee ankle", "shoulder elbow wrist"},
    "example-robot-data:talos": {"hip knee ankle", "shoulder elbow wrist"},
    "example-robot-data:g1": {"hip knee ankle", "shoulder elbow wrist"},
    "example-robot-data:panda": {"joint1 joint4 joint5"},
}


def body_named(name: str) -> Body:
    if ":" not in name:
        return body_of(name)
    if name.split(":")[1] not in installed():
        pytest.skip("example-robot-data is not installed")
    return Body(load_subject(name))


def slopes(evidence: PoseOnRays, points: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """How far the outer end of each segment is behind the point of its ray nearest to the inner end [m], (2,)."""
    return np.einsum("ij,ij->i", np.diff(points[landmarks], axis=0), evidence.rays[landmarks[1:]])


@pytest.mark.parametrize("name", LIMBS)
def test_limbs_are_found_on_any_body(name: str) -> None:
    """Left and right, from landmarks and axes alone; what can move is the limb's own joints."""
    body = body_named(name)
    jumps = KinematicJumps(body)
    limbs = [" ".join(body.landmark_names[k].split("_", 1)[1] for k in limb.landmarks) for limb in jumps.limbs]
    assert set(limbs) == LIMBS[name]
    both = "left_wrist" in body.landmark_names and "right_wrist" in body.landmark_names
    assert len(limbs) == len(LIMBS[name]) * (2 if both else 1)
    assert len(jumps.pairs) == (len(LIMBS[name]) if both else 0)
    used = np.concatenate([limb.dofs for limb in jumps.limbs])
    assert len(used) == len(set(used))


@pytest.mark.parametrize("ball", [2, 3])
def test_the_closed_form_against_known_turns(ball: int) -> None:
    """Arbitrary axes: random turns, the places they lead to, and the turns found from these."""
    rng, unbound = np.random.default_rng(70), np.full(ball + 1, np.pi)
    for _ in range(100):
        axes = rng.normal(size=(ball + 1, 3))
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        points = np.cumsum(rng.normal(size=(3, 3)), axis=0)
        through, counts = points[[0] * ball + [1]], np.array([ball, ball + 1])
        w, s, targets, reached = np.empty((ball + 1, 3)), np.empty((ball + 1, 3)), np.empty((2, 3)), np.empty((2, 3))
        placed(axes, through, points[1:], counts, rng.uniform(-1.0, 1.0, ball + 1), w, s, targets)
        turns, rays = np.empty(ball + 1), np.tile([0.0, 0.0, 1.0], (2, 1))
        limb_turns(axes, through, points, counts, targets, rays, -unbound, unbound, turns)
        placed(axes, through, points[1:], counts, turns, w, s, reached)
        np.testing.assert_allclose(reached, targets, atol=1e-6)


@pytest.mark.parametrize("name", LIMBS)
def test_solutions_keep_rays_and_limits(name: str) -> None:
    """Jumps within limits keep the image and mirror the slopes; all jumps keep limits and other joints."""
    body, rng, exact = body_named(name), np.random.default_rng(71), 0
    jumps = KinematicJumps(body)
    for _ in range(12):
        q = random_pose(body, rng, share=0.6, turn=0.6)
        evidence = pose_on_rays(body, q, CAMERA)
        for limb in jumps.limbs:
            now = slopes(evidence, evidence.points, limb.landmarks)
            for solution in limb_solutions(body, evidence, limb):
                other = turned(body, q, limb.dofs, solution.turns)
                assert inside(body, other)
                others = np.setdiff1d(np.arange(body.nv), limb.dofs)
                np.testing.assert_allclose(body.difference(q, other)[others], 0.0, atol=1e-12)
                if solution.error < 1e-8:
                    points = body.landmarks(body.at(other))
                    off = (
                        CAMERA.project(points)[limb.landmarks[1:]] - CAMERA.project(evidence.points)[limb.landmarks[1:]]
                    )
                    assert np.abs(off).max() < 1e-5
                    if abs(now[0]) > 1e-3 and name in ("human34", "arm8"):  # their axes go through the root exactly
                        assert abs(slopes(evidence, points, limb.landmarks)[0]) == pytest.approx(abs(now[0]), abs=1e-6)
                    exact += solution.moved > 0.01
    assert exact > 0


def test_no_solution_is_overlooked() -> None:
    """Against brute force: dense angles of a shoulder and an elbow, descended onto the pixels by Newton steps."""
    body = body_of("arm8")
    jumps, rng = KinematicJumps(body), np.random.default_rng(72)
    limb = jumps.limbs[0]
    for _ in range(3):
        q = random_pose(body, rng, share=0.5)
        evidence = pose_on_rays(body, q, CAMERA)
        low, high = (x[limb.dofs] for x in body.tangent_bounds(q))
        known: list[np.ndarray] = []
        for x in product(*(np.linspace(a, b, 5)[1:-1] for a, b in zip(low, high, strict=True))):
            end = onto_pixels(body, evidence, limb.landmarks[1:], limb.dofs, np.array(x), low, high)
            if end is not None and all(np.linalg.norm(end - k, axis=1).max() > 0.02 for k in known):
                known.append(end)
        solutions = limb_solutions(body, evidence, limb)
        mine = [body.landmarks(body.at(turned(body, q, limb.dofs, r.turns)))[limb.landmarks[1:]] for r in solutions]
        assert len(known) > 0
        for end in known:
            assert min(np.linalg.norm(end - m, axis=1).max() for m in mine) < 0.02


def onto_pixels(
    body: Body,
    evidence: PoseOnRays,
    landmarks: np.ndarray,
    dofs: np.ndarray,
    x: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray | None:
    """Places (2, 3) [m] of a limb's joints on their rays, by clamped Gauss-Newton steps from turns x, or None."""
    for _ in range(15):
        posed = body.at(turned(body, evidence.q, dofs, x))
        points = body.landmarks(posed)[landmarks]
        off = points - evidence.eyes[landmarks]
        across = np.eye(3) - evidence.rays[landmarks][:, :, None] * evidence.rays[landmarks][:, None, :]
        miss = np.einsum("kij,kj->ki", across, off).ravel()
        if np.abs(miss).max() < 1e-7:
            return np.asarray(points)
        J = np.einsum("kij,kjd->kid", across, body.landmark_jacobians(posed)[landmarks][:, :, dofs]).reshape(6, -1)
        x = np.clip(x - np.linalg.solve(J.T @ J + 1e-9 * np.eye(len(dofs)), J.T @ miss), low, high)
    return None


def test_every_jump_is_another_pose_with_much_the_same_image() -> None:
    """All of them, and those that are drawn, each limb's among them."""
    body, rng = body_of("human34"), np.random.default_rng(6)
    q = bent(body, left_shoulder_elevation=0.9, left_elbow_flexion=0.8, right_hip_flexion=0.6, right_knee_flexion=0.9)
    before, jumps = body.landmarks(body.at(q)), KinematicJumps(body)
    jumped = list(jumps.of(q, CAMERA))
    assert len(jumped) >= 6
    drawn = [x for _ in range(40) if (x := jumps.draw(rng, q, CAMERA)) is not None]
    moved = np.any([np.abs(body.difference(q, x)) > 1e-6 for x in drawn], axis=0)
    assert all(moved[limb.dofs].any() for limb in jumps.limbs)
    outer = np.concatenate([limb.landmarks for limb in jumps.limbs])
    for other in (*jumped, *drawn):
        after = body.landmarks(body.at(other))
        assert np.linalg.norm(after - before, axis=1).max() > 0.5 * jumps.anatomy.same
        # a place within REACHED of a ray at 3.5 m is within this many pixels of it; a trunk hands on its own error
        assert np.abs(CAMERA.project(after) - CAMERA.project(before))[outer].max() < 2.0 * REACHED / 2.4 * 720.0
        assert inside(body, other)


def test_interpretations_combine_limbs_best_first() -> None:
    """For a fixed trunk each combination of the limbs' solutions appears once, those on the rays in the order of the
    joints' prior."""
    body = body_of("human34")
    q = bent(body, left_shoulder_elevation=0.9, left_elbow_flexion=0.8, right_hip_flexion=0.6, right_knee_flexion=0.9)
    jumps, evidence = KinematicJumps(body), pose_on_rays(body, q, CAMERA)
    solutions = [limb_solutions(body, evidence, limb) for limb in jumps.limbs]
    stays = [sum(r.moved <= jumps.anatomy.same for r in readings) for readings in solutions]
    poses = list(jumps.interpretations(q, CAMERA))
    assert len({x.tobytes() for x in poses}) == len(poses)
    assert inside(body, np.array(poses))
    limbs = np.concatenate([limb.dofs for limb in jumps.limbs])
    trunk = np.setdiff1d(np.arange(body.nv), limbs)
    held = [x for x in poses if np.abs(body.difference(q, x)[trunk]).max() < 1e-12]
    assert len(held) == np.prod([len(r) for r in solutions]) - np.prod(stays)
    outer = np.concatenate([limb.landmarks[1:] for limb in jumps.limbs])
    off = [CAMERA.project(body.landmarks(body.at(x))[outer]) - CAMERA.project(evidence.points[outer]) for x in held]
    energies = [JointPrior(body).energy(x, limbs) for x, o in zip(held, off, strict=True) if np.abs(o).max() < 1e-3]
    assert len(energies) >= 5
    assert np.all(np.diff(energies) > -1e-3)


def test_a_body_without_limbs_has_no_jumps() -> None:
    class Bare(KinematicJumps):
        def __init__(self) -> None:
            super().__init__(body_of("upper13"))
            self.limbs, self.parts, self.pairs = (), (), []

    bare, rng, q = Bare(), np.random.default_rng(73), body_of("upper13").neutral
    assert bare.draw(rng, q, CAMERA) is None
    assert bare.exchange(rng, q, CAMERA) is None
    assert list(bare.of(q, CAMERA)) == []


def test_depth_is_open_to_one_camera_alone() -> None:
    body = body_of("human34")
    seen = observe(body, body.neutral, (CAMERA, camera_at(110.0)))
    assert seen.only_camera is None
    seen.confidence[0] = 0.0
    assert seen.only_camera is seen.cameras[1]


def test_limbs_change_places_in_the_image() -> None:
    body, rng = body_of("human34"), np.random.default_rng(4)
    jumps = KinematicJumps(body)
    assert len(jumps.pairs) == 2
    q = bent(body, left_hip_flexion=0.5, left_knee_flexion=0.4, right_hip_flexion=-0.1, right_knee_flexion=0.3)
    pixels = CAMERA.project(body.landmarks(body.at(q)))
    changed = set()
    for _ in range(8):
        other = jumps.exchange(rng, q, CAMERA)
        if other is None:
            continue
        after = CAMERA.project(body.landmarks(body.at(other)))
        for pair, (left, right) in enumerate(jumps.pairs):
            ends = left.landmarks[1:], right.landmarks[1:]
            moved = max(np.abs(after[a] - pixels[a]).max() for a in ends)
            if moved > 1e-9:
                changed.add(pair)
                # each end is near to where the other was, which it reaches as nearly as its own lengths allow
                assert max(np.abs(after[a] - pixels[b]).max() for a, b in (ends, ends[::-1])) < 0.5 * moved
        assert np.all((other >= body.lower) & (other <= body.upper))
    assert changed == {0, 1}


def test_a_limb_is_tried_elsewhere_and_nothing_else_moves() -> None:
    body, rng = body_of("human34"), np.random.default_rng(5)
    proposal = LimbProposal(body)
    for _ in range(30):
        v = body.difference(body.neutral, proposal.sample(rng, body.neutral))
        moved = np.flatnonzero(np.abs(v) > 1e-12)
        assert np.all(moved >= 6)
        behind = [set(np.flatnonzero(body.support(int(body.tree.dof_joint[d])))) for d in moved]
        assert set.intersection(*behind) & set(moved.tolist()), "the joints moved hang on one of them"
