"""Sets of markers: where they sit, which set a file's names belong to, and faults of a user's own file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from estimator.data.markers.load import load_points
from humanoid.kinematics.body import Body
from humanoid.subject.marker_set import MarkerSet, marker_set, marker_set_names
from humanoid.subject.marker_start import chosen_set, matching_set
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError


def places(markers: MarkerSet) -> np.ndarray:
    """The markers (M, 3) [m] on the standing subject, in the pelvis' frame."""
    body = Body(load_subject(markers.subject).with_markers(markers.markers))
    data = body.model.createData()
    pin.forwardKinematics(body.model, data, pin.neutral(body.model))
    frames = [data.oMi[int(joint)] for joint in body.marker_joint]
    return np.array([frame.act(xyz) for frame, xyz in zip(frames, body.marker_local, strict=True)])


@pytest.mark.parametrize("name", marker_set_names())
def test_sides_mirror_each_other_and_lie_on_their_side(name: str) -> None:
    markers = marker_set(name)
    names = [marker.name for marker in markers.markers]
    at = dict(zip(names, places(markers), strict=True))
    paired = {name for pair in markers.pairs for name in pair}
    assert len(paired) == 2 * len(markers.pairs) > 0.7 * len(names)
    for pair in markers.pairs:
        left, right = sorted(pair, key=lambda name: name.lower().startswith("r"))
        np.testing.assert_allclose(at[left], at[right] * [1.0, -1.0, 1.0], atol=1e-9)
        assert at[left][1] > 0.0
    assert all(0.005 <= marker.std <= 0.06 for marker in markers.markers)
    assert 0.0 < markers.noise < 0.05


@pytest.mark.parametrize("name", marker_set_names())
def test_a_set_is_recognised_by_its_names_in_any_spelling(name: str) -> None:
    markers = marker_set(name)
    names = [marker.name.upper().replace("_", " ").replace(".", "") for marker in markers.markers]
    chosen = matching_set([*names, "WAND"])
    assert (chosen.name, len(chosen.pairs)) == (name, len(markers.pairs))
    assert [marker.name for marker in chosen.markers] == names
    assert chosen.notes == (f"points that the set {name} does not know are left out: WAND",)
    assert matching_set(names).notes == ()


def test_names_of_triangulated_keypoints() -> None:
    names = ["Hip", "RHip", "RKnee", "RAnkle", "RBigToe", "RSmallToe", "RHeel", "LHip", "LKnee", "Neck", "Head", "Nose"]
    chosen = matching_set(names)
    assert chosen.name == "landmarks"
    assert {marker.name for marker in chosen.markers} == set(names)
    assert ("LKnee", "RKnee") in chosen.pairs


def test_an_unknown_set() -> None:
    with pytest.raises(InputError, match=r"lacks 'a, b.*opencap.*kinemode subjects --markers"):
        matching_set(["a", "b", "C7"])
    with pytest.raises(InputError, match="has none of the markers of opencap: 'a, b'"):
        chosen_set(["a", "b"], marker_set("opencap"))
    with pytest.raises(InputError, match=r"nosuch: is not a set of markers .a .toml, or one of landmarks, "):
        marker_set("nosuch")


LINE = 'A = {link = "left_shank", xyz = [0, 0.1, 0], std = 0.02, mirror = "B"}\n'


def test_the_other_side_is_made(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("[markers]\n" + LINE)
    own = marker_set(tmp_path / "a.toml")
    assert [(m.name, m.link, m.xyz) for m in own.markers] == [
        ("A", "left_shank", (0.0, 0.1, 0.0)),
        ("B", "right_shank", (0.0, -0.1, 0.0)),
    ]
    assert (own.name, own.pairs) == ("a", (("A", "B"),))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"has no table \[markers\]"),
        ("[a]\n", "unknown table 'a'"),
        ("[markers]\n" + LINE.replace("std", "sdt"), "'A': unknown entry 'sdt' .did you mean std"),
        ("[markers]\n" + LINE.replace(", std = 0.02", ""), "'A': lacks 'std'"),
        ("[markers]\n" + LINE.replace("0.02", "0"), "'A'.std: 0 cannot be a length here"),
        ("[markers]\n" + LINE.replace("0.1, 0", "nan, 0"), "'A'.xyz: nan cannot be a length"),
        ("[markers]\n" + LINE.replace('"B"', '"A"'), "'A'.mirror: 'A' is not another marker"),
        ("[markers]\nA = 3\n", "'A': is not a table"),
        ("[set]\nnoise = 'a'\n[markers]\n" + LINE, r"\[set\] noise: 'a' cannot be a length"),
        ("[markers]\n" + LINE.replace('"left_shank"', "?"), "is not TOML"),
    ],
)
def test_faults_are_one_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError, match=message):
        marker_set(tmp_path / "a.toml")


def test_opencap_lies_where_a_standing_person_has_it(shared_data: Path) -> None:
    """After one rigid motion, trunk, knees and ankles within 6 cm: no side or axis is confused."""
    file = shared_data / "opencap" / "subject4" / "static1.trc"
    if not file.is_file():
        pytest.skip("needs opencap/subject4")
    track = load_points(file)
    markers = matching_set(track.names)
    assert (markers.name, len(markers.markers)) == ("opencap", 55)
    names = [marker.name for marker in markers.markers]
    measured = np.nanmedian(track.points, axis=0)[[track.names.index(name) for name in names]]
    model = places(markers)
    a, b = model - model.mean(axis=0), measured - measured.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    assert np.linalg.det(u @ vt) > 0.0
    off = dict(zip(names, np.linalg.norm(b @ u @ vt - a, axis=1), strict=True))
    parts = ("C7", "ASIS", "PSIS", "HJC", "Sternum", "Shoulder", "knee", "ankle", "calc")
    assert max(off[name] for name in names if name.endswith(parts)) < 0.06
