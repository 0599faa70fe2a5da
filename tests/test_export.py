"""Exports: what other programs read is what was tracked."""

from __future__ import annotations

import csv
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from test_run_file import header, state_of, walk

import kinemode as km
import viz.exporters  # noqa: F401 - registers glb and rrd
from estimator.data.formats.opensim import read_mot, read_trc, write_trc
from estimator.data.formats.reference import load_reference
from estimator.runs.export import EXPORTERS, Exporter, export
from estimator.runs.run_file import RunWriter
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import Body
from humanoid.subject.joint_names import ROOT, ROOT_POSITION, ROOT_QUATERNION, ROOT_TURNS
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.notices import InputWarning

FRAMES = 12


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Twelve frames of a run planned to have twenty."""
    file = tmp_path_factory.mktemp("run") / "a.run"
    with RunWriter.create(file, header(20)) as writer:
        for result in walk(Body(load_subject("human34")), FRAMES):
            writer.append(result, state_of(result))
    return Run.open(file)


def test_npz(run: Run, tmp_path: Path) -> None:
    with np.load(export(run, tmp_path / "a.npz"), allow_pickle=False) as f:
        a = dict(f)
    t, k, nq, nv, n = FRAMES, run.mode_weight.shape[1], run.body.nq, run.body.nv, len(run.body.landmark_names)
    shapes = {
        "time": (t,), "q": (t, nq), "q_names": (nq,), "joint_names": (run.body.njoints - 1,), "landmark_names": (n,),
        "landmarks": (t, n, 3), "mode_q": (t, k, nq), "mode_weight": (t, k), "mode_landmarks": (t, k, n, 3),
        "covariance": (t, nv, nv), "std": (t, nv), "v_names": (nv,), "energy": (t,), "status": (t,),
        "contact_names": (6,), "contact": (t, 6), "contact_height": (t, 6), "unseen_joint_names": (0,),
        "unseen_landmark_names": (0,),
    }  # fmt: skip
    assert {name: array.shape for name, array in a.items()} == shapes
    np.testing.assert_array_equal(a["q"], run.q)
    for t in range(FRAMES):
        np.testing.assert_allclose(a["landmarks"][t], run.body.landmarks(run.body.at(a["q"][t])), atol=1e-12)
    assert list(a["q_names"]) == list(run.body.q_names)
    assert a["status"][1] == "tracked"
    reference = load_reference(tmp_path / "a.npz")
    assert reference.names == run.body.landmark_names
    np.testing.assert_array_equal(reference.time, run.time)
    np.testing.assert_array_equal(reference.points, run.landmarks)
    assert reference.coordinates is not None
    np.testing.assert_array_equal(reference.coordinates.values, run.q)


def test_csv(run: Run, tmp_path: Path) -> None:
    with export(run, tmp_path / "a.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == FRAMES
    knee = run.body.q_names.index("left_knee_flexion")
    nose = run.body.landmark_names.index("nose")
    for t, row in enumerate(rows):
        assert float(row["time_s"]) == pytest.approx(run.time[t])
        assert float(row["root_x_m"]) == pytest.approx(run.q[t, 0], rel=1e-8)
        assert float(row["root_qw"]) == pytest.approx(run.q[t, 6], rel=1e-8)
        assert float(row["left_knee_flexion_rad"]) == pytest.approx(run.q[t, knee], rel=1e-8)
        assert float(row["nose_z_m"]) == pytest.approx(run.landmarks[t, nose, 2], rel=1e-8)
        assert float(row["energy"]) == pytest.approx(run.energy[t], rel=1e-8)
        assert row["status"] == run.status[t]


def test_trc(run: Run, tmp_path: Path) -> None:
    lines = [line.split("\t") for line in export(run, tmp_path / "a.trc").read_text().splitlines()]
    assert lines[0] == ["PathFileType", "4", "(X/Y/Z)", "a.trc"]
    stated = dict(zip(lines[1], lines[2], strict=True))
    assert stated["NumFrames"] == str(FRAMES)
    assert stated["Units"] == "mm"
    assert float(stated["DataRate"]) == 30.0
    assert lines[3][:6] == ["Frame#", "Time", "nose", "", "", "left_eye"]
    assert lines[4][2:6] == ["X1", "Y1", "Z1", "X2"]
    assert lines[5] == [""]
    first = np.array(lines[6][2:5], dtype=float)
    x, y, z = 1000.0 * run.landmarks[0, 0]
    np.testing.assert_allclose(first, [x, z, -y], atol=1e-3)  # z up -> y up
    reference = load_reference(tmp_path / "a.trc")
    assert reference.names == run.body.landmark_names
    np.testing.assert_allclose(reference.time, run.time, atol=1e-3)
    np.testing.assert_allclose(reference.points, run.landmarks, atol=1e-6)


def test_a_missing_point_at_the_end_of_a_line_is_a_cell_that_opensim_counts(tmp_path: Path) -> None:
    """OpenSim's reader counts a cell by the tab after it, or by what is in it."""
    points = np.ones((3, 2, 3))
    points[1, 1] = np.nan
    points[2] = np.nan
    write_trc(tmp_path / "a.trc", ("a", "b"), points, np.arange(3) / 60.0)
    lines = (tmp_path / "a.trc").read_text().splitlines()[6:]
    assert [len(line.removesuffix("\t").split("\t")) for line in lines] == [2 + 6] * 3
    assert [line.endswith("\t") for line in lines] == [False, True, True]
    np.testing.assert_array_equal(read_trc(tmp_path / "a.trc").points, points)


def test_mot(run: Run, tmp_path: Path) -> None:
    lines = export(run, tmp_path / "a.mot").read_text().splitlines()
    end = lines.index("endheader")
    stated = dict(line.split("=") for line in lines[:end] if "=" in line)
    names = lines[end + 1].split("\t")
    values = np.array([line.split("\t") for line in lines[end + 2 :]], dtype=float)
    assert values.shape == (int(stated["nRows"]), int(stated["nColumns"])) == (FRAMES, len(names))
    assert stated["inDegrees"] == "yes"
    knee = run.body.q_names.index("left_knee_flexion")
    np.testing.assert_allclose(values[:, names.index("left_knee_flexion")], np.rad2deg(run.q[:, knee]), atol=1e-6)
    turn = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    for t in range(FRAMES):
        tilt, sideways, rotation = np.deg2rad(
            [values[t, names.index(f"root_{n}")] for n in ("tilt", "list", "rotation")]
        )
        about = [pin.AngleAxis(a, np.eye(3)[i]).matrix() for a, i in ((tilt, 2), (sideways, 0), (rotation, 1))]
        R = pin.Quaternion(run.q[t, 3:7]).matrix()
        np.testing.assert_allclose(about[0] @ about[1] @ about[2], turn @ R @ turn.T, atol=1e-6)
        np.testing.assert_allclose([values[t, names.index(f"root_{a}")] for a in "xyz"], run.q[t, :3], atol=1e-6)


def test_a_coordinate_has_one_name_and_one_value_in_every_export(run: Run, tmp_path: Path) -> None:
    with np.load(export(run, tmp_path / "a.npz"), allow_pickle=False) as f:
        npz, of_v, joints = (f[name].tolist() for name in ("q_names", "v_names", "joint_names"))
    with export(run, tmp_path / "a.csv").open() as file:
        rows = list(csv.DictReader(file))
    (mot, values, in_degrees), time = read_mot(export(run, tmp_path / "a.mot"))
    bare = [name.removesuffix("_m").removesuffix("_rad") for name in rows[0]][1 : 1 + run.body.nq]
    assert npz == bare == list(run.body.q_names)
    assert [name for name in npz if name.startswith("root")] == [*ROOT_POSITION, *ROOT_QUATERNION]
    assert set(npz) - set(mot) == set(ROOT_QUATERNION)  # which a motion file has as turns
    assert set(mot) - set(npz) == set(ROOT_TURNS)
    assert not set(of_v[:6]) & set(npz)  # velocities have other names
    assert joints[0] == ROOT
    assert in_degrees
    np.testing.assert_allclose(time, run.time, atol=1e-6)
    for name in set(npz) & set(mot):
        column = run.q[:, npz.index(name)]
        unit = 1.0 if name in ROOT_POSITION else np.pi / 180.0
        np.testing.assert_allclose(unit * values[:, mot.index(name)], column, atol=1e-7)


def test_osim_has_the_coordinates_of_the_mot(run: Run, tmp_path: Path) -> None:
    (names, _, _), _ = read_mot(export(run, tmp_path / "a.mot"))
    model = ET.parse(export(run, tmp_path / "a.osim")).getroot()
    assert sorted(c.get("name", "") for c in model.iter("Coordinate")) == sorted(names)
    assert [m.get("name") for m in model.iter("Marker")] == list(run.body.landmark_names)
    assert [m.get("name") for m in model.iter("Model")] == ["a"]


@pytest.mark.parametrize(
    ("model", "title", "count"), [("gait2392", "gait2392", 23), ("rajagopal", "Rajagopal2016", 39)]
)
def test_mot_of_gait_models(model: str, title: str, count: int, run: Run, tmp_path: Path) -> None:
    """The file names its model; a knee bent as far has the model's sign."""
    path = export(run, tmp_path / "a.mot", f"{model}-mot")
    (names, values, in_degrees), time = read_mot(path)
    assert f"the OpenSim model {title}" in path.read_text()
    assert len(names) == count
    assert in_degrees
    np.testing.assert_allclose(time, run.time, atol=1e-6)
    knee = np.rad2deg(run.q[:, run.body.q_names.index("right_knee_flexion")])
    sign = -1.0 if model == "gait2392" else 1.0
    np.testing.assert_allclose(values[:, names.index("knee_angle_r")], sign * knee, atol=1e-6)


def test_nothing_half_written(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "a.csv"
    file.write_text("before")

    def broken(run: Run, path: Path, name: str) -> None:
        path.write_text("half")
        raise RuntimeError("power cut")

    monkeypatch.setitem(EXPORTERS._members, "csv", Exporter("csv", broken))
    with pytest.raises(RuntimeError):
        export(run, file)
    assert file.read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]
    with pytest.raises(InputError, match="npz, csv, trc, mot"):
        export(run, tmp_path / "a.xyz")
    with pytest.raises(InputError, match="cannot be written"):
        export(run, tmp_path / "no folder" / "a.npz")


def test_no_frames_export(tmp_path: Path) -> None:
    RunWriter.create(tmp_path / "a.run", header(5)).close()
    run = Run.open(tmp_path / "a.run")
    with_frames = {"c3d", "bvh", "motion-npz", "motion-csv"}
    for format in with_frames:
        with pytest.raises(InputError, match=r"a\.run: contains no frames"):
            export(run, tmp_path / f"a.{format}")
    for format in set(EXPORTERS) - with_frames - {"glb", "rrd"}:
        assert export(run, tmp_path / f"a.{format}").stat().st_size > 0


def test_references(tmp_path: Path, shared_data: Path) -> None:
    names, points, time, coordinates, *_ = load_reference(shared_data / "beam4cam" / "reference3d.npz")
    assert points.shape == (100, 33, 3)
    np.testing.assert_array_equal(time, np.arange(100) / 60.0)
    assert coordinates is None
    assert names[-1] == "right_big_toe"
    assert names[1] == "left_eye_inner"
    assert "left_hip" in names
    (tmp_path / "a.npz").write_bytes(b"PK\x03\x04 nothing")
    np.savez(tmp_path / "b.npz", points=np.zeros((3, 2, 3)), names=np.array(["one"]))
    np.savez(tmp_path / "c.npz", other=np.zeros(3))
    (tmp_path / "d.trc").write_text("PathFileType\t4\nA\nB\nC\n")
    for bad in ("a.npz", "b.npz", "c.npz", "d.trc", "absent.npz"):
        with pytest.raises(InputError, match=bad):
            load_reference(tmp_path / bad)


@pytest.fixture(scope="module")
def unseen(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run in which nothing was seen in frames 3 to 5."""
    file = tmp_path_factory.mktemp("unseen") / "a.run"
    with RunWriter.create(file, header(FRAMES)) as writer:
        for i, result in enumerate(walk(Body(load_subject("human34")), FRAMES)):
            writer.append(replace(result, status="unobserved") if 3 <= i <= 5 else result, state_of(result))
    return Run.open(file)


@pytest.mark.parametrize("name", [name for name in EXPORTERS if name != "osim"])
def test_every_format_marks_unseen_joints_or_notes_that_it_cannot(name: str, unseen: Run, tmp_path: Path) -> None:
    assert unseen.unobserved == ((0.1, 5 / 30),)
    file = tmp_path / f"a.{name}"
    if not EXPORTERS[name].marks:
        with pytest.warns(InputWarning, match=rf"extrapolated: 0.10 to 0.17 s; {name} has no mark") as caught:
            km.export(unseen, file)
        assert {w.filename for w in caught} == {__file__}
        return
    if name == "rrd":
        pytest.importorskip("rerun")
    km.export(unseen, file, format=name)
    if name in ("trc", "c3d"):
        points = load_reference(file).points
        assert np.isnan(points[3:6]).all()
        assert np.isfinite(points[[2, 6]]).all()
    elif name == "npz":
        assert set(np.load(file)["status"][3:6]) == {"unobserved"}
    else:
        marks = {"csv": b"unobserved", "rrd": b"unobserved"}
        assert marks.get(name, b"extrapolated: 0.10 to 0.17 s") in file.read_bytes()
