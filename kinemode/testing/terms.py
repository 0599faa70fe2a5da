"""The contract of terms of the energy (see `estimator.energy.term.Term`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from humanoid.kinematics.body import Body
from kinemode.testing.laws import require, slope

_GRADIENT, _LEAST = (
    1e-5,
    1e-2,
)  # relative to the slope itself, which counts as this share of the whole gradient at least
_STEP, _CURVATURE_STEP = 1e-5, 1e-4


def check_term(term: Any, body: Body, q: np.ndarray, *, curvature: float | None = 1e-4) -> None:
    """Check the promises of a term at a configuration where it has an effect.

    Its name is a text; `value` is what `accumulate` returns, to the last bit; `accumulate` adds and leaves no trace;
    the gradient is the derivative through `pin.integrate`; the Hessian is symmetric, and positive semi-definite unless
    the exact one is requested, which changes neither value nor gradient and is the second derivative.

    Parameters
    ----------
    term, body: see `estimator.energy.term.Term`.
    q (nq,): away from kinks, otherwise differences are not derivatives.
    curvature: how far the exact Hessian may be from differences of the gradient, relative to its largest entry; None
        for a term that omits part of its curvature.

    Raises
    ------
    ContractError: the first promise that is not kept.
    """
    check = _TermCheck(term, body, q)
    check.names_itself()
    check.values_agree()
    check.adds()
    check.leaves_no_trace()
    check.gradient_is_the_derivative()
    check.hessian_is_convex()
    check.exactness_changes_the_curvature_alone()
    if curvature is not None:
        check.exact_hessian_is_the_second_derivative(curvature)


Quadratic = tuple[float, np.ndarray, np.ndarray]


class _TermCheck:
    def __init__(self, term: Any, body: Body, q: np.ndarray) -> None:
        self.term, self.body, self.q = term, body, np.array(q, dtype=np.float64)
        name = getattr(term, "name", None)
        self.who = name if isinstance(name, str) and name else type(term).__name__

    def at(self, q: np.ndarray, exact: bool = False) -> Quadratic:
        gradient, hessian = np.zeros(self.body.nv), np.zeros((self.body.nv, self.body.nv))
        return float(self.term.accumulate(self.body.at(q), gradient, hessian, exact)), gradient, hessian

    def require(self, kept: bool, law: str, detail: str) -> None:
        require(kept, self.who, law, detail)

    def names_itself(self) -> None:
        name = getattr(self.term, "name", None)
        self.require(isinstance(name, str) and bool(name), "has a name", f"its name is {name!r}")

    def values_agree(self) -> None:
        value, gradient, hessian = self.at(self.q)
        self.require(np.isfinite(value), "has a finite value", f"it is {value}")
        self.require(bool(gradient.any() or hessian.any()), "has an effect at q", "no gradient and no Hessian there")
        alone = self.term.value(self.body.at(self.q))
        detail = f"value gives {alone!r}, accumulate {value!r}"
        self.require(float(alone) == value, "value is what accumulate returns", detail)

    def adds(self) -> None:
        value, gradient, hessian = self.at(self.q)
        posed, total, sums = self.body.at(self.q), np.ones_like(gradient), np.ones_like(hessian)
        values = [float(self.term.accumulate(posed, total, sums)) for _ in range(2)]
        self.require(values == [value, value], "repeats itself", f"{value!r}, then {values[0]!r} and {values[1]!r}")
        for whole, part, what in ((total, gradient, "gradient"), (sums, hessian, "Hessian")):
            missed = np.abs(whole - 1.0 - 2.0 * part).max()
            allowed = 1e-12 * (1.0 + np.abs(part).max())
            detail = f"the {what} is off by {missed:.3g} when twice added to ones"
            self.require(missed <= allowed, "adds to what is there", detail)

    def leaves_no_trace(self) -> None:
        """Neither in the term nor in the posed body."""
        posed = self.body.at(self.q)
        kept = [np.array(array) for array in posed]
        before = self.at(self.q)
        self.term.accumulate(posed, np.zeros(self.body.nv), np.zeros((self.body.nv, self.body.nv)), True)
        changed = sum(not np.array_equal(a, b, equal_nan=True) for a, b in zip(kept, posed, strict=True))
        self.require(not changed, "does not change the posed body", f"{changed} of its arrays changed")
        away = self.body.clamp(self.body.integrate(self.q, np.full(self.body.nv, 0.1)))
        self.at(away, exact=True)
        self.term.value(self.body.at(away))
        after = self.at(self.q)
        apart = max(float(np.abs(np.subtract(before[i], after[i])).max()) for i in range(3))
        self.require(apart == 0.0, "has no memory", f"after another pose it differs by {apart:.3g}")

    def gradient_is_the_derivative(self) -> None:
        """One direction at a time and all at once: a wrong entry cannot hide behind large ones."""
        gradient = self.at(self.q)[1]
        size = float(np.linalg.norm(gradient))
        mixed = np.random.default_rng(0).normal(size=self.body.nv)
        names = (*self.body.v_names, "all together")
        for name, v in zip(names, (*np.eye(self.body.nv), mixed), strict=True):
            expected = float(slope(lambda x: np.array(self.at(x)[0]), self.body, self.q, v, _STEP))
            allowed = _GRADIENT * max(abs(expected), _LEAST * size * float(np.linalg.norm(v)))
            detail = f"along {name} {gradient @ v:.9g}, by differences {expected:.9g}"
            self.require(abs(gradient @ v - expected) <= allowed, "the gradient is the derivative", detail)

    def hessian_is_convex(self) -> None:
        for exact in (False, True):
            hessian = self.at(self.q, exact)[2]
            largest = np.abs(hessian).max()
            apart = np.abs(hessian - hessian.T).max()
            kind = "exact Hessian" if exact else "Hessian"
            self.require(apart <= 1e-12 * largest, "the Hessian is symmetric", f"the {kind} to {apart:.3g} only")
        hessian = self.at(self.q)[2]
        least = np.linalg.eigvalsh(hessian)[0]
        allowed = -1e-12 * self.body.nv * np.abs(hessian).max()
        detail = f"its least eigenvalue is {least:.3g}, its largest entry {np.abs(hessian).max():.3g}"
        self.require(least >= allowed, "the Hessian is positive semi-definite", detail)

    def exactness_changes_the_curvature_alone(self) -> None:
        plain, exact = self.at(self.q), self.at(self.q, exact=True)
        apart = max(abs(plain[0] - exact[0]), float(np.abs(plain[1] - exact[1]).max()))
        detail = f"value or gradient differ by {apart:.3g}"
        self.require(apart == 0.0, "exact changes the curvature alone", detail)

    def change_of_gradient(self, v: np.ndarray) -> float:
        return float(slope(lambda x: np.array(self.at(x)[1] @ v), self.body, self.q, v, _CURVATURE_STEP))

    def exact_hessian_is_the_second_derivative(self, tolerance: float) -> None:
        """Along every two directions together: along q (+) tv the velocity stays v: the gradient changes by v'Hv."""
        hessian = self.at(self.q, exact=True)[2]
        allowed, names, eye = tolerance * np.abs(hessian).max(), self.body.v_names, np.eye(self.body.nv)
        for i in range(self.body.nv):
            for k in range(i, self.body.nv):
                v = eye[i] + eye[k]
                expected = self.change_of_gradient(v)
                detail = f"along {names[i]} and {names[k]} {v @ hessian @ v:.6g}, by differences {expected:.6g}"
                kept = abs(v @ hessian @ v - expected) <= allowed
                self.require(kept, "the exact Hessian is the second derivative", detail)
