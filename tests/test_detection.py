"""Keypoints by a detector in its own environment. Unless stated otherwise the detector is a small one for the tests,
which finds coloured squares, and uv is a script that makes an environment of this Python."""

from __future__ import annotations

import json
import os
import re
import stat
import subprocess
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import uv

import kinemode as km
from estimator.data.formats.keypoints import load_people
from estimator.data.media.clip import Clip
from humanoid.support.errors import InputError
from kinemode.__main__ import main
from kinemode.detection import detectors, process as detector_process
from kinemode.detection.clip import write_people
from kinemode.detection.detectors import SCRIPTS, About, DetectorChoice, Patience
from kinemode.detection.people import People, Search, shared
from kinemode.detection.process import DetectorProcess
from kinemode.detection.scripts.mediapipe_pose import steadied, turned_square
from kinemode.detection.scripts.onnx_pose import decoded, window
from kinemode.progress import unreported
from kinemode.public.detection import with_detected
from kinemode.request import FileOptions
from tests.test_door import STANDARD, imported
from tests.tiny_onnx import constant_boxes, two_colours
from tests.waiting import DEADLINE

FAKE = """
# /// script
# requires-python = ">=3.10,<3.99"
# dependencies = ["{package}"]
# ///
import sys
import numpy as np

sys.path.insert(0, {scripts!r})
import serving

COLOURS = ((255, 0, 0), (0, 0, 255))
GRID = np.stack(np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 4)), axis=-1).reshape(-1, 2)[:17]


class Squares:
    about = {{"layout": None, "names": None}}

    def __init__(self, options):
        print("libraries print what they like", flush=True)

    def search(self, picture, parts):
        seen = [self.look(picture, {{"colour": k, "looks": -1}}) for k in range(2)]
        return [person["state"] for person in seen if person]

    def look(self, picture, state):
        rows, columns = np.nonzero((picture == COLOURS[state["colour"]]).all(axis=2))
        if not len(rows):
            return None
        looks, size = state["looks"] + 1, [picture.shape[1], picture.shape[0]]
        middle, half = np.array([columns.mean(), rows.mean()]), 0.5 * np.array([np.ptp(columns), np.ptp(rows)])
        points = middle + GRID * half
        box = [*((middle - half) / size), *((middle + half) / size)]
        keypoints = [[*point, 1 / (2 + looks)] for point in points.tolist()]
        return {{"keypoints": keypoints, "state": {{"colour": state["colour"], "looks": looks, "box": box}}}}


serving.main(Squares)
"""
UV = """#!/bin/sh
echo "$@" >> {log}
if [ "$2" = pip ]; then {answer}; exit; fi
for last; do :; done
mkdir -p "$last/bin"
printf '#!/bin/sh\\nexec {python} "$@"\\n' > "$last/bin/python"
chmod +x "$last/bin/python"
"""


PATIENCE = Patience(answer=DEADLINE, end=DEADLINE, python=DEADLINE, installation=DEADLINE)


class Fake:
    """The detector "fake", a uv that logs its arguments, and a separate cache."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch) -> None:
        self.script, self.log, self.cache = folder / "fake.py", folder / "uv.log", folder / "cache"
        self.uv = folder / "bin" / "uv"
        self.uv.parent.mkdir()
        patch.setattr(detector_process, "find_uv_bin", lambda: str(self.uv))
        patch.setenv("KINEMODE_CACHE", str(self.cache))
        self.waits(patch, PATIENCE)
        self.needs("squares==1.0")
        self.answers("true")

    def waits(self, patch: pytest.MonkeyPatch, patience: Patience) -> None:
        patch.setitem(detectors.DETECTORS, "fake", About(str(self.script), False, patience))

    def needs(self, package: str) -> None:
        self.script.write_text(FAKE.format(package=package, scripts=str(SCRIPTS)).lstrip())

    def answers(self, command: str) -> None:
        """The behaviour of the package installation."""
        self.uv.write_text(UV.format(log=self.log, answer=command, python=sys.executable))
        self.uv.chmod(self.uv.stat().st_mode | stat.S_IXUSR)

    @property
    def calls(self) -> list[str]:
        return self.log.read_text().splitlines() if self.log.exists() else []

    def python(self) -> Path:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", km.InputWarning)
            return detector_process.python_for("fake", self.script, patience=PATIENCE)


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Fake:
    return Fake(tmp_path, monkeypatch)


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DetectorProcess]:
    """A detector process, which remembers nothing from one clip to the next."""
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore", km.InputWarning)
        Fake(tmp_path_factory.mktemp("running"), patch)
        process = DetectorProcess(DetectorChoice("fake"))
    with process:
        yield process


@pytest.fixture
def started(fake: Fake, running: DetectorProcess, monkeypatch: pytest.MonkeyPatch) -> Fake:
    """The detector, its process already running."""
    monkeypatch.setattr("kinemode.detection.clip.DetectorProcess", lambda wanted: nullcontext(running))
    return fake


def places(count: int) -> np.ndarray:
    """Middles (T, 2, 2) [px] of the two squares."""
    steps = np.arange(count)
    return np.stack([np.stack([20 + 2 * steps, 30 + 0 * steps], 1), np.stack([90 - steps, 60 + 0 * steps], 1)], axis=1)


def drawn(folder: Path, count: int = 12, squares: int = 2) -> Path:
    folder.mkdir()
    for i, middles in enumerate(places(count)):
        picture = np.zeros((80, 120, 3), np.uint8)
        for (x, y), colour in list(zip(middles, ((255, 0, 0), (0, 0, 255)), strict=True))[:squares]:
            picture[y - 8 : y + 9, x - 6 : x + 7] = colour
        cv2.imwrite(str(folder / f"{i}.png"), picture)
    return folder


pytestmark = pytest.mark.filterwarnings("ignore::kinemode.InputWarning")


def test_an_environment_is_made_once_per_pin(fake: Fake) -> None:
    with pytest.warns(km.InputWarning, match=r"^fake gets an environment of its own, once") as caught:
        python = detector_process.python_for("fake", fake.script, patience=PATIENCE)
    assert len(caught) == 1
    assert python.is_file()
    assert [call.split()[1] for call in fake.calls] == ["venv", "pip"]
    assert "--python >=3.10,<3.99" in fake.calls[0]
    assert fake.calls[1].split()[-2:] == ["--requirements", str(fake.script)]
    assert "--no-deps" in fake.calls[1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert detector_process.python_for("fake", fake.script, patience=PATIENCE) == python
    assert len(fake.calls) == 2
    fake.script.write_text(fake.script.read_text() + "# changed\n")
    assert fake.python() == python
    fake.needs("squares==1.1")
    assert fake.python().parent != python.parent
    assert len(fake.calls) == 4


def test_an_unfinished_environment_is_made_again(fake: Fake) -> None:
    fake.answers("printf 'noise\\nerror: Failed\\n  cause: no network\\n\\nhint: because\\n' >&2; false")
    for _ in range(2):
        with pytest.raises(InputError, match=r"^fake: cannot be installed: cause: no network \(.*--python"):
            fake.python()
    (half,) = [path for path in fake.cache.iterdir() if path.is_dir()]
    (half / "left").touch()
    fake.answers("true")
    python = fake.python()
    assert [path for path in fake.cache.iterdir() if path.is_dir()] == [python.parent.parent]
    assert not (python.parent.parent / "left").exists()
    python.unlink()  # its Python no longer exists
    assert fake.python().is_file()


def test_an_installation_that_takes_too_long_is_ended(fake: Fake) -> None:
    fake.answers("exec sleep 20")
    with pytest.raises(InputError, match=r"^fake: was not installed within 0 minutes \(it needs a network"):
        detector_process.python_for("fake", fake.script, patience=Patience(installation=0.5))
    assert detector_process.made_python("fake", fake.script) is None


def test_a_read_only_cache_is_named(fake: Fake, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detector_process, "cache_folder", lambda: fake.script)
    with pytest.raises(InputError, match=r"cannot be made: Not a directory \(KINEMODE_CACHE names another\)"):
        fake.python()


def test_a_python_that_is_named_is_used_or_refused(fake: Fake, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The real uv reports whether it has the packages; if not, the environment is made by installing them."""
    this = Path(sys.executable)
    monkeypatch.setattr(detector_process, "find_uv_bin", uv.find_uv_bin)
    fake.needs(f"numpy=={np.__version__}")
    assert detector_process.python_for("fake", fake.script, this, PATIENCE) == this
    assert not fake.cache.exists()
    with pytest.raises(InputError, match=r"fake\.py: is not a Python \(name the file of a CPython >=3\.10,<3\.99\)"):
        detector_process.python_for("fake", fake.script, tmp_path / "fake.py", PATIENCE)
    fake.needs("numpy==1.0")
    monkeypatch.setattr(detector_process, "find_uv_bin", lambda: str(fake.uv))
    fake.answers('case "$*" in *--dry-run*) false ;; esac')
    assert detector_process.python_for("fake", fake.script, this, PATIENCE).is_relative_to(fake.cache)
    assert f"--python {this} " in fake.calls[1]
    monkeypatch.setattr(detector_process, "find_uv_bin", uv.find_uv_bin)
    assert not detector_process._has_packages(this, fake.script, DEADLINE)


def test_what_leads_to_our_packages_is_kept_from_the_detector(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", "somewhere")
    monkeypatch.setenv("VIRTUAL_ENV", "elsewhere")
    assert {"PYTHONPATH", "VIRTUAL_ENV"}.isdisjoint(detector_process.clean_environment())
    assert detector_process.alone(Path("python"), "x")[1:3] == ["-E", "-s"]


@pytest.mark.parametrize("name", ["mediapipe_pose", "onnx_pose", "serving"])
def test_programs_use_nothing_of_ours(name: str) -> None:
    used = {name.partition(".")[0] for name in imported(SCRIPTS / f"{name}.py")}
    assert used <= STANDARD | {"numpy", "cv2", "mediapipe", "google", "onnxruntime", "serving"}
    if name != "serving":
        packages = re.findall(r'^#     "(.*)",$', (SCRIPTS / f"{name}.py").read_text(), re.MULTILINE)
        assert len(packages) > 5
        assert all("==" in package for package in packages)


def test_two_people_keep_their_numbers(fake: Fake, tmp_path: Path) -> None:
    clip = drawn(tmp_path / "squares")
    files = km.detect(clip, out=tmp_path / "out.json", detector="fake")
    assert files == {"squares": tmp_path / "out.json"}
    content = json.loads(files["squares"].read_text())
    assert (content["format"], content["image_size"], content["fps"]) == ("coco17", [120, 80], None)
    people = load_people(files["squares"])
    for number in (0, 1):
        track = people.one(str(number))
        assert track.frame_count == 12
        np.testing.assert_allclose(track.pixels[:, [0, 4]].mean(axis=1), places(12)[:, number] - [0, 8], atol=0.01)


def test_one_person_is_written_as_mediapipe_files_are(started: Fake, tmp_path: Path) -> None:
    path = km.detect(drawn(tmp_path / "alone", squares=1), out=tmp_path / "out.json", detector="fake")["alone"]
    frames = json.loads(path.read_text())["frames"]
    assert {tuple(frame) for frame in frames} == {("keypoints",)}
    with pytest.raises(InputError, match="exists already"):
        km.detect(tmp_path / "alone", out=path, detector="fake")
    nobody = drawn(tmp_path / "nobody", squares=0)
    with pytest.raises(InputError, match="finds no person in 12 frames"):
        km.detect(nobody, out=tmp_path / "none.json", detector="fake")
    assert not list(tmp_path.glob("none.json*"))


def test_a_detector_that_neither_answers_nor_ends_is_killed(fake: Fake, monkeypatch: pytest.MonkeyPatch) -> None:
    fake.waits(monkeypatch, Patience(answer=0.0, end=0.0))
    fake.script.write_text(fake.script.read_text().partition("import sys")[0] + "import signal\nsignal.pause()\n")
    monkeypatch.setattr("kinemode.detection.process.python_for", lambda *_: Path(sys.executable))
    begun: list[subprocess.Popen[bytes]] = []

    class Noted(subprocess.Popen):  # type: ignore[type-arg]
        def __init__(self, *arguments: Any, **how: Any) -> None:
            super().__init__(*arguments, **how)
            begun.append(self)

    monkeypatch.setattr(subprocess, "Popen", Noted)
    with pytest.raises(InputError, match=r"fake: has not answered for 0 s \(try again\)"):
        DetectorProcess(DetectorChoice("fake"))
    assert [process.returncode for process in begun] == [-9]


def test_an_interrupted_detection_resumes_to_the_same_bytes(started: Fake, tmp_path: Path) -> None:
    """The small detector's confidence encodes how many pictures it has seen: its state is kept too."""
    clip, part = drawn(tmp_path / "squares"), tmp_path / "out.json.part"
    whole = km.detect(clip, out=tmp_path / "whole.json", detector="fake")["squares"]
    seen: list[int] = []

    class Stop:
        def __init__(self, at: int) -> None:
            self.at = at

        def __call__(self, label: str) -> Stop:
            return self

        def __enter__(self) -> Any:
            return self.report

        def __exit__(self, *_: object) -> None:
            pass

        def report(self, done: int, total: int) -> None:
            seen.append(done)
            if done == self.at:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match=r"5 frames are kept in .*out\.json\.part"):
        km.detect(clip, out=tmp_path / "out.json", detector="fake", progress=Stop(5))
    assert not (tmp_path / "out.json").exists()
    with part.open("ab") as file:
        file.write(b'{"people": {"0": [[1')  # a line truncated by a power failure
    out = km.detect(clip, out=tmp_path / "out.json", detector="fake", progress=Stop(99))["squares"]
    assert seen == [*range(1, 6), *range(6, 13)]
    assert out.read_bytes() == whole.read_bytes()
    assert not part.exists()


def test_keypoints_beside_a_run_are_taken_until_something_changes(started: Fake, tmp_path: Path) -> None:
    clip, out = drawn(tmp_path / "squares", squares=1), tmp_path / "walk.run"
    made = tmp_path / "walk.keypoints" / "squares.json"

    def made_anew(time: float) -> bool:
        """Whether a file with this time is written again; times are set explicitly, as those of two files may be too
        close."""
        if made.exists():
            os.utime(made, (time, time))
        with with_detected(FileOptions(clip, detect=True, detector="fake"), out, unreported) as files:
            assert files.keypoints == [made]
        return made.stat().st_mtime != time

    drawn_at = clip.stat().st_mtime
    assert made_anew(0.0)
    assert not made_anew(drawn_at + 1.0)
    assert made_anew(drawn_at - 1.0)  # of another clip of that name
    started.script.write_text(started.script.read_text() + "# changed\n")
    assert made_anew(drawn_at + 1.0)
    with with_detected(FileOptions(clip, keypoints=made, detect=True, detector="fake"), out, unreported) as files:
        assert files.keypoints == [made]  # given files are not searched for


@pytest.mark.parametrize(
    ("words", "work", "made"),
    [
        ("track --out walk.run", "kinemode.jobs.track_subject", "walk.keypoints"),
        ("fit --out me.urdf", "kinemode.fits.fit_subject", "me.keypoints"),
        ("compare --trackers css --out two", "kinemode.comparison.compare_trackers", "two/compare.keypoints"),
    ],
)
def test_commands_detect_for_the_clips_without_keypoints(
    words: str, work: str, made: str, started: Fake, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []

    def stopped(subject: Any, files: FileOptions, *_: Any) -> None:
        assert isinstance(files.keypoints, list)
        seen.extend(files.keypoints)
        raise InputError("here", "is the end")

    monkeypatch.setattr(work, stopped)
    monkeypatch.chdir(tmp_path)
    km.detect(drawn(tmp_path / "left", squares=1), out=tmp_path / "given.json", detector="fake")
    drawn(tmp_path / "right", squares=1)
    command, *rest = words.split()
    asked = [command, "left", "right", "--keypoints", "left=given.json", "--detect", "--detector", "fake", *rest]
    assert main(asked) == 2
    right = Path(made) / "right.json"
    assert seen == ["left=given.json", right]
    assert [path.name for path in right.parent.iterdir()] == ["right.json"]
    assert km.load_keypoints(right).frame_count == 12


class ScriptedDetector:
    """A detector with given answers: for each picture whether each state is seen, and where people are found."""

    def __init__(self, pictures: Sequence[tuple[dict[str, float | None], list[str]]]) -> None:
        self.pictures, self.now, self.searches = iter(pictures), ({}, list[str]()), list[str | None]()

    def ask(self, picture: Any, states: Sequence[dict[str, Any]], *, search: Search = None) -> dict[str, Any]:
        if picture is not None:
            self.now = next(self.pictures)  # type: ignore[assignment]
            self.searches.append(search)
        where: dict[str, float | None] = self.now[0]
        people = [self.person(s["who"], where.get(s["who"])) for s in states]
        starts = [self.state(who, where.get(who) or 0.0) for who in self.now[1]] if search else []
        return {"people": people, "starts": starts}

    def state(self, who: str, x: float) -> dict[str, Any]:
        return {"who": who, "box": [x, 0.0, x + 0.2, 1.0]}

    def person(self, who: str, x: float | None) -> dict[str, Any] | None:
        points = [[100 * ((x or 0.0) + 0.1 * k), 10.0 * k, 1.0] for k in range(3)]
        return None if x is None else {"keypoints": points, "state": self.state(who, x)}


PICTURE = np.zeros((1, 1, 3), np.uint8)


def test_a_person_who_returns_keeps_the_number() -> None:
    """a and b; b is missing in picture 1 and back in 2; in 3 both move to a's place: b, the later one, is dropped, and
    a search in 4 finds a third person far away."""
    detector = ScriptedDetector(
        [
            ({"a": 0.1, "b": 0.6}, ["a", "b"]),
            ({"a": 0.1}, []),
            ({"a": 0.1, "b": 0.62}, ["a", "b"]),
            ({"a": 0.1, "b": 0.1}, []),
            ({"a": 0.1, "c": 0.35}, ["a", "c"]),
            ({"a": 0.1, "c": 0.35}, ["a", "c", "a"]),
        ]
    )
    people = People(6)
    seen = []
    for _ in range(6):
        people = People.of(json.loads(json.dumps(people.content())), 6)  # as stored in a file
        seen.append({n: round(person["keypoints"][0, 0]) for n, person in people.see(detector, PICTURE).items()})
    assert seen == [{0: 10, 1: 60}, {0: 10}, {0: 10, 1: 62}, {0: 10}, {0: 10, 2: 35}, {0: 10, 2: 35}]
    assert detector.searches == ["parts", None, "whole", None, "whole", None]


def test_no_more_people_than_wanted() -> None:
    people = People(1)
    assert list(people.see(ScriptedDetector([({"a": 0.1, "b": 0.6}, ["b", "a"])]), PICTURE)) == [0]


def test_what_two_boxes_share() -> None:
    assert shared([0, 0, 2, 1], [1, 0, 3, 1]) == pytest.approx(1 / 3)
    assert shared([0, 0, 1, 1], [2, 0, 3, 1]) == 0.0
    assert shared([0, 0, 1, 1], [0, 0, 1, 1]) == 1.0


def test_simcc_is_decoded_to_known_places() -> None:
    """Two bins a pixel of a 192 x 256 input; the less certain coordinate gives the confidence."""
    columns, lines = np.full((3, 384), 0.01), np.full((3, 512), 0.01)
    for k, (x, y) in enumerate([(0, 511), (201, 100), (383, 7)]):
        columns[k, x], lines[k, y] = 0.8, 0.4 + k
    np.testing.assert_allclose(
        decoded(columns, lines, (192, 256)), [[0, 255.5, 0.4], [100.5, 50, 0.8], [191.5, 3.5, 0.8]]
    )
    assert decoded(columns - 2.0, lines - 2.0, (192, 256))[0, 2] == 0.0


@pytest.mark.parametrize(
    "box", [[0.25, 0.25, 0.5, 0.5], [0.0, 0.4, 1.0, 0.5], [0.4, 0.0, 0.45, 1.0], [0.5, 0.5, 0.5, 0.5]]
)
def test_a_window_holds_its_box_in_the_middle(box: list[float]) -> None:
    picture, size = (400, 200), (192, 256)
    left, top, scale = window(box, picture, size)
    assert left + 0.5 * scale * size[0] == pytest.approx(200 * (box[0] + box[2]))
    assert top + 0.5 * scale * size[1] == pytest.approx(100 * (box[1] + box[3]))
    filled = max(400 * (box[2] - box[0]) / (scale * size[0]), 200 * (box[3] - box[1]) / (scale * size[1]))
    assert filled == pytest.approx(0.8 if box[2] > box[0] else 0.0)


def test_mediapipes_square_turns_with_the_person() -> None:
    size = (400, 200)
    for turn in (0.0, 0.4, -2.0, 3.0):
        top = np.array([200.0, 100.0]) + 30.0 * np.array([np.sin(turn), -np.cos(turn)])
        square = turned_square([(0.5, 0.5), (top[0] / 400, top[1] / 200)], size)
        np.testing.assert_allclose(square, [0.5, 0.5, 75 / 400, 75 / 200, turn], atol=1e-12)


def test_the_filter_of_the_square() -> None:
    """Casiez et al. 2012, with a person's size as the unit: a person who stands still stays; a jump is followed in
    part, by a share that depends on its speed; the same in a picture of twice the size."""
    still = [(0.5, 0.5), (0.5, 0.25)]
    moved = [(0.51, 0.5), (0.51, 0.25)]
    ends, memory = steadied(still, [], (400, 400))
    np.testing.assert_array_equal(ends, still)
    again, same = steadied(still, memory, (400, 400))
    np.testing.assert_allclose(again, still, atol=1e-15)
    after, moving = steadied(moved, same, (400, 400))

    def share(cutoff: float) -> float:
        return float(1 / (1 + 1e6 / 33333 / (2 * np.pi * cutoff)))

    rate = share(1.0) * (4.0 / 200.0) * 1e6 / 33333  # persons a second
    assert after[0][0] - 0.5 == pytest.approx(0.01 * share(0.01 + 10.0 * rate))
    last, _ = steadied(moved, moving, (400, 400))  # it has come to rest, its square follows
    alpha = share(0.01 + 10.0 * (1 - share(1.0)) * rate)
    assert last[0][0] == pytest.approx(alpha * 0.51 + (1 - alpha) * after[0][0], abs=1e-12)
    double, _ = steadied(moved, steadied(still, [], (800, 800))[1], (800, 800))
    np.testing.assert_allclose(double, after, atol=1e-15)


def test_several_people_are_read_as_they_are_written(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    names = [f"k{j}" for j in range(17)]
    frames = [
        {n: {"keypoints": (rng.uniform(0.1, 0.9, (17, 3)) * [64, 48, 1]).tolist()} for n in who}
        for who in ([0, 3], [], [3])
    ]
    write_people(tmp_path / "a.json", "coco17", names, frames, image_size=(64, 48), fps=25.0)
    read = load_people(tmp_path / "a.json")
    assert read.image_size == (64, 48)
    for frame, people in zip(frames, read.frames.values(), strict=True):
        assert [p.id for p in people] == [str(number) for number in frame]
        for person, content in zip(people, frame.values(), strict=True):
            np.testing.assert_array_equal(person.points, content["keypoints"])


def test_models_are_chosen_and_unknown_ones_refused(tmp_path: Path) -> None:
    clip, model = drawn(tmp_path / "squares", 1), tmp_path / "model.onnx"
    model.touch()
    cases: list[tuple[dict[str, Any], str]] = [
        ({"detector": "onnx"}, "needs a model"),
        ({"detector": "onnx", "model": "absent.onnx"}, "there is no such file"),
        ({"model": model}, "mediapipe brings its own"),
        ({"detector": "openpose"}, "is unknown"),
        ({"people": 0}, "people"),
    ]
    for given, problem in cases:
        with pytest.raises(InputError, match=problem):
            km.detect(clip, out=tmp_path / "a.json", **given)


def made_or_skip(name: str, patch: pytest.MonkeyPatch) -> None:
    about = detectors.DETECTORS[name]
    patch.setitem(detectors.DETECTORS, name, About(about.script, about.needs_model, PATIENCE))
    wanted = DetectorChoice(name)
    if detector_process.made_python(name, wanted.script) is None and "KINEMODE_TEST_DETECTOR" not in os.environ:
        pytest.skip(f"the environment of {name} is not there; KINEMODE_TEST_DETECTOR=1 makes it (150 MB)")


def test_mediapipe_finds_what_it_found_before(
    shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made_or_skip("mediapipe", monkeypatch)
    folder = shared_data / "beam4cam"
    clip = Clip.open(folder / "videos" / "cam01.mp4")
    (tmp_path / "first").mkdir()
    for i in range(8):
        cv2.imwrite(str(tmp_path / "first" / f"{i}.png"), clip.frame(i))
    path = km.detect(tmp_path / "first", out=tmp_path / "a.json")["first"]
    ours, theirs = km.load_keypoints(path), km.load_keypoints(folder / "keypoints" / "cam01.json")
    assert json.loads(path.read_text())["names"] == json.loads(Path(theirs.source).read_text())["names"]
    apart = np.linalg.norm(ours.pixels - theirs.pixels[:8], axis=2)
    assert np.median(apart) < 0.5
    assert apart.max() < 3.0


def test_mediapipes_world_has_the_pictures_axes(
    shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Limbs have the same directions as in pictures that are turned by 30 degrees and turned back by MediaPipe's
    square."""
    made_or_skip("mediapipe", monkeypatch)
    clip = Clip.open(shared_data / "beam4cam" / "videos" / "cam01.mp4")
    (tmp_path / "turned").mkdir()
    width, height = clip.image_size
    for i, degrees in enumerate((0.0, 30.0, -30.0)):
        turn = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, 1.0)
        cv2.imwrite(str(tmp_path / "turned" / f"{i}.png"), cv2.warpAffine(clip.frame(0), turn, (width, height)))
    track = km.load_keypoints(km.detect(tmp_path / "turned", out=tmp_path / "a.json")["turned"])
    assert track.world is not None
    ends = [[track.names.index(f"{side}_{name}") for side in ("left", "right") for name in names]
            for names in (("shoulder", "hip", "knee"), ("hip", "knee", "ankle"))]  # fmt: skip
    seen, lifted = (np.diff(p[:, ends], axis=1)[:, 0] @ [1.0, 1j] for p in (track.pixels, track.world[..., :2]))
    assert np.abs(np.degrees(np.angle(seen / lifted))).max() < 12.0


def test_an_onnx_model_finds_known_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two people of two colours each, side by side: the box model finds both, and a chair that is not a person."""
    made_or_skip("onnx", monkeypatch)
    picture, size = np.zeros((160, 240, 3), np.uint8), (48, 64)
    where = [((20, 30), (60, 110)), ((150, 20), (190, 120))]  # upper left corners of red and of blue
    for red, blue in where:
        picture[red[1] : red[1] + 20, red[0] : red[0] + 15, 2] = 255
        picture[blue[1] : blue[1] + 20, blue[0] : blue[0] + 15, 0] = 255
    (tmp_path / "clip").mkdir()
    for i in range(3):
        cv2.imwrite(str(tmp_path / "clip" / f"{i}.png"), picture)
    model = two_colours(tmp_path / "model.onnx", size)
    boxes = np.array([[20, 30, 75, 130, 300], [150, 20, 205, 140, 300], [90, 0, 110, 20, 300]]) / (240 / 64)
    boxes[:, 4] = [0.9, 0.8, 0.95]
    finder = constant_boxes(tmp_path / "boxes.onnx", (64, 64), boxes, [0, 0, 56])
    path = km.detect(tmp_path / "clip", out=tmp_path / "a.json", detector="onnx", model=model, boxes=finder)["clip"]
    people = load_people(path)
    for number, (red, blue) in enumerate(where):
        pixels = people.one(str(number)).pixels
        assert pixels.shape == (3, 17, 2)
        beyond = pixels - np.array([red] * 9 + [blue] * 8)  # the model's first fully coloured pixel
        assert beyond.min() > -0.1
        assert beyond.max() < 4.0
    (tmp_path / "wrong.onnx").write_bytes(b"no model")
    with pytest.raises(InputError, match=r"onnx: .*wrong\.onnx cannot be loaded"):
        km.detect(tmp_path / "clip", out=tmp_path / "b.json", detector="onnx", model=tmp_path / "wrong.onnx")
