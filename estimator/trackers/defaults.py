"""Changes to the common settings that several trackers share (`estimator.trackers.spec.Spec.defaults`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

NEARLY_GAUSSIAN = 1e4
"""nu, in squared standard deviations, of a cue's potential that is to be Gaussian."""
EDGES_NEARLY_GAUSSIAN = 200.0
"""The same of edges. They are looked for within six standard deviations, where this is Gaussian to 9 %; and nu / 2 is
what a missing edge costs, which must not drown all else."""

ONLY_FILTERS: dict[str, Any] = {"smooth": {"enabled": False}}
"""The trackers of the papers do not look back."""
AS_DETECTED: dict[str, Any] = {"search": {"exchange": False}}
"""The trackers of the papers use keypoints unchanged."""
NOTHING_STANDS: dict[str, Any] = {"cost": {"standing_weight": 0.0}}
"""They do not ask whether feet stand."""
NOT_BALANCED: dict[str, Any] = {"cost": {"terms": {"balance": {"weight": 0.0}}}}
"""Nor whether the person would fall over."""
ONE_READING: dict[str, Any] = {"search": {"readings": False}}
"""They keep no room for the other reading of a trunk."""
ALL_AS_QUICK: dict[str, Any] = {"cost": {"quickness": False}}
"""To them all joints are as quick."""
NOT_LIFTED: dict[str, Any] = {"cost": {"lifted_weight": 0.0}}
"""Nor what another network makes of the picture."""
NO_CAPTURE: dict[str, Any] = {"cost": {"pose_prior_weight": 0.0}}
"""They use no captured poses."""
LEAST_SQUARES: dict[str, Any] = {
    "cost": {
        "potential": "gaussian",
        "transition_potential": "gaussian",
    },
    "cues": {
        "edges": {"nu": EDGES_NEARLY_GAUSSIAN},
        "silhouette": {"nu": NEARLY_GAUSSIAN},
        "flow": {"nu": NEARLY_GAUSSIAN},
    },
}
"""No observation ever loses its pull."""
OVERLAPPING: dict[str, Any] = {"cost": {"interpenetration_weight": 0.0}}
"""Parts need not keep apart."""


def together(*changes: Mapping[str, Any]) -> dict[str, Any]:
    """Nested changes in one; they do not change the same setting."""
    made: dict[str, Any] = {}
    for change in changes:
        for name, value in change.items():
            made[name] = together(made.get(name, {}), value) if isinstance(value, Mapping) else value
    return made


FROM_A_PAPER = together(
    ONLY_FILTERS, AS_DETECTED, NO_CAPTURE, NOTHING_STANDS, NOT_BALANCED, ONE_READING, ALL_AS_QUICK, NOT_LIFTED
)
