"""A short run that was made from another motion."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

import kinemode as km
from estimator.retargeting.source import SourceMotion
from tests.builders import body_of

FRAMES, RATE = 10, 30.0


def made_motion(folder: Path) -> km.Run:
    """human34 after itself, bending its left knee while its right foot stands; its left wrist is unknown."""
    body = body_of("human34")
    q = np.tile(body.neutral, (FRAMES, 1))
    knee, hip = (body.q_names.index(f"left_{name}_flexion") for name in ("knee", "hip"))
    q[:, knee] += np.linspace(0.2, 0.9, FRAMES)
    q[:, hip] += np.linspace(0.1, 0.5, FRAMES)
    points = body.landmarks_of(body.placed(q))
    points[:, body.landmark_names.index("left_wrist")] = np.nan
    source = SourceMotion(body.landmark_names, points, np.arange(FRAMES) / RATE, "bend.npz")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", km.InputWarning)
        return km.retarget(source, "human34", out=folder / "made.run")
