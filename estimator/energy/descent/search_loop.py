"""The loop of a search as compiled code, operation by operation that of `newton.minimise` on `seek.Seeker`'s problem.

The whole state is in arrays, so that the loop can stop and request: the multipliers of a step that bounds stop, and for
the terms that have no kernel. Whoever calls it writes the answer into the state and calls it again.
"""

from __future__ import annotations

from estimator.energy.descent.active_sets import settle
from estimator.energy.descent.box_step import (
    FREE,
    NOT_CONVEX,
    UNSETTLED,
    damped_step,
    free_minimum,
    free_or_scaled,
    model_decrease,
    projected_gradient,
    reduce,
    scale,
    solve_box,
)
from estimator.energy.descent.qp import ACTIVE_SET, MENDED, PROXQP_ALWAYS, ROUNDS, STEP_SOLVERS
from estimator.energy.descent.seek import ACCEPTED, DAMPING, ROUNDING, TOO_CAUTIOUS
from estimator.energy.kernels.evaluate import evaluate
from estimator.numerics.newton import LARGEST_RATIO, LEAST_PROMISE, RETRIED
from humanoid.kinematics.compiled_tree import clamp_limits, integrate, place_joints
from humanoid.support.compiled import jit

# what the loop does next
START, BEGUN, NEXT, SOLVE, FEW_ANSWERED, ANSWERED, ANSWERED_AGAIN, MOVE, EVALUATE, COMPARE, TAKE, END = range(12)
# what it returns: the search has ended; it requests ProxQP's multipliers of the problem in few unknowns, of the whole
# problem, for sharper ones, or for terms
DONE, ASKS_FEW, ASKS_STEP, ASKS_SHARPER, ASKS_TERMS = range(5)
# of the state's integers: what is next, steps tried, which model is the current one (the other is the trial), how the
# search ended, whether the repulsion was left out of the trial, whether either model is exact, how many unknowns the
# requested problem has, what follows an evaluation, and `StepCounts`
STAGE, TRIED, CURRENT, STATUS, LEFT, EXACT, UNKNOWNS, AFTER, COUNTS = 0, 1, 2, 3, 4, 5, 7, 8, 9
BY_NOTHING, BY_ACTIVE_SET, BY_PROXQP, BY_NONE, INTEGERS = COUNTS, COUNTS + 1, COUNTS + 2, COUNTS + 3, COUNTS + 4
# of the state's numbers: energy and KKT residual of both models, damping and its growth, what the step promises
VALUE, RESIDUAL, DAMPED, GROWTH, PROMISED, NUMBERS = 0, 2, 4, 5, 6, 7
# of the settings: steps, tolerance, least promise, first damping, exact below, who solves steps (in `STEP_SOLVERS`)
MOST_STEPS, TOLERANCE, LEAST, FIRST, EXACT_BELOW, SOLVER, SETTINGS = range(7)
_ACTIVE_SET, _ALWAYS = STEP_SOLVERS.index(ACTIVE_SET), STEP_SOLVERS.index(PROXQP_ALWAYS)
CONVERGED, STALLED, ITERATIONS = range(3)  # STATUS
_RETRY_FACTOR, _RETRY_LEAST = RETRIED
_LEAST_DAMPING, _MOST_DAMPING, _GROWTH = DAMPING.least, DAMPING.most, DAMPING.growth
_SHRINK, _GROWN_FROM = DAMPING.shrink, DAMPING.grown_from


@jit
def advance(  # type: ignore[no-untyped-def]
    multipliers, tree, own_starts, own_integers, own_numbers, kept_starts, kept_integers, kept_numbers, column_joint,
    column_parent, settings, radius, places, limits, others, no_rows, no_sides, scaled, start, near, few, integers,
    numbers, q, gradient, hessian, placements, columns, step, matrix, bounds, active, sets,
):  # fmt: skip
    """Continue a search until it ends or makes a request; returns which.

    multipliers (nv,): the requested ones. tree: `CompiledTree`. own_, kept_: see `evaluate`. column_joint,
    column_parent (nv,): see `Tree`. settings (6,), integers, numbers: see above. radius (nv,): half-width of the trust
    box. places (B, 2), limits (2, B): see `damped_step`. others: how many terms have no kernel. no_rows (0, nv),
    no_sides (0,): see `settle`. scaled (nv + 4, nv), start (nv,): the requested problem, see `scale`. near (F,),
    few (N,): that in few unknowns, see `reduce`. q (2, nq), gradient (2, nv), hessian (2, nv, nv): the current model
    and the trial. placements (njoints, 12), columns (nv, 6): of the trial, at the end of the current model. step (nv,),
    matrix (nv, nv), bounds (2, nv): of the current model. active, sets (nv,): of bounds.
    """
    while True:
        stage, now = integers[STAGE], integers[CURRENT]
        trial = 1 - now
        if stage == START:
            clamp_limits(q[trial], tree.bounded_q, tree.lower, tree.upper)
            _evaluate_next(False, BEGUN, integers)
        elif stage == MOVE:
            if numbers[PROMISED] < settings[LEAST]:
                integers[STAGE], integers[STATUS] = END, STALLED
                continue
            integers[TRIED] += 1
            integrate(tree, q[now], step, q[trial])
            _evaluate_next(numbers[PROMISED] < settings[EXACT_BELOW], COMPARE, integers)
        elif stage == EVALUATE:  # in one place, as all terms are compiled into it
            place_joints(tree, q[trial], placements, columns)
            gradient[trial][:] = 0.0
            hessian[trial][:] = 0.0
            numbers[VALUE + trial], integers[LEFT] = evaluate(
                own_starts, own_integers, own_numbers, kept_starts, kept_integers, kept_numbers, tree.parent,
                column_joint, column_parent, placements, columns, q[trial], integers[EXACT + trial] > 0,
                gradient[trial], hessian[trial], gradient[trial], hessian[trial],
            )  # fmt: skip
            integers[STAGE] = integers[AFTER]
            if others > 0 or integers[LEFT] > 0:
                return ASKS_TERMS
        elif stage == BEGUN:
            _begin(settings, places, limits, trial, integers, numbers, q, gradient, step, active)
        elif stage == NEXT:
            integers[STAGE] = SOLVE
            if numbers[RESIDUAL + now] < settings[TOLERANCE]:
                integers[STAGE], integers[STATUS] = END, CONVERGED
            elif integers[TRIED] >= settings[MOST_STEPS]:
                integers[STAGE], integers[STATUS] = END, ITERATIONS
        elif stage == SOLVE:
            verdict, promised = _solve(
                hessian[now], gradient[now], numbers[DAMPED], radius, q[now], places, limits, active, matrix, bounds,
                step, scaled, start, settings[SOLVER] == _ACTIVE_SET,
            )  # fmt: skip
            if settings[SOLVER] == _ALWAYS and (verdict in (UNSETTLED, FREE)):
                scale(matrix, gradient[now], bounds, step, scaled, start)
                integers[STAGE] = ANSWERED
                return ASKS_STEP
            if verdict == UNSETTLED:
                integers[UNKNOWNS] = reduce(matrix, gradient[now], bounds, step, near, few)
                integers[STAGE] = FEW_ANSWERED if integers[UNKNOWNS] > 0 else ANSWERED
                return ASKS_FEW if integers[UNKNOWNS] > 0 else ASKS_STEP
            if verdict == NOT_CONVEX:
                _damp_more(integers, numbers)
            else:
                integers[BY_NOTHING if verdict == FREE else BY_ACTIVE_SET] += 1
                numbers[PROMISED], integers[STAGE] = promised, MOVE
        elif stage in (FEW_ANSWERED, ANSWERED, ANSWERED_AGAIN):
            certified, promised = settle(
                hessian[now], matrix, gradient[now], bounds, no_rows, no_sides, multipliers, sets,
                MENDED if stage == ANSWERED_AGAIN else 1, step,
            )  # fmt: skip
            if certified:
                active[:] = sets
                integers[BY_PROXQP] += 1
                numbers[PROMISED], integers[STAGE] = promised, MOVE
            elif stage == FEW_ANSWERED:
                integers[STAGE] = ANSWERED
                return ASKS_STEP
            elif stage == ANSWERED:
                integers[STAGE] = ANSWERED_AGAIN
                return ASKS_SHARPER
            elif solve_box(matrix, gradient[now], bounds[0], bounds[1], active, ROUNDS, step) > 0:
                integers[BY_ACTIVE_SET] += 1
                numbers[PROMISED], integers[STAGE] = model_decrease(hessian[now], gradient[now], step), MOVE
            else:
                integers[BY_NONE] += 1
                _damp_more(integers, numbers)
        elif stage == COMPARE:
            residual = projected_gradient(gradient[trial], q[trial], places, limits, step)
            _compare(residual, now, integers, numbers)
        elif stage == TAKE:
            integers[CURRENT], integers[STAGE] = trial, NEXT
        else:
            place_joints(tree, q[now], placements, columns)
            return DONE


@jit
def _evaluate_next(exact, after, integers):  # type: ignore[no-untyped-def]
    """Have the trial evaluated, and what then; integers (13,)."""
    integers[EXACT + 1 - integers[CURRENT]] = exact
    integers[STAGE], integers[AFTER] = EVALUATE, after


@jit
def _begin(settings, places, limits, trial, integers, numbers, q, gradient, step, active):  # type: ignore[no-untyped-def]
    """Take the trial as the first model; settings (6,), integers (13,), numbers (7,), the others: see `advance`."""
    numbers[RESIDUAL + trial] = projected_gradient(gradient[trial], q[trial], places, limits, step)
    numbers[DAMPED], numbers[GROWTH] = settings[FIRST], _GROWTH
    integers[CURRENT], integers[TRIED], integers[STAGE] = trial, 0, NEXT
    active[:] = 0


@jit
def _solve(  # type: ignore[no-untyped-def]
    H, g, damping, radius, q, places, limits, active, matrix, bounds, step, scaled, start, by_sets
):
    """The step of a model H (nv, nv), g (nv,); the others: see `advance`. Its verdict, UNSETTLED where the problem is
    ready for ProxQP, and what it promises."""
    if not by_sets:
        return free_or_scaled(
            H, g, damping, radius, q, places, limits, active, ROUNDS, matrix, bounds, step, scaled, start
        )
    verdict, promised = damped_step(H, g, damping, radius, q, places, limits, active, ROUNDS, matrix, bounds, step)
    if verdict == UNSETTLED:
        if not free_minimum(matrix, g, step):  # the active set looks only at what it leaves free
            return NOT_CONVEX, 0.0
        scale(matrix, g, bounds, step, scaled, start)
    return verdict, promised


@jit
def _damp_more(integers, numbers):  # type: ignore[no-untyped-def]
    """Another try with more damping, or the end; integers (13,), numbers (7,)."""
    if numbers[DAMPED] < _MOST_DAMPING:
        numbers[DAMPED], integers[STAGE] = max(_RETRY_FACTOR * numbers[DAMPED], _RETRY_LEAST), SOLVE
    else:
        integers[STAGE], integers[STATUS] = END, STALLED


@jit
def _compare(residual, now, integers, numbers):  # type: ignore[no-untyped-def]
    """Take the trial, whose KKT residual this is, or refuse it, and set the damping. integers (13,), numbers (7,); now:
    the current model. After too cautious a step the trial is evaluated again, with its true curvature."""
    trial = 1 - now
    value = numbers[VALUE + now]
    gain = value - numbers[VALUE + trial]
    ratio = gain / max(numbers[PROMISED], LEAST_PROMISE)
    numbers[RESIDUAL + trial] = residual
    equal = numbers[VALUE + trial] <= value + ROUNDING * max(1.0, abs(value))
    if ratio > ACCEPTED or (equal and residual < 0.9 * numbers[RESIDUAL + now]):
        factor = _SHRINK
        if ratio < 1.0:
            factor = max(factor, 1.0 - (2.0 * max(ratio, -LARGEST_RATIO) - 1.0) ** 3)
        numbers[DAMPED], numbers[GROWTH] = max(_LEAST_DAMPING, numbers[DAMPED] * factor), _GROWTH
        if ratio > TOO_CAUTIOUS and integers[EXACT + trial] == 0:
            _evaluate_next(True, TAKE, integers)
        else:
            integers[STAGE] = TAKE
        return
    numbers[DAMPED] = max(numbers[DAMPED], _GROWN_FROM) * numbers[GROWTH]
    numbers[GROWTH] *= 2.0
    integers[STAGE] = NEXT
    if numbers[DAMPED] > _MOST_DAMPING:
        integers[STAGE], integers[STATUS] = END, STALLED
