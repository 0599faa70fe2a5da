"""Clocks of cameras that did not start together are found from motion, or reported as uncertain."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.data.cameras.camera import Camera
from estimator.data.clock_rates import Lags
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import write_keypoints
from estimator.data.moving_rays import at_times, averaged
from estimator.data.synchronisation import Synchrony, synchronised
from estimator.synthesis.detector import keypoints
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.motion_keys import TURN_REACH
from estimator.synthesis.settings import DetectorSettings
from humanoid.support.errors import InputError
from kinemode.inputs.load import Inputs, load_inputs
from kinemode.request import FileOptions
from tests.builders import body_of, camera_at

BODY = body_of("human34")
CAMERAS = [replace(camera_at(at), name=f"cam{c}") for c, at in enumerate((10.0, 80.0, 170.0))]
RATE, SECONDS = 30.0, 3.0


def own_times(rate: float = RATE, seconds: float = SECONDS) -> np.ndarray:
    return np.arange(int(seconds * rate)) / rate


def seen(camera: Camera, times: np.ndarray, seed: int, *, still: bool = False) -> Any:
    """A noisy detector's keypoints of a person who turns and reaches, at times of the common clock."""
    q = authored_motion(BODY, np.full_like(times, 1.0) if still else times, TURN_REACH)
    return keypoints(BODY, q, [camera], np.random.default_rng(seed), DetectorSettings(1.0))[0]


def clocks(begins: list[float], rates: list[float], *, held: tuple[int, ...] = (0,), still: bool = False) -> Synchrony:
    times = [own_times(rate) for rate in rates]
    pixels = [
        seen(camera, own + 1.0 + begin, c, still=still).pixels
        for c, (camera, own, begin) in enumerate(zip(CAMERAS, times, begins, strict=False))
    ]
    return synchronised(CAMERAS[: len(pixels)], pixels, times, held)


@pytest.mark.parametrize("begins", [[0.0, 0.7, -0.45], [0.0, -0.31, 0.0]])
def test_clocks_are_found_to_a_fraction_of_a_frame(begins: list[float]) -> None:
    synchrony = clocks(begins, [RATE] * 3)
    assert synchrony.sure.all()
    np.testing.assert_allclose(synchrony.offsets, begins, atol=0.75 / RATE)
    assert (synchrony.errors <= 0.5 / RATE).all()


def test_cameras_have_rates_of_their_own() -> None:
    synchrony = clocks([0.0, 0.52], [60.0, 25.0])
    assert synchrony.sure.all()
    np.testing.assert_allclose(synchrony.offsets, [0.0, 0.52], atol=0.5 / 25.0)


def test_a_camera_that_is_held_stays() -> None:
    synchrony = clocks([0.3, 0.7, 0.0], [RATE] * 3, held=(2,))
    np.testing.assert_allclose(synchrony.offsets, [0.3, 0.7, 0.0], atol=0.75 / RATE)
    assert synchrony.offsets[2] == 0.0


@pytest.mark.parametrize(("begins", "still"), [([0.0, 0.4], True), ([0.0, 0.4, 0.2], True), ([0.0, 4.0], False)])
def test_undeterminable_clocks_are_uncertain(begins: list[float], still: bool) -> None:
    """No motion, or no common time."""
    synchrony = clocks(begins, [RATE] * len(begins), still=still)
    assert synchrony.sure[0]
    assert not synchrony.sure[1:].any()


def test_empty_tracks_are_uncertain() -> None:
    pixels = [np.full((90, 5, 2), np.nan)] * 2
    synchrony = synchronised(CAMERAS[:2], pixels, [own_times()] * 2)
    assert synchrony.sure.tolist() == [True, False]
    assert np.isnan(synchrony.offsets[1])
    lone = synchronised(CAMERAS[:2], [p[:1] for p in pixels], [np.zeros(1)] * 2)
    assert lone.sure.tolist() == [True, False]


def test_lags_suit_all_pairs() -> None:
    """A wrong pair is outvoted, and a still camera keeps its place."""
    a, b, most = np.array([0, 0, 1]), np.array([1, 2, 2]), 6
    table = np.abs(np.arange(-most, most + 1.0) - np.array([[2.0], [-3.0], [-5.0]]))
    table = np.minimum(table, 3.0)
    np.testing.assert_array_equal(Lags(a, b, table, most).best(3, (0,)), [0, 2, -3])
    np.testing.assert_array_equal(Lags(a, b, table, most).best(3, (2,)), [3, 5, 0])


def test_between_frames_lie_straight_lines() -> None:
    times = np.array([0.0, 0.04, 0.08, 0.5])
    values = np.array([0.0, 4.0, np.nan, 7.0])[:, None]
    got = at_times(values, times, np.array([-0.01, 0.0, 0.01, 0.04, 0.06, 0.08, 0.3, 0.5, 0.6]))[:, 0]
    np.testing.assert_allclose(got, [np.nan, 0.0, 1.0, 4.0, np.nan, np.nan, np.nan, np.nan, np.nan], atol=1e-9)
    ramp = np.arange(50.0)[:, None] * 3.0
    ramp[20] = np.nan
    smooth = averaged(ramp, np.arange(50) / 60.0)
    assert np.isnan(smooth[20])
    np.testing.assert_allclose(smooth[5:15], ramp[5:15])  # a straight line stays one


def load(folder: Path, begins: dict[str, float], *, still: bool = False, **options: Any) -> Inputs:
    paths = {}
    for c, (name, begin) in enumerate(begins.items()):
        paths[name] = folder / f"{name}.json"
        write_keypoints(paths[name], seen(CAMERAS[c], own_times() + 1.0 + begin, c, still=still))
    write_cameras(folder / "cameras.json", CAMERAS)
    return load_inputs(
        BODY, FileOptions(None, keypoints=paths, cameras=folder / "cameras.json", sync="auto", **options)
    )


def test_files_are_put_on_one_clock(tmp_path: Path) -> None:
    inputs = load(tmp_path, {"cam0": 0.0, "cam1": 0.4, "cam2": 0.0})
    assert any("cam1=0.400" in note and "cam2=0.000" in note and "sure" in note for note in inputs.notes)
    assert inputs.times[0] == pytest.approx(0.4)
    assert not any("end after" in note for note in inputs.notes)
    given = load(tmp_path, {"cam0": 0.0, "cam1": 0.4, "cam2": 0.0}, offset="cam1=1.4")
    assert any("after cam1=1.4: cam0=1.000" in note for note in given.notes)  # given offsets are kept


def test_uncertain_clocks_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"when cam1 started is not certain.*--offset cam1="):
        load(tmp_path, {"cam0": 0.0, "cam1": 0.4}, still=True)
    with pytest.raises(InputError, match="for several cameras"):
        load(tmp_path, {"cam0": 0.0})
    with pytest.raises(InputError, match="nothing to find"):
        load(tmp_path, {"cam0": 0.0, "cam1": 0.0}, offset=["cam0=0", "cam1=0"])
