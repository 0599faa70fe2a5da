"""Mode seeking in compiled code, for bodies and energies that allow it: the search is that of `Seeker.seek`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from estimator.energy.cost import Cost, QuadraticModel
from estimator.energy.descent import search_loop as loop
from estimator.energy.descent.qp import PROXQP, STEP_SOLVERS
from estimator.energy.descent.seek import Seeker, SeekSettings
from estimator.energy.descent.solution import Solution, StepCounts
from estimator.numerics.newton import CONVERGED, ITERATIONS, STALLED
from humanoid.kinematics.body import Body, PosedBody
from humanoid.kinematics.compiled_tree import CompiledTree
from humanoid.support.compiled import is_compiled

_STATUS = {loop.CONVERGED: CONVERGED, loop.STALLED: STALLED, loop.ITERATIONS: ITERATIONS}


class _State(NamedTuple):
    """Room for one search, used again by the next; see `search_loop.advance`."""

    integers: np.ndarray
    numbers: np.ndarray
    q: np.ndarray
    gradient: np.ndarray
    hessian: np.ndarray
    placements: np.ndarray
    columns: np.ndarray
    step: np.ndarray
    matrix: np.ndarray
    bounds: np.ndarray
    active: np.ndarray
    sets: np.ndarray

    @staticmethod
    def of(body: Body) -> _State:
        nq, nv = body.nq, body.nv
        active, sets = np.zeros((2, nv), dtype=np.int8)
        return _State(
            np.zeros(loop.INTEGERS, dtype=np.int64), np.zeros(loop.NUMBERS), np.zeros((2, nq)), np.zeros((2, nv)),
            np.zeros((2, nv, nv)), np.zeros((body.njoints, 12)), np.zeros((nv, 6)), np.zeros(nv), np.zeros((nv, nv)),
            np.zeros((2, nv)), active, sets,
        )  # fmt: skip


def is_search_compiled(body: Body) -> bool:
    """Whether a body's searches need no compilation any more, or never do."""
    return body.compiled is None or is_compiled(loop.advance)


def compile_search(body: Body) -> None:
    """Compile the search, which takes a while, before the first is needed."""
    CompiledSeeker(body, SeekSettings(max_iterations=1)).seek(Cost(body, []), body.neutral)


class CompiledSeeker(Seeker):
    """A `Seeker` whose searches run in compiled code where the body allows it; their ends are its own, to rounding.

    It stops for what compiled code cannot do: ProxQP solves the steps that bounds stop, and terms without a kernel,
    such as the pictures', are added to each model.
    """

    def __init__(self, body: Body, settings: SeekSettings | None = None, step_solver: str = PROXQP) -> None:
        super().__init__(body, settings, step_solver)
        self._state = _State.of(body)
        self._settings = dict[SeekSettings, np.ndarray]()
        self._nothing = np.zeros(body.nv), np.zeros((0, body.nv)), np.zeros(0)

    def seek(self, cost: Cost, q: np.ndarray, settings: SeekSettings | None = None) -> Solution:
        """See `Seeker.seek`."""
        tree, settings = self.body.compiled, settings or self.settings
        if tree is None:
            return super().seek(cost, q, settings)
        state, proxqp = self._state, self.solver.proxqp
        state.integers[:], state.q[1] = 0, q
        asks, multipliers = loop.START, self._nothing[0]
        arguments = self._arguments(tree, cost, settings)
        while (asks := loop.advance(multipliers, *arguments)) != loop.DONE:
            if asks == loop.ASKS_TERMS:
                self._add_terms(cost)
            elif asks == loop.ASKS_FEW:
                multipliers = proxqp.multipliers_of_few(int(state.integers[loop.UNKNOWNS]))
            elif asks == loop.ASKS_STEP:
                multipliers = proxqp.multipliers(None)
            else:
                self.solver.uncertified += 1
                multipliers = proxqp.sharper(None)
        return self._solution()

    def _arguments(self, tree: CompiledTree, cost: Cost, settings: SeekSettings) -> tuple[Any, ...]:
        """The arguments of `search_loop.advance` after the multipliers."""
        solver, joints, recorded = self.solver, self.body.tree, cost.recorded
        proxqp = solver.proxqp
        return (
            tree, *recorded.own, *recorded.kept, joints.column_joint, joints.column_parent, self._numbers(settings),
            self.trust_box(settings), solver.places, solver.limits, len(cost.others), *self._nothing[1:],
            proxqp.scaled, proxqp.start, proxqp.near, proxqp.few, *self._state,
        )  # fmt: skip

    def _numbers(self, settings: SeekSettings) -> np.ndarray:
        """The settings as the loop reads them, (6,)."""
        if settings not in self._settings:
            self._settings[settings] = np.array([
                settings.max_iterations, settings.kkt_tolerance, settings.decrease_tolerance, settings.damping,
                settings.exact_below, STEP_SOLVERS.index(self.solver.step_solver),
            ], dtype=float)  # fmt: skip
        return self._settings[settings]

    def _add_terms(self, cost: Cost) -> None:
        """Add to the trial what has no kernel, and the repulsion where its kernel could not solve a contact."""
        state = self._state
        trial = 1 - int(state.integers[loop.CURRENT])
        posed = PosedBody(state.q[trial].copy(), state.placements.copy(), state.columns.copy())
        exact = bool(state.integers[loop.EXACT + trial])
        for term in cost.in_python(bool(state.integers[loop.LEFT] > 0)):
            value = term.accumulate(posed, state.gradient[trial], state.hessian[trial], exact)
            state.numbers[loop.VALUE + trial] += value

    def _solution(self) -> Solution:
        state = self._state
        now, tally = int(state.integers[loop.CURRENT]), state.integers[loop.COUNTS :].tolist()
        for k, count in enumerate(tally):
            self.solver.tally[k] += count
        posed = PosedBody(state.q[now].copy(), state.placements.copy(), state.columns.copy())
        quadratic = QuadraticModel(
            posed, float(state.numbers[loop.VALUE + now]), state.gradient[now].copy(),
            state.hessian[now].copy(), bool(state.integers[loop.EXACT + now]),
        )  # fmt: skip
        status = _STATUS[int(state.integers[loop.STATUS])]
        residual, tried = float(state.numbers[loop.RESIDUAL + now]), int(state.integers[loop.TRIED])
        return Solution(quadratic, status, residual, tried, StepCounts(*tally))
