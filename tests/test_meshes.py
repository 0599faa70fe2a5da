"""Unusable meshes are refused, including some that once crashed or hung the process."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.shape.solids import farthest, solids_of
from humanoid.shape.surface import surface_of
from humanoid.subject.subject import subject_from_text
from humanoid.support.errors import InputError
from viz.solids.mesh_files import mesh_file, read_mesh

SPHERE = trimesh.creation.icosphere(subdivisions=1, radius=0.1)
TRIANGLES = np.asarray(SPHERE.vertices)[np.asarray(SPHERE.faces)]


def stl(triangles: np.ndarray) -> bytes:
    facets = (struct.pack("<12fH", 0.0, 0.0, 1.0, *t.ravel(), 0) for t in triangles)
    return bytes(80) + struct.pack("<I", len(triangles)) + b"".join(facets)


def with_corner(value: float) -> bytes:
    changed = TRIANGLES.copy()
    changed[0, 0, 0] = value
    return stl(changed)


def body_with(mesh: Path, kind: str) -> Body:
    shape = f'<{kind}><geometry><mesh filename="{mesh}"/></geometry></{kind}>'
    joint = '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>'
    text = f'<robot name="r"><link name="a"/><link name="b">{shape}</link>{joint}</robot>'
    return Body(subject_from_text(text, source="r.urdf"))


BAD = {
    "a vertex is not a number": ("m.stl", with_corner(np.nan), "a vertex is not finite"),
    "a vertex is infinite": ("m.stl", with_corner(np.inf), "a vertex is not finite"),
    "a vertex is absurd": ("m.stl", with_corner(1e12), "a vertex lies 1.0e+12 m out"),
    "it is flat": ("m.stl", stl(TRIANGLES * [1.0, 1.0, 0.0]), "flat"),
    "it is a line": ("m.stl", stl(TRIANGLES * [1.0, 0.0, 0.0]), "flat"),
    "it is too small": ("m.stl", stl(TRIANGLES * 1e-9), "flat"),
    "it is one triangle": ("m.stl", stl(TRIANGLES[:1]), "flat"),
    "it is cut short": ("m.stl", stl(TRIANGLES)[:1000], "cannot be read"),
    "not a mesh": ("m.obj", b"hello\n" * 20, "No meshes found"),
    "an index is out of range": ("m.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 300\n", "vertex index out of range"),
    "its XML breaks off": ("m.dae", b"<COLLADA", "malformed XML"),
}


@pytest.mark.parametrize("case", BAD)
@pytest.mark.parametrize("use", [("collision", SelfCollision), ("visual", surface_of)])
def test_a_mesh_that_cannot_be_used_is_refused(case, use, tmp_path, capfd) -> None:  # type: ignore[no-untyped-def]
    name, content, message = BAD[case]
    (tmp_path / name).write_bytes(content)
    kind, made = use
    with pytest.raises(InputError) as caught:
        made(body_with(tmp_path / name, kind))
    assert message in str(caught.value)
    assert str(tmp_path / name) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")  # messages of C++ are hidden


def test_a_sound_mesh_is_its_hull(tmp_path: Path) -> None:
    (tmp_path / "m.stl").write_bytes(stl(TRIANGLES))
    solid = SelfCollision(body_with(tmp_path / "m.stl", "collision")).solids[0]
    assert 0.099 < solid.core_radius < 0.101


COLLADA = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>
{unit}<up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="f" count="{count}">{numbers}</float_array><technique_common><accessor source="#f" count="{points}"
stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor>
</technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="{faces}"><input semantic="VERTEX" source="#v" offset="0"/><p>{corners}</p></triangles></mesh>
</geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def dae(unit: str, metres: float) -> str:
    """The sphere, its numbers counting so many metres."""
    numbers, corners = (" ".join(map(str, np.ravel(a))) for a in (SPHERE.vertices / metres, SPHERE.faces))
    points, faces = len(SPHERE.vertices), len(SPHERE.faces)
    return COLLADA.format(unit=unit, numbers=numbers, corners=corners, count=3 * points, points=points, faces=faces)


@pytest.mark.parametrize(
    ("unit", "metres"),
    [
        ("", 1.0),
        ('<unit meter="1"/>', 1.0),
        ('<unit meter="0.001" name="mm"/>', 1e-3),
        ('<unit meter="2.54e-2"/>', 0.0254),
    ],
)
def test_a_mesh_is_scaled_by_its_unit(unit: str, metres: float, tmp_path: Path) -> None:
    """For distances, the surface and drawing; a scale of the URDF multiplies it."""
    path = tmp_path / "ball.dae"
    path.write_text(dae(unit, metres))
    for kind in ("collision", "visual"):
        (solid,) = solids_of(body_with(path, kind), "collision" if kind == "collision" else "visual")
        reach = [farthest(solid, direction) for direction in np.eye(3)]
        np.testing.assert_allclose(reach, SPHERE.vertices.max(axis=0), rtol=1e-5)
    scaled = body_with(path, "collision").subject.urdf.replace("<mesh ", '<mesh scale="1 2 -3" ')
    (solid,) = solids_of(Body(subject_from_text(scaled, source="r.urdf")))
    np.testing.assert_allclose([farthest(solid, d) for d in np.eye(3)], [0.1, 0.2, 0.3], rtol=0.06)
    drawn = read_mesh(mesh_file(str(path)))  # type: ignore[arg-type]
    np.testing.assert_allclose(drawn.triangles.vertices.max(axis=0), SPHERE.vertices.max(axis=0), rtol=1e-5)


@pytest.mark.parametrize("unit", ["0", "-1", "inch", "inf", "nan"])
def test_a_unit_that_is_not_a_length_is_refused(unit: str, tmp_path: Path) -> None:
    (tmp_path / "ball.dae").write_text(dae(f'<unit meter="{unit}"/>', 1.0))
    with pytest.raises(InputError, match=f'ball.dae: the mesh cannot be used: <unit meter="{unit}"> is not a length'):
        solids_of(body_with(tmp_path / "ball.dae", "collision"))
