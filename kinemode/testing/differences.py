"""Derivatives by differences, on the manifold of configurations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body


def slope(f: Callable[[np.ndarray], np.ndarray], body: Body, q: np.ndarray, v: np.ndarray, step: float) -> np.ndarray:
    """Derivative of f at q (nq,) along v (nv,): the central difference through `pin.integrate`, one order of the step's
    error removed (Richardson)."""

    def central(h: float) -> np.ndarray:
        ahead, behind = (np.asarray(f(pin.integrate(body.model, q, s * h * v))) for s in (1.0, -1.0))
        return (ahead - behind) / (2.0 * h)

    return (4.0 * central(step) - central(2.0 * step)) / 3.0
