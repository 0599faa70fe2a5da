"""The Butterworth filter: its response in closed form, on every kind of joint, and what it leaves unchanged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import body_of, inside
from made_runs import made_run
from scipy.signal import butter, freqz
from test_evaluation import robot

import kinemode as km
from estimator.runs.filtering import Filtering, filtered, gain
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError

RATE, CUTOFF = 60.0, 6.0
TIME = np.arange(300) / RATE
WITHIN = slice(60, -60)


def swung(body: Body, name: str, angle: np.ndarray) -> np.ndarray:
    q = np.tile(body.neutral, (len(angle), 1))
    q[:, body.place(name).q] = angle[:, None]
    return q


def turned(body: Body, turns: np.ndarray) -> np.ndarray:
    """Poses whose root is turned by rotation vectors turns (T, 3) [rad]."""
    q = np.tile(body.neutral, (len(turns), 1))
    q[:, 3:7] = [pin.Quaternion(pin.exp3(turn)).coeffs() for turn in turns]
    return q


def angles_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles (T,) [rad] between the roots of two motions."""
    return 2.0 * np.arccos(np.clip(np.abs(np.sum(a[:, 3:7] * b[:, 3:7], axis=1)), 0.0, 1.0))


def amplitude(signal: np.ndarray, frequency: float) -> float:
    """Amplitude of a sine of this frequency, by least squares."""
    time = TIME[WITHIN]
    basis = np.stack([np.sin(2.0 * np.pi * frequency * time), np.cos(2.0 * np.pi * frequency * time), time**0], axis=1)
    return float(np.hypot(*np.linalg.lstsq(basis, signal[WITHIN], rcond=None)[0][:2]))


def test_the_response_is_that_of_two_passes_with_three_decibels_at_the_cutoff() -> None:
    assert gain(CUTOFF, CUTOFF, RATE) == pytest.approx(1.0 / np.sqrt(2.0))
    assert gain(0.0, CUTOFF, RATE) == 1.0
    # Winter's correction, 0.802, is in the tangent of the frequency; the response of the filter so designed, squared
    corrected = RATE / np.pi * np.arctan(np.tan(np.pi * CUTOFF / RATE) / (np.sqrt(2.0) - 1.0) ** 0.25)
    frequency = np.array([1.0, 4.0, 9.0, 20.0])
    _, response = freqz(*butter(2, corrected, fs=RATE), worN=frequency, fs=RATE)
    np.testing.assert_allclose(gain(frequency, CUTOFF, RATE), np.abs(response) ** 2, rtol=1e-9)


@pytest.mark.parametrize("frequency", [1.0, 3.0, 6.0, 9.0, 14.0])
def test_a_sine_keeps_its_phase_and_the_known_part_of_its_amplitude(frequency: float) -> None:
    wave = np.sin(2.0 * np.pi * frequency * TIME + 0.3)
    known = float(gain(frequency, CUTOFF, RATE))
    human, machine = body_of("human34"), robot()
    knee = swung(human, "left_knee_flexion", 1.0 + 0.3 * wave)
    out = filtered(human, knee, TIME, CUTOFF).q[:, human.place("left_knee_flexion").q][:, 0]
    np.testing.assert_allclose(out[WITHIN], 1.0 + 0.3 * known * wave[WITHIN], atol=0.3 * 1e-3)
    assert amplitude(out, frequency) == pytest.approx(0.3 * known, rel=0.01)
    endless = np.tile(machine.neutral, (len(TIME), 1))
    angle = 3.0 + 0.3 * wave + 2.0 * TIME  # over the cut of the arc tangent, several times
    endless[:, 1:3] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    spun = filtered(machine, endless, TIME, CUTOFF).q
    out = np.unwrap(np.arctan2(spun[:, 2], spun[:, 1]))
    out = out - 2.0 * TIME
    assert amplitude(out, frequency) == pytest.approx(0.3 * known, rel=0.01)
    small = turned(human, 0.1 * wave[:, None] * np.array([0.6, 0.0, 0.8]))
    out = 2.0 * filtered(human, small, TIME, CUTOFF).q[:, 3:6] @ np.array([0.6, 0.0, 0.8])
    assert amplitude(out, frequency) == pytest.approx(0.1 * known, rel=0.01)


def test_what_moves_steadily_stays_to_the_ends() -> None:
    """A root that keeps turning, at more than half a turn a second and with quaternions of any sign; a joint and a
    position that move evenly."""
    body = body_of("human34")
    q = turned(body, TIME[:, None] * np.array([0.0, 2.4, 3.2]))
    q[::7, 3:7] *= -1.0
    q[:, 0] = 1.3 * TIME
    q[:, body.place("left_knee_flexion").q] = (0.2 + 0.3 * TIME)[:, None]
    out = filtered(body, q, TIME, CUTOFF)
    assert angles_between(out.q, q).max() < 1e-6
    np.testing.assert_allclose(np.linalg.norm(out.q[:, 3:7], axis=1), 1.0, rtol=1e-12)
    rest = [0, *range(7, body.nq)]
    np.testing.assert_allclose(out.q[:, rest], q[:, rest], atol=1e-6)
    assert out.notes == ()


def test_limits_hold_with_a_note(tmp_path: Path) -> None:
    body = body_of("human34")
    knee = body.place("left_knee_flexion").q.start
    square = np.where(np.sin(2.0 * np.pi * TIME) > 0.0, body.upper[knee], 0.3)  # it rings beyond the limit
    out = filtered(body, swung(body, "left_knee_flexion", square), TIME, CUTOFF)
    assert inside(body, out.q)
    assert list(out.clamped) == ["left_knee_flexion"]
    assert out.q[:, knee].max() == body.upper[knee]
    run = made_run(tmp_path / "a.run", body.subject, swung(body, "left_knee_flexion", square)[:, None], times=TIME)
    with pytest.warns(km.InputWarning, match="beyond joint limits were clipped to them: left_knee_flexion in"):
        km.export(run, tmp_path / "a.csv", filter=CUTOFF)


def test_an_invalid_cutoff_is_refused() -> None:
    body = body_of("human34")
    q = np.tile(body.neutral, (len(TIME), 1))
    for cutoff in (30.0, 31.0):
        with pytest.raises(InputError, match=f"a cut-off of {cutoff:g} Hz is not below half the frame rate, 30 Hz"):
            filtered(body, q, TIME, cutoff)
    for cutoff in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="Hz is not a cut-off"):
            filtered(body, q, TIME, cutoff)
    filtered(body, q, TIME, 29.9)


def response_error(time: np.ndarray, keep: np.ndarray) -> tuple[float, Filtering]:
    """The largest error of a filtered sine at these times, away from the ends, and the notes."""
    body = body_of("human34")
    wave = np.sin(2.0 * np.pi * 3.0 * time)
    q = swung(body, "left_knee_flexion", 1.0 + 0.3 * wave)
    q[~keep] = np.nan
    done = filtered(body, q, time, CUTOFF)
    out = done.q[:, body.place("left_knee_flexion").q][:, 0]
    assert np.isnan(done.q[~keep]).all()
    assert np.isfinite(done.q[keep]).all()
    known = 1.0 + 0.3 * float(gain(3.0, CUTOFF, RATE)) * wave
    return float(np.nanmax(np.abs(out - known)[WITHIN])), done


def test_uneven_times_and_short_gaps_are_bridged() -> None:
    rng, every = np.random.default_rng(0), np.ones(len(TIME), dtype=bool)
    off, done = response_error(TIME + rng.uniform(-0.3, 0.3, len(TIME)) / RATE, every)
    assert off < 0.003
    assert done.resampled
    assert "not evenly spaced" in done.notes[0]
    off, done = response_error(TIME + rng.uniform(-0.01, 0.01, len(TIME)) / RATE, every)
    assert off < 0.003
    assert not done.resampled
    short = every.copy()
    short[100:103] = False  # four frames apart, 67 ms, where half a period of the cut-off is 83 ms
    off, done = response_error(TIME, short)
    assert (off < 0.003, done.parts) == (True, 1)


def test_long_gaps_part_a_motion() -> None:
    """Samples on one side do not affect the other."""
    body = body_of("human34")
    angle = np.where(TIME < 2.0, 0.3, 1.5)
    q = swung(body, "left_knee_flexion", angle)
    q[120:130] = np.nan
    out = filtered(body, q, TIME, CUTOFF)
    assert out.parts == 2
    assert "2 parts were filtered by themselves" in out.notes[0]
    np.testing.assert_allclose(out.q, q, atol=1e-12)
    alone = np.full_like(q, np.nan)
    alone[7] = q[7]
    np.testing.assert_array_equal(filtered(body, alone, TIME, CUTOFF).q, alone)


def test_a_filtered_run_is_a_run_with_another_motion(tmp_path: Path) -> None:
    body = body_of("human34")
    q = swung(body, "left_knee_flexion", 1.0 + 0.3 * np.sin(2.0 * np.pi * 20.0 * TIME[:40]))
    run = made_run(tmp_path / "a.run", body.subject, q[:, None], times=TIME[:40])
    other = run.butterworth(CUTOFF)
    assert run.filtering is None
    assert other.filtering is not None
    assert (other.filtering.cutoff, other.filtering.rate) == (CUTOFF, pytest.approx(RATE))
    assert repr(other).endswith("filter 6 Hz>")
    np.testing.assert_array_equal(run.q, q)
    assert np.ptp(other.angle("left_knee_flexion")) < 0.3 * np.ptp(run.angle("left_knee_flexion"))
    np.testing.assert_array_equal(other.std, run.std)
    np.testing.assert_array_equal(other.mode_q, run.mode_q)
    t = 20
    np.testing.assert_allclose(other.landmarks[t], body.landmarks(body.at(other.q[t])))
    assert np.abs(other.landmarks[t] - run.landmarks[t]).max() > 1e-3
