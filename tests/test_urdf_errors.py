"""Any fault of a URDF is reported with file, element and remedy, and never otherwise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from humanoid import InputError, load_subject
from humanoid.subject.example_robots import share_folder
from humanoid.subject.subject import URDF_FOLDER, subject_from_text

GOOD = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"><flesh shape="capsule" radius="0.1" length="0.2"/></link>
  <link name="upper"><inertial><mass value="1"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="lower"><visual><geometry><box size="1 1 1"/></geometry></visual></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 1" rpy="0 0 0.5"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="prismatic"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <landmark name="hand" link="lower" xyz="0 0 0.3"/>
  <stabiliser joint="elbow" rest="0.5" std="0.2"/>
  <proportion joint="shoulder" scale_min="0.8" scale_max="1.2" mean="1" std="0.06"/>
</robot>
"""

# what is replaced, by what, and what the error must contain
FAULTS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "malformed": ("</link>", "</lnk>", ("line 3, column", "mismatched tag")),
    "doctype": ("<robot", '<!DOCTYPE r [<!ENTITY a "b">]><robot', ("DOCTYPE", "line 2", "remove")),
    "external entity": ("<robot", '<!DOCTYPE r SYSTEM "file:///etc/passwd"><robot', ("DOCTYPE",)),
    "undefined entity": ('name="arm"', 'name="&arm;"', ("undefined entity", "line 2")),
    "not a robot": ("robot", "model", ("not a URDF", "<robot>")),
    "no robot name": (' name="arm"', "", ("'name' is missing",)),
    "xacro": ("<landmark", "<xacro:include/><landmark", ("is xacro", "expand")),
    "xacro without a name": ('<robot name="arm">', "<robot><xacro:include/>", ("is xacro", "expand")),
    "plane across x": (
        'type="prismatic"',
        'type="planar"',
        ("'elbow'", "normal of its plane is 1 0 0", "no <axis>", "0 0 1"),
    ),
    "plane across y": ('name="shoulder" type="revolute"', 'name="shoulder" type="planar"', ("is 0 1 0", "line 7")),
    "deep": ("<landmark", "<a>" * 100 + "</a>" * 100 + "<landmark", ("nested over 64",)),
    "several roots": ("<landmark", '<link name="loose"/><landmark', ("2 roots", "'base', 'loose'", "fixed")),
    "cycle": ('<child link="lower"/>', '<child link="base"/>', ("cycle", "'upper'")),
    "cycle beside": (
        "<landmark",
        '<link name="u"/><link name="v"/><joint name="uv" type="fixed"><parent link="u"/><child link="v"/></joint>'
        '<joint name="vu" type="fixed"><parent link="v"/><child link="u"/></joint><landmark',
        ("form a cycle", "'u', 'v'"),
    ),
    "two parents": (
        '<parent link="upper"/><child link="lower"/>',
        '<parent link="base"/><child link="upper"/>',
        ("tree",),
    ),
    "itself": ('<child link="lower"/>', '<child link="upper"/>', ("same link 'upper'", "elbow")),
    "same links": ('<link name="lower">', '<link name="upper">', ("two <link> named 'upper'", "line 6")),
    "same joints": ('<joint name="elbow"', '<joint name="shoulder"', ("two <joint> named", "line 9")),
    "no link name": ('<link name="upper">', "<link>", ("<link> has no name", "line 4")),
    "reserved": ('name="elbow" type', 'name="root_joint" type', ("reserved",)),
    "unknown parent": ('<parent link="upper"/>', '<parent link="uper"/>', ("'uper'", "mean upper", "elbow", "line 9")),
    "no child": ('<child link="lower"/>', "", ("has no <child>", "'elbow'")),
    "two children": ('<child link="lower"/>', '<child link="lower"/><child link="base"/>', ("a second <child>",)),
    "no type": (' type="prismatic"', "", ("'type' is missing",)),
    "joint type": ('type="prismatic"', 'type="ball"', ("'ball'", "revolute, continuous, prismatic", "fixed", "line 9")),
    "no limit": (
        '<limit lower="0" upper="1" effort="1" velocity="1"/>',
        "",
        ("'elbow'", "has no <limit>", "<limit lower"),
    ),
    "half a limit": (' upper="2"', "", ("'shoulder'", "lacks lower or upper", "continuous", "line 8")),
    "inverted limit": ('lower="-1"', 'lower="3"', ("'shoulder'", "lower 3 is above upper 2", "line 8")),
    "infinite limit": ('upper="2"', 'upper="inf"', ("'shoulder'", "upper", "not finite")),
    "overflowing limit": ('upper="2"', 'upper="1e999"', ("upper", "not finite")),
    "nan": ('xyz="0 0 1" rpy', 'xyz="0 nan 1" rpy', ("'shoulder'", "<origin>", "xyz", "not finite", "line 8")),
    "not a number": ('rpy="0 0 0.5"', 'rpy="0 0 half"', ("rpy", "'half' is not a number")),
    "comma": ('rpy="0 0 0.5"', 'rpy="0 0 0,5"', ("'0,5' is not a number", "0.25")),
    "underscore": ('rpy="0 0 0.5"', 'rpy="0 0 1_0"', ("'1_0' is not a number",)),
    "two numbers": ('rpy="0 0 0.5"', 'rpy="0 0"', ("does not contain 3 numbers",)),
    "far away": ('xyz="0 0 1" rpy', 'xyz="0 0 1e200" rpy', ("out of range",)),
    "zero axis": ('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', ("'shoulder'", "zero length", "line 7")),
    "empty axis": ('<axis xyz="0 1 0"/>', "<axis/>", ("'xyz' is missing",)),
    "negative mass": ('value="1"', 'value="-1"', ("'upper'", "mass is negative", "line 4")),
    "no inertia": ('<mass value="1"/>', "", ("<mass> and <inertia>",)),
    "negative box": ('size="1 1 1"', 'size="1 -1 1"', ("'lower'", "not positive", "line 6")),
    "unknown shape": ("<box", "<torus", ("unknown shape", "sphere")),
    "no geometry": ('<geometry><box size="1 1 1"/></geometry>', "", ("needs one <geometry>",)),
    "missing mesh": (
        '<box size="1 1 1"/>',
        '<mesh filename="arm.stl"/>',
        ("'arm.stl' of link 'lower' is missing", "line 6"),
    ),
    "missing package": ('<box size="1 1 1"/>', '<mesh filename="package://a/b.stl"/>', ("ROS_PACKAGE_PATH", "require")),
    "remote mesh": ('<box size="1 1 1"/>', '<mesh filename="http://a/b.stl"/>', ("nothing is fetched",)),
    "mimic": ('<axis xyz="0 1 0"/>', '<mimic joint="elbo"/>', ("'elbo'", "mean elbow")),
    "base": ("<landmark", '<subject base="flying"/><landmark', ("'flying'", "free")),
    "two bases": ("<landmark", '<subject base="free"/><subject base="free"/><landmark', ("second <subject>",)),
    "landmark link": ('link="lower" xyz', 'link="lover" xyz', ("'hand'", "'lover'", "mean lower", "line 11")),
    "landmark twice": ("<landmark", '<landmark name="hand" link="base"/><landmark', ("second <landmark> of 'hand'",)),
    "landmark name": ('<landmark name="hand"', "<landmark", ("'name' is missing", "line 11")),
    "attribute": ('<landmark name="hand"', '<landmark nmae="hand"', ("'nmae' is unknown", "mean name", "line 11")),
    "place": ('xyz="0 0 0.3"/>', 'xzy="0 0 0.3"/>', ("'xzy' is unknown", "mean xyz", "line 11")),
    "element": ("<landmark", '<stabilizer joint="b"/><landmark', ("<stabilizer> is unknown", "mean <stabiliser>")),
    "flesh attribute": ("<flesh ", '<flesh tapr="0 0" ', ("'tapr' is unknown", "mean taper")),
    "stabiliser joint": ('<stabiliser joint="elbow"', '<stabiliser joint="elbows"', ("'elbows'", "mean elbow")),
    "stabiliser std": ('std="0.2"', 'std="0"', ("std=0 is not positive", "line 12")),
    "quickness": ('std="0.2"', 'std="0.2" quickness="0"', ("quickness=0 is out of range", "0.01 to 100", "line 12")),
    "stabiliser twice": (
        "<stabiliser",
        '<stabiliser joint="elbow" rest="0" std="1"/><stabiliser',
        ("second <stabiliser>",),
    ),
    "no rest": (' rest="0.5"', "", ("'rest' is missing",)),
    "proportion joint": ('<proportion joint="shoulder"', '<proportion joint="shoulde"', ("mean shoulder", "line 13")),
    "proportion range": ('scale_min="0.8"', 'scale_min="1.3"', ("scale_min=1.3", "not a range")),
    "proportion std": ('std="0.06"', 'std="-1"', ("not positive",)),
    "proportion twice": ('std="0.06"', 'std="0.06" symmetric_with="elbow shoulder"', ("'shoulder' is scaled",)),
    "proportion symmetry": ('std="0.06"', 'std="0.06" symmetric_with="elbo"', ("'elbo'", "mean elbow")),
    "proportion of nothing": ('xyz="0 0 1" rpy', 'xyz="0 0 0" rpy', ("no offset to scale",)),
    "flesh": ('radius="0.1"', 'radius="-0.1"', ("'base'", "not positive", "line 3")),
    "flesh shape": ('shape="capsule"', 'shape="cube"', ("'cube'", "ellipsoid")),
}


def refused(path: Path, capfd: pytest.CaptureFixture[str], **options: object) -> str:
    """The error's text; nothing else is printed."""
    with pytest.raises(InputError) as caught:
        load_subject(path, **options)  # type: ignore[arg-type]
    assert capfd.readouterr() == ("", "")
    error_text = str(caught.value)
    assert str(path) in error_text or repr(str(path)) in error_text
    assert "\n" not in error_text
    return error_text


def test_the_good_file_loads(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(GOOD)
    assert load_subject(tmp_path / "arm.urdf").model.nv == 2


def test_attributes_of_other_programs_are_passed_over(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Also where their prefix is undeclared, which yourdfpy would reject."""
    (tmp_path / "arm.urdf").write_text(GOOD.replace('upper="2"', 'upper="2" drake:acceleration="3"'))
    assert load_subject(tmp_path / "arm.urdf").model.nv == 2
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_is_reported(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    old, new, message = FAULTS[name]
    assert old in GOOD
    count = -1 if name == "not a robot" else 1
    (tmp_path / "arm.urdf").write_text(GOOD.replace(old, new, count))
    error_text = refused(tmp_path / "arm.urdf", capfd, meshes="require")
    for part in message:
        assert part in error_text


CONTENTS = {
    "empty": (b" \n", "is empty"),
    "binary": (bytes(range(256)), "not well-formed"),
    "text": (b"hello", "not well-formed"),
    "not utf-8": (GOOD.replace("arm", "\xe4rm").encode("latin-1"), "line 2"),
    "unknown encoding": (GOOD.replace('"1.0"', '"1.0" encoding="klingon"').encode(), "unknown encoding"),
    "no links": (b'<robot name="r"/>', "no <link>"),
    "nothing moves": (b'<robot name="r"><subject base="fixed"/><link name="a"/></robot>', "nothing in it can move"),
    "huge": (b" " * 20_000_001, "larger than 20 MB"),
}


@pytest.mark.parametrize("name", CONTENTS)
def test_files_that_are_not_urdf_are_refused(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    content, message = CONTENTS[name]
    (tmp_path / "x.urdf").write_bytes(content)
    assert message in refused(tmp_path / "x.urdf", capfd)


def test_missing_files_are_reported(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert "is a folder" in refused(tmp_path, capfd)
    assert "did you mean human34" in refused(Path("humn34"), capfd)
    assert "cannot be read" in refused(Path("a\0b"), capfd)
    assert "arm8" in refused(Path("qqqq.urdf"), capfd)


def test_options_are_checked(capfd: pytest.CaptureFixture[str]) -> None:
    for options, error_text in [
        ({"base": "flying"}, "auto, free, fixed"),
        ({"meshes": "some"}, "ignore, require"),
        ({"lock": ["left_elbow"]}, "left_elbow_flexion"),
        ({"landmarks": "nowhere.toml"}, "no such file"),
    ]:
        with pytest.raises(InputError, match=error_text):
            load_subject("arm8", **options)  # type: ignore[arg-type]


@pytest.mark.skipif(share_folder() is None, reason="example-robot-data is not installed")
def test_an_unknown_example_robot_is_refused() -> None:
    with pytest.raises(InputError, match="did you mean panda"):
        load_subject("example-robot-data:pand")


TOML_FAULTS = {
    "not toml": ("[landmarks", ("is not TOML", "declaration")),
    "twice": ("[limits]\nelbow=[0,1]\nelbow=[0,1]", ("is not TOML",)),
    "unknown table": ("[landmark]\n", ("[landmark]", "mean landmarks")),
    "unknown member of the subject": ('[subject]\nbas = "free"', ("unknown entry 'bas'", "mean base")),
    "no table": ("landmarks = 3", ("not a table",)),
    "unknown link": ('[landmarks]\nhand = {link = "lowr"}', ("[landmarks] hand", "'lowr'", "mean lower")),
    "no link": ("[landmarks]\nhand = {xyz = [0, 0, 0]}", ("lacks 'link'",)),
    "two numbers": ('[landmarks]\nhand = {link = "lower", xyz = [0, 0]}', ("three numbers",)),
    "nan": ('[landmarks]\nhand = {link = "lower", xyz = [0, 0, nan]}', ("three numbers",)),
    "unknown entry": ('[landmarks]\nhand = {lnk = "lower"}', ("'lnk'", "mean link")),
    "bad name": ('[landmarks]\n"a\\u0001b" = {link = "lower"}', ("cannot be written",)),
    "std": ("[stabilisers]\nelbow = {rest = 0, std = 0}", ("[stabilisers] elbow", "not positive")),
    "truth": ("[stabilisers]\nelbow = {rest = true, std = 1}", ("a number",)),
    "proportion": ("[proportions]\nelbow = {scale_min = 2, scale_max = 1, mean = 1, std = 1}", ("not a range",)),
    "unknown limit": ("[limits]\nelbw = [0, 1]", ("[limits] elbw", "mean elbow")),
    "inverted limit": ("[limits]\nelbow = [2, 1]", ("[lower, upper]",)),
    "base": ('[subject]\nbase = "flying"', ("'flying'", "free or fixed")),
}


@pytest.mark.parametrize("name", TOML_FAULTS)
def test_a_wrong_landmark_file_is_refused(name: str, tmp_path: Path) -> None:
    text, message = TOML_FAULTS[name]
    (tmp_path / "arm.urdf").write_text(GOOD)
    (tmp_path / "arm.toml").write_text(text)
    with pytest.raises(InputError) as caught:
        load_subject(tmp_path / "arm.urdf", landmarks=tmp_path / "arm.toml")
    for part in (str(tmp_path / "arm.toml"), *message):
        assert part in str(caught.value)


def mangled(good: bytes, rng: np.random.Generator) -> bytes:
    """Cut short, with bits flipped, or with an attribute or a line changed."""
    kind, at = rng.integers(4), int(rng.integers(len(good)))
    if kind == 0:
        return good[:at]
    if kind == 1:
        return good[:at] + bytes([good[at] ^ (1 << int(rng.integers(8)))]) + good[at + 1 :]
    if kind == 2:
        parts = good.split(b'"')
        values = [b"nan", b"-1", b"1e300", b"", b"0 0 0", b"planar", b"floating", b"fixed", b"pelvis", b"\xff"]
        parts[2 * int(rng.integers(len(parts) // 2)) + 1] = values[int(rng.integers(len(values)))]
        return b'"'.join(parts)
    lines = good.split(b"\n")
    lines.insert(int(rng.integers(len(lines))), lines.pop(int(rng.integers(len(lines)))))
    return b"\n".join(lines)


def test_mangled_files_load_or_are_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    good, rng, path = (URDF_FOLDER / "human34.urdf").read_bytes(), np.random.default_rng(0), tmp_path / "mangled.urdf"
    loaded = 0
    for _ in range(120):
        path.write_bytes(mangled(good, rng))
        try:
            subject = load_subject(path)
        except InputError:
            continue
        loaded += 1
        assert subject_from_text(subject.urdf, source="again").model == subject.model
    assert 0 < loaded < 120
    assert capfd.readouterr() == ("", "")
