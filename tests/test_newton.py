"""Laws of the damped Newton loop: an iteration by hand, the damping's schedule, energies that never rise, its ends."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve

from estimator.numerics.newton import Damping, DescentResult, NewtonSettings, Problem, Step, descend, minimise

NIELSEN = Damping(first=0.5, least=1e-12, most=1e12, growth=2.0, by_ratio=True)


class Point(NamedTuple):
    value: float
    x: np.ndarray
    gradient: np.ndarray
    hessian: np.ndarray


class LeastSquares(Problem[Point]):
    """1/2 |r(x)|^2; records its calls. promises: whether it gives the decrease that a step promises."""

    def __init__(
        self, residual: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], *, promises: bool = True
    ) -> None:
        self._residual, self._promises = residual, promises
        self.asked: list[tuple[float, float]] = []  # value of the model, damping
        self.values: list[float] = []  # of all trials

    def model(self, x: np.ndarray) -> Point:
        r, J = self._residual(x)
        return Point(0.5 * float(r @ r), x, J.T @ r, J.T @ J)

    def step(self, model: Point, damping: float) -> Step | None:
        self.asked.append((model.value, damping))
        H, g = model.hessian, model.gradient
        x = -np.linalg.solve(H + damping * np.diag(np.diag(H)), g)
        return x, -float(g @ x + 0.5 * x @ H @ x) if self._promises else None

    def at(self, model: Point, step: Step) -> Point:
        trial = self.model(model.x + step[0])
        self.values.append(trial.value)
        return trial

    def converged(self, model: Point) -> bool:
        return float(np.abs(model.gradient).max()) < 1e-9


def parabola(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return x**2 - 2.0, 2.0 * np.diag(x)


def rosenbrock(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    residual = np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])
    return residual, np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])


def descended(problem: LeastSquares, x: list[float], settings: NewtonSettings) -> DescentResult[Point]:
    return minimise(problem, problem.model(np.array(x)), settings)


def test_one_iteration_equals_that_done_by_hand() -> None:
    """r = x^2 - 2 at x = 3: r = 7, J = 6, so H = 36, g = 42; with damping 1/2 the step is -42 / 54."""
    step = Fraction(-42, 54)
    x = 3 + step
    value, trial = Fraction(49, 2), (x * x - 2) ** 2 / 2
    promised = -(42 * step + 18 * step**2)
    ratio = (value - trial) / promised
    damping = Fraction(1, 2) * (1 - (2 * ratio - 1) ** 3)
    problem = LeastSquares(parabola)
    end = descended(problem, [3.0], NewtonSettings(1, NIELSEN))
    assert (end.status, end.tried) == ("iterations", 1)
    assert end.model.x[0] == pytest.approx(float(x), rel=1e-15)
    descended(problem, [3.0], NewtonSettings(2, NIELSEN))
    assert problem.asked[1] == (24.5, 0.5)
    assert problem.asked[2] == (pytest.approx(float(trial), rel=1e-14), pytest.approx(float(damping), rel=1e-13))
    assert 0.1 < float(2 * damping) < 0.5  # neither of the bounds of the factor


@pytest.mark.parametrize("damping", [NIELSEN, Damping(), Damping(first=10.0, growth=8.0, shrink=0.2, grown_from=1e-6)])
@pytest.mark.parametrize("promises", [True, False])
def test_the_valley_is_descended_and_the_energy_never_rises(damping: Damping, promises: bool) -> None:
    problem = LeastSquares(rosenbrock, promises=promises)
    end = descended(problem, [-1.2, 1.0], NewtonSettings(200, damping))
    assert end.status == "converged"
    assert end.model.x == pytest.approx([1.0, 1.0], abs=1e-8)
    models = [value for value, _ in problem.asked]
    assert all(after <= before for before, after in pairwise(models))
    refused = [v for v, m in zip(problem.values, models, strict=True) if v > m]
    assert refused  # some steps did rise
    assert end.tried == len(problem.values)


class Stubborn(Problem[Point]):
    """Every trial rises, or has the value `trial`; `unsolved`: dampings below it have no step."""

    def __init__(self, trial: float = 2.0, unsolved: float = 0.0) -> None:
        self._trial, self._unsolved = trial, unsolved
        self.dampings: list[float] = []

    def step(self, model: Point, damping: float) -> Step | None:
        self.dampings.append(damping)
        return None if damping < self._unsolved else (np.zeros(1), 1.0)

    def at(self, model: Point, step: Step) -> Point:
        return model._replace(value=self._trial)


FLAT = Point(1.0, np.zeros(1), np.zeros(1), np.eye(1))


def test_refused_steps_are_damped_more_until_the_descent_stalls() -> None:
    problem = Stubborn()
    end = minimise(problem, FLAT, NewtonSettings(50, Damping(first=1e-9, most=1e3, growth=10.0, grown_from=1e-2)))
    assert problem.dampings == pytest.approx([1e-9, 0.1, 1.0, 10.0, 100.0, 1000.0])
    assert (end.model, end.status, end.tried) == (FLAT, "stalled", 6)
    problem = Stubborn()
    minimise(problem, FLAT, NewtonSettings(5, NIELSEN))
    assert problem.dampings == [0.5, 1.0, 4.0, 32.0, 512.0]  # the growth doubles each time


def test_growth_restarts_after_an_accepted_step() -> None:
    class Once(Stubborn):
        def at(self, model: Point, step: Step) -> Point:
            return model._replace(value=model.value + (-1.0 if len(self.dampings) == 3 else 1.0))

    problem = Once()
    minimise(problem, FLAT, NewtonSettings(5, NIELSEN))
    taken = 4.0 * 0.1  # the promised decrease was reached, so the ratio is 1
    assert problem.dampings == pytest.approx([0.5, 1.0, 4.0, taken, 2.0 * taken])


def test_models_without_a_step() -> None:
    """Refused: each counts as a step tried. Retried: damped at once until there is one. Or the end."""
    schedule = Damping(first=1e-6, most=1e2, growth=10.0)
    refusing, retrying, stopping = (Stubborn(0.5, unsolved=0.5) for _ in range(3))
    end = minimise(refusing, FLAT, NewtonSettings(4, schedule))
    assert (end.status, end.tried, end.model.value) == ("iterations", 4, 1.0)
    assert refusing.dampings == pytest.approx([1e-6, 1e-5, 1e-4, 1e-3])
    end = minimise(retrying, FLAT, NewtonSettings(1, schedule, unsolved="retry"))
    assert (end.status, end.tried, end.model.value) == ("iterations", 1, 0.5)
    assert retrying.dampings == pytest.approx([1e-6, *(1e-3 * 4.0**k for k in range(6))])
    end = minimise(stopping, FLAT, NewtonSettings(4, schedule, unsolved="stop"))
    assert (end.status, end.tried, end.model.value, len(stopping.dampings)) == ("stalled", 0, 1.0, 1)
    never = minimise(Stubborn(unsolved=np.inf), FLAT, NewtonSettings(4, schedule, unsolved="retry"))
    assert (never.status, never.model) == ("stalled", FLAT)


def test_ends() -> None:
    problem = LeastSquares(rosenbrock)
    start = problem.model(np.array([-1.2, 1.0]))
    assert minimise(problem, start, NewtonSettings(0, NIELSEN)).status == "iterations"
    assert minimise(problem, problem.model(np.ones(2)), NewtonSettings(0, NIELSEN)).status == "converged"
    assert minimise(problem, start, NewtonSettings(50, NIELSEN, least_promise=1e6))[1:] == ("stalled", 0)
    # enough: the first step that gains less is the last, and is taken
    problem = LeastSquares(rosenbrock, promises=False)
    settled = minimise(problem, start, NewtonSettings(50, Damping(), enough=1.0))
    models = [*(value for value, _ in problem.asked), settled.model.value]
    gains = [before - after for before, after in pairwise(models) if after < before]
    assert (settled.status, settled.tried) == ("settled", len(problem.values))
    assert 0.0 < gains[-1] < 1.0
    assert all(gain >= 1.0 for gain in gains[:-1])
    # a step that promises as much is not the last
    promising = minimise(Stubborn(1.0 - 1e-6), FLAT, NewtonSettings(1, NIELSEN, enough=1e-3))
    assert promising.status == "iterations"


def test_a_share_of_the_promise_has_to_come() -> None:
    half = Stubborn(0.5)
    assert minimise(half, FLAT, NewtonSettings(1, NIELSEN, accepted=0.4)).model.value == 0.5
    assert minimise(half, FLAT, NewtonSettings(1, NIELSEN, accepted=0.6)).model is FLAT


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, -1e300, 1.0 + 1e-9, 1.0 - 1e-9])
def test_wild_energies_raise_nothing(value: float) -> None:
    class Anything(Stubborn):
        def as_good(self, model: Point, trial: Point) -> bool:
            return True  # every ratio reaches the damping

        def step(self, model: Point, damping: float) -> Step | None:
            return np.zeros(1), 0.0

    for damping in (NIELSEN, Damping()):
        end = minimise(Anything(value), FLAT, NewtonSettings(5, damping, unsolved="retry"))
        assert end.status in ("iterations", "stalled", "settled")
    assert minimise(Stubborn(np.nan), FLAT, NewtonSettings(5, NIELSEN)).model is FLAT
    assert minimise(Stubborn(0.0), FLAT._replace(value=np.inf), NewtonSettings(5, NIELSEN)).model.value == 0.0


# --- states of any type ---


class Valley:
    """The valley's descent as functions of a state; records where derivatives were computed."""

    def __init__(self) -> None:
        self.expanded: list[tuple[float, ...]] = []

    def energy(self, x: tuple[float, ...]) -> float:
        r, _ = rosenbrock(np.array(x))
        return 0.5 * float(r @ r)

    def expand(self, x: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        self.expanded.append(x)
        r, J = rosenbrock(np.array(x))
        return J.T @ J, J.T @ r

    def step(self, x: tuple[float, ...], known: tuple[np.ndarray, np.ndarray], damping: float) -> tuple[float, ...]:
        H, g = known
        return tuple(x - np.linalg.solve(H + damping * np.diag(np.diag(H)), g))


@pytest.mark.parametrize("start", [(-1.2, 1.0), (3.0, -2.0)])
def test_states_of_any_type_descend(start: tuple[float, ...]) -> None:
    valley = Valley()
    end = descend(start, valley.energy, valley.expand, valley.step, NewtonSettings(200, Damping(growth=6.0)))
    assert end.model.state == pytest.approx((1.0, 1.0), abs=1e-9)
    assert end.model.value == valley.energy(end.model.state)
    assert len(valley.expanded) == len(set(valley.expanded)) < end.tried  # once each, however many steps are refused
    count = len(valley.expanded)
    assert end.model.expansion is end.model.expansion
    assert len(valley.expanded) - count <= 1


def test_refused_steps_may_be_free() -> None:
    """With `count_taken` the same steps are taken as in as many trials as that needs."""
    valley, start = Valley(), (-1.2, 1.0)
    parts = valley.energy, valley.expand, valley.step
    taken = descend(start, *parts, NewtonSettings(6, count_taken=True))
    tried = descend(start, *parts, NewtonSettings(6))
    assert (taken.status, tried.status, tried.tried) == ("iterations", "iterations", 6)
    assert taken.tried > 6  # some were refused
    assert taken.model.value < tried.model.value
    same = descend(start, *parts, NewtonSettings(taken.tried))
    assert (same.model.state, same.tried) == (taken.model.state, taken.tried)


@pytest.mark.parametrize(("share", "tried"), [(0.3, 2), (0.15, 3), (0.1, 4)])
def test_a_share_of_the_energy_is_enough(share: float, tried: int) -> None:
    """Gains of 1/3, 1/5, 1/9 and 1/17 of the energy that is left: the first below the threshold is the last."""
    energies = [16.0, 12.0, 10.0, 9.0, 8.5, 8.4]
    end = descend(0, energies.__getitem__, int, lambda k, known, damping: k + 1, NewtonSettings(5, share=share))
    assert (end.status, end.tried, end.model.value) == ("settled", tried, energies[tried])


@pytest.mark.parametrize("count", [3, 40])
def test_a_bundle_with_a_closed_form(count: int) -> None:
    """Points p seen as a and, shifted by s, as b: s is the mean of b - a, p = (a + b - s) / 2, by sparse equations."""
    a, b = np.random.default_rng(5).normal(size=(2, count))
    J = sparse.bmat([[sparse.identity(count), None], [sparse.identity(count), np.ones((count, 1))]], format="csr")
    seen, A = np.concatenate([a, b]), J.T @ J

    def step(x: np.ndarray, gradient: np.ndarray, damping: float) -> np.ndarray:
        return np.asarray(x - spsolve((A + damping * sparse.diags(A.diagonal())).tocsc(), gradient))

    end = descend(
        np.zeros(count + 1), lambda x: 0.5 * float(np.square(J @ x - seen).sum()), lambda x: J.T @ (J @ x - seen), step,
        NewtonSettings(30, share=1e-12),
    )  # fmt: skip
    s = (b - a).mean()
    assert end.status in ("settled", "stalled")
    assert end.model.state == pytest.approx(np.append((a + b - s) / 2.0, s), abs=1e-6)
