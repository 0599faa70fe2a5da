"""Foreign subjects in pictures: their own shapes and colours, and missing or broken meshes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from humanoid import Body, InputError, load_subject
from humanoid.subject.subject import subject_from_text
from kinemode import __main__ as front
from tests.test_viz import looking_camera, moving_scene, saved
from viz.palette import SIDES
from viz.pictures.painter import BodyPainter, camera_view
from viz.solids.body_solids import body_solids, drawing_notes
from viz.solids.decimation import Triangles, creased, merged_vertices, oriented, simplified
from viz.solids.solid import DrawnMesh, merged
from viz.solids.visual_solids import COARSE, FINE

DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><up_axis>Z_UP</up_axis></asset>
<library_effects>{effects}</library_effects><library_materials>{materials}</library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="f" count="18">0 0 0 1 0 0 0 1 0  0 0 1 1 0 1 0 1 1</float_array>
<technique_common><accessor source="#f" count="6" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1" material="m0"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1</p></triangles>
<triangles count="1" material="m1"><input semantic="VERTEX" source="#v" offset="0"/><p>3 4 5</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="m0" target="#m0"/><instance_material symbol="m1" target="#m1"/>
</technique_common></bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
EFFECT = """<effect id="e{0}"><profile_COMMON><technique sid="t"><lambert><diffuse><color>{1} 1</color></diffuse>
</lambert></technique></profile_COMMON></effect>"""


def dae(path: Path, *colours: str) -> Path:
    """Two triangles of different colours, given as "r g b"."""
    effects = "".join(EFFECT.format(i, colour) for i, colour in enumerate(colours))
    names = range(len(colours))
    materials = "".join(f'<material id="m{i}"><instance_effect url="#e{i}"/></material>' for i in names)
    path.write_text(DAE.format(effects=effects, materials=materials))
    return path


def arm(folder: Path, upper: str, lower: str = '<sphere radius="0.1"/>', *, collision: str = "") -> Path:
    """Two links on one joint, with <visual> contents (geometry and whatever follows it)."""
    path = folder / "arm.urdf"
    path.write_text(f"""<robot name="arm"><material name="brick"><color rgba="0.6 0.2 0.2 1"/></material>
<link name="left_upper"><visual><origin xyz="0 0 0.2"/>{upper}</visual>{collision}</link>
<link name="left_lower"><visual><geometry>{lower}</geometry></visual></link>
<joint name="elbow" type="revolute"><parent link="left_upper"/><child link="left_lower"/><origin xyz="0 0 1"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>""")
    return path


def mesh(path: Path, after: str = "", scale: str = "1 1 1") -> str:
    return f'<geometry><mesh filename="{path}" scale="{scale}"/></geometry>{after}'


def box_stl(path: Path, extents: tuple[float, float, float] = (0.2, 0.4, 0.6)) -> Path:
    trimesh.creation.box(extents=extents).export(path)
    return path


def drawn(urdf: Path, *, coarse: bool = False) -> dict[str, list[DrawnMesh]]:
    by_name: dict[str, list[DrawnMesh]] = {}
    for solid in body_solids(Body(load_subject(urdf, base="fixed")), coarse=coarse):
        by_name.setdefault(solid.name, []).append(solid)
    return by_name


def test_a_mesh_has_the_place_and_scale_of_the_urdf(tmp_path: Path) -> None:
    (upper,) = drawn(arm(tmp_path, mesh(box_stl(tmp_path / "a.stl"), scale="2 -1 1")))["left_upper"]
    low, high = upper.vertices.min(axis=0), upper.vertices.max(axis=0)
    np.testing.assert_allclose([low, high], [[-0.2, -0.2, -0.1], [0.2, 0.2, 0.5]], atol=1e-6)
    p = (upper.vertices - [0.0, 0.0, 0.2])[upper.faces]  # mirrored, and still facing outwards
    assert np.einsum("fi,fi->", p[:, 0], np.cross(p[:, 1], p[:, 2])) / 6.0 == pytest.approx(0.4 * 0.4 * 0.6)
    outward = np.einsum("ni,ni->n", upper.normals, upper.vertices - [0.0, 0.0, 0.2])
    assert (outward > 0.0).all()
    assert upper.closed


def test_colours_are_the_urdfs_else_the_meshs_else_those_of_the_side(tmp_path: Path) -> None:
    coloured, plain = dae(tmp_path / "a.dae", "1 0 0", "0 0 0.8"), box_stl(tmp_path / "b.stl")
    own = drawn(arm(tmp_path, mesh(coloured)))
    assert {solid.colour for solid in own["left_upper"]} == {(255, 0, 0), (0, 0, 204)}
    assert own["left_lower"][0].colour == SIDES["trunk"]  # a body with its own colours has no left and right
    (red,) = {s.colour for s in drawn(arm(tmp_path, mesh(coloured, '<material name="brick"/>')))["left_upper"]}
    assert red == (153, 51, 51)
    inline = '<material name="x"><color rgba="0 0.4 0 1"/></material>'
    assert {s.colour for s in drawn(arm(tmp_path, mesh(plain, inline)))["left_upper"]} == {(0, 102, 0)}
    sided = drawn(arm(tmp_path, mesh(plain, '<material name="unknown"/>')))
    assert all(s.colour is None and s.paint == SIDES["left"] for solids in sided.values() for s in solids)
    hidden = drawn(arm(tmp_path, mesh(plain, '<material name="x"><color rgba="1 1 1 0"/></material>')))
    assert "left_upper" not in hidden


def test_a_texture_counts_as_its_mean(tmp_path: Path) -> None:
    picture = np.zeros((8, 8, 3), dtype=np.uint8)
    picture[:, 4:] = (0, 100, 200)  # BGR
    cv2.imwrite(str(tmp_path / "t.png"), picture)
    (tmp_path / "t.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd t.png\n")
    (tmp_path / "t.obj").write_text(
        "mtllib t.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\n"
        "f 1/1 3/3 2/2\nf 1/1 2/2 4/3\nf 2/1 3/2 4/3\nf 3/1 1/2 4/3\n"
    )
    (solid,) = drawn(arm(tmp_path, mesh(tmp_path / "t.obj")))["left_upper"]
    assert solid.colour == (100, 50, 0)


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("nan.obj", b"v 0 0 0\nv 1 0 nan\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\n", "not finite"),
        ("far.obj", b"v 0 0 0\nv 1e300 0 0\nv 0 1 0\nf 1 2 3\n", "out of range"),
        ("point.obj", b"v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "no triangles"),
        ("empty.stl", b"", "cannot be read|no triangles"),
        ("text.dae", b"not XML at all", "cannot be read"),
        ("points.obj", b"v 0 0 0\nv 1 0 0\n", "no triangles|cannot be read"),
        ("index.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 9\n", "cannot be read"),
        ("odd.zip", b"?", "not a mesh format"),
        ("noise.stl", bytes(range(256)) * 3, "cannot be read|no triangles"),
    ],
)
def test_a_mesh_that_cannot_be_read_is_named_with_its_link(
    tmp_path: Path, name: str, content: bytes, problem: str, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(content)
    body = Body(load_subject(arm(tmp_path, mesh(tmp_path / name)), base="fixed"))
    with pytest.raises(InputError, match=problem) as caught:
        BodyPainter(body)
    assert caught.value.source == str(tmp_path / name)
    assert "left_upper" in caught.value.place
    assert len(str(caught.value)) <= 500
    assert capfd.readouterr() == ("", "")


def test_a_missing_mesh_is_replaced_with_a_note(tmp_path: Path) -> None:
    moved = box_stl(tmp_path / "a.stl")
    collision = '<collision><geometry><box size="0.1 0.1 0.4"/></geometry></collision>'
    subjects = [
        load_subject(arm(tmp_path, mesh(moved), collision=text), base="fixed")
        for text in (collision, f"<collision>{mesh(moved)}</collision>", "")
    ]
    assert [drawing_notes(Body(subject)) for subject in subjects] == [()] * 3
    moved.unlink()
    with_collision, *without = [subject_from_text(s.urdf, source=s.source) for s in subjects]
    (stand_in,) = [s for s in body_solids(Body(with_collision)) if s.name == "left_upper"]
    np.testing.assert_allclose(np.ptp(stand_in.vertices, axis=0), [0.1, 0.1, 0.4], atol=1e-6)
    for subject in (with_collision, *without):
        body = Body(subject)
        (note,) = drawing_notes(body)
        assert str(moved) in note
        assert "left_upper" in note
        upper = [s for s in body_solids(body) if s.joint == 0]  # from the shoulder towards the elbow at 1 m
        assert max(s.vertices[:, 2].max() for s in upper) > 0.15
        assert BodyPainter(body).notes == (note,)


def test_a_leaf_without_its_mesh_is_a_ball(tmp_path: Path) -> None:
    gone = box_stl(tmp_path / "a.stl")
    urdf = arm(tmp_path, '<geometry><box size="0.1 0.1 1"/></geometry>', f'<mesh filename="{gone}"/>')
    subject = load_subject(urdf, base="fixed")
    gone.unlink()
    (ball,) = [s for s in body_solids(Body(subject)) if s.name == "left_lower"]
    assert np.linalg.norm(ball.vertices, axis=1).max() < 0.05


def test_meshes_are_read_once_and_again_after_a_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    load = trimesh.load
    monkeypatch.setattr(trimesh, "load", lambda path, **k: (read.append(path), load(path, **k))[1])
    urdf = arm(tmp_path, mesh(box_stl(tmp_path / "a.stl")))
    for coarse in (False, True, False):
        drawn(urdf, coarse=coarse)
    assert read == [str(tmp_path / "a.stl")]
    box_stl(tmp_path / "a.stl", (1.0, 1.0, 1.5))
    (upper,) = drawn(urdf)["left_upper"]
    assert np.ptp(upper.vertices[:, 2]) == pytest.approx(1.5)
    assert len(read) == 2


def test_a_robot_keeps_its_shape_and_colours_with_few_triangles() -> None:
    body = Body(load_subject("example-robot-data:panda"))
    exact: dict[str, list[np.ndarray]] = {}
    geometry = pin.buildGeomFromUrdfString(body.model, body.subject.urdf, pin.GeometryType.VISUAL)
    for shape in geometry.geometryObjects:
        points = np.asarray(shape.geometry.vertices()) @ shape.placement.rotation.T + shape.placement.translation
        exact.setdefault(body.model.frames[shape.parentFrame].name, []).append(points)
    for coarse, most, off in ((False, FINE, 0.002), (True, COARSE, 0.012)):
        solids = body_solids(body, coarse=coarse)
        assert sum(len(s.faces) for s in solids) < 1.3 * most
        assert len({s.paint for s in solids}) >= 4
        assert all(s.colour is not None for s in solids)
        for link, points in exact.items():
            given = np.concatenate(points)
            vertices = np.concatenate([s.vertices for s in solids if s.name == link])
            assert np.abs(vertices.min(axis=0) - given.min(axis=0)).max() < off, link
            assert np.abs(vertices.max(axis=0) - given.max(axis=0)).max() < off, link


def sphere(fine: int = 5) -> Triangles:
    ball = trimesh.creation.icosphere(subdivisions=fine)
    label = (ball.triangles_center[:, 2] > 0.0).astype(np.int64)  # two colours, divided at the equator
    return Triangles(np.asarray(ball.vertices), np.asarray(ball.faces), label)


def test_decimation_keeps_surface_and_colour_borders() -> None:
    before = sphere()
    after = simplified(before, 800)
    assert 700 < len(after.faces) <= 800
    assert np.abs(np.linalg.norm(after.vertices, axis=1) - 1.0).max() < 0.02
    shape = trimesh.Trimesh(after.vertices, after.faces, process=False)
    assert shape.is_watertight
    assert shape.volume == pytest.approx(4.0 / 3.0 * np.pi, rel=0.02)
    middles = shape.triangles_center[:, 2]
    assert middles[after.label == 1].min() > -0.03
    assert middles[after.label == 0].max() < 0.03
    assert oriented(after)
    np.testing.assert_array_equal(simplified(before, 800).vertices, after.vertices)


def test_flat_sides_cost_nothing() -> None:
    box = trimesh.creation.box(extents=(1.0, 2.0, 3.0))
    for _ in range(4):
        box = box.subdivide()
    fine = Triangles(np.asarray(box.vertices), np.asarray(box.faces), np.zeros(len(box.faces), dtype=np.int64))
    light = simplified(fine, 60)
    assert len(light.faces) <= 60
    assert trimesh.Trimesh(light.vertices, light.faces).volume == pytest.approx(6.0, rel=1e-6)


def test_sharp_edges_part_vertices_and_round_ones_do_not() -> None:
    box, ball = trimesh.creation.box(), sphere(3)
    flat = Triangles(np.asarray(box.vertices), np.asarray(box.faces), np.zeros(12, dtype=np.int64))
    assert len(creased(flat).vertices) == 24
    assert len(creased(ball).vertices) == len(ball.vertices)
    corners = Triangles(
        ball.vertices[ball.faces].reshape(-1, 3), np.arange(3 * len(ball.faces)).reshape(-1, 3), ball.label
    )
    assert len(merged_vertices(corners).vertices) == len(ball.vertices)
    assert not oriented(Triangles(flat.vertices, flat.faces[:, ::-1], flat.label))
    assert not oriented(Triangles(flat.vertices, flat.faces[:6], flat.label[:6]))


def test_merging_keeps_colours_apart() -> None:
    body = Body(load_subject("example-robot-data:panda"))
    solids = body_solids(body)
    joined = merged(solids)
    assert len(joined) < len(solids)
    assert len({(s.joint, s.paint) for s in solids}) <= len(joined)
    assert sum(len(s.faces) for s in joined) == sum(len(s.faces) for s in solids)


def test_a_robot_is_painted_in_its_own_colours() -> None:
    body = Body(load_subject("example-robot-data:panda"))
    canvas = np.zeros((480, 640, 3), dtype=np.uint8)
    painter = BodyPainter(body)
    view = camera_view(looking_camera("front", (2.0, 0.6, 0.5), (0.3, 0.0, 0.5)), 640)
    painter.solid(canvas, view, body.at(body.neutral), 1.0)
    seen = canvas[canvas.max(axis=2) > 0].astype(int)
    assert len(seen) > 10000
    assert np.ptp(seen, axis=1).mean() < 5.0  # white and black, not blue and orange for its two fingers
    assert (seen.min(axis=1) > 150).mean() > 0.4
    assert (seen.max(axis=1) < 90).mean() > 0.02


def test_the_command_names_missing_meshes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gone = box_stl(tmp_path / "a.stl")
    body = Body(load_subject(arm(tmp_path, mesh(gone)), base="fixed"))
    scene = moving_scene(3)
    count = len(body.landmark_names)
    arms = replace(
        scene, body=body, q=np.zeros((3, 1)), mode_q=np.zeros((3, 1, 1)), mode_weight=np.ones((3, 1)),
        path=np.zeros(3, dtype=int), pixels=np.zeros((3, 1, count, 2)), confidence=np.zeros((3, 1, count)),
    )  # fmt: skip
    run, out = str(saved(arms, tmp_path, 3)), tmp_path / "p.html"
    assert front.main(["view", run, "--html", str(out)]) == 0
    assert "meshes" not in capsys.readouterr().err
    gone.unlink()
    assert front.main(["view", run, "--html", str(out)]) == 0
    printed = capsys.readouterr().err
    assert f"drawn without their meshes, which are gone (the first is {gone}): left_upper" in " ".join(printed.split())
    gone.write_text("solid nothing")
    assert front.main(["overlay", run, "--out", str(tmp_path / "o.mp4")]) == front.BAD_INPUT
    assert capsys.readouterr().err.startswith(f"error: {gone}: link 'left_upper': the mesh ")
