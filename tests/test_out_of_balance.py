"""Frames in which a standing person would fall over are found, and are hard."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

import kinemode as km
from estimator.energy.balance import BalanceSettings
from estimator.runs.run_file import RunWriter
from estimator.runs.run_header import RunHeader
from estimator.runs.run_reader import Run
from estimator.trackers.frame_result import FrameResult
from kinemode.findings import balance_note, out_of_balance, run_findings
from tests.builders import bent, body_of, camera_at, observe

BODY = body_of("human34")
CAMERA = camera_at(70.0, distance=3.5)
FPS, FRAMES = 30.0, 45


def leaning(lean: float) -> np.ndarray:
    """Standing on both feet as a stiff body that leans forwards by so much [rad] about its ankles."""
    q = bent(BODY, left_ankle_dorsiflexion=lean, right_ankle_dorsiflexion=lean, lumbar_flexion=0.0)
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, lean, 0.0)).coeffs()
    feet = [BODY.landmark_names.index(f"{side}_ankle") for side in ("left", "right")]
    q[:3] -= BODY.landmarks(BODY.at(q))[feet].mean(axis=0) - [0.0, 0.0, -0.8]
    return q


def run_of(path: Path, q: np.ndarray) -> Run:
    """A finished run of poses (T, nq) whose keypoints are exact."""
    times = np.arange(len(q)) / FPS
    header = RunHeader(
        BODY.subject.urdf, BODY.subject.source, BODY.subject.base, (CAMERA,), {CAMERA.name: None},
        {CAMERA.name: CAMERA.image_size}, times, "css", {}, 0, km.__version__,
    )  # fmt: skip
    with RunWriter.create(path, header, overwrite=True) as writer:
        shots = [observe(BODY, x, (CAMERA,), index=t, time=float(times[t])) for t, x in enumerate(q)]
        writer.put_observations([replace(shot, jitter=(0.5,)) for shot in shots])
        unit, zero = np.ones(1), np.zeros(1)
        for t, x in enumerate(q):
            covariance, parent = np.eye(BODY.nv)[None], np.array([0 if t else -1])
            writer.append(
                FrameResult(
                    t, float(times[t]), "tracked", x[None], unit, unit, covariance, parent, zero, zero, ("as_detected",)
                ), {},
            )  # fmt: skip
        writer.finish()
    return Run.open(path)


def test_a_falling_person_is_found_unless_it_is_brief(tmp_path: Path) -> None:
    """A person leaning by 30 degrees about the ankles for over half a second, for three frames, and not at all."""
    settings, upright, falling = BalanceSettings(), leaning(0.0), leaning(0.55)
    long, short = np.array([upright] * 15 + [falling] * 30), np.array([upright] * 30 + [falling] * 3 + [upright] * 12)
    rows = out_of_balance(run_of(tmp_path / "long.run", long), settings)
    assert rows[-1] == FRAMES - 1
    assert 15 <= rows[0] <= 22  # feet that have just moved count as standing a little later
    assert out_of_balance(run_of(tmp_path / "short.run", short), settings) == ()
    assert out_of_balance(run_of(tmp_path / "upright.run", np.array([upright] * FRAMES)), settings) == ()
    assert out_of_balance(run_of(tmp_path / "off.run", long), replace(settings, weight=0.0)) == ()


def test_these_frames_are_hard_with_a_warning(tmp_path: Path) -> None:
    run = run_of(tmp_path / "a.run", np.array([leaning(0.55)] * FRAMES))
    warnings, hard = run_findings(run)
    rows = out_of_balance(run, BalanceSettings())
    assert set(rows) <= set(hard)
    assert balance_note(run, rows) in warnings
    assert f"in {len(rows)} frames" in balance_note(run, rows)
