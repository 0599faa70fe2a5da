"""Laws of quadratic programs: closed forms, dense and sparse alike, statuses in place of errors, warm starts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from estimator.numerics.quadratic_program import Answer, QuadraticProgram, WarmSolvers, solve

ACCURACY, ITERATIONS = 1e-7, 60
INF = np.inf


def program(
    hessian: list[list[float]], gradient: list[float], *, equal: list[list[float]] | None = None,
    to: list[float] | None = None, rows: list[list[float]] | None = None, least: list[float] | None = None,
    low: float = -INF, high: float = INF,
) -> QuadraticProgram:  # fmt: skip
    n = len(gradient)
    C = np.reshape(rows or [], (-1, n)).astype(float)
    return QuadraticProgram(
        np.array(hessian, dtype=float), np.array(gradient, dtype=float), np.reshape(equal or [], (-1, n)).astype(float),
        np.array(to or [], dtype=float), C, np.array(least or [], dtype=float), np.full(len(C), INF), np.full(n, low),
        np.full(n, high),
    )  # fmt: skip


def as_sparse(dense: QuadraticProgram) -> QuadraticProgram:
    matrices = {name: sparse.csc_matrix(getattr(dense, name)) for name in ("hessian", "equal", "rows")}
    return dense._replace(**matrices)


def solved(of: QuadraticProgram) -> list[Answer]:
    return [solve(of, ACCURACY, ITERATIONS), solve(as_sparse(of), ACCURACY, ITERATIONS)]


KNOWN = [
    (program([[2, 0], [0, 4]], [-2, 4]), [1, -1]),  # nothing binds: x = -H^-1 g
    (program([[2, 0], [0, 4]], [-2, 4], low=-0.25, high=0.5), [0.5, -0.25]),  # diagonal: each variable at its bound
    (program([[1, 0], [0, 1]], [0, 0], equal=[[3, 4]], to=[10]), [1.2, 1.6]),  # the point of a line nearest to 0
    (program([[1, 0], [0, 1]], [0, 0], rows=[[3, 4], [1, 0]], least=[10, -5]), [1.2, 1.6]),  # and of a half-plane
    (program([[1, 0], [0, 1]], [0, 0], equal=[[3, 4]], to=[10], high=1.5), [4 / 3, 1.5]),  # along it to a bound
]
"""Programs and their answers."""


@pytest.mark.parametrize(("of", "x"), KNOWN)
def test_known_answers(of: QuadraticProgram, x: list[float]) -> None:
    for answer in solved(of):
        assert answer.solved
        assert answer.residual < 1.01 * ACCURACY
        assert answer.x == pytest.approx(np.array(x), abs=1e-6)


@pytest.mark.parametrize("least", [[3.0, -4.0], [1.0, 0.5]])
def test_what_nothing_meets_is_not_solved(least: list[float]) -> None:
    """least[0] <= x + y <= -least[1]: beyond the box, or two contradictory rows."""
    for answer in solved(program([[1, 0], [0, 1]], [0, 0], rows=[[1, 1], [-1, -1]], least=least, low=-1.0, high=1.0)):
        assert not answer.solved
        assert answer.residual > ACCURACY


@pytest.mark.parametrize("place", ["hessian", "gradient", "least"])
def test_nan_and_infinity_raise_nothing(place: str) -> None:
    of = program([[1, 0], [0, 1]], [1, 1], rows=[[1, 1]], least=[0.5], low=-1.0, high=1.0)
    getattr(of, place).flat[0] = np.nan
    assert [answer.solved for answer in solved(of)] == [False, False]


def test_too_few_iterations_are_not_solved() -> None:
    of = KNOWN[3][0]
    assert [solve(each, 1e-12, 1).solved for each in (of, as_sparse(of))] == [False, False]


def test_the_residual_is_that_of_the_worst_condition() -> None:
    """At x = (1, 2), by hand: x - y + 1 = 0 is missed by 0, each other condition by as much as is put into it."""
    of = program([[2, 0], [0, 4]], [1, -3], equal=[[1, -1]], to=[-1], rows=[[1, 1]], least=[2], low=-5, high=2)
    x, y, z = np.array([1.0, 2.0]), np.array([0.5]), np.array([-0.25, -3.25, -4.25])
    assert of.residual(x, y, z) == 0.0
    assert of.residual(x, y + 0.125, z) == 0.125
    assert of.residual(x, y, z - np.array([0.0, 0.0, 0.5])) == 0.5
    assert of._replace(to=np.array([-1.75])).residual(x, y, z) == 0.75
    assert of._replace(least=np.array([3.5])).residual(x, y, z) == 0.5
    assert of._replace(most=np.array([2.75])).residual(x, y, z) == 0.25
    assert of._replace(high=np.array([2.0, 0.5])).residual(x, y, z) == 1.5
    assert of._replace(low=np.array([1.25, 2.5])).residual(x, y, z) == 0.5
    assert np.isnan(of.residual(x, np.array([np.nan]), z))


@pytest.mark.parametrize("stiffness", [1.0, 300.0])
def test_softened_equations_are_an_energy(stiffness: float) -> None:
    """min 1/2 |x|^2 + 1/2 s (a x - b)^2 is at x = s b a / (1 + s |a|^2)."""
    of = program([[1, 0], [0, 1]], [0, 0], equal=[[3, 4]], to=[10])
    for each in (of, as_sparse(of)):
        answer = solve(each.softened(stiffness), ACCURACY, ITERATIONS)
        assert answer.solved
        assert answer.x == pytest.approx(10.0 * stiffness / (1.0 + 25.0 * stiffness) * np.array([3.0, 4.0]), abs=1e-6)


def test_warm_multipliers_are_those_of_a_new_solver() -> None:
    """H x + g + z = 0 where the bounds hold x, one program after another; a tighter tolerance is closer."""
    solvers = WarmSolvers(1e-4, outer=25, inner=50, penalty=1e-3)
    for gradient in ([-3.0, 0.25, 2.0], [4.0, -4.0, 0.5], [0.0, 0.0, 9.0]):
        of = program(np.eye(3).tolist(), gradient, low=-1.0, high=1.0)
        expected = -np.sign(gradient) * np.maximum(np.abs(gradient) - 1.0, 0.0)
        assert solvers.multipliers(of, np.zeros(3)) == pytest.approx(expected, abs=1e-2)
        assert solvers.sharper(3, 0, 1e-9) == pytest.approx(expected, abs=1e-7)
