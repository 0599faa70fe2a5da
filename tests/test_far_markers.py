"""Runs from points whose markers lie far from the body do not have the status "tracked"."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from builders import body_of

import kinemode as km
from estimator.runs.run_reader import Run
from estimator.synthesis.motion import authored_motion

COUNT, RATE = 14, 30.0


def tracked(folder: Path, points: np.ndarray) -> tuple[Run, list[str]]:
    path = folder / "points.npz"
    np.savez(path, points=points, names=np.array(body_of("human34").landmark_names), fps=RATE, unit="m", up="z")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = km.track("human34", points=path, fit="off")
    return run, [str(warning.message) for warning in caught if warning.category is km.FindingWarning]


@pytest.mark.parametrize(("share", "off"), [(0.0, 0.0), (0.4, 1.7), (0.3, 0.6)])
def test_frames_whose_markers_lie_elsewhere_are_hard(share: float, off: float, tmp_path: Path) -> None:
    """Labels that jump to other points for six frames, as after an occlusion."""
    body, rng = body_of("human34"), np.random.default_rng(3)
    points = body.landmarks_of(body.placed(authored_motion(body, 0.4 + np.arange(COUNT) / RATE)))
    wrong = rng.permutation(points.shape[1])[: round(share * points.shape[1])]
    points[4:10, wrong] += off * rng.normal(size=(6, len(wrong), 3))
    run, findings = tracked(tmp_path, points)
    hard = np.flatnonzero(run.status != "tracked").tolist()
    assert hard == (list(range(4, 10)) if share else [])
    assert any("lie far from the body in 6 frames" in finding for finding in findings) == bool(share)
