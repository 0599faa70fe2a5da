"""The family of energy terms."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from humanoid.kinematics.body import PlacedBodies, PosedBody


class Term(Protocol):
    """One part of the energy (negative log-probability, dimensionless).

    name: what it is, as tables of the energy's parts show it.
    """

    @property
    def name(self) -> str:
        """See `Term`."""
        ...

    def value(self, posed: PosedBody) -> float:
        """The value that `accumulate` returns, to the last bit, without the cost of derivatives."""
        ...

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """Add the term's gradient (nv,) and Hessian (nv, nv), both in the tangent space at `posed.q`; return its value.

        The Hessian is positive semi-definite (Gauss-Newton with robust weights), unless `exact` requests the second
        derivative: that may be indefinite, and lets a search end in a few steps. Terms that leave a part of it out
        document this: the transition, and the repulsion of hulls.
        """
        ...


class BatchTerm:
    """Base of the terms that evaluate many poses in one call of compiled code, and without Jacobians."""

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """`Term.value` of N poses, (N,), each to the last bit the same regardless of the others."""
        raise NotImplementedError

    def value(self, posed: PosedBody) -> float:
        """See `Term`."""
        return float(self.values(posed.alone)[0])
