"""The texts of the corpus that is damaged: a small arm with meshes, and two skeletons."""

from __future__ import annotations

_LINKS = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"><collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>
  <link name="upper"><inertial><mass value="1"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
    <visual><origin xyz="0 0 0.1" rpy="0 0.1 0"/><geometry>{shape}</geometry></visual></link>
  <link name="lower"><visual><geometry><cylinder radius="0.03" length="0.2"/></geometry></visual>
    <collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 1" rpy="0 0 0.5"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><axis xyz="1 0 0"/>
    <origin xyz="0 0 1"/></joint>
{more}</robot>
"""
_ELEMENTS = """  <subject base="fixed"/>
  <landmark name="hand" link="lower" xyz="0 0 0.3"/>
  <stabiliser joint="shoulder" rest="0.5" std="0.2"/>
  <proportion joint="elbow" scale_min="0.8" scale_max="1.2" mean="1" std="0.06"/>
"""
ARM = _LINKS.format(shape='<box size="1 1 1"/>', more=_ELEMENTS)
ARM_MESHES = {
    "": _LINKS.format(shape='<box size="1 1 1"/>', more=""),
    **{n: _LINKS.format(shape=f'<mesh filename="{n}"/>', more="") for n in ("arm.stl", "arm.obj", "arm.dae")},
}
ARM_LANDMARKS = """[subject]
base = "free"
[landmarks]
left_elbow = {link = "lower", xyz = [0, 0, 0]}
left_wrist = {link = "lower", xyz = [0, 0.1, 0.3]}
[upright]
base = {xyz = [0, 0, 1], std = 0.3}
[stabilisers]
shoulder = {rest = 0.3, std = 0.8}
[proportions]
elbow = {scale_min = 0.8, scale_max = 1.2, mean = 1, std = 0.06, symmetric_with = []}
[limits]
elbow = [0, 2.6]
"""
OBJ = "o arm\nv 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nvn 0 0 1\nf 1 3 2\nf 1//1 2//1 4//1\nf 1 4 3\nf 2 3 4\n"
DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g" name="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 0.1 0 0 0 0.1 0 0 0 0.1</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


def _skeleton(lumbar: str) -> str:
    """A person's joints in BVH; lumbar: names of the joints from the hips to the neck."""
    lines = ["HIERARCHY", "ROOT Hips", "{", "OFFSET 0 0 0", f"CHANNELS 6 {_MOVES} {_TURNS}"]
    columns = 6
    for side, sign in (("Left", 1), ("Right", -1)):
        first = f"{side[0]}HipJoint" if "LowerBack" in lumbar else ""
        chain = [*([first] if first else []), f"{side}UpLeg", f"{side}Leg", f"{side}Foot", f"{side}ToeBase"]
        offsets = [*(["0 0 0"] if first else []), f"{2 * sign} -2 0", "0 -8 0", "0 -7 0", "0 -1 2"]
        lines += _chain(chain, offsets)
        columns += 3 * len(chain)
    spine = lumbar.split()
    for name in spine:
        lines += [f"JOINT {name}", "{", "OFFSET 0 3 0", f"CHANNELS 3 {_TURNS}"]
    lines += _chain(["Neck", "Head"], ["0 0 0", "0 2 0"])
    for side, sign in (("Left", 1), ("Right", -1)):
        chain = [f"{side}{part}" for part in ("Shoulder", "Arm", "ForeArm", "Hand")]
        lines += _chain(chain, ["0 0 0", f"{3 * sign} 0 0", f"{5 * sign} 0 0", f"{3 * sign} 0 0"])
    columns += 3 * (len(spine) + 2 + 8)
    lines += ["}"] * (len(spine) + 1) + ["MOTION", "Frames: 3", "Frame Time: 0.02"]
    lines += [" ".join(["1 17 2", *(f"{(i * 7 + t) % 19 - 9}.5" for i in range(columns - 3))]) for t in range(3)]
    return "\n".join(lines) + "\n"


def _chain(names: list[str], offsets: list[str]) -> list[str]:
    lines = []
    for name, offset in zip(names, offsets, strict=True):
        lines += [f"JOINT {name}", "{", f"OFFSET {offset}", f"CHANNELS 3 {_TURNS}"]
    return [*lines, "End Site", "{", "OFFSET 0 1 0", "}", *["}"] * len(names)]


_MOVES, _TURNS = "Xposition Yposition Zposition", "Zrotation Yrotation Xrotation"
BVH_PLAIN, BVH_CMU = _skeleton("Spine"), _skeleton("LowerBack Spine Spine1")
LIMBS = """[limbs.arm]
links = ["left_upper_arm", "left_forearm"]
link = "left_upper_arm"
proximal = "left_shoulder_elevation"
distal = "left_wrist_flexion"
[limbs.left_hand]
start = 0.01
end = 0.2
proximal_radii = [0.04, 0.02]
distal_radii = [0.03, 0.01]
"""
