"""How bodies move from frame to frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class MotionPrior(NamedTuple):
    """Energy of velocities and accelerations in the tangent space, every degree of freedom by itself.

    velocity_std (nv,) [per second], acceleration_std (nv,) [per second squared]: standard deviations. nu: of the
    Lorentzian (`estimator.numerics.robust`): a sudden movement is unlikely but possible.
    """

    velocity_std: np.ndarray
    acceleration_std: np.ndarray
    nu: float = 8.0

    def velocity_energy(self, v: np.ndarray) -> np.ndarray:
        """Energy (...) of velocities (..., nv)."""
        return self._energy(v / self.velocity_std)

    def acceleration_energy(self, a: np.ndarray) -> np.ndarray:
        """Energy (...) of accelerations (..., nv)."""
        return self._energy(a / self.acceleration_std)

    def _energy(self, e: np.ndarray) -> np.ndarray:
        energy: np.ndarray = 0.5 * self.nu * np.log1p(np.square(e) / self.nu).sum(axis=-1)
        return energy
