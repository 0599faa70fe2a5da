"""Laws of the distances between body parts, and of the potential made of them."""

from __future__ import annotations

import dataclasses

import coal
import numpy as np
import pinocchio as pin
import pytest
from builders import body_of

from estimator.energy.interpenetration import Interpenetration
from estimator.search.cost_model import parts_apart
from estimator.search.cost_terms import CostSettings
from estimator.tracking.registry import settings_for
from humanoid.collision import curvature
from humanoid.collision.floor import stiff_hands
from humanoid.collision.self_collision import Contacts, SelfCollision
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject, subject_from_text
from humanoid.support.errors import InputError

LOOSE = (("torso", "left_upper_arm"), ("pelvis", "left_thigh"))  # adjacent, so they overlap often and deeply


@pytest.fixture(scope="module")
def human() -> Body:
    return Body(load_subject("human34"))


def random_pose(body: Body, rng: np.random.Generator) -> np.ndarray:
    q = pin.neutral(body.model)
    q[body.bounded_q] = rng.uniform(body.lower[body.bounded_q], body.upper[body.bounded_q])
    q[:3], q[3:7] = rng.normal(size=3), rng.normal(size=4)
    return pin.normalize(body.model, q)


def two_solids(first: str, second: str) -> Body:
    """A solid at the world's origin, and one that slides along x, then y, then turns about z."""
    axes = (("slide_x", "prismatic", "1 0 0"), ("slide_y", "prismatic", "0 1 0"), ("turn", "revolute", "0 0 1"))
    joints, parent = "", "a"
    for name, kind, axis in axes:
        child = "b" if name == "turn" else f"{name}_link"
        joints += (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
            f'<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
            f'<link name="{child}">{second if child == "b" else ""}</link>'
        )
        parent = child
    text = f'<robot name="two"><subject base="fixed"/><link name="a">{first}</link>{joints}</robot>'
    return Body(subject_from_text(text, source="two.urdf"))


BALL = '<flesh shape="ellipsoid" radii="0.1 0.1 0.1"/>'
EGG = '<flesh shape="ellipsoid" radii="0.1 0.14 0.2"/>'
STICK = '<flesh shape="capsule" radius="0.05" length="0.4"/>'  # along z
LYING = '<flesh shape="capsule" radius="0.03" length="0.3" rpy="1.5707963267948966 0 0"/>'  # along y


@pytest.mark.parametrize(
    ("first", "second", "q", "expected"),
    [
        (STICK, LYING, (0.2, 0.05, 0.0), 0.2 - 0.08),
        (STICK, LYING, (0.03, 0.05, 0.0), 0.03 - 0.08),
        (STICK, STICK, (0.3, 0.4, 1.0), 0.5 - 0.10),
        (BALL, BALL, (0.3, 0.4, 1.0), 0.5 - 0.2),
        (BALL, BALL, (0.06, 0.08, 1.0), 0.1 - 0.2),
        (STICK, BALL, (0.06, 0.08, 1.0), 0.1 - 0.15),  # the capsule's axis just touches the ball: GJK's worst
        (EGG, BALL, (0.25, 0.0, 0.0), 0.25 - 0.2),
        (EGG, EGG, (0.0, -0.3, 0.0), 0.3 - 0.28),
        (EGG, EGG, (0.15, 0.0, 0.0), 0.15 - 0.2),
        (EGG, LYING, (0.11, 0.02, 0.0), 0.11 - 0.13),
        (EGG, LYING, (0.0, 0.33, 0.0), 0.33 - 0.15 - 0.03 - 0.14),
        (EGG, STICK, (0.13, 0.0, 0.4), 0.13 - 0.15),
    ],
)
def test_distances_known_in_closed_form(first: str, second: str, q: tuple[float, ...], expected: float) -> None:
    body = two_solids(first, second)
    self_collision = SelfCollision(body, margin=1.0, include=[("a", "b")])
    contacts = self_collision.near(body.at(np.array(q)))
    assert contacts.distance[0] == pytest.approx(expected, abs=1e-9)
    along = np.einsum("mi,mi->m", contacts.normal, contacts.point_b - contacts.point_a)
    assert along[0] == pytest.approx(expected, abs=1e-9)
    assert self_collision.penetration(body.at(np.array(q))) == pytest.approx(max(0.0, -expected), abs=1e-9)


@pytest.mark.parametrize(
    ("first", "second", "depth"),
    [(STICK, LYING, 0.08), (BALL, BALL, 0.2), (EGG, EGG, 0.2), (EGG, STICK, 0.15), (STICK, STICK, 0.1)],
)
def test_coinciding_solids(first: str, second: str, depth: float) -> None:
    """The normal is then one of many, or a guess, but of unit length, and the depth is right."""
    body = two_solids(first, second)
    contacts = SelfCollision(body, include=[("a", "b")]).near(body.at(np.zeros(3)))
    assert contacts.distance[0] == pytest.approx(-depth, abs=1e-9)
    assert all(np.isfinite(array).all() for array in contacts)
    assert np.linalg.norm(contacts.normal[0]) == pytest.approx(1.0)


def _kind(self_collision: SelfCollision, pair: int, distance: float) -> tuple[str, ...]:
    i, j = self_collision._solid_pairs[pair]
    names = sorted(type(self_collision.solids[s].geometry).__name__ for s in (i, j))
    return (*names, "overlap" if distance < 0.0 else "apart")


def test_gradient_is_the_central_difference(human: Body) -> None:
    """Relative 1e-5 along random directions, for every pair of shapes, apart and in overlap.

    The distance's second derivative jumps where the touched point passes the end of a capsule, and grows without bound
    where two axes nearly cross: hence a small step and many poses instead of a wide tolerance.
    """
    rng, step = np.random.default_rng(3), 1e-6
    self_collision = SelfCollision(human, include=LOOSE)
    seen: dict[tuple[str, ...], int] = {}
    for _ in range(120):
        q, v = random_pose(human, rng), rng.normal(size=human.nv)
        here = self_collision.near(human.at(q), 0.02)
        sides = [self_collision.near(human.at(pin.integrate(human.model, q, s * step * v)), 0.03) for s in (1, -1)]
        ahead, behind = (dict(zip(side.pair, side.distance, strict=True)) for side in sides)
        for pair, distance, gradient in zip(here.pair, here.distance, here.gradient, strict=True):
            difference = (ahead[pair] - behind[pair]) / (2.0 * step)
            scale = max(np.linalg.norm(gradient) * np.linalg.norm(v), 1e-3)
            assert abs(difference - gradient @ v) < 1e-5 * scale, (self_collision.pairs[pair], distance)
            kind = _kind(self_collision, pair, distance)
            seen[kind] = seen.get(kind, 0) + 1
    assert len(seen) == 6, seen
    assert min(seen.values()) >= 3, seen


def test_curvature_is_the_central_difference_of_the_gradient(human: Body) -> None:
    """Each contact alone, sides and ends of capsules and ellipsoids, apart and overlapping."""
    self_collision, rng, kinds, h = SelfCollision(human), np.random.default_rng(5), set(), 2e-6
    for _ in range(12):
        q, v = random_pose(human, rng), rng.normal(size=human.nv)
        contacts = self_collision.near(human.at(q))
        moved = [self_collision.near(human.at(pin.integrate(human.model, q, s * h * v))) for s in (1.0, -1.0)]
        for m, pair in enumerate(contacts.pair):
            if contacts.distance[m] < -0.06:  # so deep that the axes of two capsules may cross
                continue
            ends = [near.gradient[near.pair == pair] @ v for near in moved]
            if any(len(end) == 0 for end in ends):
                continue
            curvature, alone = np.zeros((human.nv, human.nv)), (np.arange(len(contacts.pair)) == m).astype(float)
            self_collision.add_curvature(human.at(q), contacts, alone, curvature)
            assert np.array_equal(curvature, curvature.T)
            expected = float((ends[0] - ends[1])[0]) / (2.0 * h)
            assert abs(v @ curvature @ v - expected) < 1e-4 * (1.0 + np.abs(curvature).max()) * float(v @ v)
            kinds.add(_kind(self_collision, int(pair), float(contacts.distance[m])))
    assert len(kinds) >= 4


def test_broad_phase_misses_no_pair(human: Body) -> None:
    rng = np.random.default_rng(5)
    self_collision = SelfCollision(human, include=LOOSE)
    request = coal.DistanceRequest()
    contacts = 0
    for _ in range(60):
        posed = human.at(random_pose(human, rng))
        near = self_collision.near(posed, 0.03)
        expected = set()
        placed = []
        for solid in self_collision.solids:
            T_world_joint = pin.SE3(posed.rotations[solid.joint], posed.translations[solid.joint])
            T = T_world_joint * pin.SE3(solid.rotation, solid.translation)
            placed.append(coal.Transform3s(T.rotation, T.translation))
        for k, (i, j) in enumerate(self_collision._solid_pairs):
            a, b = self_collision.solids[i].geometry, self_collision.solids[j].geometry
            distance = coal.distance(a, placed[i], b, placed[j], request, coal.DistanceResult())
            if distance < 0.03:
                expected.add(k)
                m = np.flatnonzero(near.pair == k)
                assert m.size == 1, self_collision.pairs[k]
                assert near.distance[m[0]] == pytest.approx(distance, abs=3e-6)
        assert set(near.pair.tolist()) == expected
        contacts += len(expected)
    assert contacts > 100


def _equal(ours: Contacts, other: Contacts) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(ours, other, strict=True))


def test_the_same_pose_gives_the_same_bits_whatever_came_before(human: Body) -> None:
    rng = np.random.default_rng(7)
    poses = [human.at(random_pose(human, rng)) for _ in range(40)]
    self_collision = SelfCollision(human, include=LOOSE)
    once = [self_collision.near(posed) for posed in poses]
    again = [self_collision.near(poses[i]) for i in rng.permutation(len(poses)).repeat(2)]
    order = np.random.default_rng(7)
    _ = [random_pose(human, order) for _ in range(40)]
    for i, contacts in zip(order.permutation(len(poses)).repeat(2), again, strict=True):
        assert _equal(once[i], contacts)
    assert sum(len(contacts.pair) for contacts in once) > 40


def test_a_failed_query_still_gives_an_overlap(human: Body) -> None:
    """EPA may fail: the answer is then the gap along the line of centres, refined, and always finite."""
    rng = np.random.default_rng(11)
    self_collision, failures = SelfCollision(human), 0
    self_collision.arrays.kind[:] = curvature.UNKNOWN  # so that every pair is left to coal
    for _ in range(30):
        posed = human.at(random_pose(human, rng))
        right = self_collision.near(posed, 0.0)
        if not right.pair.size:
            continue
        failures += right.pair.size
        queries = self_collision._queries
        self_collision._queries = [q and (*q[:2], lambda *_: -np.finfo(float).max, None) for q in queries]
        failed = self_collision.near(posed, 0.0)
        self_collision._queries = queries
        kept = dict(zip(failed.pair, failed.distance, strict=True))
        assert all(np.isfinite(array).all() for array in failed)
        # any direction's gap is at most the signed distance
        assert all(kept[k] <= d + 1e-6 for k, d in zip(right.pair, right.distance, strict=True))
    assert failures > 20


def test_pairs_follow_the_tree(human: Body) -> None:
    self_collision = SelfCollision(human)
    pairs = {frozenset(pair) for pair in self_collision.pairs}
    for adjacent in (("torso", "left_upper_arm"), ("torso", "pelvis"), ("pelvis", "right_thigh"), ("torso", "neck"),
                     ("left_forearm", "left_hand"), ("neck", "head")):  # fmt: skip
        assert frozenset(adjacent) not in pairs
    for apart in (("torso", "head"), ("left_thigh", "right_thigh"), ("left_upper_arm", "left_hand")):
        assert frozenset(apart) in pairs
    assert self_collision.penetration(human.at(human.neutral)) < 0.003
    changed = SelfCollision(human, exclude=[("head", "torso")], include=[("torso", "left_upper_arm")])
    assert {frozenset(p) for p in changed.pairs} == pairs - {frozenset(("torso", "head"))} | {
        frozenset(("torso", "left_upper_arm"))
    }


def test_stiff_hands_are_kept_apart_but_for_markers(human: Body) -> None:
    hands = frozenset(("left_hand", "right_hand"))
    assert hands == frozenset(stiff_hands(human))
    assert stiff_hands(body_of("example-robot-data:g1")) == ()
    kept = {apart: parts_apart(human, CostSettings(hands_apart=apart)).pairs for apart in (True, False)}
    assert hands in {frozenset(pair) for pair in kept[True]}
    assert [pair for pair in kept[True] if frozenset(pair) != hands] == list(kept[False])
    assert not settings_for("markers").cost.hands_apart
    assert settings_for("css").cost.hands_apart


def test_pairs_that_overlap_at_rest_are_left_out_and_named() -> None:
    text = load_subject("human34").urdf.replace('clearance="0.072 0.068 0.24"', 'clearance="0.122 0.118 0.315"')
    body = Body(subject_from_text(text, source="wide.urdf"))
    self_collision = SelfCollision(body)
    assert ("left_thigh", "right_thigh") in {tuple(sorted(pair)) for pair in self_collision.overlapping_at_rest}
    assert frozenset(("left_thigh", "right_thigh")) not in {frozenset(p) for p in self_collision.pairs}
    kept = SelfCollision(body, include=[("left_thigh", "right_thigh")])
    assert frozenset(("left_thigh", "right_thigh")) in {frozenset(p) for p in kept.pairs}
    assert kept.penetration(body.at(body.neutral)) > 0.03


@pytest.mark.parametrize("option", ["exclude", "include"])
@pytest.mark.parametrize("pair", [("torso", "tail"), ("torso", "left_clavicle"), ("head", "head"), "head"])
def test_wrong_pairs_name_the_choices(human: Body, option: str, pair: object) -> None:
    with pytest.raises(InputError) as caught:
        SelfCollision(human, **{option: [pair]})
    assert caught.value.place == option
    if pair != "head" and pair[0] != pair[1]:  # type: ignore[index]
        assert "left_upper_arm" in caught.value.remedy


def test_links_fixed_to_each_other_are_refused(human: Body) -> None:
    with pytest.raises(InputError, match="fixed to each other"):
        SelfCollision(human, include=[("neck", "head")])


def test_without_solids_nothing_is_near(human: Body) -> None:
    self_collision = SelfCollision(Body(dataclasses.replace(human.subject, flesh=())))
    contacts = self_collision.near(human.at(human.neutral))
    assert self_collision.pairs == ()
    assert contacts.gradient.shape == (0, human.nv)


@pytest.mark.parametrize("name", ["panda", "talos"])
def test_third_party_robots(name: str) -> None:
    try:
        body = Body(load_subject(f"example-robot-data:{name}"))
    except (InputError, OSError) as error:
        pytest.skip(f"example-robot-data:{name} does not load: {error}")
    self_collision = SelfCollision(body)
    assert self_collision.pairs
    rng, step = np.random.default_rng(0), 1e-6
    compared = 0
    for _ in range(20):
        q = pin.neutral(body.model)
        q[body.bounded_q] = rng.uniform(body.lower[body.bounded_q], body.upper[body.bounded_q])
        v = rng.normal(size=body.nv)
        here = self_collision.near(body.at(q))
        sides = [self_collision.near(body.at(pin.integrate(body.model, q, s * step * v)), 0.03) for s in (1, -1)]
        ahead, behind = (dict(zip(side.pair, side.distance, strict=True)) for side in sides)
        difference = np.array([ahead[k] - behind[k] for k in here.pair]) / (2.0 * step)
        # hulls have flat faces and edges: the odd step crosses from one to the next
        compared += np.count_nonzero(np.abs(difference - here.gradient @ v) < 1e-5 * np.linalg.norm(v))
    assert compared > 10


@pytest.mark.parametrize("power", [1.0, 1.5, 2.0])
def test_potential_gradient_and_curvature(human: Body, power: float) -> None:
    rng, step = np.random.default_rng(13), 1e-6
    term = Interpenetration(SelfCollision(human), scale=0.008, weight=2.0, power=power)

    def energy(q: np.ndarray) -> float:
        return term.accumulate(human.at(q), np.zeros(human.nv), np.zeros((human.nv, human.nv)))

    compared = 0
    for _ in range(40):
        q, v = random_pose(human, rng), rng.normal(size=human.nv)
        gradient, hessian = np.zeros(human.nv), np.zeros((human.nv, human.nv))
        if term.accumulate(human.at(q), gradient, hessian) == 0.0:
            continue
        slopes = [energy(pin.integrate(human.model, q, s * step * v)) for s in (1, -1)]
        scale = max(np.linalg.norm(gradient) * np.linalg.norm(v), 1.0)
        assert abs((slopes[0] - slopes[1]) / (2.0 * step) - gradient @ v) < 1e-5 * scale
        assert np.array_equal(hessian, hessian.T)
        assert np.linalg.eigvalsh(hessian)[0] > -1e-9 * np.abs(hessian).max()
        compared += 1
    assert compared > 10


@pytest.mark.parametrize("power", [1.0, 2.0])
def test_potential_along_one_line(power: float) -> None:
    """CSS 3.2.4 near contact; zero with its slope at the margin; falling with the distance, finite at any depth."""
    body = two_solids(BALL, BALL)
    self_collision = SelfCollision(body, include=[("a", "b")])
    term = Interpenetration(self_collision, scale=0.005, power=power)

    def energy(distance: float) -> tuple[float, float, float]:
        gradient, hessian = np.zeros(3), np.zeros((3, 3))
        value = term.accumulate(body.at(np.array([0.2 + distance, 0.0, 0.0])), gradient, hessian)
        return value, gradient[0], hessian[0, 0]

    margin = self_collision.margin
    assert energy(margin + 1e-9)[:2] == (0.0, 0.0)
    assert energy(margin - 1e-7)[0] == pytest.approx(0.0, abs=1e-8)
    assert abs(energy(margin - 1e-7)[1]) < 1e-3
    distances = np.linspace(-0.15, margin - 1e-6, 400)
    values, slopes, curvatures = np.array([energy(d) for d in distances]).T
    assert np.all(np.diff(values) < 0.0)
    assert np.all(slopes < 0.0)
    assert np.all(curvatures >= 0.0)
    # the paper's function, up to the subtracted line
    z = np.array([-0.006, -0.004, 0.002, 0.006]) / 0.005
    paper = np.exp(-z * np.abs(z) ** (power - 1.0))
    line = np.array([energy(0.005 * x)[0] for x in z]) - paper
    assert np.ptp(np.diff(line) / np.diff(z)) < 1e-9


@pytest.mark.parametrize("wrong", [{"scale": 0.0}, {"weight": -1.0}, {"power": 0.5}, {"scale": float("nan")}])
def test_potential_settings_are_checked(human: Body, wrong: dict[str, float]) -> None:
    with pytest.raises(InputError):
        Interpenetration(SelfCollision(human), **wrong)


def test_too_many_shapes_are_refused_at_once() -> None:
    """The number of pairs grows with the square of the shapes; a thousand would take minutes and gigabytes in every
    worker."""
    shape = '<collision><geometry><sphere radius="0.01"/></geometry></collision>'
    limits = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    links = "".join(f'<link name="l{k}">{shape}</link>' for k in range(500))
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0 0 0.05"/><axis xyz="0 1 0"/>{limits}</joint>'
        for k in range(499)
    )
    body = Body(subject_from_text(f'<robot name="chain">{links}{joints}</robot>', source="chain.urdf"))
    with pytest.raises(InputError, match=r"chain.urdf: collision geometry: 500 shapes make 124750 pairs"):
        SelfCollision(body)
