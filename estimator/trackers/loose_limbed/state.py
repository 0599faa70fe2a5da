"""State of the loose-limbed tracker: the beliefs of all limbs, and the poses assembled from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimator.data.formats.checked_arrays import DamageError, Field, check_arrays
from estimator.inference.beliefs.graph import APART, OK, UNEXPLAINED, Belief
from estimator.inference.beliefs.space import PLACEMENTS
from estimator.inference.mixture import Mixture
from estimator.trackers.loose_limbed.limbs.window import Beliefs
from estimator.trackers.mixture_state import MixtureState
from humanoid.kinematics.body import Body

_FIELDS = {
    "seen": Field("f"),
    "believed": Field("f"),
    "limb_points": Field("f", ("L", "N", "size")),
    "limb_weights": Field("f", ("L", "N")),
    "limb_status": Field("U", ("L",)),
}


@dataclass(frozen=True)
class LimbState:
    """mixture: poses of the last frame. time [s]: of that. seen [s]: of the last frame that was searched. beliefs (L):
    of each limb at `believed` [s], which is that frame or the one before."""

    beliefs: Beliefs
    mixture: Mixture
    time: float
    seen: float
    believed: float

    def arrays(self) -> dict[str, np.ndarray]:
        """See `estimator.trackers.base.State`."""
        return {
            **MixtureState(self.mixture, self.time).arrays(),
            "seen": np.array(self.seen),
            "believed": np.array(self.believed),
            **belief_arrays(self.beliefs),
        }

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray], body: Body, limbs: int) -> LimbState:
        """The inverse of `arrays`, of so many limbs; raises DamageError for invalid arrays."""
        state = MixtureState.from_arrays(arrays, body)
        check_arrays(arrays, _FIELDS, {"L": limbs, "size": PLACEMENTS.size})
        points, weights = arrays["limb_points"], arrays["limb_weights"]
        seen, believed = float(arrays["seen"]), float(arrays["believed"])
        if weights.shape != points.shape[:2] or not (weights >= 0.0).all() or not np.allclose(weights.sum(axis=1), 1.0):
            raise DamageError("limb_weights are not shares of limb_points")
        if not np.allclose(np.linalg.norm(points[:, :, 3:], axis=2), 1.0):
            raise DamageError("limb_points have quaternions of another length than 1")
        if not believed <= seen <= state.time:
            raise DamageError(f"limbs were believed at {believed:g} s, seen at {seen:g} s, after {state.time:g}")
        known = [str(status) for status in arrays["limb_status"]]
        if not set(known) <= {OK, UNEXPLAINED, APART}:
            raise DamageError("limb_status has an invalid status")
        beliefs = tuple(Belief(PLACEMENTS, p, w, s) for p, w, s in zip(points, weights, known, strict=True))
        return LimbState(beliefs, state.mixture, state.time, seen, believed)


def belief_arrays(beliefs: Beliefs) -> dict[str, np.ndarray]:
    """limb_points (L, N, 7), limb_weights (L, N) and limb_status (L): beliefs of as many points each, to the last bit;
    see `estimator.inference.beliefs.graph.Belief`."""
    return {
        "limb_points": np.array([belief.points for belief in beliefs]),
        "limb_weights": np.array([belief.weights for belief in beliefs]),
        "limb_status": np.array([belief.status for belief in beliefs], dtype=np.str_),
    }
