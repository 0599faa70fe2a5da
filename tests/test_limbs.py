"""The limb graph of any body: what is merged, where frames lie, how near cones are, trees, mirrors, overrides."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import cKDTree

from humanoid.kinematics.body import Body
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.limbs.bodies import Bodies, bodies_of
from humanoid.limbs.graph import along_axis, limb_graph, outer_nodes
from humanoid.limbs.limb import Cone, Limb, LimbGraph, cone_distance, cone_surface, fitted_cone, limb_placements
from humanoid.limbs.merging import RULES, Group, Rule, merged, topmost_first
from humanoid.shape.surface import surface_of
from humanoid.subject.example_robots import installed
from humanoid.subject.subject import Subject, load_subject, subject_from_text
from humanoid.support.errors import InputError
from tests.builders import SUBJECTS, bent, body_of, camera_at, gripper, random_pose
from tests.tiers import later
from viz import palette
from viz.pictures.limb_layer import draw_limbs
from viz.pictures.painter import camera_view

ROBOTS = {"human": 10, "g1": 9}
"""Limbs of example-robot-data's bodies as in the paper."""
BALL = '<collision><geometry><sphere radius="{r}"/></geometry></collision>'
LIMIT = '<limit lower="-1.1" upper="1.3" effort="1" velocity="1"/>'


@pytest.fixture(scope="module")
def graphs() -> dict[tuple[str, str], LimbGraph]:
    return {(n, d): limb_graph(body_of(n), d) for n in SUBJECTS for d in ("paper", "fine")}


def check(graph: LimbGraph, body: Body) -> None:
    """A tree of limbs that share no link, with right-handed frames and cones of positive size."""
    size = len(graph.limbs)
    assert len(set(graph.names)) == size >= 2
    links = [link for limb in graph.limbs for link in limb.links]
    assert len(set(links)) == len(links)
    assert all(limb.link in limb.links for limb in graph.limbs)
    assert len(graph.edges) == size - 1
    assert all(i < j for i, j in graph.edges)
    reached = {0}
    for _ in range(size):
        reached |= {j for i, j in graph.directed if i in reached}
    assert reached == set(range(size))
    assert all(graph.mirror[m] == k for k, m in enumerate(graph.mirror))
    for limb in graph.limbs:
        np.testing.assert_allclose(limb.R_link_limb.T @ limb.R_link_limb, np.eye(3), atol=1e-9)
        assert np.linalg.det(limb.R_link_limb) > 0.0
        assert limb.length >= 0.0
        assert limb.end > limb.start
        assert min(*limb.proximal, *limb.distal) > 0.0
    t, R = limb_placements(graph, body, body.neutral)
    assert np.isfinite(t).all()
    assert np.isfinite(R).all()


def test_the_adult_has_the_limbs_of_the_paper(graphs: dict[tuple[str, str], LimbGraph]) -> None:
    graph = graphs["human34", "paper"]
    check(graph, body_of("human34"))
    assert set(graph.names) == {
        "torso", "head", "left_upper_arm", "right_upper_arm", "left_forearm", "right_forearm", "left_thigh",
        "right_thigh", "left_shank", "right_shank",
    }  # fmt: skip
    assert len(graph.directed) == 18
    named = {frozenset((graph.names[i], graph.names[j])) for i, j in graph.edges}
    sides = [{"torso", f"{s}_{p}"} for s in ("left", "right") for p in ("upper_arm", "thigh")]
    chains = [
        {f"{s}_{a}", f"{s}_{b}"} for s in ("left", "right") for a, b in (("upper_arm", "forearm"), ("thigh", "shank"))
    ]
    assert named == {frozenset(pair) for pair in [{"torso", "head"}, *sides, *chains]}
    assert {"pelvis", "left_clavicle", "lumbar_flexion_link"} < set(graph.limbs[graph.index("torso")].links)
    with pytest.raises(InputError, match="left_shank"):
        graph.index("left_shanks")


def test_finer_limbs_are_pelvis_and_feet_too(graphs: dict[tuple[str, str], LimbGraph]) -> None:
    fine, paper = graphs["human34", "fine"], graphs["human34", "paper"]
    check(fine, body_of("human34"))
    assert set(fine.names) - set(paper.names) == {"pelvis", "left_foot", "right_foot"}
    assert set(paper.names) < set(fine.names)


@pytest.mark.parametrize(("name", "paper", "fine"), [("arm8", 4, 5), ("upper13", 6, 6)])
def test_other_built_in_bodies(graphs: dict[tuple[str, str], LimbGraph], name: str, paper: int, fine: int) -> None:
    for detail, count in (("paper", paper), ("fine", fine)):
        check(graphs[name, detail], body_of(name))
        assert len(graphs[name, detail].limbs) == count


@pytest.mark.parametrize("name", later(ROBOTS, "human"))
def test_robots_have_limbs_that_mirror_each_other(name: str) -> None:
    if name not in installed():
        pytest.skip("example-robot-data is not installed")
    body = body_of(f"example-robot-data:{name}")
    graph = limb_graph(body)
    check(graph, body)
    assert len(graph.limbs) == ROBOTS[name]
    paired = sum(m != k for k, m in enumerate(graph.mirror))
    assert paired == 8


@pytest.mark.parametrize("name", SUBJECTS)
def test_placements_are_those_of_the_links_and_the_same_in_a_crowd(
    graphs: dict[tuple[str, str], LimbGraph], name: str
) -> None:
    body, graph, rng = body_of(name), graphs[name, "fine"], np.random.default_rng(1)
    q = np.array([random_pose(body, rng) for _ in range(5)])
    t, R = limb_placements(graph, body, q)
    data = body.model.createData()
    for row, each in enumerate(q):
        alone = limb_placements(graph, body, body.at(each))
        assert np.array_equal(alone[0], t[row])
        assert np.array_equal(alone[1], R[row])
        pin.framesForwardKinematics(body.model, data, each)
        for k, limb in enumerate(graph.limbs):
            frame = data.oMf[body.model.getFrameId(limb.link, pin.FrameType.BODY)]
            np.testing.assert_allclose(t[row, k], frame.act(limb.t_link_limb), atol=1e-12)
            np.testing.assert_allclose(R[row, k], frame.rotation @ limb.R_link_limb, atol=1e-12)
    assert np.array_equal(limb_placements(graph, body, body.placed(q))[0], t)
    assert limb_placements(graph, body, q[:0])[0].shape == (0, len(graph.limbs), 3)
    with pytest.raises(InputError, match="shape"):
        limb_placements(graph, body, q[0, :-1])


def test_z_leads_from_joint_to_joint_in_every_pose(graphs: dict[tuple[str, str], LimbGraph]) -> None:
    body, graph, rng = body_of("human34"), graphs["human34", "paper"], np.random.default_rng(2)
    ends = {
        "thigh": ("hip_rotation", "knee_flexion"),
        "shank": ("knee_flexion", "ankle_dorsiflexion"),
        "upper_arm": ("shoulder_rotation", "elbow_flexion"),
    }
    for _ in range(4):
        posed = body.at(random_pose(body, rng))
        t, R = limb_placements(graph, body, posed)
        for side in ("left", "right"):
            for name, joints in ends.items():
                k = graph.index(f"{side}_{name}")
                first, last = (posed.translations[body.model.getJointId(f"{side}_{j}")] for j in joints)
                np.testing.assert_allclose(t[k], first, atol=1e-9)
                np.testing.assert_allclose(t[k] + graph.limbs[k].length * R[k, :, 2], last, atol=1e-9)


def test_mirrored_limbs_have_mirrored_frames_and_shapes(graphs: dict[tuple[str, str], LimbGraph]) -> None:
    body = body_of("human34")
    flip = np.diag([1.0, -1.0, 1.0])
    for detail in ("paper", "fine"):
        graph = graphs["human34", detail]
        t, R = limb_placements(graph, body, body.neutral)
        other = list(graph.mirror)
        assert all(
            n.replace("left", "right") == graph.names[other[k]] for k, n in enumerate(graph.names) if "left" in n
        )
        np.testing.assert_allclose(t[other], t @ flip, atol=1e-9)
        np.testing.assert_allclose(
            R[other][..., 2], (flip @ R @ flip)[..., 2], atol=1e-9 if detail == "paper" else 2e-2
        )
        np.testing.assert_allclose(R[other], flip @ R @ flip, atol=0.05)
        for a, b in ((limb, graph.limbs[m]) for limb, m in zip(graph.limbs, other, strict=True)):
            for x, y in ((a.proximal, b.proximal), (a.distal, b.distal), ((a.start, a.end), (b.start, b.end))):
                np.testing.assert_allclose(x, y, atol=1.5e-3)


def test_sides_without_names_mirror_by_where_they_are() -> None:
    text = _with_arms("red", "green")
    graph = limb_graph(subject_from_text(text, source="arms"))
    pairs = {frozenset((graph.names[k], graph.names[m])) for k, m in enumerate(graph.mirror)}
    assert pairs == {frozenset({"red", "green"}), frozenset({"trunk"})}


def test_cones_are_near_the_flesh_and_hold_it(graphs: dict[tuple[str, str], LimbGraph]) -> None:
    body, graph = body_of("human34"), graphs["human34", "paper"]
    bodies = bodies_of(body, surface_of(body, 3000))
    t, R = limb_placements(graph, body, body.neutral)
    for k, limb in enumerate(graph.limbs):
        points = (_nodes(bodies, limb, R[k, :, 2]) - t[k]) @ R[k]
        cone = Cone(limb.start, limb.end, limb.proximal, limb.distal)
        away = cKDTree(cone_surface(cone, 120, 60)).query(points)[0]
        assert away.mean() < (0.013 if limb.name == "torso" else 0.008), limb.name
        assert np.mean(cone_distance(cone, points) < 0.02) > 0.85, limb.name
    assert bodies.longest == pytest.approx(0.463, abs=1e-3)


def test_a_cone_is_found_again() -> None:
    cone = Cone(-0.03, 0.4, np.array([0.09, 0.06]), np.array([0.05, 0.045]))
    points = cone_surface(cone, 40, 20)
    assert np.abs(cone_distance(cone, points)).max() < 1e-9
    fitted = fitted_cone(points, 0.01)
    sizes = [[c.start, c.end, *c.proximal, *c.distal] for c in (fitted, cone)]
    np.testing.assert_allclose(sizes[0], sizes[1], atol=1e-4)
    straight = Cone(0.0, 1.0, np.array([0.1, 0.1]), np.array([0.1, 0.1]))
    points = np.array([[0.15, 0.0, 0.5], [0.0, 0.05, 0.5], [0.0, 0.0, 1.2], [0.13, 0.0, 1.04], [0.0, 0.0, 0.97]])
    np.testing.assert_allclose(cone_distance(straight, points), [0.05, -0.05, 0.2, 0.05, -0.03], atol=1e-12)
    limb = Limb("a", ("a",), "a", np.zeros(3), np.eye(3), 0.4, cone.start, cone.end, cone.proximal, cone.distal)
    np.testing.assert_allclose(
        limb.semi_axes(np.array([-1.0, 0.185, 9.0])), [[0.09, 0.06], [0.07, 0.0525], [0.05, 0.045]]
    )


def test_limbs_follow_fitted_lengths(graphs: dict[tuple[str, str], LimbGraph]) -> None:
    subject, graph = load_subject("human34"), graphs["human34", "paper"]
    lengths = ProportionedBody(subject)
    scales = np.linspace(0.86, 1.17, len(lengths.names))
    tall = subject.scaled(lengths.scales(scales))
    fitted, kept = limb_graph(lengths.at(scales), like=graph), limb_graph(tall, "fine", like=graph)
    assert fitted.names == kept.names == graph.names
    assert fitted.edges == kept.edges == graph.edges
    for part, joint in (("upper_arm", "elbow_flexion"), ("thigh", "knee_flexion"), ("shank", "ankle_dorsiflexion")):
        scale = scales[lengths.names.index(f"left_{joint}")]
        k = graph.index(f"left_{part}")
        assert fitted.limbs[k].length == pytest.approx(scale * graph.limbs[k].length, abs=1e-9)
        assert kept.limbs[k].length == pytest.approx(scale * graph.limbs[k].length, abs=1e-9)
        stretch = (kept.limbs[k].end - kept.limbs[k].start) / (graph.limbs[k].end - graph.limbs[k].start)
        assert stretch == pytest.approx(scale, abs=0.06)  # flesh too, but for its round ends


@pytest.mark.parametrize("seed", range(3))
def test_a_person_of_other_lengths_has_the_same_limbs(seed: int) -> None:
    """The rule has a margin: lengths up to 2.5 standard deviations off change no limb."""
    subject, rng = load_subject("human34"), np.random.default_rng(seed)
    kept = [_partition(subject, rule) for rule in RULES.values()]
    scaled = subject.scaled({p.joint: float(rng.choice([0.85, 1.15])) for p in subject.proportions})
    assert [_partition(scaled, rule) for rule in RULES.values()] == kept


def test_links_and_shapes_can_be_given(tmp_path: Path) -> None:
    path = tmp_path / "limbs.toml"
    path.write_text(
        """[limbs.left_leg]
        links = ["left_thigh", "left_foot", "left_shank"]
        link = "left_shank"
        distal = "left_ankle_dorsiflexion"
        [limbs.left_forearm]
        distal = "left_wrist"
        start = 0.01
        proximal_radii = [0.04, 0.03]
        """
    )
    body = body_of("human34")
    graph = limb_graph(body, overrides=path)
    check(graph, body)
    assert len(graph.limbs) == 9
    leg, arm = graph.limbs[graph.index("left_leg")], graph.limbs[graph.index("left_forearm")]
    assert set(leg.links) >= {"left_thigh", "left_shank", "left_foot", "left_hip_flexion_link"}
    assert leg.link == "left_shank"
    t, R = limb_placements(graph, body, body.neutral)
    k = graph.index("left_leg")
    ankle = body.at(body.neutral).translations[body.model.getJointId("left_ankle_dorsiflexion")]
    np.testing.assert_allclose(t[k] + leg.length * R[k, :, 2], ankle, atol=1e-9)
    assert arm.length == pytest.approx(0.261, abs=1e-9)  # to the wrist, which is a fixed joint here
    assert arm.start == 0.01
    assert arm.proximal.tolist() == [0.04, 0.03]


FAULTS = {
    "limb": ("[limbs.left_arm]\nstart = 0", ("left_arm", "no such limb", "upper_arm", "links")),
    "link": ('[limbs.a]\nlinks = ["left_tigh"]', ("no link 'left_tigh'", "left_thigh")),
    "twice": ('[limbs.a]\nlinks = ["left_thigh"]\n[limbs.b]\nlinks = ["left_thigh", "left_shank"]', ("limb 'a' too",)),
    "apart": ('[limbs.a]\nlinks = ["left_thigh", "head"]', ("not connected", "between them")),
    "carrier": ('[limbs.a]\nlinks = ["left_thigh"]\nlink = "head"', ("not one of the links", "left_thigh")),
    "joint": ('[limbs.left_thigh]\ndistal = "left_knee"', ("no joint 'left_knee'", "left_knee_flexion")),
    "far joint": ('[limbs.left_thigh]\ndistal = "neck_axial"', ("not on this limb", "left_knee_flexion")),
    "no length": ('[limbs.left_thigh]\ndistal = "left_hip_rotation"', ("same place",)),
    "inside out": ("[limbs.left_thigh]\nstart = 0.9", ("begin at 0.9 m", "end beyond")),
    "radii": ("[limbs.left_thigh]\ndistal_radii = [0.1, 0]", ("not two lengths",)),
    "one radius": ("[limbs.left_thigh]\ndistal_radii = 0.1", ("not two lengths",)),
    "entry": ("[limbs.left_thigh]\nlenght = 1", ("unknown entry 'lenght'", "entries")),
    "same name": ('[limbs.torso]\nlinks = ["head"]', ("has this name", "another name")),
    "table": ("[limb.a]\nstart = 0", ("unknown table", "[limbs.NAME]")),
    "no table": ("limbs = 3", ("is not a table",)),
    "not toml": ("[limbs", ("is not TOML", "[limbs.NAME]")),
    "all": ('[limbs.a]\nlinks = ["pelvis", "torso", "head", "left_hand", "right_hand", "left_upper_arm", '
            '"right_upper_arm", "left_clavicle", "right_clavicle", "left_thigh", "right_thigh", "left_shank", '
            '"right_shank", "left_foot", "right_foot"]', ("1 limb", "two links")),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_wrong_requests_are_refused(tmp_path: Path, fault: str) -> None:
    text, message = FAULTS[fault]
    path = tmp_path / "limbs.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        limb_graph(body_of("human34"), overrides=path)
    assert all(words in str(caught.value) for words in message), str(caught.value)
    assert "\n" not in str(caught.value)


def test_bodies_without_limbs_are_refused(graphs: dict[tuple[str, str], LimbGraph]) -> None:
    joint = f'<joint name="j" type="revolute"><parent link="a"/><child link="b"/>{LIMIT}</joint><subject base="fixed"/>'
    bare = subject_from_text(f'<robot name="r"><link name="a"/><link name="b"/>{joint}</robot>', source="bare")
    with pytest.raises(InputError, match=r"bare: surface: has no geometry \(add <flesh>"):
        limb_graph(bare)
    single = f'<robot name="r"><link name="a"/><link name="b">{BALL.format(r=0.1)}</link>{joint}</robot>'
    body = Body(subject_from_text(single, source="single"))
    assert body.at(body.neutral).spatial_jacobian.shape == (1, 6)
    with pytest.raises(InputError, match="1 limb"):
        limb_graph(body)
    with pytest.raises(InputError, match="paper, fine"):
        limb_graph(body_of("arm8"), "coarse")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no link"):
        limb_graph(body_of("arm8"), like=graphs["human34", "paper"])
    with pytest.raises(InputError, match="no link"):
        limb_placements(graphs["human34", "paper"], body_of("arm8"), body_of("arm8").neutral)


def test_joints_that_follow_others_are_joints() -> None:
    body = Body(subject_from_text(gripper(), source="gripper"))
    check(limb_graph(body, "fine"), body)


def test_limbs_that_hang_on_the_world_alone_are_connected() -> None:
    links = "".join(f'<link name="l{k}">{BALL.format(r=0.1 + 0.01 * k)}</link>' for k in range(3))
    joints = "".join(
        f'<joint name="j{k}" type="floating"><parent link="world"/><child link="l{k}"/><origin xyz="{k} 0 0"/></joint>'
        for k in range(3)
    )
    body = Body(subject_from_text(f'<robot name="loose"><link name="world"/>{links}{joints}</robot>', source="loose"))
    graph = limb_graph(body)
    check(graph, body)
    assert len(graph.limbs) == 3
    assert [limb.links for limb in graph.limbs] == [(name,) for name in graph.names]


@pytest.mark.parametrize("seed", later(range(4), 2, 3))
def test_random_trees_give_connected_graphs(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("humanoid.limbs.graph.NODES", 200)
    rng = np.random.default_rng(seed)
    body = Body(subject_from_text(_random_tree(rng), source=f"tree {seed}"))
    covered = set(surface_of(body, 200).links)
    graph = limb_graph(body, "fine" if seed % 2 else "paper")
    check(graph, body)
    assert covered <= {link for limb in graph.limbs for link in limb.links}
    again = limb_graph(body, like=graph)
    assert (again.names, again.edges, again.mirror) == (graph.names, graph.edges, graph.mirror)
    there, here = (limb_placements(g, body, body.neutral)[0] for g in (again, graph))
    np.testing.assert_allclose(there, here, atol=1e-9)


def test_limbs_are_drawn_where_they_are(graphs: dict[tuple[str, str], LimbGraph], tmp_path: Path) -> None:
    body, graph = body_of("human34"), graphs["human34", "paper"]
    q = bent(body, left_elbow_flexion=1.2)
    t, R = limb_placements(graph, body, q)
    camera = camera_at(30.0)
    view = camera_view(camera, 640)
    blank = palette.plain(*view.size)
    picture = blank.copy()
    draw_limbs(picture, view, graph, t, R)
    middles = np.array([t[k] + 0.5 * limb.length * R[k, :, 2] for k, limb in enumerate(graph.limbs)])
    for x, y in np.round(view.project(middles)[0]).astype(int):
        assert (picture[y, x] != blank[y, x]).any()
    assert 0.01 < (picture != blank).any(axis=2).mean() < 0.25
    outlines = blank.copy()
    draw_limbs(outlines, view, graph, np.repeat(t[None], 3, axis=0), np.repeat(R[None], 3, axis=0))
    assert 0 < (outlines != blank).sum() < (picture != blank).sum()
    nothing = blank.copy()
    draw_limbs(nothing, view, graph, t - 20.0 * camera.R_camera_world[2], R)
    draw_limbs(nothing, view, graph, np.full_like(t, np.nan), R)
    draw_limbs(nothing, view, graph, t[None][:0], R[None][:0])
    assert np.array_equal(nothing, blank)
    with pytest.raises(InputError, match="shapes"):
        draw_limbs(nothing, view, graph, t[:-1], R[:-1])
    with pytest.raises(InputError, match="weights"):
        draw_limbs(nothing, view, graph, t, R, weights=np.ones(3))


def _partition(subject: Subject, rule: Rule) -> list[tuple[int, ...]]:
    body = Body(subject)
    return [group.members for group in merged(bodies_of(body, surface_of(body, 300)), rule)]


def _nodes(bodies: Bodies, limb: Limb, z: np.ndarray) -> np.ndarray:
    """The outer nodes of a limb that its cone approximates, in the world with the body at rest."""
    joint = {link: j for j, links in enumerate(bodies.links) for link in links}
    group = Group(tuple(topmost_first(bodies, {joint[link] for link in limb.links})), joint[limb.link])
    return outer_nodes(bodies, along_axis(bodies, group, z))


def _with_arms(*names: str) -> str:
    """A trunk with an arm on either side of its plane y = 0."""
    arms = ""
    for k, name in enumerate(names):
        y = 0.2 * (1 - 2 * k)
        box = f'<collision><origin xyz="0 {y} 0"/><geometry><box size="0.06 0.4 0.06"/></geometry></collision>'
        arms += f"""<link name="{name}">{box}</link><joint name="to_{name}" type="revolute"><parent link="trunk"/>
            <child link="{name}"/><origin xyz="0 {y} 0.3"/><axis xyz="1 0 0"/>{LIMIT}</joint>"""
    trunk = '<link name="trunk"><collision><geometry><box size="0.2 0.3 0.6"/></geometry></collision></link>'
    return f'<robot name="arms">{trunk}{arms}<subject base="free"/></robot>'


def _random_tree(rng: np.random.Generator) -> str:
    """A URDF of 4 to 14 links in a random tree: any joints, some at one place, some links without a shape."""
    count = int(rng.integers(4, 15))
    shapes = ['<sphere radius="0.07"/>', '<box size="0.1 0.2 0.3"/>', '<cylinder radius="0.05" length="0.4"/>']
    kinds = ["revolute", "revolute", "revolute", "continuous", "prismatic", "fixed"]
    links, joints = [], []
    for k in range(count):
        shape = f"<collision>{_origin(rng, 0.1)}<geometry>{rng.choice(shapes)}</geometry></collision>"
        links.append(f'<link name="l{k}">{shape if k in (1, 2) or rng.random() < 0.7 else ""}</link>')
        if k:
            kind = "revolute" if k < 3 else rng.choice(kinds)
            axis = " ".join(map(repr, rng.choice([*np.eye(3), np.array([0.0, 0.6, 0.8])]).tolist()))
            joints.append(
                f'<joint name="j{k}" type="{kind}"><parent link="l{int(rng.integers(k))}"/><child link="l{k}"/>'
                f'{_origin(rng, 0.3 * (rng.random() < 0.7))}<axis xyz="{axis}"/>{LIMIT}</joint>'
            )
    base = rng.choice(["free", "fixed"])
    return f'<robot name="tree">{"".join(links)}{"".join(joints)}<subject base="{base}"/></robot>'


def _origin(rng: np.random.Generator, size: float) -> str:
    xyz, rpy = rng.uniform(-size, size, size=3).tolist(), rng.uniform(-1.5, 1.5, size=3).tolist()
    return f'<origin xyz="{" ".join(map(repr, xyz))}" rpy="{" ".join(map(repr, rpy))}"/>'
