"""The command line: every command can be found, and every error is one line and an exit code."""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import tomli_w

import kinemode
from estimator.data.cameras.camera import Camera
from humanoid import Body, load_subject
from kinemode import __main__ as front, cli
from kinemode.named import named_paths
from kinemode.progress import reported
from kinemode.public import results
from tests.command_lines import interrupted_after
from tests.tiny_clip import QUICK_BY_KEYPOINTS
from tests.waiting import DEADLINE, ended, kinemode_process

COMMANDS = (
    "demo", "annotate", "batch", "retarget", "detect", "render", "track", "compare", "fit", "live", "calibrate",
    "settings", "subjects", "trackers", "cues", "view", "report", "overlay", "plot", "samples", "explain", "export",
    "evaluate", "contact", "gait", "forces", "train-index", "train-templates", "version",
)  # fmt: skip
FRAMES = 4


def camera(name: str, x: float) -> Camera:
    """Looks along y from 4 m before the origin, a little to the side."""
    K = np.array([[700.0, 0.0, 320.0], [0.0, 700.0, 240.0], [0.0, 0.0, 1.0]])
    R = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return Camera(name, (640, 480), K, np.zeros(5), R, -R @ np.array([x, -4.0, 1.0]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keypoints of human34 standing before two cameras, and the camera file."""
    made: Path = tmp_path_factory.mktemp("with space")  # the space is on purpose
    body = Body(load_subject("human34"))
    q = body.clamp(pin.neutral(body.model))
    q[2] = 1.0
    points = body.landmarks(body.at(q))
    cameras = [camera("left", -0.5), camera("right", 0.5)]
    for view in cameras:
        frame = {"keypoints": [[*pixel, 1.0] for pixel in view.project(points).tolist()]}
        content = {"names": body.landmark_names, "image_size": [640, 480], "fps": 30.0, "frames": [frame] * FRAMES}
        (made / f"{view.name}.json").write_text(json.dumps({"format": "kinemode", **content}))
    entries = [
        {
            "name": c.name,
            "image_size": list(c.image_size),
            "K": c.K.tolist(),
            "distortion": [0.0] * 5,
            "R": c.R_camera_world.tolist(),
            "t": c.t_camera_world.tolist(),
        }
        for c in cameras
    ]
    (made / "cameras.json").write_text(json.dumps({"cameras": entries}))
    (made / "empty.json").write_text("")
    (made / "quick.toml").write_text(tomli_w.dumps(QUICK_BY_KEYPOINTS))
    (made / "clip").mkdir()
    return made


def track_line(folder: Path, out: Path) -> list[str]:
    """A command line that tracks both cameras."""
    keypoints = ["--keypoints", str(folder / "left.json"), str(folder / "right.json")]
    how = ["--cameras", str(folder / "cameras.json"), "--settings", str(folder / "quick.toml"), "--fit", "off"]
    return ["track", *keypoints, *how, "--out", str(out)]


@pytest.fixture(scope="module")
def tracked(folder: Path) -> Path:
    """A run of both cameras."""
    out = folder / "both.run"
    assert front.main(track_line(folder, out)) == 0
    return out


def run_process(*arguments: str) -> subprocess.CompletedProcess[str]:
    process = kinemode_process(arguments)
    return subprocess.CompletedProcess(process.args, *ended(process))


def test_help_names_every_command_and_imports_nothing_heavy() -> None:
    program = (
        "import sys; from kinemode.__main__ import main; code = main(['--help']);"
        "sys.exit(code or str([m for m in ('pinocchio', 'numba', 'cv2', 'numpy') if m in sys.modules] or ''))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=DEADLINE
    )
    assert done.stderr.strip() == ""
    assert re.findall(r"^│ ([a-z][\w-]*) ", done.stdout, re.MULTILINE) == sorted(COMMANDS)


def test_all_commands_are_tested() -> None:
    assert {name for name in cli.app if not name.startswith("-")} == set(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main([command, "--help"]) == 0
    assert f"Usage: kinemode {command}" in capsys.readouterr().out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["version"]) == 0
    assert capsys.readouterr().out.strip() == kinemode.__version__


BAD = {
    "unknown command": (["trac"], "track"),
    "no output": (["track", "--keypoints", "{left}"], "--out"),
    "no such run to plot": (["plot", "nothing.run", "--out", "{out}"], "nothing.run"),
    "no such run to draw samples of": (["samples", "nothing.run", "--out", "a.png"], "nothing.run"),
    "unknown option": (["track", "--bogus", "1", "--out", "{out}"], "bogus"),
    "not a number": (["track", "--modes", "many", "--keypoints", "{left}", "--out", "{out}"], "modes"),
    "no such clip": (["track", "nothing.mp4", "--keypoints", "{left}", "--out", "{out}"], "nothing.mp4"),
    "no keypoints": (["track", "--out", "{out}"], "keypoints: are needed"),
    "model not named": (["detect", "{clip}", "--detector", "onnx", "--out", "{out}"], "--model FILE"),
    "detector without use": (["fit", "{clip}", "--people", "2", "--out", "{out}"], "add --detect"),
    "clip without keypoints": (["track", "{clip}", "--out", "{out}"], "kinemode annotate"),
    "unknown cue": (["track", "--keypoints", "{left}", "--cues", "edge", "--out", "{out}"], "edges, flow, silhouette"),
    "cues without clips": (["track", "--keypoints", "{left}", "--cues", "flow", "--out", "{out}"], "give the clips"),
    "mask without a clip": (["track", "--keypoints", "{left}", "--mask", "{left}", "--out", "{out}"], "clips: none"),
    "no such mask": (["track", "--keypoints", "{left}", "--mask", "m", "--out", "{out}"], "m: no such mask"),
    "no such background": (
        ["track", "--keypoints", "{left}", "--background", "b", "--out", "{out}"],
        "no such background",
    ),
    "no such settings": (["track", "--keypoints", "{left}", "--settings", "s.toml", "--out", "{out}"], "s.toml"),
    "invalid settings": (
        ["track", "--keypoints", "{left}", "--settings", "{left}", "--out", "{out}"],
        "not TOML",
    ),
    "settings of an unknown tracker": (["settings", "--tracker", "cs"], "css"),
    "explanation of a missing run": (["explain", "none.run", "--frame", "0"], "none.run"),
    "explanation without a frame": (["explain", "none.run"], "--frame"),
    "no such keypoint file": (["track", "--keypoints", "none.json", "--out", "{out}"], "none.json"),
    "empty keypoint file": (["track", "--keypoints", "{folder}/empty.json", "--out", "{out}"], "is empty"),
    "bad NAME=": (["track", "--keypoints", "={left}", "--out", "{out}"], "NAME=PATH"),
    "bad =PATH": (["track", "--keypoints", "left=", "--out", "{out}"], "NAME=PATH"),
    "name used twice": (["track", "--keypoints", "{left}", "left={right}", "--out", "{out}"], "has the name 'left'"),
    "views without cameras": (["track", "--keypoints", "{left}", "{right}", "--out", "{out}"], "camera file"),
    "no such camera file": (["track", "--keypoints", "{left}", "--cameras", "c.json", "--out", "{out}"], "c.json"),
    "no such camera": (
        ["track", "--keypoints", "middle={left}", "--cameras", "{folder}/cameras.json", "--out", "{out}"],
        "cameras: left, right",
    ),
    "unknown subject": (["track", "--subject", "human35", "--keypoints", "{left}", "--out", "{out}"], "human34"),
    "unknown tracker": (["track", "--tracker", "cs", "--keypoints", "{left}", "--out", "{out}"], "css"),
    "no modes": (["track", "--modes", "0", "--keypoints", "{left}", "--out", "{out}"], "at least 1"),
    "negative seed": (["track", "--seed=-1", "--keypoints", "{left}", "--out", "{out}"], "must be 0 or more"),
    "bad fit": (["track", "--fit", "maybe", "--keypoints", "{left}", "--out", "{out}"], "auto"),
    "output folder missing": (["track", "--keypoints", "{left}", "--out", "{folder}/a/b.run"], "does not exist"),
    "output is a folder": (["track", "--keypoints", "{left}", "--out", "{folder}"], "is a folder"),
    "fit output missing": (["fit", "--keypoints", "{left}", "--out", "{folder}/a/b.urdf"], "does not exist"),
    "no such run": (["view", "none.run"], "none.run"),
    "not a run": (["overlay", "{left}", "--out", "{out}.mp4"], "left.json"),
    "export of a missing run": (["export", "none.run", "a.csv", "--format", "csv"], "none.run"),
    "evaluation of a missing run": (["evaluate", "none.run", "--reference", "r.npz"], "none.run"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_exit_code_2(case: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments, expected = BAD[case]
    places = {name: folder / f"{name}.json" for name in ("left", "right")}
    places |= {"folder": folder, "clip": folder / "clip", "out": folder / "x.run"}
    assert front.main([a.format(**places) for a in arguments]) == front.BAD_INPUT
    printed = capsys.readouterr()
    errors = [line for line in printed.err.splitlines() if not line.startswith("note:")]
    assert len(errors) == 1, printed.err
    assert errors[0].startswith("error: ")
    assert expected in errors[0]
    assert not (folder / "x.run").exists()


def test_the_process_itself_ends_with_2_and_debug_shows_the_traceback() -> None:
    plain, debug = run_process("view", "none.run"), run_process("view", "none.run", "--debug")
    assert (plain.returncode, plain.stdout) == (2, "")
    assert len(plain.stderr.splitlines()) == 1
    assert debug.returncode == 2
    assert "Traceback" in debug.stderr


def test_internal_errors_are_reported_as_internal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(path: object) -> None:
        raise ZeroDivisionError("division\nby zero")

    monkeypatch.setattr(results, "open_run", broken)
    assert front.main(["view", "a.run"]) == front.INTERNAL_ERROR
    printed = capsys.readouterr().err
    assert printed.startswith("internal error: ZeroDivisionError: division by zero; run with --debug")
    assert len(printed.splitlines()) == 1


def test_an_interrupted_run_resumes_to_the_same_result(
    folder: Path, tracked: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "stopped.run"
    arguments = track_line(folder, out)
    with interrupted_after(2):
        assert front.main([*arguments, "--overwrite"]) == front.INTERRUPTED
    assert capsys.readouterr().err.rstrip().endswith("--resume")
    assert len(kinemode.open_run(out)) == 2
    assert front.main([*arguments, "--resume"]) == 0
    whole, resumed = kinemode.open_run(tracked), kinemode.open_run(out)
    assert resumed.complete
    np.testing.assert_array_equal(resumed.mode_q, whole.mode_q)
    np.testing.assert_array_equal(resumed.mode_weight, whole.mode_weight)
    assert front.main([*arguments, "--resume", "--seed", "1"]) == front.BAD_INPUT
    assert "seed" in capsys.readouterr().err


def test_a_run_is_not_replaced_without_overwrite(
    folder: Path, tracked: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["track", "--keypoints", str(folder / "left.json"), "--out", str(tracked)]
    before = tracked.read_bytes()
    assert front.main(arguments) == front.BAD_INPUT
    assert "--overwrite" in capsys.readouterr().err
    assert tracked.read_bytes() == before


def test_export_and_evaluate(folder: Path, tracked: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for suffix in ("npz", "csv", "trc", "mot", "osim"):
        assert front.main(["export", str(tracked), "--format", suffix, str(folder / f"o.{suffix}")]) == 0
        assert (folder / f"o.{suffix}").stat().st_size > 0
    capsys.readouterr()
    assert front.main(["evaluate", str(tracked), "--reference", str(folder / "o.npz")]) == 0
    assert "MPJPE" in capsys.readouterr().out


def test_names_of_clips(tmp_path: Path) -> None:
    plain, odd = tmp_path / "cam01.mp4", tmp_path / "a=b.mp4"
    images = tmp_path / "shots.v2"
    plain.touch()
    odd.touch()
    images.mkdir()
    given = [str(plain), f"front={plain}", str(odd), str(images)]
    assert named_paths(given, "clip") == {"cam01": plain, "front": plain, "a=b": odd, "shots.v2": images}
    assert named_paths({"x": plain}, "clip") == {"x": plain}


def test_progress_off_a_terminal_is_a_few_plain_lines() -> None:
    log = io.StringIO()
    with reported("tracking", log) as progress:
        for done in range(1, 501):
            progress(done, 500)
    assert log.getvalue().splitlines() == ["tracking: 1/500", "tracking: 500/500"]


def test_public_names() -> None:
    assert all(hasattr(kinemode, name) for name in kinemode.__all__)
    with pytest.raises(AttributeError, match="it has"):
        _ = kinemode.nothing


@pytest.mark.parametrize("up", ["-y", "-x"])
def test_an_axis_may_begin_with_a_minus(
    up: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    given = []
    monkeypatch.setattr(kinemode, "track", lambda *args, **how: given.append(how["up"]))
    monkeypatch.setattr("kinemode.terminal.report.print_run", lambda run: None)
    assert front.main(["track", "--points", "a.trc", "--up", up, "--out", str(tmp_path / "a.run")]) == 0
    assert given == [up]
    assert front.main(["track", "--points", "a.trc", "--up", "--out", str(tmp_path / "a.run")]) != 0
    assert "--up" in capsys.readouterr().err
