"""The family of energy terms, and their sum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from humanoid.kinematics.body import Body, PlacedBodies, PosedBody


class Term(Protocol):
    """One part of the energy (negative log-probability, dimensionless).

    name: what it is, as tables of the energy's parts show it.
    """

    @property
    def name(self) -> str:
        """See `Term`."""
        ...

    def value(self, posed: PosedBody) -> float:
        """What `accumulate` returns, to the last bit, without the cost of derivatives."""
        ...

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """Add the term's gradient (nv,) and Hessian (nv, nv), both in the tangent space at `posed.q`; return its value.

        The Hessian is positive semi-definite (Gauss-Newton with robust weights), unless `exact` asks for the second
        derivative: that may be indefinite, and lets a search end in a few steps. What a term leaves out of it, it says:
        the transition, and the repulsion of hulls.
        """
        ...


class BatchTerm:
    """Base of the terms that look at many poses in one call of compiled code, and without Jacobians."""

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """`Term.value` of N poses, (N,), each to the last bit the same regardless of the others."""
        raise NotImplementedError

    def value(self, posed: PosedBody) -> float:
        """See `Term`."""
        return float(self.values(posed.alone)[0])


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

    def value_at(self, q: np.ndarray) -> float:
        """The energy at configuration q (nq,): `at(q).value` to the last bit, without derivatives."""
        return float(self.values_at(q[None])[0])

    def value(self, posed: PosedBody) -> float:
        """The energy at an already posed body, see `value_at`."""
        value = 0.0
        for term in self.terms:
            value += term.value(posed)
        return value

    def values_at(self, q: np.ndarray) -> np.ndarray:
        """The energies (N,) at configurations q (N, nq), see `value_at`."""
        return self.values(self.body.placed(q))

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """The energies (N,) of N placed bodies, see `value_at`."""
        total = np.zeros(len(placed.q))
        self.add_values(placed, total)
        return total

    def add_values(self, placed: PlacedBodies, total: np.ndarray) -> None:
        """Add the terms one after the other to `total` (N,): the energy of a sum that continues with these."""
        for term in self.terms:
            total += term.values(placed) if isinstance(term, BatchTerm) else self._one_by_one(term, placed)

    def _one_by_one(self, term: Term, placed: PlacedBodies) -> np.ndarray:
        return np.array([term.value(self.body.at(q)) for q in placed.q])
