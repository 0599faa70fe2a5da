"""The compiled contacts of body parts equal coal's to the last digits where certain; the others are left to coal."""

from __future__ import annotations

import numpy as np
import pytest
from test_self_collision import LOOSE, human, random_pose, two_solids

from humanoid.collision import curvature
from humanoid.collision.compiled_contacts import find_contacts
from humanoid.collision.self_collision import Contacts, SelfCollision
from humanoid.kinematics.body import Body, PosedBody

__all__ = ["human"]  # the fixture

SHAPES = {
    "ball": 'shape="ellipsoid" radii="0.1 0.1 0.1"',
    "egg": 'shape="ellipsoid" radii="0.1 0.14 0.2"',
    "palm": 'shape="ellipsoid" radii="0.085 0.02 0.042"',
    "disc": 'shape="ellipsoid" radii="0.15 0.02 0.15"',
    "plate": 'shape="ellipsoid" radii="0.3 0.005 0.2"',
    "stick": 'shape="capsule" radius="0.05" length="0.4"',
    "finger": 'shape="capsule" radius="0.008" length="0.06"',
}


def asks_coal_alone(self_collision: SelfCollision) -> SelfCollision:
    """The same object with solids unknown to the kernel: coal's answers, refined."""
    self_collision.arrays.kind[:] = curvature.UNKNOWN
    return self_collision


def found(self_collision: SelfCollision, posed: PosedBody, margin: float, garbage: float = 0.0) -> tuple[object, ...]:
    """What the kernel writes: pairs left, pairs, distances, witness points and normals, into arrays of garbage."""
    arrays = self_collision.arrays
    solids, pairs = len(arrays.joint), len(arrays.pairs)
    room = [np.full(shape, garbage) for shape in ((solids, 12), (solids, 6), pairs, (pairs, 3), (pairs, 3), (pairs, 3))]
    indices = [np.full(pairs, 7, dtype=np.int64) for _ in range(3)]
    count, remaining = find_contacts(
        posed.placements, *arrays[:-1], margin, *room[:2], *indices[:2], *room[2:], indices[2]
    )
    return indices[2][:remaining], indices[1][:count], *(array[:count] for array in room[2:])


def flesh(name: str, rng: np.random.Generator) -> str:
    rpy = " ".join(str(angle) for angle in rng.uniform(-3.0, 3.0, size=3))
    return f'<flesh {SHAPES[name]} rpy="{rpy}"/>'


def compare(ours: Contacts, coals: Contacts, margin: float) -> int:
    """Equal to 1e-9 m, but for pairs on the margin: whether coal includes them is decided before refinement."""
    mine, other = (dict(zip(c.pair.tolist(), range(len(c.pair)), strict=True)) for c in (ours, coals))
    for pair in mine.keys() ^ other.keys():
        distance = ours.distance[mine[pair]] if pair in mine else coals.distance[other[pair]]
        assert abs(distance - margin) < 1e-5
    common = [k for k in mine if k in other]
    for a, b in zip(ours[1:], coals[1:], strict=True):
        np.testing.assert_allclose(a[[mine[k] for k in common]], b[[other[k] for k in common]], rtol=0.0, atol=1e-9)
    return len(common)


def test_contacts_of_a_person_are_coals(human: Body) -> None:
    rng, coal = np.random.default_rng(21), asks_coal_alone(SelfCollision(human, include=LOOSE))
    self_collision, compared, left = SelfCollision(human, include=LOOSE), 0, 0
    for _ in range(250):
        posed = human.at(random_pose(human, rng))
        ours = self_collision.near(posed)
        compared += compare(ours, coal.near(posed), self_collision.margin)
        assert np.all(np.diff(ours.pair) > 0)
        left += len(found(self_collision, posed, self_collision.margin)[0])
    assert compared > 500
    assert 0 < left < 0.3 * compared


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("stick", "finger"), ("stick", "egg"), ("palm", "stick"), ("finger", "disc"), ("egg", "palm"), ("disc", "palm"),
        ("ball", "egg"), ("ball", "ball"), ("plate", "stick"),
    ],
)  # fmt: skip
def test_pairs_of_shapes_are_coals(first: str, second: str) -> None:
    """Turned at random, near, touching and in shallow overlap."""
    rng, sides = np.random.default_rng([len(first), ord(second[0])]), []
    for _ in range(6):
        body = two_solids(flesh(first, rng), flesh(second, rng))
        self_collision, coal = (SelfCollision(body, include=[("a", "b")]) for _ in range(2))
        asks_coal_alone(coal)
        for q in rng.uniform(-0.3, 0.3, size=(300, 3)) * (1.0, 1.0, 10.0):
            posed = body.at(q)
            answer = found(self_collision, posed, 0.02)
            if len(answer[1]) and answer[2][0] > -0.02:
                compare(self_collision.near(posed), coal.near(posed), 0.02)
                sides.append(answer[2][0] > 0.0)
    assert min(sides.count(True), sides.count(False)) >= 20, sides


@pytest.mark.parametrize(
    ("first", "second"), [("palm", "palm"), ("disc", "palm"), ("disc", "finger"), ("egg", "stick"), ("stick", "stick")]
)
def test_no_gap_is_larger_than_a_compiled_distance(first: str, second: str) -> None:
    """However deep the overlap: the signed distance is the largest gap along any direction."""
    rng = np.random.default_rng([len(first), ord(second[0]), 3])
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    deep = left = 0
    for _ in range(4):
        body = two_solids(flesh(first, rng), flesh(second, rng))
        self_collision = SelfCollision(body, include=[("a", "b")])
        for q in rng.uniform(-0.15, 0.15, size=(60, 3)) * (1.0, 1.0, 20.0):
            posed = body.at(q)
            remaining, _, distance, *_ = found(self_collision, posed, 0.02)
            left += len(remaining)
            if len(distance):
                assert distance[0] > gaps(self_collision, posed, directions).max() - 1e-12
                deep += distance[0] < 0.0
    assert deep >= 10
    assert left > 0 or first == second == "stick"


def gaps(self_collision: SelfCollision, posed: PosedBody, directions: np.ndarray) -> np.ndarray:
    """Of the two solids along unit vectors (N, 3) from a to b [m], from their support functions."""
    reach = []
    for solid, sign in zip(self_collision.solids, (1.0, -1.0), strict=True):
        R, t = posed.rotations[solid.joint], posed.translations[solid.joint]
        n = sign * directions @ (R @ solid.rotation)
        size = np.linalg.norm(n * solid.radii, axis=1)
        if not solid.radii.any():
            size = np.abs(n @ solid.core_half) + solid.core_radius
        reach.append(sign * directions @ (R @ solid.translation + t) + size)
    return -reach[0] - reach[1]


BOX = '<collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision>'
SPHERE = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'


@pytest.mark.parametrize(
    ("first", "second", "q"),
    [
        (BOX, SPHERE, (0.1, 0.02, 0.0)),  # a hull
        (f"<flesh {SHAPES['stick']}/>", f"<flesh {SHAPES['stick']}/>", (0.06, 0.08, 0.3)),  # parallel
        (f"<flesh {SHAPES['stick']}/>", f'<flesh {SHAPES["finger"]} rpy="1.2 0 0"/>', (0.0, 0.01, 0.0)),  # crossing
        (f"<flesh {SHAPES['egg']}/>", f"<flesh {SHAPES['palm']}/>", (0.0, 0.0, 1.0)),  # one centre
        (f"<flesh {SHAPES['disc']}/>", f"<flesh {SHAPES['palm']}/>", (0.09, 0.015, 0.2)),  # deep
        (f"<flesh {SHAPES['disc']}/>", f"<flesh {SHAPES['finger']}/>", (0.1, 0.002, 0.0)),  # deep
    ],
)
def test_uncertain_contacts_are_left_to_coal(first: str, second: str, q: tuple[float, ...]) -> None:
    body = two_solids(first, second)
    self_collision, coal = (SelfCollision(body, include=[("a", "b")]) for _ in range(2))
    posed = body.at(np.array(q))
    remaining, pair, *_ = found(self_collision, posed, 0.02)
    assert (remaining.tolist(), pair.tolist()) == ([0], [])
    assert len(self_collision.near(posed).pair) == 1
    assert same(self_collision.near(posed), asks_coal_alone(coal).near(posed))


def same(ours: tuple[np.ndarray, ...], other: tuple[np.ndarray, ...]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(ours, other, strict=True))


@pytest.mark.parametrize(("q", "expected"), [((0.06, 0.08, 1.0), 0.0), ((-0.024, 0.032, 0.0), 0.04 - 0.1)])
def test_spheres_of_a_urdf_are_capsules_without_length(q: tuple[float, ...], expected: float) -> None:
    body = two_solids(SPHERE, SPHERE)
    self_collision = SelfCollision(body, include=[("a", "b")])
    remaining, pair, distance, *_ = found(self_collision, body.at(np.array(q)), 0.02)
    assert (len(remaining), pair.tolist()) == (0, [0])
    assert distance[0] == pytest.approx(expected, abs=1e-12)


def test_the_kernel_depends_on_its_arguments_alone(human: Body) -> None:
    """Whatever its buffers held before; and `near` gives its answers."""
    rng, self_collision, contacts = np.random.default_rng(8), SelfCollision(human, include=LOOSE), 0
    for _ in range(60):
        posed = human.at(random_pose(human, rng))
        once, again = (found(self_collision, posed, 0.02, garbage) for garbage in (np.nan, 1e9))
        assert same(once, again)
        near, (remaining, pair, distance, point_a, point_b, normal) = self_collision.near(posed), once
        rows = np.isin(near.pair, pair)
        assert same([array[rows] for array in near[:5]], [pair, distance, point_a, point_b, normal])
        assert set(near.pair[~rows]) <= set(remaining)
        contacts += len(pair)
    assert contacts > 60


def test_distances_of_poses_are_in_order_with_coals_among_them(human: Body) -> None:
    rng, self_collision = np.random.default_rng(12), SelfCollision(human, include=LOOSE)
    q = np.array([random_pose(human, rng) for _ in range(60)])
    near = [self_collision.near(human.at(each)).distance for each in q]
    first, distance = self_collision.distances(human.placed(q))
    assert np.array_equal(np.diff(first), [len(each) for each in near])
    assert np.array_equal(distance, np.concatenate(near))
    left = [len(found(self_collision, human.at(each), 0.02)[0]) for each in q]
    assert sum(left) > 10
    assert any(0 < some < len(each) for some, each in zip(left, near, strict=True))
