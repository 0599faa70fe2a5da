"""The family of energy terms, and their sum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from humanoid.kinematics.body import Body, PosedBody


class Term(Protocol):
    """One part of the energy (negative log-probability, dimensionless)."""

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """Add the term's gradient (nv,) and Hessian (nv, nv), both in the tangent space at `posed.q`; return its value.

        The Hessian is positive semi-definite (Gauss-Newton with robust weights), unless `exact` asks for the true
        curvature as far as the term knows it: that may be indefinite, and lets a search end in a few steps.
        """
        ...


class QuadraticModel(NamedTuple):
    """Second-order model of an energy at a posed body: value, gradient (nv,), Hessian (nv, nv), whether it is exact."""

    posed: PosedBody
    value: float
    gradient: np.ndarray
    hessian: np.ndarray
    exact: bool


class Cost:
    """A sum of terms on one body (CSS eqs. 3, 11, 12)."""

    def __init__(self, body: Body, terms: Sequence[Term]) -> None:
        self.body = body
        self.terms = tuple(terms)

    def plus(self, terms: Sequence[Term]) -> Cost:
        """This sum and more terms."""
        return Cost(self.body, (*self.terms, *terms))

    def at(self, q: np.ndarray, exact: bool = False) -> QuadraticModel:
        """The energy's quadratic model at configuration q (nq,)."""
        return self.of(self.body.at(q), exact)

    def of(self, posed: PosedBody, exact: bool = False) -> QuadraticModel:
        """The energy's quadratic model at an already posed body."""
        gradient = np.zeros(self.body.nv)
        hessian = np.zeros((self.body.nv, self.body.nv))
        value = 0.0
        for term in self.terms:
            value += term.accumulate(posed, gradient, hessian, exact)
        return QuadraticModel(posed, value, gradient, hessian, exact)
