"""Terms that compiled code evaluates, and sums of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from estimator.energy.kernels.evaluate import evaluate
from estimator.energy.kernels.records import REPULSION, Record, Records, joined
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
        """What the kernel reads."""
        raise NotImplementedError

    def __getstate__(self) -> dict[str, Any]:
        """Without the record, which is made again."""
        return {name: value for name, value in self.__dict__.items() if name != "record"}

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        return RecordedSum(self._body, [self]).add(posed, gradient, hessian, exact)


@lru_cache(maxsize=_MOST_ROWS)
def _lasting_records(terms: tuple[RecordedTerm, ...]) -> Records:
    return joined([term.record for term in terms])


class RecordedSum:
    """A sum of recorded terms on one body.

    own, kept: the records of the terms of a frame, and of those that last. last: the repulsion, the last of them, which
    the kernel leaves out where it cannot solve a contact.
    """

    def __init__(self, body: Body, terms: Sequence[RecordedTerm]) -> None:
        self._body = body
        lasting = tuple(term for term in terms if term.lasting)
        self.own = joined([term.record for term in terms if not term.lasting])
        self.kept = _lasting_records(lasting)
        self.last = lasting[-1] if lasting else None

    def add(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool) -> float:
        """As `Term.accumulate`: the sum of its terms."""
        by_column = self._by_column(gradient, hessian)
        tree = self._body.tree
        value, left = evaluate(
            *self.own, *self.kept, tree.joint_parent, tree.column_joint, tree.column_parent, posed.placements,
            posed.spatial_jacobian, posed.q, exact, gradient, hessian, *by_column,
        )  # fmt: skip
        if self._body.follows:
            gradient += self._body.collected(by_column[0])
            hessian += self._body.collected_hessian(by_column[1])
        if left:
            assert self.last is not None
            value += self.last.accumulate(posed, gradient, hessian, exact)
        return float(value)

    def _by_column(self, gradient: np.ndarray, hessian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if not self._body.follows:
            return gradient, hessian
        columns = len(self._body.tree.column_dof)
        return np.zeros(columns), np.zeros((columns, columns))


def in_order(terms: Sequence[Term]) -> tuple[list[RecordedTerm], list[Term]]:
    """Recorded terms in the order in which they are summed, and the others: of a frame, lasting, repulsion."""
    rows: tuple[list[RecordedTerm], ...] = ([], [], [])
    others = list[Term]()
    for term in terms:
        row = _row(term)
        if row is None or (row == _REPULSION and rows[row]):
            others.append(term)
        else:
            assert isinstance(term, RecordedTerm)
            rows[row].append(term)
    return [term for row in rows for term in row], others


_OWN, _LASTING, _REPULSION = range(3)


def _row(term: Term) -> int | None:
    if not isinstance(term, RecordedTerm) or not term.recorded:
        return None
    if term.kind == REPULSION:
        return _REPULSION
    return _LASTING if term.lasting else _OWN
