"""Poses that explain the images otherwise than the particles, followed beside these until images have decided."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimator.data.formats.checked_arrays import DamageError, Field, check_arrays, check_configurations
from humanoid.kinematics.body import Body

_FIELDS = {"alternative_q": Field("f", ("M", "nq")), "alternative_log_odds": Field("f")}


@dataclass(frozen=True, eq=False)
class Alternative:
    """Poses q (M, nq), each as likely as the others, too unlikely together to be among the particles; log_odds: of all
    of them to all of the particles."""

    q: np.ndarray
    log_odds: float

    def arrays(self) -> dict[str, np.ndarray]:
        """See `estimator.trackers.base.State`."""
        return {"alternative_q": self.q, "alternative_log_odds": np.array(self.log_odds)}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray], body: Body) -> Alternative | None:
        """The alternative of a stored state, None where it has none. Raises DamageError for invalid arrays."""
        if not any(name in arrays for name in _FIELDS):
            return None
        check_arrays(arrays, _FIELDS, {"nq": body.nq})
        q = arrays["alternative_q"]
        if not len(q):
            raise DamageError("alternative_q has no poses")
        check_configurations(body, q, "alternative_q")
        return Alternative(q, float(arrays["alternative_log_odds"]))
