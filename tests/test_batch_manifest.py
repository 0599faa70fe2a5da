"""Manifests of batches: read whole, every fault named with its row, and no clip started where there is one."""

from __future__ import annotations

import inspect
import json
import pickle
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, get_origin

import pytest
import tomli_w

import kinemode as km
from humanoid.support.errors import InputError
from kinemode import __main__ as front, cli
from kinemode.batches import columns
from kinemode.batches.manifest import BatchRow, read_manifest, rows_of
from kinemode.batches.tables import ManifestError
from kinemode.flags import flag_types
from kinemode.option import options_of
from kinemode.request import DetectorOptions, PointOptions, TrackRequest

FILES = ("a.mp4", "b.mp4", "my walk.mp4", "a.json", "b.json", "cameras.json", "me.urdf", "a=b.mp4", "truth.npz")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Empty files that a manifest may name."""
    for name in FILES:
        (tmp_path / name).write_text("")
    return tmp_path


def read(folder: Path, text: str, name: str = "manifest.csv") -> tuple[BatchRow, ...]:
    (folder / name).write_text(text, encoding="utf-8")
    return read_manifest(folder / name)


def faults_of(folder: Path, text: str | bytes, name: str = "manifest.csv") -> list[str]:
    """The faults of a manifest, each without the file's name, and its place."""
    (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ManifestError) as caught:
        read_manifest(folder / name)
    assert all(fault.source == str(folder / name) for fault in caught.value.faults)
    lines = str(caught.value).split("\n")
    assert len(lines) == 1 + len(caught.value.faults)
    assert f"{len(lines) - 1} fault" in lines[0]
    return [f"{fault.place}: {fault.problem}" for fault in caught.value.faults]


EVERYTHING_WRONG = """\
name,clips,hight,cameras,person,height,fits,fit,tracker,subject,fps,out,detector,person-id
a,a.mp4,,nowhere.json,Anna,1.8,yes,,,,0,,,all
A,b.mp4,,,Anna,1.9,yes,x,css2,,,,onnx,

,,,,,,,,,human35,,,,
q,x=a.mp4 gone.mp4,,,Bob,99,,,,,,,,,beyond
../x,a.mp4 a.mp4,,,,,yes,,,,,,\x1b[31m,
.,'a.mp4,,,,much,,,,,,,,
"""


def test_all_faults_are_named_at_once(folder: Path) -> None:
    faults = faults_of(folder, EVERYTHING_WRONG)
    for place, problem in (
        ("row 1", "there is no column 'hight'"),
        ("row 1", "'out' is not of a clip"),
        ("row 2, column cameras", "no such file: 'nowhere.json'"),
        ("row 2, column fps", "'0' cannot be used"),
        ("row 2, column person_id", "all people in the clip, and the column person has 'Anna'"),
        ("row 3, column height", "1.9 for 'Anna', for whom row 2 has 1.8"),
        ("row 3, column name", "row 2 has the name 'A' too but for case"),
        ("row 3, column fits", "'Anna' is fitted from row 2 already"),
        ("row 3, column fit", "'x' is not taken"),
        ("row 3, column tracker", "no tracker 'css2'"),
        ("row 3, column detector", "is for --detect, which is not given"),
        ("row 5, column subject", "there is no subject 'human35'"),
        ("row 5", "neither clips nor keypoints"),
        ("row 6, column clips", "no such clip: 'gone.mp4'"),
        ("row 6, column height", "must be"),
        ("row 6", "has 15 cells, the head has 14: 'beyond'"),
        ("row 7, column name", "'../x' is not a valid folder name"),
        ("row 7", "has the name 'a' too"),
        ("row 7, column fits", "is for clips of a person"),
        ("row 8, column clips", "unclosed quotation mark"),
        ("row 8, column height", "'much' is not taken"),
        ("row 8, column name", "'.' is not a valid folder name"),
    ):
        hits = [i for i, fault in enumerate(faults) if fault.startswith(f"{place}: ") and problem in fault]
        assert len(hits) == 1, (place, problem, faults)
        faults.pop(hits[0])
    assert [fault.split(":")[0] for fault in faults] == ["row 7, column detector"]  # no false positives


def test_an_error_crosses_processes_and_is_printed_whole(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "m.csv").write_text("clips,up\x1b[31m\na.mp4,1\nb.mp4,\ngone.mp4\x1b[2J,\n")
    with pytest.raises(ManifestError) as caught:
        read_manifest(folder / "m.csv")
    again = pickle.loads(pickle.dumps(caught.value))
    assert type(again) is ManifestError
    assert str(again) == str(caught.value)
    assert [f.__reduce__()[1] for f in again.faults] == [f.__reduce__()[1] for f in caught.value.faults]

    def refuse(arguments: list[str]) -> None:
        read_manifest(arguments[0])

    monkeypatch.setattr("kinemode.cli.run_command", refuse)
    assert front.main([str(folder / "m.csv")]) == front.BAD_INPUT
    head, *lines = capsys.readouterr().err.splitlines()
    assert head == f"error: {folder / 'm.csv'}: 2 faults, nothing was started"
    assert [line.split(":")[0] for line in lines] == ["  row 1", "  row 4, column clips"]
    assert "\\x1b[2J" in lines[1]
    assert all(line.isprintable() for line in (head, *lines))


@pytest.mark.parametrize(
    ("name", "text", "fault"),
    [
        ("m.csv", "", ": lists no clips"),
        ("m.csv", "clips,height\n", ": lists no clips"),
        ("m.csv", b"clips\nm\xfcller.mp4\n", "line 2: is not in UTF-8"),
        ("m.csv", 'clips,name\n"a.mp4,b\n', "row 2: is not CSV"),
        ("m.csv", "clips,clips\na.mp4,b.mp4\n", "row 1, column clips: appears twice"),
        ("m.csv", "clips,\na.mp4,x\n", "row 2: 'x' is in a column without a name"),
        ("m.txt", "clips\na.mp4\n", ": '.txt' is not the ending of a manifest"),
        ("m.toml", "[[clip]]\nclips =\n", "line 2: is not TOML"),
        ("m.toml", "[clip]\nclips = 'a.mp4'\n", ": clip is not a list of tables"),
        ("m.toml", "[[clips]]\n", ": there is no 'clips'"),
        ("m.toml", "[[clip]]\nclips='a.mp4'\n[people.Bob]\nheight=1.8", "[people.Bob]: no clip is of the person 'Bob'"),
        ("m.toml", "[[clip]]\nclips='a.mp4'\nup=2024-01-01", "row 1, column up: is of type date"),
        ("m.toml", "[[clip]]\nclips='a.mp4'\n[defaults]\nname='a'", "[defaults], column name: does not stand here"),
    ],
)
def test_files_that_are_not_manifests(folder: Path, name: str, text: str | bytes, fault: str) -> None:
    assert any(line.startswith(fault) for line in faults_of(folder, text, name)), faults_of(folder, text, name)


def test_rows_are_lines_of_the_file(folder: Path) -> None:
    """Also below a cell of two lines; the backslashes of Windows paths are kept."""
    text = 'clips,name,detect,detector\n"a.mp4\nb.mp4",a,,\n\n"gone\\x.mp4 b.mp4",b,maybe,onnx\n'
    assert faults_of(folder, text) == [
        "row 5, column clips: there is no such clip: 'gone\\\\x.mp4'",
        "row 5, column detect: 'maybe' is not taken",
    ]


def test_a_fault_common_to_all_rows_is_reported_once(folder: Path) -> None:
    text = "[defaults]\nheight = 9.0\ncameras = 'gone.json'\nfps = 'x'\n" + "[[clip]]\nclips = ['a.mp4']\n" * 1
    text += "[[clip]]\nclips = 'b.mp4'\nheight = 1.7\n"
    assert sorted(fault.split(":")[0] for fault in faults_of(folder, text, "m.toml")) == [
        "[defaults], column cameras",
        "[defaults], column fps",
        "[defaults], column height",
    ]


def test_csv_and_toml_are_equivalent(folder: Path) -> None:
    table = [
        {"name": "first", "clips": ["x=a.mp4", "y=b.mp4"], "cameras": "cameras.json", "person": "Anna", "height": 1.75,
         "keypoints": ["x=a.json", "y=b.json"], "fps": ["x=30", "y=60"], "reference": "truth.npz"},
        {"clips": ["my walk.mp4"], "detect": True, "people": 2, "phone": "iPhone 12 Pro", "start": "index"},
        {"clips": ["a.mp4"], "person": "Anna", "cues": "off", "seed": 3, "floor": 0.5},
    ]  # fmt: skip
    head = list(dict.fromkeys(key for row in table for key in row))
    separated = {
        "m.csv": ",".join(head).replace("keypoints", "Keypoints"),
        "semicolons.csv": "\ufeff" + ";".join(head),
        "tabs.csv": "\t".join(f"--{name}" for name in head),
    }
    rows = read(folder, tomli_w.dumps({"clip": table}), "m.toml")
    for name, first in separated.items():
        separator = {"m.csv": ",", "semicolons.csv": ";", "tabs.csv": "\t"}[name]
        lines = [separator.join(cell(row.get(key, "")) for key in head) for row in table]
        read_rows = read(folder, "\r\n".join([first, *lines, "", ""]), name)
        assert without_places(read_rows) == without_places(rows)
        assert [row.place for row in read_rows] == ["row 2", "row 3", "row 4"]
    assert [row.place for row in rows] == ["row 1", "row 2", "row 3"]
    assert without_places(rows_of(table, folder=folder)) == without_places(rows)


def cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    several = isinstance(value, list)
    return " ".join(f"'{part}'" if " " in part else part for part in value) if several else str(value)


def without_places(rows: Iterable[BatchRow]) -> list[dict[str, Any]]:
    return [{name: value for name, value in vars(row).items() if name != "place"} for row in rows]


def test_what_a_row_becomes(folder: Path) -> None:
    """Only given values, in the form that `kinemode.track` takes and JSON stores; paths are relative to the manifest's
    folder."""
    (folder / "below").mkdir()
    table = {"clips": ["c=../a.mp4", "../a=b.mp4"], "keypoints": "c=../a.json", "detect": "yes", "detector": "onnx",
             "model": "../a.json", "mask": "c=../b.mp4", "cameras": "auto", "lenses": "../cameras.json", "seed": 0,
             "person-id": ["c=3", "1"]}  # fmt: skip
    (row,) = read(folder / "below", tomli_w.dumps({"clip": [table]}), "m.toml")
    assert row.clips == (f"c={folder / 'a.mp4'}", f"{folder / 'a=b.mp4'}")
    assert row.options == {
        "keypoints": [f"c={folder / 'a.json'}"],
        "detect": True,
        "detector": "onnx",
        "model": f"{folder / 'a.json'}",
        "mask": [f"c={folder / 'b.mp4'}"],
        "cameras": "auto",
        "lenses": f"{folder / 'cameras.json'}",
        "seed": 0,
        "person": ["c=3", "1"],
    }
    assert json.loads(json.dumps(row.options)) == row.options
    inspect.signature(km.track).bind(row.subject, row.clips, **row.options)
    assert read_manifest(folder / "below" / "m.toml") == (row,)


@pytest.mark.parametrize(
    ("cells", "name"),
    [
        ({"clips": "a.mp4"}, "a"),
        ({"clips": "my walk.mp4"}, "my_walk"),
        ({"clips": "below"}, "below"),
        ({"keypoints": "x=b.json"}, "b"),
        ({"clips": ["below/1.mp4", "y=below/2.mp4"]}, "below"),
        ({"clips": "a.mp4", "name": "Größe-1.x"}, "Größe-1.x"),
    ],
)
def test_names(folder: Path, cells: dict[str, Any], name: str) -> None:
    (folder / "below").mkdir()
    for number in "12":
        (folder / "below" / f"{number}.mp4").write_text("")
    assert rows_of([cells], folder=folder)[0].name == name


def test_a_person_has_one_subject_and_one_height(folder: Path) -> None:
    """A value given once for a person holds for all their clips and overrides the defaults of the batch."""
    rows = [{"name": n, "clips": "a.mp4", "person": p} for n, p in zip("abcde", ("A", "A", "B", "B", ""), strict=True)]
    rows[1]["height"] = "1.6"
    text = tomli_w.dumps({"clip": rows, "defaults": {"height": 1.8}, "people": {"B": {"height": 1.9}}})
    read_rows = read(folder, text, "m.toml")
    assert [row.options["height"] for row in read_rows] == [1.6, 1.6, 1.9, 1.9, 1.8]
    assert [row.fits for row in read_rows] == [True, False, True, False, False]


@pytest.mark.parametrize(
    ("cells", "fitting"),
    [
        ([{}, {}], [True, False]),
        ([{}, {"fits": "yes"}], [False, True]),
        ([{"fits": False}, {}], [False, True]),
        ([{"fit": "off"}, {}], [False, True]),
        ([{"subject": "me.urdf"}, {}], [False, False]),
        ([{"subject": "human30"}, {}], [True, False]),
    ],
)
def test_which_clip_a_person_is_fitted_from(folder: Path, cells: list[dict[str, Any]], fitting: list[bool]) -> None:
    rows = rows_of(
        [{"name": str(i), "clips": "a.mp4", "person": "A", **row} for i, row in enumerate(cells)], folder=folder
    )
    assert [row.fits for row in rows] == fitting
    assert len({row.subject for row in rows}) == 1


def test_a_subject_that_is_a_file_is_not_fitted(folder: Path) -> None:
    rows = [{"clips": "a.mp4", "person": "A", "fits": "yes", "subject": "me.urdf"}]
    with pytest.raises(ManifestError, match=r"column fits: the subject .*me.urdf' is taken as measured"):
        rows_of(rows, folder=folder)


A_VALUE = {"detect": "yes", "floor": "off", "start": "index", "sync": "auto", "fit": "off", "up": "z", "cues": "off",
           "detector": "onnx", "tracker": "css", "phone": "iPhone13,3", "layout": "coco17", "focal": "26mm",
           "person": "a=1", "keypoint_size": "a=960x540", "keypoint_noise": "a=3",
           "fps": "a=30", "offset": "a=0.5", "stereo": "a=b",
           "subject": "human30", "height": "1.8", "end": "2", "modes": "3", "seed": "1", "people": "1",
           "markers": "opencap", "unit": "mm"}  # fmt: skip


OF_POINTS = list(options_of(PointOptions))


def option_names() -> list[str]:
    """Every option of `track` on the command line."""
    return [name for name in flag_types(TrackRequest) if name not in ("clips", *columns.OF_THE_BATCH)]


@pytest.mark.parametrize("name", option_names())
def test_every_option_of_track_is_a_column(folder: Path, name: str) -> None:
    """A column has the option's command-line name, and its value reaches `kinemode.track`."""
    row: dict[str, Any] = {"clips": "a.mp4"}
    column = "person-id" if name == "person" else name.replace("_", "-")
    if name in options_of(DetectorOptions):
        row |= {"detect": "yes", "detector": "onnx", "model": "a.json"}
    if name == "lenses":
        row["cameras"] = "auto"
    if name in OF_POINTS:
        row = {"points": "b.json", "name": "a"}
    if name == "settings":
        (folder / "cameras.json").write_text("")
    (read_row,) = rows_of([row | {column: A_VALUE.get(name, "cameras.json")}], folder=folder)
    given = dict(read_row.options)
    given["subject"] = read_row.subject
    assert name in given
    assert name in A_VALUE or "cameras.json" in str(given[name])
    with pytest.raises(ManifestError, match=rf"row 1, column {column.replace('-', '_')}: "):
        rows_of([row | {column: {"a": object()}}], folder=folder)


@pytest.mark.parametrize("name", sorted(A_VALUE.keys() - {"detect", "detector", "people"}))
def test_a_value_is_that_of_the_command_line(name: str) -> None:
    option = f"--{name.replace('_', '-')}"
    line = ["track", "a.mp4", "--out", "a.run", option, A_VALUE[name]]
    _, bound, _ = cli.app.parse_args(line, exit_on_error=False, print_error=False)
    expected = bound.arguments[name]
    what = "points" if name in OF_POINTS else "keypoints"
    (row,) = rows_of([{what: str(Path(__file__)), "person-id" if name == "person" else name: A_VALUE[name]}])
    value = (dict(row.options) | {"subject": row.subject})[name]
    assert value == (list(expected) if isinstance(expected, tuple) else expected)
    assert type(value) in (str, int, float, list)


def test_lists_of_texts_are_files_or_values() -> None:
    """A new option that takes a list declares its kind, so that relative paths in it start in the manifest's folder."""
    for declared in options_of(TrackRequest).values():
        assert bool(declared.files) == bool({"Named", "Clips", "Keypoints"} & {*declared.parts})
    assert all(get_origin(kind) is not dict for c in columns.columns().values() for kind in c.kinds)


@pytest.mark.parametrize(
    ("cells", "fault"),
    [
        ({"detector": "yolo"}, "detector: 'yolo' is unknown"),
        ({"detector": "onnx"}, "model: onnx needs a model"),
        ({"model": "a.json"}, "model: mediapipe brings its own"),
        ({"people": 0}, "people: must be 1 or more, got 0"),
        ({"clips": "", "keypoints": "a.json"}, "detect: there is no clip"),
    ],
)
def test_unusable_detectors(folder: Path, cells: dict[str, Any], fault: str) -> None:
    with pytest.raises(ManifestError, match=f"1 fault, nothing was started\n  row 1, column {fault}"):
        rows_of([{"clips": "a.mp4", "detect": True} | cells], folder=folder)


def test_missing_files_are_reported_without_heavy_imports(folder: Path) -> None:
    program = (
        "import sys; from kinemode.batches.manifest import rows_of\n"
        "try: rows_of([{'clips': 'gone.mp4', 'keypoints': 'gone.json', 'fps': '30'}])\n"
        "except ValueError as error: print(len(error.faults))\n"
        "print([m for m in ('pinocchio', 'numba', 'cv2', 'numpy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["2", "[]"]


def test_a_fault_is_an_input_error() -> None:
    assert issubclass(ManifestError, InputError)
    with pytest.raises(InputError, match="row 1: is of type int"):
        rows_of([3])  # type: ignore[list-item]


def test_rows_of_points(folder: Path) -> None:
    """As `kinemode track --points` takes them; a file of markers starts in the manifest's folder, a set has a name."""
    (folder / "own.toml").write_text('[markers.C7]\nlink = "thorax"\nxyz = [0, 0, 0]\nstd = 0.01\n')
    walk, rest = rows_of(
        [
            {"points": ["a.json", "b.json"], "name": "walk", "markers": "own.toml", "unit": "mm", "static": "b.json"},
            {"points": "a.json", "markers": "cast", "fps": "100", "up": "y"},
        ],
        folder=folder,
    )
    files = [str(folder / name) for name in ("a.json", "b.json")]
    assert walk.options == {"points": files, "markers": str(folder / "own.toml"), "unit": "mm", "static": files[1:]}
    assert rest.name == "a"
    assert rest.options == {"points": files[:1], "markers": "cast", "fps": ["100"], "up": "y"}


@pytest.mark.parametrize(
    ("cells", "fault"),
    [
        ({"points": "a.json", "clips": "a.mp4"}, "is of cameras, and points are given"),
        ({"points": "a.json", "cameras": "cameras.json"}, "is of cameras, and points are given"),
        ({"points": "a.json", "fit": "proportions"}, "'proportions' is of keypoints"),
        ({"points": "a.json", "static": "b.json", "fit": "off"}, "is for the fit"),
        ({"points": "a.json", "markers": "no-such-set"}, "is not a set of markers"),
        ({"points": "a.json", "markers": "none.toml"}, "there is no such file: 'none.toml'"),
        ({"points": "none.trc"}, "there is no such file of points: 'none.trc'"),
        ({"points": "a.json", "unit": "inch"}, "'inch'"),
        ({"clips": "a.mp4", "unit": "mm"}, "is for points, which are not given"),
        ({"clips": "a.mp4", "static": "b.json"}, "is for points, which are not given"),
        ({"keypoints": "a.json", "fit": "markers"}, "no points are given"),
    ],
)
def test_what_does_not_belong_to_points(folder: Path, cells: dict[str, Any], fault: str) -> None:
    with pytest.raises(ManifestError, match=f"row 1, column .*: .*{fault}"):
        rows_of([cells], folder=folder)
