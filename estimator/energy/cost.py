"""The energy: a sum of terms, and its quadratic model at a pose."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from estimator.energy.recorded import RecordedSum, TermRows
from estimator.energy.term import BatchTerm, Term
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody


class QuadraticModel(NamedTuple):
    """Second-order model of an energy at a posed body: value, gradient (nv,), Hessian (nv, nv), whether it is exact."""

    posed: PosedBody
    value: float
    gradient: np.ndarray
    hessian: np.ndarray
    exact: bool


class Cost:
    """A sum of terms on one body (CSS eqs. 3, 11, 12).

    terms: all of them, those first that compiled code evaluates together. compiled, others: those that it evaluates,
    and those that it does not. base: a sum that the terms given are added to.
    """

    def __init__(self, body: Body, terms: Sequence[Term], base: Cost | None = None) -> None:
        rows = TermRows.of(terms)
        # the base's records are used again where nothing comes between them
        self._base = None if rows.lasting or rows.repulsion else base
        self.body = body
        self._rows: TermRows = rows if base is None else base._rows.plus(rows)
        self.compiled, self.others, self.terms = self._rows.compiled, self._rows.others, self._rows.terms

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled without the records, which are made again."""
        return Cost, (self.body, self.terms)

    def plus(self, terms: Sequence[Term]) -> Cost:
        """This sum and more terms."""
        return Cost(self.body, terms, self) if terms else self

    @cached_property
    def recorded(self) -> RecordedSum:
        """The sum of the terms that compiled code evaluates."""
        if self._base is None:
            return RecordedSum.of(self.body, self.compiled)
        return self._base.recorded.plus(self._rows.own[len(self._base._rows.own) :])

    def in_python(self, left: bool) -> tuple[Term, ...]:
        """Terms to be added to `recorded`: the other terms, and before them the repulsion, the last of `compiled`,
        where that was left out."""
        return (*self.compiled[-1:], *self.others) if left else self.others

    def at(self, q: np.ndarray, exact: bool = False) -> QuadraticModel:
        """The energy's quadratic model at configuration q (nq,)."""
        return self.of(self.body.at(q), exact)

    def of(self, posed: PosedBody, exact: bool = False) -> QuadraticModel:
        """The energy's quadratic model at an already posed body."""
        gradient = np.zeros(self.body.nv)
        hessian = np.zeros((self.body.nv, self.body.nv))
        value, left = self.recorded.add(posed, gradient, hessian, exact)
        for term in self.in_python(left):
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
