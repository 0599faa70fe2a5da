"""Points in space from files: the same points from every kind of file, and every fault in a line with its remedy."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.robustness.c3d_files import c3d_file
from estimator.data.formats.markers import output_kind
from estimator.data.formats.opensim import R_OPENSIM_WORLD, write_trc
from estimator.data.formats.reference import load_reference
from estimator.data.markers.load import load_points, point_names
from estimator.data.markers.track import MarkerTrack
from humanoid.subject.landmarks import FORMATS
from humanoid.support.errors import InputError

NAMES = ("LASI", "RASI", "SACR", "LANK")
FRAMES, RATE = 5, 100.0
TIME = np.arange(FRAMES) / RATE


def points() -> np.ndarray:
    """(5, 4, 3) [m] in a z-up world, one missing."""
    places = np.array([[0.1, 0.12, 1.0], [0.1, -0.12, 1.0], [-0.08, 0.01, 1.02], [0.02, 0.1, 0.08]])
    made = places + 0.01 * np.random.default_rng(4).normal(size=(FRAMES, 4, 3))
    made[2, 1] = np.nan
    return made


def csv_text(names: tuple[str, ...], values: np.ndarray, ends: str = "_x _y _z", clock: str = "time") -> str:
    """clock: the name of the first column, of frames or times; none where it is empty."""
    head = ",".join([*([clock] if clock else []), *(name + end for name in names for end in ends.split())])
    times = range(len(values)) if clock == "frame" else TIME
    rows = [
        ",".join([*([f"{t:.6g}"] if clock else []), *("" if np.isnan(v) else f"{v:.9g}" for v in row.ravel())])
        for t, row in zip(times, values, strict=True)
    ]
    return "\n".join([head, *rows]) + "\n"


def write_all(folder: Path) -> dict[str, dict[str, Any]]:
    """The same points in files of every kind, with the options that each needs."""
    made, y_up = points(), points() @ R_OPENSIM_WORLD.T
    write_trc(folder / "a.trc", tuple(f"ann:{name}" for name in NAMES), made, TIME)
    write_trc(folder / "z.trc", NAMES, made @ R_OPENSIM_WORLD, TIME)
    for name, up in (("y.c3d", "+Y"), ("z.c3d", "+Z"), ("u.c3d", "")):
        own = y_up if up == "+Y" else made
        (folder / name).write_bytes(c3d_file(NAMES, 1e3 * own, up=up, rate=RATE, first=1, whole=False))
    names = np.array(NAMES)
    np.savez(folder / "declared.npz", points=100 * y_up, names=names, time=TIME, unit="cm", up="y")
    np.savez(folder / "plain.npz", points=made, names=names, fps=RATE)
    np.savez(folder / "run.npz", landmarks=made, landmark_names=names, time=TIME)
    (folder / "a.csv").write_text(csv_text(NAMES, 1e3 * made, "_x_mm _y_mm _z_mm"))
    (folder / "b.csv").write_text("# unit = cm\n# up = y\n" + csv_text(NAMES, 100 * y_up, ".X .Y .Z"))
    (folder / "c.csv").write_text(csv_text(NAMES, made, ":x :y :z", clock="frame"))
    return {
        "a.trc": {}, "z.trc": {"up": "z"}, "y.c3d": {}, "z.c3d": {}, "u.c3d": {"up": "z"}, "declared.npz": {},
        "plain.npz": {"up": "z", "unit": "m"}, "run.npz": {}, "a.csv": {"up": "z"}, "b.csv": {},
        "c.csv": {"up": "z", "unit": "m", "fps": RATE},
    }  # fmt: skip


def test_the_same_points_from_every_kind_of_file(tmp_path: Path) -> None:
    for name, options in write_all(tmp_path).items():
        track = load_points(tmp_path / name, **options)
        assert track.names == NAMES, name
        np.testing.assert_allclose(track.points, points(), atol=1e-6, err_msg=name)
        np.testing.assert_allclose(track.time, TIME, atol=1e-6, err_msg=name)
        assert track.notes == (), name
        assert track.source == name


WORDS = {
    "mm": ("mm", "MM", " mm ", "[mm]", "Millimeters", "millimetre", "MILLIMETRES"),
    "cm": ("cm", "Cm", "centimeter", "Centimetres "),
    "m": ("m", "M", "meters", "Metre", "METERS", "metres."),
}
SCALE = {"mm": 1e3, "cm": 1e2, "m": 1.0}


@pytest.mark.parametrize("unit", WORDS)
def test_units_are_read_in_any_spelling(tmp_path: Path, unit: str) -> None:
    """In the header of a TRC and C3D file, an array of an npz, a comment and the columns of a csv, and as an option."""
    made = points()
    for word in WORDS[unit]:
        write_trc(tmp_path / "a.trc", NAMES, SCALE[unit] / 1e3 * made, TIME)
        content = (tmp_path / "a.trc").read_text().replace("\tmm\t", f"\t{word}\t")
        (tmp_path / "a.trc").write_text(content)
        (tmp_path / "a.c3d").write_bytes(
            c3d_file(NAMES, SCALE[unit] * made, unit=word, up="+Z", rate=RATE, first=1, whole=False)
        )
        np.savez(tmp_path / "a.npz", points=SCALE[unit] * made, names=np.array(NAMES), fps=RATE, unit=word, up="z")
        text = csv_text(NAMES, SCALE[unit] * made)
        (tmp_path / "a.csv").write_text(f"# unit={word.strip()}\n# up=z\n{text}")
        for name in ("a.trc", "a.c3d", "a.npz", "a.csv"):
            track = load_points(tmp_path / name)
            np.testing.assert_allclose(track.points, made, atol=2e-4, err_msg=f"{name} {word}")
        plain = word.strip(" [].")
        (tmp_path / "b.csv").write_text(csv_text(NAMES, SCALE[unit] * made, f"_x_{plain} _y_{plain} _z_{plain}"))
        (tmp_path / "c.csv").write_text(text)
        for name, unit_given in (("b.csv", None), ("c.csv", word)):
            np.testing.assert_allclose(load_points(tmp_path / name, up="z", unit=unit_given).points, made, atol=1e-6)


@pytest.mark.parametrize("padding", ["", ",,"])
def test_cells_of_a_trc_stand_between_commas_too(tmp_path: Path, padding: str) -> None:
    """padding: appended to short lines, as spreadsheets write them."""
    write_trc(tmp_path / "a.trc", NAMES, points(), TIME)
    lines = (tmp_path / "a.trc").read_text().replace("\t", ",").splitlines()
    (tmp_path / "b.trc").write_text("\n".join(line + padding for line in lines) + "\n")
    first, second = load_points(tmp_path / "a.trc"), load_points(tmp_path / "b.trc")
    assert second.names == first.names
    assert second.notes == first.notes == ()
    np.testing.assert_array_equal(second.points, first.points)


def test_a_csv_without_times_is_counted_at_the_given_rate(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(csv_text(NAMES, 1e3 * points(), clock=""))
    for rate in (30.0, 59.94):
        track = load_points(tmp_path / "a.csv", unit="mm", up="z", fps=rate)
        np.testing.assert_allclose(track.points, points(), atol=1e-6)
        np.testing.assert_allclose(track.time, np.arange(FRAMES) / rate)


@pytest.mark.parametrize("count", [33, 553])
def test_arrays_of_mediapipes_points_have_its_names(tmp_path: Path, count: int) -> None:
    made = 1e3 * np.random.default_rng(count).uniform(0.2, 1.8, (FRAMES, count, 3))
    made[1, 11] = np.nan
    np.save(tmp_path / "a.npy", made)
    track = load_points(tmp_path / "a.npy", unit="mm", up="z", fps=30.0)
    body = FORMATS["mediapipe33"]
    assert track.names == tuple(name for name in body if name)
    for name in ("nose", "left_shoulder", "right_ankle", "left_big_toe"):
        np.testing.assert_allclose(track.points[:, track.names.index(name)], 1e-3 * made[:, body.index(name)])
    assert f"{count} points without names are read as MediaPipe's" in track.notes[0]
    assert f"{count - len(track.names)} that are not landmarks" in track.notes[0]


def test_names_beside_an_array_name_its_points(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", points())
    (tmp_path / "a.names.txt").write_text("\n".join(NAMES))
    track = load_points(tmp_path / "a.npy", unit="m", up="z", fps=RATE)
    assert track.names == NAMES
    np.testing.assert_array_equal(track.points, points())
    (tmp_path / "a.names.txt").write_text("\n".join(NAMES[:3]))
    with pytest.raises(InputError, match=r"a\.names\.txt: has 3 names, the points are 4"):
        load_points(tmp_path / "a.npy", unit="m", up="z", fps=RATE)


def test_files_of_the_same_instants_are_one(tmp_path: Path) -> None:
    write_trc(tmp_path / "a.trc", NAMES[:2], points()[:, :2], TIME)
    np.savez(tmp_path / "b.npz", points=1e3 * points()[:, 2:], names=np.array(NAMES[2:]), fps=RATE, unit="mm", up="z")
    track = load_points([tmp_path / "a.trc", tmp_path / "b.npz"])
    assert (track.names, track.source) == (NAMES, "a.trc, b.npz")
    np.testing.assert_allclose(track.points, points(), atol=1e-6)
    for change, message in (
        (
            {"fps": 50.0},
            "b.npz: is of other instants than a.trc: 5 frames at 50/s from 0 s on against 5 frames",
        ),
        ({"names": np.array(["LASI", "b"])}, "b.npz: the point 'LASI' is in a.trc, too"),
    ):
        content = dict(np.load(tmp_path / "b.npz")) | change
        np.savez(tmp_path / "b2.npz", **content)
        with pytest.raises(InputError, match=message.replace("b.npz", "b2.npz")):
            load_points([tmp_path / "a.trc", tmp_path / "b2.npz"])


def test_omissions_and_reinterpretations_are_noted(tmp_path: Path) -> None:
    made = points()
    made[1, 0], made[:, 3] = 0.0, np.nan
    names = ("LASI", "*12", "SACR", "LANK")
    write_trc(tmp_path / "a.trc", names, made, TIME)
    track = load_points(tmp_path / "a.trc")
    assert track.names == ("LASI", "SACR", "LANK")
    assert np.isnan(track.points[1, 0]).all()
    assert np.isfinite(track.points[[0, 2, 3, 4], 0]).all()
    for message in ("without a name left out: *12", "1 points at exactly zero", "never seen: LANK"):
        assert sum(message in note for note in track.notes) == 1
    text = (tmp_path / "a.trc").read_text().splitlines()
    (tmp_path / "b.trc").write_text("\n".join(text[:-1]))
    assert "4 frames, its header declares 5" in load_points(tmp_path / "b.trc").notes[0]
    (tmp_path / "c.c3d").write_bytes(c3d_file(("A", "*1", ""), 1e3 * points()[:, :3], rate=RATE))
    assert "2 points without a name" in load_points(tmp_path / "c.c3d", up="z").notes[0]
    for options, message in (
        ({"unit": "cm"}, "declares mm: --unit cm is used"),
        ({"fps": 50.0}, "100 frames .*--fps 50"),
    ):
        track = load_points(tmp_path / "a.trc", **options)  # type: ignore[arg-type]
        assert any(message.partition(" .*")[0] in note for note in track.notes)
    np.testing.assert_allclose(track.time, 2.0 * TIME)


def trc(change: Callable[[list[str]], object]) -> Callable[[Path], object]:
    """A TRC file with changed lines."""

    def write(path: Path) -> None:
        write_trc(path, NAMES, points(), TIME)
        lines = path.read_text().splitlines()
        change(lines)
        path.write_text("\n".join(lines) + "\n")

    return write


def set_line(number: int, old: str, new: str) -> Callable[[Path], object]:
    def change(lines: list[str]) -> None:
        assert old in lines[number - 1]
        lines[number - 1] = lines[number - 1].replace(old, new)

    return trc(change)


def npz(**arrays: Any) -> Callable[[Path], object]:
    whole = {"points": points(), "names": np.array(NAMES), "fps": RATE, "unit": "m", "up": "z"} | arrays
    return lambda path: np.savez(path, **{name: array for name, array in whole.items() if array is not None})


def npy(array: np.ndarray) -> Callable[[Path], object]:
    return lambda path: np.save(path, array)


def text(content: str) -> Callable[[Path], object]:
    return lambda path: path.write_text(content)


CSV = csv_text(NAMES, points())
FAULTS: list[tuple[str, Callable[[Path], object], str]] = [
    ("a.trc", set_line(3, "mm", "inch"), "line 3, Units: unknown unit 'inch' .one of mm, cm, m; or --unit gives it"),
    ("a.trc", set_line(3, "mm", "m"), "Units: its markers are spread over .* read in m .*--unit"),
    ("a.trc", set_line(3, "100", "60"), "time: its times have 100 frames per second, its header declares 60 .*--fps"),
    ("a.trc", set_line(8, "0.010000", "0.000000"), "frame 1: times do not rise: 0 s is followed by 0 s .*--fps"),
    ("a.trc", set_line(4, "RASI", "LASI"), "the point 'LASI' appears twice"),
    ("a.trc", set_line(4, "\t\t\tLANK", ""), "line 7: has 14 columns, 11 are expected"),
    ("a.trc", set_line(4, "LASI\t\t\tRASI", "ann:LASI\t\t\tbob:RASI"), "markers of several people: 'ann, bob'"),
    ("a.trc", trc(lambda lines: lines.__setitem__(slice(6, None), [])), "has no points"),
    ("a.npz", npz(points=np.full((2, 4, 3), np.nan)), "all are missing"),
    ("a.npz", npz(unit=None), "does not declare its unit of length .--unit"),
    ("a.npz", npz(unit="furlong"), "unknown unit 'furlong'"),
    ("a.npz", npz(fps=None), "neither times nor frames per second .--fps"),
    ("a.npz", npz(fps=0.0), "fps: must be 0.5 to 2000, got 0"),
    ("a.npz", npz(time=TIME * 2), "its times have 50 frames per second, its header declares 100"),
    ("a.npz", npz(time=TIME[:3]), "has 3 times of 5 frames"),
    ("a.npz", npz(up="up"), "up: 'up' is not an axis"),
    ("a.npz", npz(names=np.array(NAMES[:2])), "2 names do not fit an array of shape"),
    ("a.npz", npz(points=None), "has no arrays points and names"),
    ("a.npz", npz(points=np.where(np.isnan(points()), np.inf, points())), "frame 2, 'RASI': is infinite, or at least"),
    ("a.npz", npz(names=np.array(["*1", "U2", "unlabeled", "Unlabeled_3"])), "has no points with a name"),
    ("a.csv", text("x\n1\n"), "line 1: has no points"),
    ("a.csv", text("# unit=m\n# up=z\n"), "has no columns"),
    ("a.csv", text(csv_text(NAMES, points(), clock="")), "neither times nor frames per second .--fps"),
    ("a.npy", npy(points()[:, :3]), "has 3 points without names .33 or 553 .*a.names.txt"),
    ("a.npy", npy(points()[..., :2]), "has the shape .5, 4, 2. ..frames, points, 3. is needed"),
    ("a.csv", text("time,a\n1,2\n"), "line 1: has no points .columns NAME_x, NAME_y and NAME_z"),
    ("a.csv", text(CSV.replace("LASI_z", "LASI_w")), "the point 'LASI' has no column z"),
    ("a.csv", text(CSV.replace("RASI_x", "LASI.x")), "two columns x of the point 'LASI'"),
    ("a.csv", text(CSV.replace("LASI_x", "LASI_x_mm").replace("LASI_y", "LASI_y_cm")), "columns in cm and mm"),
    ("a.csv", text(CSV), "does not declare its unit of length .--unit"),
    ("a.csv", text("# up=w\n" + CSV), "'w' is not an axis"),
    ("a.csv", text("# unit=m\n" + CSV.replace("0.02,", "oops,")), "not a number"),
    ("a.csv", text(csv_text(NAMES, points(), clock="frame")), "neither times nor frames per second .--fps"),
    ("a.c3d", lambda path: path.write_bytes(c3d_file(NAMES, 1e3 * points(), rate=RATE)[:-400]), "within its 5 frames"),
    ("a.c3d", lambda path: path.write_bytes(c3d_file(NAMES, 1e3 * points(), rate=0.0)), "--fps"),
    ("a.bvh", text("HIERARCHY"), "is not a file of points .one of .trc, .c3d, .npz, .npy, .csv"),
    ("a.trc", lambda path: None, "no such file"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "write", "message"), FAULTS, ids=[f"{name}: {message[:40]}" for name, _, message in FAULTS]
)
def test_faults_are_one_line(tmp_path: Path, name: str, write: Callable[[Path], object], message: str) -> None:
    write(tmp_path / name)
    with pytest.raises(InputError, match=message):
        load_points(tmp_path / name)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"up": "w"}, "up: 'w' is not an axis"),
        ({"unit": "ft"}, "unit: 'ft' is not a unit"),
        ({"fps": -1.0}, "fps: must be"),
    ],
)
def test_invalid_options(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_points(tmp_path / "a.trc", **options)
    with pytest.raises(InputError, match="no file is given"):
        load_points([])


def test_options_repair_a_file(tmp_path: Path) -> None:
    """Each remedy named by an error makes the file readable."""

    def read(name: str, write: Callable[[Path], object], **options: Any) -> MarkerTrack:
        write(tmp_path / name)
        return load_points(tmp_path / name, **options)

    for track in (
        read("a.trc", set_line(3, "mm", "inch"), unit="mm"),
        read("a.trc", set_line(3, "mm", "m"), unit="mm"),
        read("a.trc", set_line(3, "100", "60"), fps=100.0),
        read("a.trc", set_line(8, "0.010000", "0.000000"), fps=100.0),
        read("a.csv", text(csv_text(NAMES, points(), clock="frame")), fps=100.0, unit="m", up="z"),
        read("a.npz", npz(fps=None, unit=None), fps=100.0, unit="m"),
    ):
        np.testing.assert_allclose(track.points, points(), atol=1e-6)
        np.testing.assert_allclose(track.time, TIME, atol=1e-6)


OUTPUTS = {
    "angles": ("LKneeAngles", "RHipAngles", "LPelvisAngles", "RFootProgressAngles", "LAbsAnkleAngle", "R_Elbow_Angles"),
    "forces": ("LKneeForce", "RGroundReactionForce", "LNormalisedGRF", "RNormalizedGRF", "RWaistForce"),
    "moments": ("LKneeMoment", "RGroundReactionMoment", "left_hip_moment", "LANKLEMOMENT"),
    "powers": ("LKneePower", "RShoulderPower", "RAnklePowers"),
    "centres of mass": ("CentreOfMass", "CenterOfMass", "CentreOfMassFloor"),
}
OF_MARKERS = (  # bony landmarks and objects that markers are named after
    "RInferiorAngle", "LAcromialAngle", "ScapulaInfAngle", "LJawAngle", "SternalAngle", "AngulusInferior",
    "ForcePlate1", "LForceShoe", "PowerDrill", "LHeelForce", "KneeAnglesMarker", "CentreOfMassPlate", "LKnee", "LKNE",
    "Moment1",
)  # fmt: skip


def test_outputs_of_a_gait_model_are_recognised_by_their_names() -> None:
    for kind, names in OUTPUTS.items():
        assert [output_kind(name) for name in (*names, *(f"ann:{name}" for name in names))] == 2 * len(names) * [kind]
    assert [output_kind(name) for name in OF_MARKERS] == [None] * len(OF_MARKERS)


def write_with_outputs(path: Path, outputs: tuple[str, ...], subject: str = "") -> None:
    """The markers with outputs of a model among them, far from any body, as moments in N mm are."""
    far = 3e4 * np.random.default_rng(len(outputs)).normal(size=(FRAMES, len(outputs), 3))
    names = tuple(subject + name for name in (*NAMES[:2], *outputs, *NAMES[2:]))
    all_points = np.concatenate([points()[:, :2], far / 1e3, points()[:, 2:]], axis=1)
    if path.suffix == ".trc":
        write_trc(path, names, all_points, TIME)
    elif path.suffix == ".csv":
        path.write_text("# unit=mm\n# up=z\n" + csv_text(names, 1e3 * all_points))
    else:
        path.write_bytes(c3d_file(names, 1e3 * all_points, up="+Z", rate=RATE, first=1, whole=False))


@pytest.mark.parametrize("kind", ["c3d", "trc", "csv"])
def test_outputs_of_a_gait_model_are_left_out_with_a_note(tmp_path: Path, kind: str) -> None:
    for outputs, subject, counts in (
        (("LKneeAngles", "LKneeMoment", "RKneeMoment", "CentreOfMass"), "", "4 .*angles 1, moments 2, centres"),
        (("RHipAngles", "LHipAngles", "RHipPower", "LNormalisedGRF"), "ann:", "4 .*angles 2, forces 1, powers 1"),
    ):  # fmt: skip
        path = tmp_path / f"a.{kind}"
        write_with_outputs(path, outputs, subject if kind != "csv" else "")
        track = load_points(path)
        assert track.names == NAMES == point_names(path)
        np.testing.assert_allclose(track.points, points(), atol=1e-5)
        assert len(track.notes) == 1
        assert re.search(counts, track.notes[0]), track.notes


def test_a_file_of_outputs_alone_has_no_points(tmp_path: Path) -> None:
    write_trc(tmp_path / "a.trc", ("LKneeAngles", "RKneeAngles"), points()[:, :2], TIME)
    with pytest.raises(InputError, match=r"has no points .2 outputs of a gait model .angles 2. are left out"):
        load_points(tmp_path / "a.trc")


def test_a_reference_of_markers_leaves_outputs_of_a_model_out(tmp_path: Path) -> None:
    write_with_outputs(tmp_path / "a.trc", ("LKneeAngles", "LKneeForce"))
    reference = load_reference(tmp_path / "a.trc")
    assert reference.names == NAMES
    assert "angles 1, forces 1" in reference.notes[-1]
