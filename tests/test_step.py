"""Laws of one constrained step: the box solver against brute force, the step solver against ProxQP and KKT."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from builders import body_of, inside, random_pose
from proxsuite import proxqp

from estimator.energy.descent.box_step import model_decrease, solve_box
from estimator.energy.descent.qp import ACTIVE_SET, PROXQP, PROXQP_ALWAYS, STEP_SOLVERS, ProxQP, StepSolver
from estimator.energy.descent.solution import StepCounts
from estimator.search.settings import ModeSearchSettings
from humanoid.support.errors import InputError

DAMPING = 1e-2


def convex(rng: np.random.Generator, n: int, rank: int | None = None) -> np.ndarray:
    """A random positive (semi-)definite matrix with spread eigenvalues, (n, n)."""
    root = rng.normal(size=(n, rank or n)) * np.exp(rng.normal(scale=1.0, size=rank or n))
    return root @ root.T + (1e-3 * np.eye(n) if rank is None else 0.0)


def brute_force(M: np.ndarray, g: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """The best feasible point over every choice of active bounds; it includes the minimum."""
    best, best_value = None, np.inf
    for sides in product((-1, 0, 1), repeat=len(g)):
        side = np.array(sides)
        x = np.where(side < 0, lower, upper)
        if not np.all(np.isfinite(x[side != 0])):
            continue
        free = side == 0
        if free.any():
            held = M[np.ix_(free, ~free)] @ x[~free]
            x[free] = np.linalg.solve(M[np.ix_(free, free)], -g[free] - held)
        value = 0.5 * x @ M @ x + g @ x
        if np.all(x >= lower - 1e-12) and np.all(x <= upper + 1e-12) and value < best_value:
            best, best_value = x, value
    assert best is not None
    return best


def random_box(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounds around zero, some of them infinite, some exactly zero, as at a joint limit."""
    lower, upper = -rng.exponential(size=n), rng.exponential(size=n)
    lower[rng.random(n) < 0.2], upper[rng.random(n) < 0.2] = -np.inf, np.inf
    lower[rng.random(n) < 0.15] = 0.0
    return lower, upper


def test_the_box_solver_equals_enumeration() -> None:
    rng, certified = np.random.default_rng(31), 0
    for _ in range(150):
        n = int(rng.integers(1, 6))
        M, g, (lower, upper) = convex(rng, n), rng.normal(scale=2.0, size=n), random_box(rng, n)
        active, step = rng.integers(-1, 2, size=n).astype(np.int8), np.empty(n)
        verdict = solve_box(M, g, lower, upper, active, 20, step)
        assert verdict >= 0
        if verdict > 0:  # a certificate must be right for any guess
            certified += 1
            assert np.abs(step - brute_force(M, g, lower, upper)).max() < 1e-7 * (1.0 + np.abs(step).max())
            assert np.all(step[active < 0] == lower[active < 0])
            assert np.all(step[active > 0] == upper[active > 0])
            assert np.all((step >= lower) & (step <= upper))
    assert certified > 140


def test_the_box_solver_takes_a_right_guess_in_one_round() -> None:
    rng, taken = np.random.default_rng(32), 0
    for _ in range(20):
        M, g, (lower, upper) = convex(rng, 8), rng.normal(size=8), random_box(rng, 8)
        active, step, again = np.zeros(8, dtype=np.int8), np.empty(8), np.empty(8)
        if solve_box(M, g, lower, upper, active, 30, step) > 0:
            assert solve_box(M, g, lower, upper, active.copy(), 1, again) == 1
            assert np.array_equal(step, again)
            taken += 1
    assert taken > 15


def test_the_box_solver_reports_a_nonconvex_model() -> None:
    M, unlimited = np.diag([1.0, -1.0, 2.0]), np.full(3, np.inf)
    verdict = solve_box(M, np.ones(3), -unlimited, unlimited, np.zeros(3, dtype=np.int8), 5, np.empty(3))
    assert verdict == -1
    body = body_of("human34")
    solver, q = StepSolver(body), body.neutral
    hessian = -np.eye(body.nv)
    active = np.zeros(body.nv, dtype=np.int8)
    assert solver.solve(hessian, np.ones(body.nv), DAMPING, np.ones(body.nv), q, active) is None


class Problem:
    """A random step of human34: semi-definite Hessian, a pose with a share of its joints on their limits.

    pull: standard deviation of the gradient's entries.
    """

    def __init__(self, seed: int, share: float = 0.3, pull: float = 3.0) -> None:
        self.body = body = body_of("human34")
        rng = np.random.default_rng(seed)
        self.hessian = convex(rng, body.nv, rank=20 if seed % 2 else body.nv)
        self.gradient = rng.normal(scale=pull, size=body.nv)
        self.q = random_pose(body, rng)
        on_limit = body.bounded_q[rng.random(len(body.bounded_q)) < share]
        self.q[on_limit] = np.where(rng.random(len(on_limit)) < 0.5, body.lower[on_limit], body.upper[on_limit])
        self.radius = rng.uniform(0.2, 0.8, size=body.nv)
        low, high = body.tangent_bounds(self.q)
        self.lower, self.upper = np.maximum(low, -self.radius), np.minimum(high, self.radius)
        inward = rng.uniform(self.lower, self.upper)
        self.A = rng.normal(size=(4, body.nv)) * (rng.random((4, body.nv)) < 0.3)
        self.b = self.A @ inward - rng.uniform(0.0, 0.01, size=4)  # a feasible point exists, the rows are active

    @property
    def model(self) -> np.ndarray:
        """The damped model's matrix."""
        diagonal = np.diag(self.hessian)
        return self.hessian + DAMPING * np.diag(np.maximum(diagonal, 1e-7 * diagonal.max()))

    def step(self, solver: StepSolver, rows: bool = False) -> np.ndarray:
        active = np.zeros(self.body.nv, dtype=np.int8)
        step = solver.solve(
            self.hessian, self.gradient, DAMPING, self.radius, self.q, active, (self.A, self.b) if rows else None
        )
        assert step is not None
        move, promised = step
        decrease = -(self.gradient @ move + 0.5 * move @ self.hessian @ move)
        assert promised == pytest.approx(decrease, rel=1e-9, abs=1e-9)
        return move

    def reference(self, rows: bool = False) -> np.ndarray:
        n = self.body.nv
        box, unbounded = np.eye(n), np.full(4, 1e20)
        C = np.concatenate([box, self.A]) if rows else box
        low = np.concatenate([self.lower, self.b]) if rows else self.lower
        high = np.concatenate([self.upper, unbounded]) if rows else self.upper
        solved = proxqp.dense.solve(self.model, self.gradient, None, None, C, low, high, eps_abs=1e-10, eps_rel=0.0)
        return np.array(solved.x)


@pytest.mark.parametrize("name", STEP_SOLVERS)
def test_steps_equal_those_of_a_plain_qp(name: str) -> None:
    solver = StepSolver(body_of("human34"), name)
    for seed in range(12):
        problem = Problem(seed)
        step, reference = problem.step(solver), problem.reference()
        assert np.all((step >= problem.lower) & (step <= problem.upper))
        assert np.abs(step - reference).max() < 1e-5
        assert inside(problem.body, problem.body.integrate(problem.q, step))
    # each of these touches a bound, and the active set settles some of them
    assert sum(solver.counts) == solver.counts.active_set + solver.counts.proxqp == 12
    assert (solver.counts.active_set > 0) == (name == ACTIVE_SET)


@pytest.mark.parametrize("rows", [False, True])
def test_steps_are_equal_from_any_solver(rows: bool) -> None:
    """To the last bit, also the sets that the next step starts from; some are free, most touch bounds or rows."""
    solvers = [StepSolver(body_of("human34"), name) for name in STEP_SOLVERS]
    for seed in range(24):
        problem, ends = Problem(seed, 0.0, 1e-4) if seed % 4 == 0 else Problem(seed), []
        for solver in solvers:
            active = np.zeros(problem.body.nv, dtype=np.int8)
            solved = solver.solve(
                problem.hessian, problem.gradient, DAMPING, problem.radius, problem.q, active,
                (problem.A, problem.b) if rows else None,
            )  # fmt: skip
            assert solved is not None
            ends.append((solved[0].tobytes(), solved[1], active.tobytes()))
        assert ends[0] == ends[1] == ends[2]
    by_name = {solver.step_solver: solver.counts for solver in solvers}
    assert by_name[PROXQP_ALWAYS] == StepCounts(proxqp=24)
    assert by_name[PROXQP].active_set == by_name[PROXQP].failed == 0
    assert by_name[PROXQP].free > 0 or rows
    assert by_name[PROXQP].proxqp > 12
    assert by_name[ACTIVE_SET].active_set > 0 or rows


def half_convex(solver: StepSolver) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """A Hessian, a gradient and a trust box: concave along one direction, which is pushed onto its bound."""
    nv = solver.body.nv
    hessian, gradient, radius = np.eye(nv), np.zeros(nv), np.full(nv, 10.0)
    hessian[0, 0], gradient[0], gradient[1], radius[0] = -1.0, -1e3, 0.1, 0.01
    return hessian, gradient, radius, 0


@pytest.mark.parametrize("name", STEP_SOLVERS)
def test_nonconvex_problems_stay_with_the_active_set(name: str) -> None:
    solver = StepSolver(body_of("human34"), name)
    hessian, gradient, radius, held = half_convex(solver)
    active, q = np.zeros(solver.body.nv, dtype=np.int8), solver.body.neutral
    active[held] = 1
    solved = solver.solve(hessian, gradient, DAMPING, radius, q, active.copy())
    assert solved is not None
    assert solved[0][held] == radius[held]
    assert solver.counts == StepCounts(active_set=1)
    biting = np.eye(solver.body.nv)[1:2], np.array([0.05])
    assert solver.solve(hessian, gradient, DAMPING, radius, q, active.copy(), biting) is None
    assert solver.solve(hessian, gradient, DAMPING, radius, q, np.zeros_like(active)) is None  # guessed free: concave
    assert solver.counts == StepCounts(active_set=1)


def settled_by_the_active_set() -> Problem:
    """The first problem solved by the active set."""
    for seed in range(12):
        problem, solver = Problem(seed), StepSolver(body_of("human34"), ACTIVE_SET)
        problem.step(solver)
        if solver.counts.active_set:
            return problem
    raise AssertionError


@pytest.mark.parametrize("sharper", [False, True])
def test_only_a_certified_answer_becomes_a_step(sharper: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where ProxQP returns wrong sets it is solved again to a tighter tolerance; if still wrong, the active set is
    used, and with active rows there is no step."""
    problem, honest = settled_by_the_active_set(), StepSolver(body_of("human34"))
    plain, above = problem.step(honest), problem.step(honest, rows=True)
    assert honest.uncertified == 0
    wrong = lambda _, rows: np.zeros(problem.body.nv + (0 if rows is None else len(rows[1])))  # noqa: E731
    ask = ProxQP.multipliers
    monkeypatch.setattr(ProxQP, "multipliers", lambda self, rows: wrong(ask(self, rows), rows))
    if not sharper:
        monkeypatch.setattr(ProxQP, "sharper", wrong)
    solver = StepSolver(body_of("human34"))
    assert np.array_equal(problem.step(solver), plain)
    if sharper:
        assert np.array_equal(problem.step(solver, rows=True), above)
        assert (solver.counts, solver.uncertified) == (StepCounts(proxqp=2), 2)
        return
    active, rows = np.zeros(problem.body.nv, dtype=np.int8), (problem.A, problem.b)
    arguments = problem.hessian, problem.gradient, DAMPING, problem.radius, problem.q
    assert solver.solve(*arguments, active, rows) is None
    assert (solver.counts, solver.uncertified) == (StepCounts(active_set=1, failed=1), 4)


def test_unknown_step_solvers_are_refused() -> None:
    for make in (lambda: StepSolver(body_of("arm8"), "osqp"), lambda: ModeSearchSettings(step_solver="osqp")):
        with pytest.raises(InputError, match="osqp") as error:
            make()
        assert all(name in str(error.value) for name in STEP_SOLVERS)


def test_steps_are_counted_by_what_they_took() -> None:
    body = body_of("human34")
    q, wide = body.neutral, np.full(body.nv, 10.0)
    hessian, free, held = np.eye(body.nv), np.zeros(body.nv), np.zeros(body.nv)
    free[0], held[body.bounded_v[3]] = 0.1, -1e3  # the root moves a little; a joint is pressed onto its limit
    biting = np.eye(body.nv)[:1], np.array([0.05])  # of the root, against its gradient
    idle = biting[0], -10.0 * biting[1]
    by_proxqp, by_set = StepCounts(proxqp=1), StepCounts(active_set=1)
    cases = [(free, None), (held, None), (free, biting), (free, idle), (held, idle)]
    expected = {
        PROXQP: [StepCounts(free=1), by_proxqp, by_proxqp, StepCounts(free=1), by_proxqp],
        ACTIVE_SET: [StepCounts(free=1), by_set, by_proxqp, StepCounts(free=1), by_set],
        PROXQP_ALWAYS: [by_proxqp] * 5,
    }
    for name in STEP_SOLVERS:
        solver = StepSolver(body, name)
        for (gradient, rows), count in zip(cases, expected[name], strict=True):
            before, active = solver.counts, np.zeros(body.nv, dtype=np.int8)
            assert solver.solve(hessian, gradient, DAMPING, wide, q, active, rows) is not None
            assert StepCounts.between(before, solver.counts) == count
        assert solver.solve(-hessian, free, DAMPING, wide, q, np.zeros(body.nv, dtype=np.int8)) is None
        assert sum(solver.counts) == 5


def test_steps_satisfy_the_kkt_conditions() -> None:
    solver = StepSolver(body_of("human34"))
    for seed in range(20, 32):
        problem = Problem(seed)
        step = problem.step(solver)
        slope = problem.model @ step + problem.gradient
        slope[(step <= problem.lower + 1e-7) & (slope > 0.0)] = 0.0
        slope[(step >= problem.upper - 1e-7) & (slope < 0.0)] = 0.0
        assert np.abs(slope).max() < 1e-6 * np.abs(problem.gradient).max()


def test_rows_are_respected_and_cost_no_more_than_they_must() -> None:
    solver, biting = StepSolver(body_of("human34")), 0
    for seed in range(12):
        problem = Problem(seed)
        free, step = problem.step(solver), problem.step(solver, rows=True)
        assert np.all(problem.A @ step >= problem.b - 1e-6)
        assert np.all((step >= problem.lower) & (step <= problem.upper))
        assert np.abs(step - problem.reference(rows=True)).max() < 1e-5
        biting += not np.all(problem.A @ free >= problem.b)
    assert biting > 6
    assert solver.counts.failed == 0


@pytest.mark.parametrize("name", STEP_SOLVERS)
@pytest.mark.parametrize("rows", [False, True])
def test_equal_problems_have_equal_steps_whatever_came_between(rows: bool, name: str) -> None:
    """To the last bit, since a resumed track has to equal an uninterrupted one."""
    for seed in range(8):
        problem, used = Problem(seed), StepSolver(body_of("human34"), name)
        for other in range(3):
            Problem(100 + other).step(used, rows)
        fresh = StepSolver(body_of("human34"), name)
        assert np.array_equal(problem.step(fresh, rows), problem.step(used, rows))


@pytest.mark.parametrize("name", STEP_SOLVERS)
def test_held_bounds_are_met_exactly(name: str) -> None:
    """Otherwise the pose stops short of a joint limit, which then never counts as active."""
    solver, held = StepSolver(body_of("human34"), name), 0
    for seed in range(12):
        problem, active = Problem(seed), np.zeros(solver.body.nv, dtype=np.int8)
        solved = solver.solve(problem.hessian, problem.gradient, DAMPING, problem.radius, problem.q, active)
        assert solved is not None
        step, _ = solved
        assert np.array_equal(step[active < 0], problem.lower[active < 0])
        assert np.array_equal(step[active > 0], problem.upper[active > 0])
        held += np.count_nonzero(active)
    assert held > 50


def test_model_decrease() -> None:
    rng = np.random.default_rng(33)
    H, g, x = convex(rng, 7), rng.normal(size=7), rng.normal(size=7)
    assert model_decrease(H, g, x) == pytest.approx(-(g @ x + 0.5 * x @ H @ x), rel=1e-12)
    problem, solver = Problem(5), StepSolver(body_of("human34"))
    assert model_decrease(problem.hessian, problem.gradient, problem.step(solver)) > 0.0
