"""Data association: how a frame's keypoints are assigned to the body's landmarks: detectors take left for right."""

from __future__ import annotations

from typing import NamedTuple

from estimator.energy.reprojection import Reprojection

AS_DETECTED, EXCHANGED = "as_detected", "exchanged"


class Association(NamedTuple):
    """One data association of a frame's keypoints with landmarks.

    name: `AS_DETECTED`, or `EXCHANGED` (left and right). term: the keypoints' energy under it. penalty: the energy that
    choosing it costs.
    """

    name: str
    term: Reprojection
    penalty: float
