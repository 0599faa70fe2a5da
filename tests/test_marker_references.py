"""Markers of laboratories as references: which are joint centres, in which world and on which clock."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_run_file import header, state_of, walk

import kinemode as km
from benchmarks.robustness.c3d_files import DEC, INTEL, MIPS, c3d_file
from estimator.data.formats.c3d import read_c3d
from estimator.data.formats.markers import named_points
from estimator.data.formats.opensim import R_OPENSIM_WORLD, write_trc
from estimator.data.formats.reference import load_reference
from estimator.runs.evaluation import LIMB_JOINTS, Evaluation
from estimator.runs.export import export
from estimator.runs.run_file import RunWriter
from estimator.runs.run_reader import Run
from humanoid.subject.landmarks import landmark_name
from humanoid.support.errors import InputError
from kinemode.__main__ import main
from tests.builders import body_of

FRAMES = 6
MARKERS = ("C7", "RHJC", "L_HJC_reg", "r_knee", "r_mknee", "L_ankle", "L.elbow.lat", "L.elbow.med", "RShoulder")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    file = tmp_path_factory.mktemp("run") / "a.run"
    with RunWriter.create(file, header(FRAMES)) as writer:
        for result in walk(body_of("human34"), FRAMES):
            writer.append(result, state_of(result))
    return Run.open(file)


def laboratory(run: Run) -> np.ndarray:
    """Points (T, 9, 3) [m] of `MARKERS` beside the run's landmarks: two markers of a joint lie on either side of it."""
    at = dict(zip(run.body.landmark_names, np.moveaxis(run.landmarks, 1, 0), strict=True))
    rng, beside = np.random.default_rng(5), np.array([0.0, 0.04, 0.01])
    places = [
        at["neck"], at["right_hip"], at["left_hip"], at["right_knee"] + beside, at["right_knee"] - beside,
        at["left_ankle"], at["left_elbow"] - beside, at["left_elbow"] + beside, at["right_shoulder"],
    ]  # fmt: skip
    points = np.stack(places, axis=1) + 0.01 * rng.normal(size=(FRAMES, 1, 3)) + [0.0, 0.0, 0.02]
    points[:, 1] += [0.03, 0.0, 0.0]
    return points


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("RHip", "LKnee", "Hip"), {"right_hip": ("RHip",), "left_knee": ("LKnee",), "mid_hip": ("Hip",)}),
        (("left_hip", "right_big_toe", "arm_end"), {"left_hip": ("left_hip",), "right_big_toe": ("right_big_toe",)}),
        (("RHJC_study", "r_knee_study", "r_mknee_study", "r_ankle_study", "r_shoulder_study", "RAnkle", "RHip"),
         {"right_hip": ("RHJC_study",), "right_knee": ("r_knee_study", "r_mknee_study"), "right_ankle": ("RAnkle",)}),
        (("L_HJC", "L_HJC_reg", "L_knee", "r.ASIS", "L_Shoulder", "LAnkle"), {"left_hip": ("L_HJC",)}),
        (("LKNE", "RANK", "LSHO", "LASI", "LWRA"), {}),
        (("R_wrist_radius", "R_wrist_ulna", "LElbowLat", "LElbowMed", "L_knee_lat"),
         {"right_wrist": ("R_wrist_radius", "R_wrist_ulna"), "left_elbow": ("LElbowLat", "LElbowMed")}),
        (("right_knee_joint_center", "left_ankle_centre", "RSJC"), {"right_knee": ("right_knee_joint_center",),
          "left_ankle": ("left_ankle_centre",), "right_shoulder": ("RSJC",)}),
        (("r_knee_study", "mknee"), {}),
    ],
)  # fmt: skip
def test_which_markers_are_joint_centres(names: Sequence[str], expected: dict[str, tuple[str, ...]]) -> None:
    points = np.random.default_rng(len(names)).normal(size=(2, len(names), 3))
    named = named_points(names, points)
    assert sorted(name for name in named.names if landmark_name(name) == name) == sorted(expected)
    assert named.sources == {ours: theirs for ours, theirs in expected.items() if theirs != (ours,)}
    for ours, theirs in expected.items():
        middle = points[:, [names.index(name) for name in theirs]].mean(axis=1)
        np.testing.assert_allclose(named.points[:, named.names.index(ours)], middle)


def errors(run: Run, file: Path, **how: Any) -> Evaluation:
    return km.evaluate(run, file, **how)


def test_every_file_of_the_same_markers_gives_the_same_errors(run: Run, tmp_path: Path) -> None:
    """For any up axis and unit, integers or not."""
    points = laboratory(run)
    write_trc(tmp_path / "a.trc", MARKERS, points, run.time)
    y_up = errors(run, tmp_path / "a.trc")
    assert set(y_up.joints) == {"right_hip", "left_hip", "right_knee", "left_elbow"}
    assert y_up.frames_compared == FRAMES
    assert 0.005 < y_up.mpjpe < 0.05
    text = (tmp_path / "a.trc").read_text()
    metres = [line.split("\t") for line in text.splitlines()]
    for row in metres[6:]:
        row[2:] = [f"{1e-3 * float(cell):.9f}" for cell in row[2:]]
    (tmp_path / "m.trc").write_text("\n".join(map("\t".join, metres)).replace("\tmm\t", "\tm\t"))
    write_trc(tmp_path / "z.trc", MARKERS, points @ R_OPENSIM_WORLD, run.time)  # the written file has z up
    assert errors(run, tmp_path / "z.trc", up="z").per_joint == pytest.approx(y_up.per_joint, abs=1e-4)
    for name, unit, up, whole in (("z", "mm", "+Z", True), ("y", "m", "+Y", False), ("i", "mm", "+Y", True)):
        own = points if up == "+Z" else points @ R_OPENSIM_WORLD.T
        scaled = own if unit == "m" else 1e3 * own
        content = c3d_file(MARKERS, scaled, unit=unit, up=up, rate=30.0, whole=whole)
        (tmp_path / f"{name}.c3d").write_bytes(content)
    for file in ("m.trc", "z.c3d", "y.c3d", "i.c3d"):
        again = errors(run, tmp_path / file)
        assert again.per_joint == pytest.approx(y_up.per_joint, abs=1e-4)
        assert again.pa_mpjpe == pytest.approx(y_up.pa_mpjpe, abs=1e-4)
    wrong = errors(run, tmp_path / "z.c3d", up="y")
    assert wrong.mpjpe > 0.1
    assert wrong.pa_mpjpe == pytest.approx(y_up.pa_mpjpe, abs=1e-4)


def test_the_matched_markers_are_reported(run: Run, tmp_path: Path) -> None:
    write_trc(tmp_path / "a.trc", MARKERS, laboratory(run), run.time)
    notes = errors(run, tmp_path / "a.trc").notes
    for pair in ("right_hip (RHJC)", "left_hip (L_HJC_reg)", "right_knee (r_knee and r_mknee)"):
        assert pair in notes[0]
    assert notes[1].endswith(": C7, L_ankle, RShoulder")
    assert len(notes) == 2
    about = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    write_trc(tmp_path / "b.trc", MARKERS, laboratory(run) @ about.T, run.time)
    result = errors(run, tmp_path / "b.trc")
    assert "turned by 9" in result.notes[2] or "turned by 8" in result.notes[2]
    assert errors(run, export(run, tmp_path / "own.trc")).notes == ()


def test_the_clock_of_a_file_and_its_offset(run: Run, tmp_path: Path) -> None:
    points = laboratory(run)[2:]
    write_trc(tmp_path / "a.trc", MARKERS, points, run.time[2:])
    (tmp_path / "a.c3d").write_bytes(c3d_file(MARKERS, 1e3 * points, rate=30.0, first=3))
    missing = 1e3 * points
    missing[1, 1] = np.nan
    (tmp_path / "b.c3d").write_bytes(c3d_file(MARKERS, missing, rate=30.0, first=1))
    for file, offset in (("a.trc", 0.0), ("a.c3d", 0.0), ("b.c3d", 2 / 30.0)):
        reference = load_reference(tmp_path / file)
        np.testing.assert_allclose(reference.time + offset, run.time[2:], atol=1e-6)
        result = errors(run, tmp_path / file, offset=offset)
        assert (result.frames_compared, result.frames_missing) == ((4, 0) if file[0] == "a" else (3, 1))
        assert result.mpjpe < 0.05
    assert errors(run, tmp_path / "a.trc", offset=100.0).frames_compared == 0


def test_a_signalling_nan_is_a_missing_number(tmp_path: Path) -> None:
    points = np.tile([[1500.0, 0.0, 0.0], [0.0, 700.0, 0.0]], (3, 1, 1))
    content = c3d_file(("A", "B"), points, rate=30.0, whole=False)
    number, quiet = np.float32(1500.0).tobytes(), np.uint32(0x7FA00000).tobytes()
    at = content.rindex(number)
    (tmp_path / "a.c3d").write_bytes(content[:at] + quiet + content[at + 4 :])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read = read_c3d(tmp_path / "a.c3d")
    assert np.isnan(read.points).any(axis=2).tolist() == [[False, False], [False, False], [True, False]]


TRC = "PathFileType\t4\nDataRate\tUnits\n30\tmm\nFrame#\tTime\tRHJC\t\t\tC7\t\t\n\tX\n1\t0\t0\t900\t0\t0\t1400\t0\n"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.trc", TRC.replace("\tUnits", "").replace("\tmm", ""), "Units: has no unit of length .one of mm, cm, m"),
        ("a.trc", TRC.replace("mm", "inch"), "Units: unknown unit 'inch' .one of mm, cm, m"),
        ("a.trc", TRC.replace("mm", "m"), "Units: its markers are spread over 500 m, read in m .0.05 to 10 m"),
        ("a.trc", TRC, "1 of its markers are landmarks of the run, 3 are needed .*reference: right_hip, C7; landm"),
        ("a.c3d", c3d_file(("A",), np.ones((2, 1, 3)), unit="furlong"), "POINT:UNITS: unknown unit 'furlong'"),
        ("a.c3d", c3d_file(("A",), np.ones((2, 1, 3)), unit=""), "POINT:UNITS: has no unit of length"),
        ("a.c3d", c3d_file(("*1", ""), np.ones((2, 2, 3))), "has no points with a name"),
        ("a.c3d", c3d_file(("ann:LHJC", "bob:LHJC"), np.ones((2, 2, 3))), "several people: 'ann, bob'"),
        ("a.c3d", c3d_file(("A",), np.ones((200, 1, 3)))[:1800], "ends within its 200 frames"),
        ("a.c3d", c3d_file(("A",), np.ones((2, 1, 3)), first=5).replace(b"\x05\0\x06\0", b"\x05\0\x03\0"), "-1 frames"),
        ("a.c3d", c3d_file(("A",), np.ones((2, 1, 3)), processor=99), "unknown processor type 99 .84 to 86"),
        ("a.c3d", b"PathFileType", "does not start with a C3D header"),
        ("a.c3d", c3d_file(("A",), np.ones((2, 1, 3)))[:600], "ends within its parameters"),
    ],
)  # fmt: skip
def test_faults_are_one_line(run: Run, tmp_path: Path, name: str, content: Any, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=message):
        km.evaluate(run, path)


def test_an_undeclared_axis_is_reported(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.c3d").write_bytes(c3d_file(MARKERS, 1e3 * laboratory(run), up="", rate=30.0))
    assert "--up" in errors(run, tmp_path / "a.c3d").notes[0]
    assert "--up" not in errors(run, tmp_path / "a.c3d", up="z").notes[0]
    for how, message in (({"up": "w"}, "up: 'w' is not an axis"), ({"offset": float("nan")}, "offset: must be")):
        with pytest.raises(InputError, match=message):
            errors(run, tmp_path / "a.c3d", **how)
    np.savez(tmp_path / "a.npz", points=run.landmarks, names=np.array(LIMB_JOINTS), fps=30.0)
    with pytest.raises(InputError, match="up: is of the world of markers"):
        errors(run, tmp_path / "a.npz", up="y")


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("whole", [True, False])
def test_c3d_of_every_processor(tmp_path: Path, processor: int, whole: bool) -> None:
    points = np.random.default_rng(processor).uniform(-900.0, 900.0, (5, 3, 3))
    points[2, 1] = np.nan
    (tmp_path / "a.c3d").write_bytes(c3d_file(("A", "RHJC", "c"), points, whole=whole, processor=processor, rate=50.0))
    file = read_c3d(tmp_path / "a.c3d")
    assert file.names == ("A", "RHJC", "c")
    np.testing.assert_allclose(1e3 * file.points, points, atol=0.051 if whole else 1e-3)
    np.testing.assert_allclose(file.time, np.arange(5) / 50.0)


def test_our_own_c3d_is_read_again(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("ezc3d", reason="the extra c3d is not installed")
    reference = load_reference(export(run, tmp_path / "a.c3d"))
    assert reference.names == run.body.landmark_names  # without the channels of angles
    np.testing.assert_allclose(reference.points, run.landmarks, atol=1e-6)
    np.testing.assert_allclose(reference.time, run.time, atol=1e-6)


def test_the_command_opens_a_run_once(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_trc(tmp_path / "a.trc", MARKERS, laboratory(run), run.time)
    opened: list[Path] = []
    whole = Run.open

    def counted(path: str | Path) -> Run:
        opened.append(Path(path))
        return whole(path)

    monkeypatch.setattr(Run, "open", staticmethod(counted))
    assert main(["evaluate", str(run.file), "--reference", str(tmp_path / "a.trc")]) == 0
    assert opened == [run.file]
