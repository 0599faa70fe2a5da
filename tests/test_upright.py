"""The up direction: found from a walking person, taken from the user or the file, otherwise requested."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import kinemode as km
from estimator.data.cameras.camera import UPS, axis_of, in_world, world_with_up
from estimator.data.formats.cameras import declared_up, write_cameras
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.data.formats.opensim import write_trc
from estimator.data.people.up_direction import up_direction
from estimator.runs.run_header import RunHeader
from humanoid.support.errors import InputError
from kinemode.inputs.load import Inputs, load_inputs
from kinemode.request import FileOptions
from tests.builders import body_of, camera_at
from tests.test_run_file import header

BODY = body_of("human34")
NAMES = ("left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle", "left_shoulder",
         "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist")  # fmt: skip
TIME = np.arange(0.0, 3.0, 1.0 / 30.0)
CAMERAS = tuple(replace(camera_at(at, height=1.2, distance=6.0), name=f"c{at}") for at in (0, 80, 200))


def walker(*, lean: float = 0.0, rise: float = 0.0, bent: float = 0.0) -> np.ndarray:
    """Points (T, L, 3) [m] of a stick figure walking along x, on a floor with a slope; lean [rad] of the trunk, with
    hips that move back for balance; bent [rad]: of hips and knees, as in sitting."""
    speed, stride, frames = 1.2, 1.1, []
    for t in TIME:
        ahead, feet = speed * (t - TIME[-1] / 2.0), []
        for side in (1.0, -1.0):
            phase = (speed * t / stride / 2.0 + (0.0 if side > 0 else 0.5)) % 1.0
            step = stride * (0.5 - 2.0 * phase) if phase < 0.5 else stride * (2.0 * phase - 1.5)
            lift = 0.1 * np.sin(2.0 * np.pi * phase) ** 2 if phase > 0.5 else 0.0
            feet.append(np.array([ahead + step, 0.1 * side, 0.08 + lift + rise * (ahead + step)]))
        foot = 0.06 + 0.5 * np.sin(bent)
        middle = np.array([ahead + foot - 0.25 * np.sin(lean), 0.0, 0.9 * np.cos(bent / 2) ** 2 + rise * ahead])
        trunk = 0.5 * np.array([np.sin(lean), 0.0, np.cos(lean)])
        across = np.array([0.0, 0.15, 0.0])
        hips = [middle + across, middle - across]
        knees = [0.5 * (h + f) + [0.4 * np.sin(bent), 0.0, 0.0] for h, f in zip(hips, feet, strict=True)]
        shoulders = [middle + trunk + across, middle + trunk - across]
        arms = [s - [0.0, 0.0, down] for down in (0.3, 0.55) for s in shoulders]
        frames.append([*hips, *knees, *feet, *shoulders, *arms])
    return np.array(frames)


def off(direction: np.ndarray, up: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(direction @ up, -1.0, 1.0))))


@pytest.mark.parametrize("lean", [0.0, 0.3])
def test_walking_determines_up_however_the_trunk_leans(lean: float) -> None:
    rng = np.random.default_rng(0)
    points = walker(lean=lean) + 0.01 * rng.normal(size=(len(TIME), len(NAMES), 3))
    up = up_direction(NAMES, points, TIME)
    assert up is not None
    assert up.sure
    assert off(up.direction, axis_of("z")) < 2.0


def test_the_floor_mends_a_lean_out_of_balance() -> None:
    points = walker()
    points[:, NAMES.index("left_shoulder") :] += [0.12, 0.0, 0.0]  # about five degrees, as in running
    up = up_direction(NAMES, points, TIME)
    assert up is not None
    assert off(up.direction, axis_of("z")) < 1.0


def test_up_turns_with_the_world_and_a_mistaken_frame_changes_little() -> None:
    points, R = walker(), Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()
    plain, turned = up_direction(NAMES, points, TIME), up_direction(NAMES, points @ R.T, TIME)
    assert plain is not None
    assert turned is not None
    np.testing.assert_allclose(turned.direction, R @ plain.direction, atol=1e-6)
    points[5:8] = points[5:8, ::-1]
    mistaken = up_direction(NAMES, points, TIME)
    assert mistaken is not None
    assert off(mistaken.direction, plain.direction) < 1.0


def test_a_ramp_is_not_level_and_sitting_is_not_evidence() -> None:
    ramp = up_direction(NAMES, walker(rise=0.3), TIME)
    assert ramp is not None
    assert not ramp.agree
    assert off(ramp.direction, axis_of("z")) < 6.0
    assert up_direction(NAMES, walker(bent=1.4), TIME) is None
    assert up_direction(NAMES[:4], walker()[:, :4], TIME) is None


def load(folder: Path, R_given_upright: np.ndarray, *, up: str | None = None, cameras: int = 3) -> Inputs:
    """The walker as loaded with cameras of another world."""
    points, paths = walker(), []
    for camera in CAMERAS[:cameras]:
        pixels = np.array([camera.project(p) for p in points])
        paths.append(folder / f"{camera.name}.json")
        write_keypoints(
            paths[-1], KeypointTrack("x", NAMES, pixels, np.ones(pixels.shape[:2]), camera.image_size, 30.0)
        )
    write_cameras(folder / "cameras.json", [in_world(camera, R_given_upright) for camera in CAMERAS])
    return load_inputs(BODY, FileOptions(None, keypoints=paths, cameras=folder / "cameras.json", up=up))


def turn_left(inputs: Inputs) -> float:
    """Angle of the cameras' world to one whose z points up [deg]."""
    camera, true = inputs.observations[0].cameras[0], CAMERAS[0]
    return off(camera.R_camera_world[:, 2], true.R_camera_world[:, 2])


@pytest.mark.parametrize(("up", "word"), [*((up, False) for up in UPS), ("-y", True), ("z", True)])
def test_a_world_of_another_axis_is_turned_upright(up: str, word: bool, tmp_path: Path) -> None:
    """Exactly, given or found; a world whose z points up is unchanged to the bit."""
    inputs = load(tmp_path, world_with_up(axis_of(up)).T, up=up if word else None)
    assert turn_left(inputs) < 1e-5
    assert any(f"{up} is used as up" in note for note in inputs.notes) is (up != "z" and not word)
    if up == "z":
        assert inputs.R_upright_given is None
        np.testing.assert_array_equal(inputs.observations[0].cameras[0].R_camera_world, CAMERAS[0].R_camera_world)


@pytest.mark.parametrize("seed", range(2))
def test_a_world_without_an_up_axis_is_turned_upright_with_a_note(seed: int, tmp_path: Path) -> None:
    R = Rotation.from_quat(np.random.default_rng(seed).normal(size=4)).as_matrix()
    inputs = load(tmp_path, R)
    assert turn_left(inputs) < 2.0
    assert any("found from balance and floor" in note for note in inputs.notes)
    direction = ",".join(str(x) for x in R[:, 2])
    assert turn_left(load(tmp_path, R, up=direction)) < 1e-5


def test_one_camera_asks(tmp_path: Path) -> None:
    inputs = load(tmp_path, world_with_up(axis_of("y")).T, cameras=1)
    assert inputs.R_upright_given is None
    assert any("which way is up" in note for note in inputs.notes)


def test_an_invalid_direction_is_refused(tmp_path: Path) -> None:
    for wrong in ("w", "1,2", "0,0,0", "nan,1,0"):
        with pytest.raises(InputError, match=r"--up: .* is not an axis .one of x, y, z, -x, -y, -z"):
            load(tmp_path, np.eye(3), up=wrong)
    with pytest.raises(InputError, match="none is given"):
        load_inputs(BODY, FileOptions(None, keypoints=tmp_path / "c0.json", up="y"))


def test_the_up_axis_of_the_camera_file_is_used(tmp_path: Path) -> None:
    path = tmp_path / "cameras.json"
    load(tmp_path, world_with_up(axis_of("-y")).T)
    assert declared_up(path) is None
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"up": "-y"}))
    assert declared_up(path) == "-y"
    keypoints = [tmp_path / f"{camera.name}.json" for camera in CAMERAS]
    inputs = load_inputs(BODY, FileOptions(None, keypoints=keypoints, cameras=path))
    assert turn_left(inputs) < 1e-5
    assert not any("is used as up" in note for note in inputs.notes)
    path.write_text(json.dumps(content | {"up": "down"}))
    with pytest.raises(InputError, match=r"up: 'down' is not an axis"):
        declared_up(path)


def test_references_are_of_the_given_world_and_trc_stands(tmp_path: Path) -> None:
    """A laboratory's trc with y up lies in the world to which a rig with y up is turned."""
    R = world_with_up(axis_of("y"))
    turned = RunHeader.from_json(header(3, R_upright_given=R).to_json(), "a.run")
    assert turned.R_upright_given is not None
    np.testing.assert_array_equal(turned.R_upright_given, R)
    given = np.random.default_rng(0).normal(size=(4, len(NAMES), 3))
    reference = km.Reference(NAMES, given).in_world_of(R)
    np.testing.assert_allclose(reference.points, given @ R.T)
    assert reference.in_world_of(R) is reference
    write_trc(tmp_path / "a.trc", NAMES, reference.points, np.arange(4) / 30.0)
    read = km.Reference.load(tmp_path / "a.trc")
    np.testing.assert_allclose(read.in_world_of(R).points, reference.points, atol=1e-6)
