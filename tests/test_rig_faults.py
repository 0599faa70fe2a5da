"""Cameras that disagree with the others or with the calibration, and other doubts about a rig."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import kinemode as km
import kinemode.__main__ as front
from benchmarks.accuracy.rig_faults import backwards, turned_camera, with_turn
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import write_keypoints
from estimator.data.rigs import calibrate, check
from humanoid.support.errors import InputError
from tests.quick_rigs import quick_rigs
from tests.test_rigs import FPS, Filmed

__all__ = ["quick_rigs"]

ACROSS = np.array([0.6, 0.8, 0.0])


@pytest.fixture(scope="module")
def filmed() -> Filmed:
    return Filmed()


def test_a_camera_that_is_moved_during_the_clip_is_named(filmed: Filmed) -> None:
    camera, half = filmed.cameras["cam03"], filmed.tracks["cam03"].frame_count // 2
    moved = with_turn(filmed.tracks["cam03"], camera, turned_camera(camera, 4.0, ACROSS), half)
    tracks = {**filmed.tracks, "cam03": moved}
    rig = calibrate.calibrate_by_person(filmed.body, tracks, filmed.lost(), filmed.times, clocks_known=True)
    assert rig.doubtful == ("cam03",)
    assert "cam03" in rig.unsure
    assert f"cam03 was moved at about {half / FPS:.1f} s" in rig.notes[0]


@pytest.mark.parametrize("others", [("cam01", "cam02"), pytest.param(("cam01",), marks=pytest.mark.thorough)])
def test_a_camera_that_sees_another_person_is_named(filmed: Filmed, others: tuple[str, ...]) -> None:
    """With two cameras it is undecidable which one."""
    tracks = {**{name: filmed.tracks[name] for name in others}, "cam03": backwards(filmed.tracks["cam03"])}
    rig = calibrate.calibrate_by_person(filmed.body, tracks, filmed.lost(), filmed.times, clocks_known=True)
    assert rig.doubtful == (("cam03",) if len(others) > 1 else ("cam01", "cam03"))
    assert "--person cam03=NUMBER" in rig.notes[0]


def test_right_cameras_are_found_right_and_a_turned_one_is_named(filmed: Filmed) -> None:
    right = check.check_by_person(filmed.body, filmed.tracks, filmed.cameras, filmed.times)
    assert right.agrees
    assert right.gain < 1.1
    assert right.size == pytest.approx(1.0, abs=0.03)
    for camera in right.cameras.values():
        assert camera.turn <= 3.0 * camera.turn_std
    wrong = {**filmed.cameras, "cam01": turned_camera(filmed.cameras["cam01"], 2.0, ACROSS)}
    off = check.check_by_person(filmed.body, filmed.tracks, wrong, filmed.times)
    assert off.moved == ("cam01",)
    assert off.gain > 2.0 * right.gain


def test_a_check_needs_what_two_cameras_see_at_once(filmed: Filmed) -> None:
    """The first camera sees only the first half, the second only the second."""
    half, tracks = filmed.tracks["cam01"].frame_count // 2, {}
    for name, hidden in (("cam01", slice(half, None)), ("cam02", slice(0, half))):
        pixels = filmed.tracks[name].pixels.copy()
        pixels[hidden] = np.nan
        tracks[name] = replace(filmed.tracks[name], pixels=pixels)
    with pytest.raises(km.InputError, match="no two of cam01, cam02 see 100 points"):
        check.check_by_person(filmed.body, tracks, filmed.cameras, filmed.times)


def test_the_command_reports_the_errors_of_the_function(
    filmed: Filmed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {name: tmp_path / f"{name}.json" for name in filmed.tracks}
    for name, path in files.items():
        write_keypoints(path, filmed.tracks[name])
    right, wrong = tmp_path / "right.json", tmp_path / "wrong.json"
    write_cameras(right, filmed.cameras.values())
    write_cameras(
        wrong, [{**filmed.cameras, "cam01": turned_camera(filmed.cameras["cam01"], 2.0, ACROSS)}[n] for n in files]
    )
    messages = []
    for path in (right, wrong):
        assert front.main(["calibrate", "--check", str(path), "--keypoints", *map(str, files.values())]) == 0
        messages.append(capsys.readouterr().out)
    assert "the cameras hold" in messages[0]
    assert "cam01 does not stand where" in messages[1]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--height", "1.7"], "--height: is for cameras that are found"),
        (["--out", "c.json"], "--out: is for a calibration that is made"),
        (["--sync", "some"], "sync"),
    ],
)
def test_options_that_do_not_serve_a_check_are_refused(
    given: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert front.main(["calibrate", "a.mp4", "--check", "cameras.json", *given]) != 0
    assert message in capsys.readouterr().err


def test_a_check_needs_cameras_of_its_own() -> None:
    with pytest.raises(InputError, match="to be checked are needed"):
        km.check_cameras("auto", keypoints={"a": "a.json", "b": "b.json"})
