"""Clocks whose rate differs from the declared one are found beside the offsets, and are not mistaken for offsets."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.data.clock_rates import best_line, clock_rates
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.data.lag_lines import LagLine, fitted_line
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
SECONDS = 12.0


@cache
def filmed(
    c: int, declared: float, true: float, begin: float, *, jump: float = 0.0, seconds: float = SECONDS
) -> KeypointTrack:
    """What camera c sees, from `begin` [s], of a person who never repeats a motion, at a true rate while the file
    declares another. jump [s]: time that the clock skips in the middle."""
    at = begin + 2.0 + np.arange(int(seconds * declared)) / true
    at = at + jump * (at > at.mean())
    phase = 1.5 + 0.9 * np.sin(2.0 * np.pi * at / 5.3) + 0.5 * np.sin(2.0 * np.pi * at / 2.9 + 1.0) + 0.02 * at
    q = authored_motion(BODY, phase, TURN_REACH)
    track = keypoints(BODY, q, [CAMERAS[c]], np.random.default_rng(c), DetectorSettings(0.7))[0]
    return replace(track, fps=declared)


def clocks_of(*tracks: KeypointTrack, held: tuple[int, ...] = (0,)) -> Synchrony:
    times = [np.arange(track.frame_count) / float(track.fps or 0.0) for track in tracks]
    return synchronised(CAMERAS[: len(tracks)], [track.pixels for track in tracks], times, held)


@pytest.mark.parametrize(("declared", "true", "begin"), [(30.0, 29.87, 0.37), (24.9, 25.0, -0.62)])
def test_rate_and_offset_are_found_together(declared: float, true: float, begin: float) -> None:
    result = clocks_of(filmed(0, 30.0, 30.0, 0.0), filmed(1, declared, true, begin))
    assert result.sure.all()
    assert result.rates is not None
    assert result.rates.scales[1] == pytest.approx(declared / true, abs=1.5e-3)
    assert result.rates.stds[1] < 0.8e-3
    assert result.offsets[1] == pytest.approx(begin, abs=0.5 / 25.0)


def test_each_of_three_cameras_has_its_rate() -> None:
    tracks = [
        filmed(c, 30.0, true, begin, seconds=10.0)
        for c, (true, begin) in enumerate([(30, 0), (29.85, 0.3), (30, -0.4)])
    ]
    result = clocks_of(*tracks, held=(2,))
    assert result.sure.all()
    assert result.rates is not None
    np.testing.assert_allclose(result.rates.scales, [1.0, 30.0 / 29.85, 1.0], atol=2e-3)
    assert result.rates.scales[[0, 2]].tolist() == [1.0, 1.0]


def test_equal_rates_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    tracks = [filmed(0, 30.0, 30.0, 0.0), filmed(1, 30.0, 30.0, 0.43)]
    result = clocks_of(*tracks)
    assert result.rates is not None
    assert not result.rates.differ
    assert not result.rates.doubtful.any()
    assert result.sure.all()
    monkeypatch.setattr("estimator.data.clock_rates._FEWEST", 1000)  # as if every clip were too short for rates
    np.testing.assert_array_equal(clocks_of(*tracks).offsets, result.offsets)


@pytest.mark.parametrize("jump", [0.1, -0.07])
def test_a_clock_that_jumps_has_no_rate(jump: float) -> None:
    """Frames dropped or repeated in the middle: no single line fits both halves."""
    result = clocks_of(filmed(0, 30.0, 30.0, 0.0), filmed(1, 30.0, 30.0, 0.2, jump=jump))
    assert result.sure.tolist() == [True, False]
    assert result.rates is not None
    assert not result.rates.differ


def test_short_and_empty_clips_have_no_rates() -> None:
    pixels = [np.full((90, 5, 2), np.nan)] * 2
    for count in (0, 1, 90):
        rates = clock_rates(CAMERAS[:2], [p[:count] for p in pixels], [np.arange(count) / 30.0] * 2, (0,), 10.0)
        assert not rates.differ
        assert np.isnan(rates.first).all()


def test_the_line_of_most_pieces_is_found_among_lags() -> None:
    """Isolated wrong pieces, each at another lag, decide nothing."""
    offsets, step, rng = np.linspace(-20.0, 20.0, 16), 1.0 / 30.0, np.random.default_rng(0)
    lags = step * np.arange(-60, 61)
    table = np.minimum(np.abs(lags - (0.4 + 0.005 * offsets)[:, None]), 0.2)
    table[::4] = np.minimum(np.abs(lags - rng.uniform(-2.0, 2.0, 4)[:, None]), 0.2) * 1.5
    line = best_line(table, offsets, step, 2.0, 0.01)
    assert line is not None
    assert line == (pytest.approx(0.4, abs=step), pytest.approx(0.005, abs=0.002))
    assert best_line(np.full_like(table, np.nan), offsets, step, 2.0, 0.01) is None


def test_the_deviation_of_a_slope_is_that_of_its_errors() -> None:
    offsets, step, std = np.linspace(-8.0, 8.0, 16), 0.01, 0.012
    lags = step * np.arange(-12, 13)
    lines = []
    for seed in range(60):
        off = 0.01 + 0.0005 * offsets + np.random.default_rng(seed).normal(0.0, std, 16)
        lines.append(fitted_line(np.square(lags - off[:, None]) * 100.0, offsets, step, 3))
    errors = np.array([(line.slope - 0.0005) / line.slope_std for line in lines if line is not None])
    assert len(errors) == 60
    assert 0.7 < float(np.sqrt(np.mean(np.square(errors)))) < 1.3


def test_a_jump_is_not_a_line() -> None:
    offsets, step, rng = np.linspace(-8.0, 8.0, 16), 0.01, np.random.default_rng(1)
    lags = step * np.arange(-12, 13)

    def line(off: np.ndarray) -> LagLine:
        errors = rng.normal(0.0, 0.004, 16)
        fitted = fitted_line(np.square(lags - (off + errors)[:, None]) * 100.0, offsets, step, 3)
        assert fitted is not None
        return fitted

    assert line(np.where(offsets > 2.0, 0.03, -0.02)).jump == pytest.approx(0.05, abs=0.01)
    assert line(0.006 * offsets).jump == 0.0
    assert line(0.0 * offsets).jump == 0.0


def load(folder: Path, *tracks: KeypointTrack, **options: Any) -> Inputs:
    paths = {}
    for camera, track in zip(CAMERAS, tracks, strict=False):
        paths[camera.name] = folder / f"{camera.name}.json"
        write_keypoints(paths[camera.name], track)
    write_cameras(folder / "cameras.json", CAMERAS[: len(tracks)])
    return load_inputs(
        BODY, FileOptions(None, keypoints=paths, cameras=folder / "cameras.json", **{"sync": "auto"} | options)
    )


def test_files_are_put_on_one_clock_of_one_rate(tmp_path: Path) -> None:
    inputs = load(tmp_path, filmed(0, 30.0, 30.0, 0.0), filmed(1, 30.0, 29.85, 0.37))
    assert any("cam1 at 29.8" in note and "where 30 is declared" in note for note in inputs.notes)
    assert inputs.times[-1] <= SECONDS
    exact = load(tmp_path, filmed(0, 30.0, 30.0, 0.0), filmed(1, 30.0, 30.0, 0.0), sync="off")
    at = {round(30.0 * time): each.pixels[1] for time, each in zip(exact.times, exact.observations, strict=True)}
    off = [
        np.linalg.norm(each.pixels[1] - at[round(30.0 * time)], axis=1)
        for time, each in zip(inputs.times, inputs.observations, strict=True)
    ]
    assert all(np.nanmedian(part) < 3.0 for part in (off[:60], off[-60:]))


def test_a_jump_is_refused_with_its_reason(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="parts of the clips of cam1 have different offsets"):
        load(tmp_path, filmed(0, 30.0, 30.0, 0.0), filmed(1, 30.0, 30.0, 0.2, jump=0.1))
