"""Meshes that cannot be used are refused; some of them used to end the process, or never to end it."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.shape.surface import surface_of
from humanoid.subject.subject import subject_from_text
from humanoid.support.errors import InputError

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
    "a vertex is no number": ("m.stl", with_corner(np.nan), "a vertex is not finite"),
    "a vertex is infinite": ("m.stl", with_corner(np.inf), "a vertex is not finite"),
    "a vertex is absurd": ("m.stl", with_corner(1e12), "a vertex lies 1.0e+12 m out"),
    "it is flat": ("m.stl", stl(TRIANGLES * [1.0, 1.0, 0.0]), "flat"),
    "it is a line": ("m.stl", stl(TRIANGLES * [1.0, 0.0, 0.0]), "flat"),
    "it is too small": ("m.stl", stl(TRIANGLES * 1e-9), "flat"),
    "it is one triangle": ("m.stl", stl(TRIANGLES[:1]), "flat"),
    "it is cut short": ("m.stl", stl(TRIANGLES)[:1000], "cannot be read"),
    "it is no mesh": ("m.obj", b"hello\n" * 20, "No meshes found"),
    "an index is out of range": ("m.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 300\n", "vertex index out of range"),
    "its XML breaks off": ("m.dae", b"<COLLADA", "malformed XML"),
}


@pytest.mark.parametrize("case", BAD)
@pytest.mark.parametrize("use", [("collision", SelfCollision), ("visual", surface_of)])
def test_a_mesh_that_cannot_be_used_is_refused(case, use, tmp_path, capfd) -> None:  # type: ignore[no-untyped-def]
    name, content, said = BAD[case]
    (tmp_path / name).write_bytes(content)
    kind, made = use
    with pytest.raises(InputError) as caught:
        made(body_with(tmp_path / name, kind))
    assert said in str(caught.value)
    assert str(tmp_path / name) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")  # what C++ has to say of it is not shown


def test_a_sound_mesh_is_its_hull(tmp_path: Path) -> None:
    (tmp_path / "m.stl").write_bytes(stl(TRIANGLES))
    solid = SelfCollision(body_with(tmp_path / "m.stl", "collision")).solids[0]
    assert 0.099 < solid.core_radius < 0.101
