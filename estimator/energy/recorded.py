"""Terms that compiled code evaluates, and sums of them."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from estimator.energy.kernels.evaluate import evaluate
from estimator.energy.kernels.records import REPULSION, Record, Records, joined
from estimator.energy.points import add_by_column
from estimator.energy.term import BatchTerm, Term
from humanoid.kinematics.body import Body, PosedBody

_MOST_ROWS = 16  # rows of lasting records that are kept


class RecordedTerm(BatchTerm):
    """Base of the terms that a compiled kernel evaluates from a record of their numbers.

    kind: which kernel. lasting: whether it serves many frames, so that its record is made once. recorded: whether the
    kernel serves its body too.
    """

    name: str
    kind: int
    lasting = False
    recorded = True
    _body: Body

    @cached_property
    def record(self) -> Record:
        """The kernel's input."""
        raise NotImplementedError

    def __getstate__(self) -> dict[str, Any]:
        """The state without the record, which is made again."""
        return {name: value for name, value in self.__dict__.items() if name != "record"}

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        return RecordedSum.of(self._body, [self]).add(posed, gradient, hessian, exact)[0]


@lru_cache(maxsize=_MOST_ROWS)
def _lasting_records(terms: tuple[RecordedTerm, ...]) -> Records:
    return joined([term.record for term in terms])


class RecordedSum:
    """A sum of recorded terms on one body. own, kept: the records of the terms of a frame, and of those that last."""

    def __init__(self, body: Body, of_frame: Records, lasting: Records) -> None:
        self._body, self.own, self.kept = body, of_frame, lasting

    @staticmethod
    def of(body: Body, terms: Sequence[RecordedTerm]) -> RecordedSum:
        """The sum of these terms."""
        own = joined([term.record for term in terms if not term.lasting])
        return RecordedSum(body, own, _lasting_records(tuple(term for term in terms if term.lasting)))

    def plus(self, terms: Sequence[RecordedTerm]) -> RecordedSum:
        """This sum and more terms of a frame."""
        return RecordedSum(self._body, joined([term.record for term in terms], self.own), self.kept)

    def add(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool) -> tuple[float, bool]:
        """As `Term.accumulate`: the sum of its terms, and whether the repulsion was left out of it, see `evaluate`."""
        value, left, tree = 0.0, 0, self._body.tree

        def add(column_gradient: np.ndarray, column_hessian: np.ndarray) -> None:
            nonlocal value, left
            value, left = evaluate(
                *self.own, *self.kept, tree.joint_parent, tree.column_joint, tree.column_parent, posed.placements,
                posed.spatial_jacobian, posed.q, exact, gradient, hessian, column_gradient, column_hessian,
            )  # fmt: skip

        add_by_column(self._body, gradient, hessian, add)
        return float(value), left > 0


class TermRows(NamedTuple):
    """Terms in the order in which they are summed: recorded ones of a frame, lasting ones, the repulsion last, and the
    others."""

    own: tuple[RecordedTerm, ...] = ()
    lasting: tuple[RecordedTerm, ...] = ()
    repulsion: tuple[RecordedTerm, ...] = ()
    others: tuple[Term, ...] = ()

    @staticmethod
    def of(terms: Sequence[Term]) -> TermRows:
        """The rows of these terms; a second repulsion is one of the others."""
        rows: tuple[list[Any], ...] = ([], [], [], [])
        for term in terms:
            k = _row(term)
            rows[_OTHERS if k == _REPULSION and rows[k] else k].append(term)
        return TermRows(*map(tuple, rows))

    def plus(self, more: TermRows) -> TermRows:
        """These and more of them."""
        return TermRows.of([*self.terms, *more.terms]) if more.repulsion else TermRows(*map(operator.add, self, more))

    @property
    def compiled(self) -> tuple[RecordedTerm, ...]:
        """The terms that compiled code evaluates together."""
        return (*self.own, *self.lasting, *self.repulsion)

    @property
    def terms(self) -> tuple[Term, ...]:
        """All of them."""
        return (*self.compiled, *self.others)


_OWN, _LASTING, _REPULSION, _OTHERS = range(4)


def _row(term: Term) -> int:
    if not isinstance(term, RecordedTerm) or not term.recorded:
        return _OTHERS
    if term.kind == REPULSION:
        return _REPULSION
    return _LASTING if term.lasting else _OWN
