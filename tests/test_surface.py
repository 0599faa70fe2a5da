"""The body's surface: closed, even, true to its parts, and its derivatives by shapes and proportions."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import coal
import numpy as np
import pinocchio as pin
import pytest

from humanoid.kinematics.body import Body, points_in_world
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.shape.flesh import even_nodes, flesh_derivatives, flesh_normals, flesh_points
from humanoid.shape.solids import solids_of
from humanoid.shape.surface import Surface, flesh_surface, surface_of
from humanoid.shape.surface_shape import SurfaceShape
from humanoid.subject.subject import Flesh, Subject, load_subject, subject_from_text
from humanoid.subject.urdf_flesh import limb_capsule, mirror_parts, stretched
from humanoid.support.errors import InputError
from tests.builders import SUBJECTS, body_of, random_pose
from tests.tiers import later

CAPSULE = Flesh("arm", "capsule", (0.05, 0.3, 0.0), (0.01, 0.02, -0.1), (0.3, -0.2, 0.5))
FOREIGN = """<robot name="two"><subject base="fixed"/><link name="a">{a}</link><link name="b">{b}</link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 1" rpy="0.4 0 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def check(surface: Surface) -> None:
    """Every part is a closed sphere of triangles that face outwards, with unit normals."""
    edges = np.concatenate([surface.faces[:, [0, 1]], surface.faces[:, [1, 2]], surface.faces[:, [2, 0]]])
    directed = {tuple(e) for e in edges.tolist()}
    assert len(directed) == len(edges)
    assert directed == {(b, a) for a, b in directed}
    assert len(surface.local) - len(edges) // 2 + len(surface.faces) == 2 * len(surface.links)
    assert (surface.part[edges[:, 0]] == surface.part[edges[:, 1]]).all()
    np.testing.assert_allclose(np.linalg.norm(surface.normal, axis=1), 1.0, atol=1e-9)
    p = surface.local[surface.faces]
    across = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    # a triangle's own side, which its three nodes agree with together
    assert (np.einsum("fi,fi->f", across, surface.normal[surface.faces].sum(axis=1)) > 0.0).all()
    for k in range(len(surface.links)):
        own = surface.part[surface.faces[:, 0]] == k
        assert np.einsum("fi,fi->f", p[own, 0], np.cross(p[own, 1], p[own, 2])).sum() > 0.0


@pytest.mark.parametrize("name", SUBJECTS)
@pytest.mark.parametrize("nodes", [400, 1000, 3000])
def test_built_in_surfaces_are_closed_and_even(name: str, nodes: int) -> None:
    surface = surface_of(body_of(name), nodes)
    check(surface)
    assert len(surface.local) == pytest.approx(nodes, rel=0.1)
    p = surface.local[surface.faces]
    edge = np.linalg.norm(p - np.roll(p, 1, axis=1), axis=2).ravel()
    low, middle, high = np.quantile(edge, [0.01, 0.5, 0.99])
    if nodes >= 1000:  # with fewer, the smallest parts determine their spacing
        assert low > 0.5 * middle
        assert high < 1.7 * middle


def test_capsules_and_ellipsoids_have_their_closed_forms() -> None:
    u = even_nodes(CAPSULE, 0.02).u
    own = (flesh_points(CAPSULE, u) - np.array(CAPSULE.xyz)) @ CAPSULE.R_link_part
    nearest = np.stack([0 * own[:, 0], 0 * own[:, 1], np.clip(own[:, 2], -0.15, 0.15)], axis=-1)
    np.testing.assert_allclose(np.linalg.norm(own - nearest, axis=1), 0.05, atol=1e-12)
    np.testing.assert_allclose(flesh_normals(CAPSULE, u), (own - nearest) @ CAPSULE.R_link_part.T / 0.05, atol=1e-12)
    for k, step in ((0, 1e-6), (1, 1e-6)):
        ahead, behind = (
            flesh_points(CAPSULE.with_parameters(CAPSULE.parameters + s * step * np.eye(9)[k]), u) for s in (1, -1)
        )
        np.testing.assert_allclose(flesh_derivatives(CAPSULE, u)[:, :, k], (ahead - behind) / (2 * step), atol=1e-9)
    egg = Flesh("egg", "ellipsoid", (0.1, 0.2, 0.3), (0, 0, 0), (0, 0, 0))
    points = flesh_points(egg, even_nodes(egg, 0.03).u)
    np.testing.assert_allclose(np.linalg.norm(points / egg.size, axis=1), 1.0, atol=1e-12)


def test_nodes_lie_on_parts_in_the_frame_of_the_joint() -> None:
    """Against the parts' points, placed by the frames of links instead of joints."""
    body = body_of("human34")
    surface = surface_of(body, 800)
    posed = body.at(random_pose(body, np.random.default_rng(0)))
    world = points_in_world(posed, surface.joint, surface.local)
    data = body.model.createData()
    pin.framesForwardKinematics(body.model, data, posed.q)
    for k, flesh in enumerate(body.subject.flesh):
        T_world_link = data.oMf[body.model.getFrameId(flesh.link, pin.FrameType.BODY)]
        in_link = (world[surface.part == k] - T_world_link.translation) @ T_world_link.rotation
        own = (in_link - np.array(flesh.xyz)) @ flesh.R_link_part
        assert surface.links[k] == flesh.link
        reach = np.linalg.norm(own / (np.array(flesh.size) * [1.4, 1.4, 1.02]), axis=1)
        assert reach.max() < np.sqrt(3.0)
        assert np.abs(own[:, 2]).max() == pytest.approx(flesh.size[2], rel=0.02)


def test_neighbouring_links_leave_no_gap() -> None:
    """Nodes of one link lie inside a part of its neighbour, in random poses in the middle of the limits."""
    body = body_of("human34")
    surface = surface_of(body, 2500)
    pairs = [("torso", "lumbar_flexion_link"), ("lumbar_flexion_link", "pelvis"), ("torso", "neck"), ("neck", "head")]
    for s in ("left", "right"):
        arm = ["torso", *(f"{s}_{link}" for link in ("clavicle", "upper_arm", "forearm", "hand"))]
        leg = ["pelvis", *(f"{s}_{link}" for link in ("thigh", "shank", "foot"))]
        pairs += [*pairwise(arm), *pairwise(leg)]
    rng = np.random.default_rng(4)
    for _ in range(3):
        posed = body.at(random_pose(body, rng, share=0.8))
        world = points_in_world(posed, surface.joint, surface.local)
        for a, b in pairs:
            assert any(
                windings(world[surface.part == i], world[surface.faces[surface.part[surface.faces[:, 0]] == k]]).any()
                for i in np.flatnonzero(np.array(surface.links) == b)
                for k in np.flatnonzero(np.array(surface.links) == a)
            ), (a, b)


def windings(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Winding numbers of closed triangles (F, 3, 3) about points (N, 3): by solid angles (van Oosterom, Strackee
    1983)."""
    a, b, c = (triangles[:, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    dot = [np.einsum("nfi,nfi->nf", u, v) for u, v in ((a, b), (b, c), (c, a))]
    triple = np.einsum("nfi,nfi->nf", a, np.cross(b, c))
    half = np.arctan2(triple, la * lb * lc + dot[0] * lc + dot[1] * la + dot[2] * lb)
    return np.rint(half.sum(axis=1) / (2.0 * np.pi)).astype(int)


def test_urdf_geometry_is_covered_by_its_hull() -> None:
    box = '<visual><origin xyz="0.1 0 0"/><geometry><box size="0.2 0.4 0.6"/></geometry></visual>'
    rod = '<collision><geometry><cylinder radius="0.1" length="0.5"/></geometry></collision>'
    body = Body(subject_from_text(FOREIGN.format(a=box, b=rod), source="two.urdf"))
    surface = surface_of(body, 1500)
    check(surface)
    assert surface.links == ("a",)  # the visual shapes, as they exist
    outside = np.abs(surface.local - [0.1, 0.0, 0.0]) / [0.1, 0.2, 0.3]
    np.testing.assert_allclose(outside.max(axis=1), 1.0, atol=1e-9)
    rods = surface_of(body, 1500, "collision")
    check(rods)
    assert rods.links == ("b",)
    radius, height = np.hypot(*rods.local[:, :2].T), np.abs(rods.local[:, 2])
    assert (np.maximum(radius / 0.1, height / 0.25) > 0.99).all()
    assert radius.max() < 0.1 + 1e-9
    area = np.linalg.norm(np.cross(*np.diff(rods.local[rods.faces], axis=1).transpose(1, 0, 2)), axis=1).sum() / 2
    assert area == pytest.approx(2 * np.pi * 0.1 * (0.5 + 0.1), rel=0.05)


@pytest.mark.parametrize("name", later(["human", "talos", "panda"], "human", "talos"))
def test_example_robots_have_surfaces(name: str) -> None:
    try:
        body = Body(load_subject(f"example-robot-data:{name}"))
    except (InputError, OSError) as error:
        pytest.skip(f"example-robot-data:{name} does not load: {error}")
    surface = surface_of(body, 1000)
    check(surface)
    assert 800 < len(surface.local) < 1500
    assert surface.convex.all()
    if name != "panda":  # the largest meshes are read once
        return
    solids = {s.link: s for s in solids_of(body, "visual")}
    for k, link in enumerate(surface.links):
        if list(surface.links).count(link) == 1 and isinstance(solids[link].geometry, coal.ConvexBase):
            shape, own = solids[link], surface.local[surface.part == k]
            corners = np.array([shape.geometry.point(i) for i in range(shape.geometry.num_points)])
            placed = corners @ shape.rotation.T + shape.translation
            assert (own.min(axis=0) >= placed.min(axis=0) - 1e-6).all()
            assert (own.max(axis=0) <= placed.max(axis=0) + 1e-6).all()


def test_a_body_without_geometry_is_refused() -> None:
    body = Body(subject_from_text(FOREIGN.format(a="", b=""), source="bare.urdf"))
    for geometry in ("auto", "flesh", "visual", "collision"):
        with pytest.raises(InputError, match="has no"):
            surface_of(body, geometry=geometry)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="unknown kind"):
        surface_of(body, geometry="skin")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="nodes"):
        surface_of(body, 0)


BENT = '<flesh shape="superquadric" radii="0.1 0.1 0.3" exponents="0.6 1" taper="0.2 0.1" bend="0.5 -1"/>'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('taper="0.2 0.1"', 'taper="0.2"', "2 numbers"),
        ('taper="0.2 0.1"', 'taper="1 0"', "taper"),
        ('exponents="0.6 1"', 'exponents="0 1"', "exponents"),
        ("0.5 -1", "30 0", "folds"),
        ("0.1 0.1 0.3", "0.1 -0.1 0.3", "not positive"),
        ('bend="', 'clearance="no" bend="', "on, off, or three half-axes"),
        ('bend="', 'clearance="0.1 0.1" bend="', "on, off, or three half-axes"),
        ('bend="', 'clearance="0.1 0 0.3" bend="', "not positive"),
        ('bend="', 'clearance="0.1 0.1 wide" bend="', "clearance"),
        ("superquadric", "quadric", "superquadric, capsule, ellipsoid"),
    ],
)
def test_faulty_flesh_is_named(old: str, new: str, message: str) -> None:
    assert subject_from_text(FOREIGN.format(a=BENT, b=""), source="bent.urdf").flesh[0].bend == (0.5, -1.0)
    with pytest.raises(InputError, match=message) as caught:
        subject_from_text(FOREIGN.format(a=BENT.replace(old, new), b=""), source="bent.urdf")
    assert "'a'" in caught.value.place
    assert "line 1" in caught.value.place


def test_solids_are_simple_and_leave_fillers_out() -> None:
    body = body_of("human34")
    solids = {s.link: s for s in solids_of(body)}
    thigh, torso = solids["left_thigh"], solids["torso"]
    assert (thigh.geometry.radius, 2 * thigh.geometry.halfLength) == pytest.approx((0.07, 0.27))
    np.testing.assert_allclose(torso.radii, [0.105, 0.145, 0.22])
    assert "left_clavicle" not in solids
    assert len(solids_of(body)) == sum(f.clearance for f in body.subject.flesh)


def test_a_limb_grows_as_its_capsule_does() -> None:
    limb = Flesh("a", "superquadric", (0.07, 0.07, 0.24), (0.0, 0.01, -0.2), (0.2, 0.0, 0.0), exponents=(0.6, 1.0))
    core = limb_capsule(limb)
    assert core is not None
    capsule = replace(limb, shape="capsule", size=(*core, 0.0), exponents=(1.0, 1.0))
    offset = np.array([0.0, 0.1, -0.4])
    longer, solid = stretched(limb, offset, 1.15), stretched(capsule, offset, 1.15)
    assert longer.xyz == pytest.approx(solid.xyz)
    assert limb_capsule(longer) == pytest.approx(solid.size[:2])


def test_reshaped_parts_are_written_and_read() -> None:
    subject = load_subject("human34")
    shape = subject.flesh[3].parameters * 1.03
    other = subject.reshaped({3: shape, "left_hand": [0.04, 0.02, 0.09, 0.7, 0.9, 0.1, 0, 0.3, 0.2]})
    np.testing.assert_array_equal(other.flesh[3].parameters, shape)
    hand = {f.link: f for f in other.flesh}["left_hand"]
    assert (hand.size, hand.bend) == ((0.04, 0.02, 0.09), (0.3, 0.2))
    changed = [k for k, (a, b) in enumerate(zip(subject.flesh, other.flesh, strict=True)) if a != b]
    assert len(changed) == 2
    assert subject_from_text(other.urdf, source="again").flesh == other.flesh
    for wrong, message in (
        ({"tail": shape}, "no flesh"),
        ({"left_foot": shape}, "2 parts"),
        ({99: shape}, "no part 99"),
    ):
        with pytest.raises(InputError, match=message):
            subject.reshaped(wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="nine"):
        subject.reshaped({0: [1.0]})


def test_mirrored_parts_are_each_others_mirror_image() -> None:
    body = body_of("human34")
    flesh, mirror = body.subject.flesh, mirror_parts([f.link for f in body.subject.flesh])
    np.testing.assert_array_equal(mirror[mirror], np.arange(len(flesh)))
    assert {flesh[k].link for k in np.flatnonzero(mirror == np.arange(len(flesh)))} == {
        "pelvis", "lumbar_flexion_link", "torso", "neck", "head"
    }  # fmt: skip
    surface = surface_of(body, 2000)
    q = body.neutral.copy()
    world = points_in_world(body.at(q), surface.joint, surface.local)
    for k, m in enumerate(mirror):
        ours, other = world[surface.part == k] * [1.0, -1.0, 1.0], world[surface.part == m]
        apart = np.linalg.norm(ours[:, None] - other[None], axis=2).min(axis=1)
        assert apart.max() < 0.02  # nodes lie anywhere on the same surface
        np.testing.assert_allclose(ours.mean(axis=0), other.mean(axis=0), atol=2e-3)


@pytest.fixture(scope="module")
def shaped() -> SurfaceShape:
    return SurfaceShape(ProportionedBody(_with_capsule()), 500)


def _with_capsule() -> Subject:
    """human34 with a capsule and a bent thigh among its parts, so that every kind of part is stretched."""
    subject = load_subject("human34")
    shapes = {"left_thigh": [0.072, 0.068, 0.24, 0.6, 1.0, 0.2, 0.25, 0.4, -0.3]}
    text = subject.reshaped(shapes).urdf
    start = text.index("<flesh", text.index('<link name="right_thigh">'))
    end = text.index("/>", start) + 2
    capsule = '<flesh shape="capsule" radius="0.07" length="0.27" xyz="0.01 0 -0.2" rpy="0.1 0 0"/>'
    return subject_from_text(text[:start] + capsule + text[end:], source="mixed.urdf")


def _other(shaped: SurfaceShape, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    scales = rng.uniform(0.9, 1.1, len(shaped._body.names))
    change = rng.uniform(0.97, 1.03, shaped.parameters.shape)
    return shaped.parameters * change, scales


def test_shape_and_scales_give_the_surface_of_the_written_subject(shaped: SurfaceShape) -> None:
    parameters, scales = _other(shaped, np.random.default_rng(0))
    subject = shaped._body.base.subject
    keep = [k for k, f in enumerate(subject.flesh) if f.shape == "capsule"]
    parameters[keep] = shaped.parameters[keep]
    shapes: dict[int | str, list[float]] = {k: list(p) for k, p in enumerate(parameters) if k not in keep}
    written = subject.reshaped(shapes).scaled(shaped._body.scales(scales))
    expected = flesh_surface(Body(written), shaped._nodes)
    moved = shaped.at(parameters, scales)
    np.testing.assert_allclose(moved.local, expected.local, atol=1e-12)
    np.testing.assert_allclose(moved.normal, expected.normal, atol=1e-12)
    np.testing.assert_array_equal(shaped.at().local, shaped.surface.local)


def test_shape_derivatives_are_central_differences(shaped: SurfaceShape) -> None:
    parameters, scales = _other(shaped, np.random.default_rng(1))
    derivatives = shaped.shape_derivatives(parameters, scales)
    for k in range(9):
        ahead, behind = parameters.copy(), parameters.copy()
        ahead[:, k] += 1e-6
        behind[:, k] -= 1e-6
        difference = (shaped.at(ahead, scales).local - shaped.at(behind, scales).local) / 2e-6
        np.testing.assert_allclose(derivatives[:, :, k], difference, atol=5e-9)


def test_proportion_derivatives_are_central_differences(shaped: SurfaceShape) -> None:
    rng = np.random.default_rng(2)
    parameters, scales = _other(shaped, rng)
    body = shaped._body
    q = random_pose(body.base, rng)

    def world(s: np.ndarray) -> np.ndarray:
        surface = shaped.at(parameters, s)
        return points_in_world(body.at(s).at(q), surface.joint, surface.local)

    derivatives = shaped.proportion_derivatives(body.at(scales).at(q), parameters, scales)
    for k in range(len(scales)):
        ahead, behind = scales.copy(), scales.copy()
        ahead[k] += 1e-6
        behind[k] -= 1e-6
        np.testing.assert_allclose(derivatives[:, :, k], (world(ahead) - world(behind)) / 2e-6, atol=5e-9)
        assert np.abs(derivatives[:, :, k]).max() > 0.05
