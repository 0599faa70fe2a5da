"""Laws of assembly: beliefs of single limbs become poses within limits and without overlaps; typical mistakes are
tried."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from builders import body_of, camera_at, observe, random_pose

from estimator.data.observation import Observation
from estimator.inference.beliefs.graph import UNEXPLAINED, Belief
from estimator.inference.beliefs.space import PLACEMENTS, Space, placements_of, points_of
from estimator.inference.mixture import Mixture
from estimator.inference.origin import Family
from estimator.search.cost_model import CostModel
from estimator.search.mode_search import ModeSearch
from estimator.trackers.loose_limbed.assembly import AssemblySettings, assembled
from estimator.trackers.loose_limbed.limb_choices import Mistakes, choices, instead, limb_places, outermost
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph, limb_placements
from humanoid.subject.example_robots import installed
from humanoid.support.errors import InputError

CAMERAS = tuple(camera_at(azimuth) for azimuth in (20.0, 110.0))
MISTAKES = Mistakes(3.0, 0.1, 0.12)


@cache
def search_of(name: str) -> ModeSearch:
    body = body_of(name)
    return ModeSearch(CostModel(body, self_collision=SelfCollision(body)))


@cache
def graph_of(name: str) -> LimbGraph:
    return limb_graph(body_of(name))


def unseen(body: Body) -> Observation:
    """Cameras without keypoints."""
    shape = len(CAMERAS), len(body.landmark_names)
    return Observation(0, 0.0, CAMERAS, np.full((*shape, 2), np.nan), np.zeros(shape))


def about(rng: np.random.Generator, points: np.ndarray, metres: float, radians: float, count: int = 60) -> list[Belief]:
    """Beliefs of normal deviates about points (L, 7)."""
    std = np.repeat([metres, radians], 3)
    spread = std * rng.normal(size=(len(points), count, 6))
    weights = np.full(count, 1.0 / count)
    return [Belief(PLACEMENTS, PLACEMENTS.moved(p[None], e), weights) for p, e in zip(points, spread, strict=True)]


def points_at(name: str, q: np.ndarray) -> np.ndarray:
    return points_of(*limb_placements(graph_of(name), body_of(name), q))


def put_together(name: str, beliefs: Sequence[Belief], **more: object) -> Mixture:
    return assembled(search_of(name), graph_of(name), beliefs, unseen(body_of(name)), **more)  # type: ignore[arg-type]


def ends_of(name: str, points: np.ndarray) -> np.ndarray:
    """Both ends (2 L, 3) of limbs at points (L, 7)."""
    (t, R), length = placements_of(points), np.array([[limb.length] for limb in graph_of(name).limbs])
    return np.concatenate([t, t + length * R[:, :, 2]])


def distances(name: str, points: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Of limbs' ends, at points (L, 7) and in a pose (nq,), [m]."""
    return np.linalg.norm(ends_of(name, points) - ends_of(name, points_at(name, q)), axis=1)


def away(name: str, a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance [m] of limbs' ends."""
    return float(distances(name, points_at(name, a), b).max())


class NearTruth:
    """A likelihood that knows where the limbs of a pose are, but not on which side."""

    def __init__(self, name: str, q: np.ndarray) -> None:
        self.points, self.mirror = points_at(name, q), graph_of(name).mirror

    def log_ratio(self, limb: int, t: np.ndarray, R: np.ndarray) -> np.ndarray:
        points = points_of(t, R)
        both = [self._near(points, k) for k in (limb, self.mirror[limb])]
        return np.maximum(both[0], both[1] - 4.0)

    def _near(self, points: np.ndarray, limb: int) -> np.ndarray:
        """Limbs of the other side look nearly alike."""
        off = PLACEMENTS.differences(self.points[limb], points) / [0.04, 0.04, 0.04, 0.2, 0.2, 2.0]
        far = np.sum(np.square(off), axis=1)
        return np.where(far > 400.0, -np.inf, 20.0 - 0.5 * far)


def quiet_pose(name: str, rng: np.random.Generator) -> np.ndarray:
    """A random pose without overlaps."""
    body, collision = body_of(name), search_of(name).self_collision
    while True:
        q = random_pose(body, rng, share=0.6)
        if collision is None or collision.penetration(body.at(q)) == 0.0:
            return q


def within_limits(body: Body, mixture: Mixture) -> bool:
    q = np.array([m.q for m in mixture.modes])
    return bool(np.all(body.lower <= q) and np.all(q <= body.upper))


@pytest.mark.parametrize("name", ["human34", "arm8", "upper13"])
def test_exact_beliefs_are_put_together_from_nothing(name: str) -> None:
    """Floors far below the priors: the beliefs decide."""
    rng, sharp = np.random.default_rng(3), AssemblySettings(place_floor=1e-4, turn_floor=1e-3)
    for _ in range(2):
        q = quiet_pose(name, rng)
        mixture = put_together(name, about(rng, points_at(name, q), 1e-5, 1e-5), settings=sharp)
        assert away(name, mixture.modes[0].q, q) < 0.003
        assert mixture.modes[0].status == "converged"
        assert mixture.modes[0].origin is not None
        assert mixture.modes[0].origin.family is Family.LIMBS


@pytest.mark.paper
def test_g1_is_put_together() -> None:
    if "g1" not in installed():
        pytest.skip("robot descriptions are not installed")
    body = body_of("example-robot-data:g1")
    graph, search = limb_graph(body), ModeSearch(CostModel(body))
    rng = np.random.default_rng(1)
    q = random_pose(body, rng, share=0.4)
    beliefs = about(rng, points_of(*limb_placements(graph, body, q)), 1e-4, 1e-4)
    best = assembled(search, graph, beliefs, unseen(body), settings=AssemblySettings(1e-3, 1e-2)).modes[0]
    ends = limb_placements(graph, body, best.q)[0] - limb_placements(graph, body, q)[0]
    assert np.linalg.norm(ends, axis=1).max() < 0.01


def exchanged(graph: LimbGraph, points: np.ndarray) -> np.ndarray:
    return points[list(graph.mirror)]


def test_exchanged_sides_are_corrected_by_the_joints() -> None:
    rng, name = np.random.default_rng(5), "human34"
    for _ in range(3):
        q = quiet_pose(name, rng)
        beliefs = about(rng, points_at(name, q)[list(graph_of(name).mirror)], 0.01, 0.05)
        best = put_together(name, beliefs).modes[0]
        assert away(name, best.q, q) < 0.1
        assert best.origin is not None
        assert best.origin.penalty == AssemblySettings().exchange


def test_a_person_believed_to_face_the_other_way_is_turned_by_the_pictures() -> None:
    """The true heading is among the hypotheses, and a likelihood that hardly distinguishes the sides selects it."""
    name, rng = "human34", np.random.default_rng(6)
    body, q = body_of(name), body_of(name).neutral
    back = body.integrate(q, np.eye(body.nv)[5] * np.pi)
    beliefs = about(rng, points_at(name, back), 0.01, 0.05)

    def faces_truly(pose: np.ndarray) -> bool:
        """The root's heading, and the limbs but for arms, which are bent to the front."""
        at, true = body.at(pose), body.at(q)
        heading = at.rotations[1][:, 0] @ true.rotations[1][:, 0]
        return bool(heading > 0.9 and np.median(distances(name, points_at(name, pose), q)) < 0.12)

    believed = put_together(name, beliefs)
    assert away(name, believed.modes[0].q, back) < 0.05
    assert [m for m in believed.modes[1:] if faces_truly(m.q)]
    assert not faces_truly(back)
    assert faces_truly(put_together(name, beliefs, likelihood=NearTruth(name, q)).modes[0].q)


def test_a_trunk_believed_back_to_front_is_turned_by_the_joints() -> None:
    name, rng = "human34", np.random.default_rng(6)
    graph, q = graph_of(name), body_of(name).neutral
    middle = [i for i, m in enumerate(graph.mirror) if i == m]
    points = points_at(name, q)
    points[middle] = PLACEMENTS.moved(points[middle], np.pi * np.eye(6)[5])
    assert away(name, put_together(name, about(rng, points, 0.01, 0.05)).modes[0].q, q) < 0.05


def legs(name: str) -> tuple[list[int], list[int]]:
    """The limbs of both legs: those that come below the root's place, paired."""
    graph, body = graph_of(name), body_of(name)
    low = limb_placements(graph, body, body.neutral)[0][:, 2] < 0.02
    pairs = [(i, m) for i, m in enumerate(graph.mirror) if i < m and low[i]]
    return [i for i, _ in pairs], [m for _, m in pairs]


def test_two_legs_in_one_image_are_parted() -> None:
    """Both believed to be where one is, with a share of the second's belief at its own place: the pictures decide.
    Without the pictures or the share they stay in one place, but do not intersect."""
    rng, name = np.random.default_rng(7), "human34"
    left, right = legs(name)
    assert len(left) == 2
    body = body_of(name)
    for _ in range(3):
        q = body.neutral.copy()
        q[7:] += rng.normal(0.0, 0.15, body.nq - 7)
        step = 0.5 * (1.0 + rng.random())
        for joint, bend in (("left_hip", step), ("right_hip", -0.2)):
            q[[k for k, n in enumerate(body.q_names) if n.startswith(joint) and "flexion" in n]] = bend
        q = body.clamp(q)
        points = points_at(name, q)
        beliefs = about(rng, points, 0.015, 0.1)
        both = list(beliefs)
        for i, m in zip(left, right, strict=True):
            wrong, count = about(rng, points[[m]], 0.015, 0.1)[0], len(beliefs[i].points)
            some = count // 12  # too few for a place to be tried for its own sake
            both[i] = replace(beliefs[i], points=np.concatenate([beliefs[i].points[:some], wrong.points[some:]]))
        mixture = put_together(name, both, likelihood=NearTruth(name, q))
        assert away(name, mixture.modes[0].q, q) < 0.15
        for i, m in zip(left, right, strict=True):
            both[i] = beliefs[m]
        mixture = put_together(name, both)
        assert max(m.penetration for m in mixture.modes) <= 0.01


def test_beliefs_beyond_limits_and_through_each_other() -> None:
    """Arbitrary beliefs: poses stay within limits to the last bit, and parts do not overlap."""
    rng, name = np.random.default_rng(8), "human34"
    body, graph = body_of(name), graph_of(name)
    for _ in range(4):
        points = points_at(name, random_pose(body, rng))
        wild = np.concatenate([0.1 * rng.normal(size=(len(points), 3)), rng.normal(size=(len(points), 3))], axis=1)
        mixture = put_together(name, about(rng, PLACEMENTS.moved(points, wild), 0.02, 0.2))
        assert within_limits(body, mixture)
        assert max(m.penetration for m in mixture.modes) <= 0.01
    left, right = legs(name)
    arms = [i for i, m in enumerate(graph.mirror) if i != m and i not in [*left, *right]]
    points = points_at(name, body.neutral)
    points[arms, :3] = points[0, :3] + 0.1 * rng.normal(size=(len(arms), 3))  # in the trunk
    mixture = put_together(name, about(rng, points, 0.005, 0.05))
    assert max(m.penetration for m in mixture.modes) <= 0.01


def test_noise_of_single_limbs_is_lowered() -> None:
    """Limbs independently 30 mm and 0.2 rad off: the joints determine more than any single limb."""
    rng, name = np.random.default_rng(9), "human34"
    std, raw, put = np.repeat([0.03, 0.2], 3), [], []
    for _ in range(5):
        q = quiet_pose(name, rng)
        points = points_at(name, q)
        off = PLACEMENTS.moved(points, std * rng.normal(size=(len(points), 6)))
        best = put_together(name, about(rng, off, 0.03, 0.2)).modes[0]
        raw.append(distances(name, off, q).mean())
        put.append(distances(name, points_at(name, best.q), q).mean())
    assert np.mean(put) < 0.75 * np.mean(raw)


def test_the_likelihood_near_modes_moves_them_and_a_flat_one_does_not() -> None:
    rng, name = np.random.default_rng(10), "human34"
    q = quiet_pose(name, rng)
    off = PLACEMENTS.moved(points_at(name, q), np.repeat([0.03, 0.1], 3) * rng.normal(size=(10, 6)))
    beliefs = about(rng, off, 0.03, 0.2)
    still = put_together(name, beliefs)

    class Sharp(NearTruth):
        def log_ratio(self, limb: int, t: np.ndarray, R: np.ndarray) -> np.ndarray:
            return 4.0 * super().log_ratio(limb, t, R)

    seen = put_together(name, beliefs, likelihood=Sharp(name, q), rng=np.random.default_rng(1))
    before, after = (distances(name, points_at(name, m.modes[0].q), q).mean() for m in (still, seen))
    assert after < 0.7 * before

    class Flat:
        def log_ratio(self, limb: int, t: np.ndarray, R: np.ndarray) -> np.ndarray:
            return np.full(len(t), 3.0)

    flat = put_together(name, beliefs, likelihood=Flat(), rng=np.random.default_rng(1))
    assert away(name, flat.modes[0].q, still.modes[0].q) < 1e-6
    assert flat.modes[0].covariance == pytest.approx(still.modes[0].covariance, abs=1e-6)

    class Nowhere(Flat):
        def log_ratio(self, limb: int, t: np.ndarray, R: np.ndarray) -> np.ndarray:
            return np.full(len(t), -np.inf)

    nowhere = put_together(name, beliefs, likelihood=Nowhere(), rng=np.random.default_rng(1))
    assert away(name, nowhere.modes[0].q, still.modes[0].q) < 1e-6
    assert np.isfinite(nowhere.log_scores).all()


def test_limbs_without_information() -> None:
    """A limb without points, without weights or without an explanation leaves it to the others; without any the body is
    at rest."""
    rng, name = np.random.default_rng(11), "human34"
    graph, body = graph_of(name), body_of(name)
    q = quiet_pose(name, rng)
    beliefs = about(rng, points_at(name, q), 0.005, 0.05)
    left, right = legs(name)
    arms = [i for i, m in enumerate(graph.mirror) if i != m and i not in [*left, *right]]
    beliefs[arms[0]] = Belief(PLACEMENTS, np.zeros((0, 7)), np.zeros(0))
    beliefs[arms[1]] = replace(beliefs[arms[1]], weights=np.zeros(60))
    elsewhere = random_pose(body, rng)
    elsewhere[0] += 3.0
    far = about(rng, points_at(name, elsewhere), 0.005, 0.05)
    beliefs[arms[2]] = replace(far[arms[2]], status=UNEXPLAINED)
    best = put_together(name, beliefs).modes[0]
    known = [i for i in range(len(graph.limbs)) if i not in arms[:3]]
    apart = limb_placements(graph, body, best.q)[0] - limb_placements(graph, body, q)[0]
    assert np.linalg.norm(apart[known], axis=1).max() < 0.1
    doubted = [replace(b, status=UNEXPLAINED) for b in beliefs]
    wide, narrow = (np.trace(put_together(name, b).modes[0].covariance[:3, :3]) for b in (doubted, beliefs))
    assert wide > 2.0 * narrow
    none = [Belief(PLACEMENTS, np.zeros((0, 7)), np.zeros(0))] * len(graph.limbs)
    at_rest = put_together(name, none)
    assert np.isfinite(at_rest.modes[0].q).all()
    assert away(name, at_rest.modes[0].q, body.neutral) < 0.3


def test_wrong_beliefs_are_reported() -> None:
    beliefs = about(np.random.default_rng(0), points_at("arm8", body_of("arm8").neutral), 0.01, 0.1)
    with pytest.raises(InputError, match="one for each of the"):
        put_together("arm8", beliefs[:-1])
    flat = Belief(Space(3, False), np.zeros((2, 3)), np.full(2, 0.5))
    with pytest.raises(InputError, match="beliefs of placements"):
        put_together("arm8", [flat, *beliefs[1:]])


def test_the_frame_before_is_continued_or_left() -> None:
    rng, name = np.random.default_rng(12), "human34"
    body, q = body_of(name), quiet_pose(name, rng)
    first = put_together(name, about(rng, points_at(name, q), 0.005, 0.05))
    moved = body.integrate(q, 0.5 / 30.0 * rng.normal(size=body.nv))
    beliefs = about(rng, points_at(name, moved), 0.005, 0.05)
    after = put_together(name, beliefs, before=first, elapsed=1.0 / 30.0)
    best = after.modes[0]
    assert best.parent == 0
    assert best.velocity == pytest.approx(body.velocity(first.modes[0].q, best.q, 1.0 / 30.0))
    assert best.origin is not None
    assert best.origin.transition_from is not None
    q_far = quiet_pose(name, rng)
    q_far[:3] += [2.0, 0.0, 0.0]
    leapt = put_together(name, about(rng, points_at(name, q_far), 0.005, 0.05), before=first, elapsed=1.0 / 30.0)
    assert leapt.modes[0].parent == -1
    assert away(name, leapt.modes[0].q, q_far) < 0.15


def test_keypoints_choose_their_association() -> None:
    rng, name = np.random.default_rng(13), "human34"
    body, search = body_of(name), search_of(name)
    q = quiet_pose(name, rng)
    beliefs = about(rng, points_at(name, q), 0.03, 0.1)
    seen = observe(body, q, CAMERAS, noise=2.0, rng=rng)
    best = assembled(search, graph_of(name), beliefs, seen).modes[0]
    assert best.association == "as_detected"
    assert away(name, best.q, q) < 0.6 * away(name, put_together(name, beliefs).modes[0].q, q)
    assert assembled(search, graph_of(name), beliefs, seen.exchanged(search.mirror)).modes[0].association == "exchanged"


def test_one_cameras_keypoints_count_against_sharp_wrong_beliefs() -> None:
    rng, name = np.random.default_rng(19), "human34"
    body, off = body_of(name), np.repeat([0.05, 0.3], 3)
    errors = np.zeros((4, 2))
    for row in errors:
        q = quiet_pose(name, rng)
        seen = observe(body, q, CAMERAS[:1], noise=1.0, rng=rng)
        wrong = points_at(name, q)
        wrong = PLACEMENTS.moved(wrong, off * rng.standard_normal((len(wrong), 6)))
        beliefs = about(rng, wrong, 0.005, 0.02)
        for k, settings in enumerate((AssemblySettings(), AssemblySettings(alone_place=0.01, alone_turn=0.1))):
            best = assembled(search_of(name), graph_of(name), beliefs, seen, settings=settings).modes[0]
            row[k] = away(name, best.q, q)
    assert errors[:, 0].mean() < 0.9 * errors[:, 1].mean(), errors


def test_equal_seeds_equal_bits() -> None:
    rng, name = np.random.default_rng(14), "human34"
    q = quiet_pose(name, rng)
    beliefs = about(rng, points_at(name, q), 0.03, 0.2)
    body = body_of(name)
    search = ModeSearch(CostModel(body, self_collision=SelfCollision(body)))

    def once() -> Mixture:
        return assembled(
            search, graph_of(name), beliefs, unseen(body), NearTruth(name, q), rng=np.random.default_rng(2)
        )

    first, again = once(), once()
    assert np.array_equal(first.weights, again.weights)
    assert np.array_equal([m.q for m in first.modes], [m.q for m in again.modes])
    assert np.array_equal([m.covariance for m in first.modes], [m.covariance for m in again.modes])


def test_each_choice_is_one_mistake() -> None:
    """On exact beliefs of ten limbs: four exchanges from a limb outwards, one of all, two with the back in front."""
    name = "human34"
    graph = graph_of(name)
    beliefs = about(np.random.default_rng(0), points_at(name, body_of(name).neutral), 1e-3, 1e-3)
    made = choices(graph, limb_places(graph, beliefs, 0.25, 3), MISTAKES)
    pairs = sum(i < m for i, m in enumerate(graph.mirror))
    assert made[0].cost == 0.0
    assert len(made) == 1 + 1 + pairs + 2
    assert sorted(c.cost for c in made[1:]) == pytest.approx([3.0] * (2 + pairs) + [6.0])
    arm = graph_of("arm8")
    beliefs = about(np.random.default_rng(0), points_at("arm8", body_of("arm8").neutral), 1e-3, 1e-3)
    assert all(np.isfinite(c.cost) for c in choices(arm, limb_places(arm, beliefs, 0.25, 3), MISTAKES))


def test_an_outermost_limb_elsewhere_leaves_those_it_hangs_on_free() -> None:
    name = "human34"
    graph = graph_of(name)
    places = limb_places(
        graph, about(np.random.default_rng(0), points_at(name, body_of(name).neutral), 1e-3, 1e-3), 0.25, 3
    )
    base, k = choices(graph, places, MISTAKES)[0], graph.names.index("right_forearm")
    assert sorted(graph.names[i] for i in outermost(graph)) == [
        "left_forearm", "left_shank", "right_forearm", "right_shank"
    ]  # fmt: skip
    elsewhere = places.of[graph.names.index("left_forearm")][0]
    (made,) = instead(graph, base, {k: [elsewhere]}, 3.0)
    assert made.cost == base.cost + 3.0
    assert made.places[k] is elsewhere
    assert [graph.names[i] for i, p in enumerate(made.places) if p is None] == ["right_upper_arm"]
