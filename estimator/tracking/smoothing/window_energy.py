"""Terms of the single frames of a window, and terms that tie each frame to the next, in one compiled pass."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.energy.cost import Cost
from estimator.energy.kernels.evaluate import evaluate
from estimator.energy.kernels.records import Record, joined
from estimator.energy.recorded import RecordedTerm
from estimator.energy.standing import StandingTie, TiedPoints, tie_points
from estimator.tracking.smoothing.ties import Tie, Ties
from humanoid.kinematics.body import Body, PosedBody
from humanoid.kinematics.compiled_tree import integrate, place_joints
from humanoid.support.compiled import jit


class WindowRecords(NamedTuple):
    """The records of T frames in a row, those of terms that frames share once.

    starts (N, 3), integers (I,), numbers (F,): see `Records`. rows (T, 3): of each frame its first start, that of its
    first lasting term, and that after its last.
    """

    starts: np.ndarray
    integers: np.ndarray
    numbers: np.ndarray
    rows: np.ndarray

    @staticmethod
    def of(costs: Sequence[Cost]) -> WindowRecords:
        """Records of the terms of each frame."""
        number, records, used = dict[RecordedTerm, int](), list[Record](), list[int]()
        rows = np.empty((len(costs), 3), dtype=np.int64)
        for cost, row in zip(costs, rows, strict=True):
            terms = cost.compiled
            row[:] = len(used), len(used) + sum(not term.lasting for term in terms), len(used) + len(terms)
            for term in terms:
                if term not in number:
                    number[term] = len(records)
                    records.append(term.record)
                used.append(number[term])
        starts, integers, numbers = joined(records)
        return WindowRecords(starts[used], integers, numbers, rows)


class WindowEnergy:
    """Energies of T frames, and of the ties between each and the next.

    costs (T). ties (T - 1). What has no kernel, as the pictures' terms and flow, is added frame by frame, and so is all
    of a body without a `CompiledTree`.
    """

    def __init__(self, body: Body, costs: Sequence[Cost], ties: Sequence[Ties]) -> None:
        self._body, self._costs, self._tree = body, costs, body.compiled
        self._records = None if self._tree is None else WindowRecords.of(costs)
        every = [(t, tie) for t, row in enumerate(ties) for tie in row]
        compiled = [isinstance(tie, StandingTie) and self._tree is not None for _, tie in every]
        self._pairs = [pair for pair, is_compiled in zip(every, compiled, strict=True) if not is_compiled]
        self._standing = _in_a_row([pair for pair, is_compiled in zip(every, compiled, strict=True) if is_compiled])
        self._room = np.empty((len(costs), body.njoints, 12)), np.empty((len(costs), len(body.tree.column_dof), 6))

    def add(
        self, q: np.ndarray, gradient: np.ndarray, blocks: np.ndarray, exact: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Energies (T,) of poses q (T, nq), and of their ties (T - 1,); adds to gradient (T, nv) and blocks
        (K, T, nv, nv), K at least 2, block k of which couples frame t with frame t + k. exact: see `Term.accumulate`;
        the ties' Hessian is Gauss-Newton's."""
        tied = np.zeros(len(q) - 1)
        values = self._add_frames(q, gradient, blocks[0], exact)
        if self._standing is not None:
            frame, points = self._standing
            tie_points(frame, *points, *self._room, self._body.tree.column_parent, tied, gradient, blocks)
        for t, tie in self._pairs:
            tied[t] += self._add_pair(t, q, tie, gradient, blocks)
        return values, tied

    def values(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The energies of `add` alone."""
        count, nv = len(q), self._body.nv
        return self.add(q, np.zeros((count, nv)), np.zeros((2, count, nv, nv)))

    def _add_frames(self, q: np.ndarray, gradient: np.ndarray, hessian: np.ndarray, exact: bool) -> np.ndarray:
        """The part of the frames themselves: their energies (T,); adds to gradient (T, nv) and hessian (T, nv, nv)."""
        values, left = np.zeros(len(q)), np.zeros(len(q), dtype=np.int64)
        if self._records is None:
            for t, cost in enumerate(self._costs):
                model = cost.at(q[t], exact)
                values[t], self._room[0][t], self._room[1][t] = model.value, *model.posed[1:]
                gradient[t] += model.gradient
                hessian[t] += model.hessian
            return values
        joints = self._body.tree
        evaluate_frames(
            self._tree, *self._records, joints.column_joint, joints.column_parent, q, exact, *self._room, values, left,
            gradient, hessian,
        )  # fmt: skip
        for t, cost in enumerate(self._costs):
            for term in cost.in_python(bool(left[t])):
                values[t] += term.accumulate(self._posed(t, q), gradient[t], hessian[t], exact)
        return values

    def _add_pair(self, t: int, q: np.ndarray, tie: Tie, gradient: np.ndarray, blocks: np.ndarray) -> float:
        """Add a tie of frame t to the next one."""
        nv = self._body.nv
        own, hessian = np.zeros(2 * nv), np.zeros((2 * nv, 2 * nv))
        value = tie.accumulate_pair(self._posed(t, q), self._posed(t + 1, q), own, hessian)
        gradient[t : t + 2] += own.reshape(2, nv)
        blocks[0, t] += hessian[:nv, :nv]
        blocks[0, t + 1] += hessian[nv:, nv:]
        blocks[1, t] += hessian[:nv, nv:]
        return value

    def _posed(self, t: int, q: np.ndarray) -> PosedBody:
        return PosedBody(q[t], self._room[0][t], self._room[1][t])


def _in_a_row(ties: Sequence[tuple[int, Tie]]) -> tuple[np.ndarray, TiedPoints] | None:
    """The frame of each point (P,), and the points, of all ties, given with the frames they begin at; None of none."""
    standing = [(t, tie.points) for t, tie in ties if isinstance(tie, StandingTie)]
    if not standing:
        return None
    frame = np.repeat([t for t, _ in standing], [len(points.joint) for _, points in standing])
    return frame, TiedPoints(*(np.concatenate(parts) for parts in zip(*(p for _, p in standing), strict=True)))


@jit
def evaluate_frames(  # type: ignore[no-untyped-def]
    tree, starts, integers, numbers, rows, column_joint, column_parent, q, exact, placements, columns, values, left,
    gradient, hessian,
):  # fmt: skip
    """`evaluate` of T frames at q (T, nq): fills values, left (T,), and placements (T, njoints, 12) and columns
    (T, nv, 6) with the poses, adds to gradient (T, nv) and hessian (T, nv, nv).

    tree: `CompiledTree`. starts, integers, numbers, rows: `WindowRecords`. column_joint, column_parent (nv,):
    see `Tree`.
    """
    for t in range(q.shape[0]):
        first, lasting, last = rows[t, 0], rows[t, 1], rows[t, 2]
        place_joints(tree, q[t], placements[t], columns[t])
        values[t], left[t] = evaluate(
            starts[first:lasting], integers, numbers, starts[lasting:last], integers, numbers, tree.parent,
            column_joint, column_parent, placements[t], columns[t], q[t], exact, gradient[t], hessian[t], gradient[t],
            hessian[t],
        )  # fmt: skip


def moved_poses(body: Body, q: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Poses (T, nq) after a step (T, nv) from q (T, nq); one that stays keeps its bits."""
    if body.compiled is None:
        return np.array([body.integrate(a, v) if v.any() else a for a, v in zip(q, step, strict=True)])
    moved = q.copy()
    move_poses(body.compiled, step, moved)
    return moved


@jit
def move_poses(tree, step, q):  # type: ignore[no-untyped-def]
    """Move poses q (T, nq) of a `CompiledTree` by a step (T, nv), in place."""
    for t in range(q.shape[0]):
        if np.any(step[t] != 0.0):
            integrate(tree, q[t].copy(), step[t], q[t])
