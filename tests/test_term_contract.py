"""Every term keeps the contract, and a term that breaks one of its laws is found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from builders import body_of, random_pose
from term_family import CURVATURE, FAMILY

from estimator.energy.recorded import RecordedTerm
from humanoid.kinematics.body import PosedBody
from kinemode.testing import ContractError, check_term
from tests.sources import Facts, below


@pytest.mark.parametrize("kind", FAMILY)
def test_terms_keep_the_contract(kind: str) -> None:
    body, term, q = FAMILY[kind](np.random.default_rng(11))
    check_term(term, body, q, curvature=CURVATURE.get(kind, 1e-4))


def test_no_term_is_left_out(facts: Mapping[Path, Facts]) -> None:
    made = {type(make(np.random.default_rng(11))[1]).__name__ for make in FAMILY.values()}
    classes = (c for source in below(facts, "estimator").values() for c in source.classes)
    ways = {"accumulate", "record"}  # a term derives itself, or has a kernel
    terms = {c.name for c in classes if ways & {*c.methods} and not any("Protocol" in base for base in c.bases)}
    terms.remove(RecordedTerm.__name__)
    assert len(terms) >= 7
    assert terms == made


class Spring:
    """A right term: 1/2 stiffness |q - rest|^2 of an arm, with factors that tests spoil."""

    name = "spring"

    def __init__(self) -> None:
        self.looks = 0

    def value(self, posed: PosedBody) -> float:
        return 0.5 * 3.0 * float(posed.q @ posed.q)

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        gradient += 3.0 * posed.q
        hessian += 3.0 * np.eye(len(posed.q))
        return self.value(posed)


class Nameless(Spring):
    name = ""


class NotANumber(Spring):
    def value(self, posed: PosedBody) -> float:
        return float("nan")


class Silent(Spring):
    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        return self.value(posed)


class AnotherValue(Spring):
    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        return super().accumulate(posed, gradient, hessian, exact) * (1.0 + 1e-15)


class Overwrites(Spring):
    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        gradient[:], hessian[:] = 0.0, 0.0
        return super().accumulate(posed, gradient, hessian, exact)


class Restless(Spring):
    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        self.looks += 1
        gradient += 1e-9 * self.looks
        return super().accumulate(posed, gradient, hessian, exact)


class Remembers(Spring):
    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        self.looks += exact  # a call for the exact Hessian changes the state
        gradient += 1e-9 * self.looks
        return super().accumulate(posed, gradient, hessian, exact)


class MovesTheBody(Spring):
    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        value = super().accumulate(posed, gradient, hessian, exact)
        if exact:
            posed.translations.setflags(write=True)
            posed.translations[-1] += 1.0
        return value


class WrongSlope(Spring):
    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        value = super().accumulate(posed, gradient, hessian, exact)
        gradient[5] += 1e-4 * abs(posed.q[5])
        return value


class Lopsided(Spring):
    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        value = super().accumulate(posed, gradient, hessian, exact)
        hessian[0, 1] += 1e-9
        return value


class Indefinite(Spring):
    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        value = super().accumulate(posed, gradient, hessian, exact)
        hessian[2, 2] -= 0.0 if exact else 3.0 + 1e-9
        return value


class ExactlyElsewhere(Spring):
    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        value = super().accumulate(posed, gradient, hessian, exact)
        gradient[0] += 1e-12 if exact else 0.0
        return value


class WrongCurvature(Spring):
    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        value = super().accumulate(posed, gradient, hessian, exact)
        hessian[1, 4] += 1e-3
        hessian[4, 1] += 1e-3
        return value


BROKEN: dict[Callable[[], Spring], str] = {
    Nameless: "has a name",
    NotANumber: "has a finite value",
    Silent: "has an effect at q",
    AnotherValue: "value is what accumulate returns",
    Overwrites: "adds to what is there",
    Restless: "adds to what is there",
    Remembers: "has no memory",
    MovesTheBody: "does not change the posed body",
    WrongSlope: "the gradient is the derivative",
    Lopsided: "the Hessian is symmetric",
    Indefinite: "the Hessian is positive semi-definite",
    ExactlyElsewhere: "exact changes the curvature alone",
    WrongCurvature: "the exact Hessian is the second derivative",
}


@pytest.mark.parametrize("kind", BROKEN, ids=lambda kind: kind.__name__)
def test_a_broken_law_is_found_and_reported(kind: Callable[[], Spring]) -> None:
    body = body_of("arm8")
    q = random_pose(body, np.random.default_rng(1), share=0.5)
    check_term(Spring(), body, q)
    with pytest.raises(ContractError) as broken:
        check_term(kind(), body, q)
    assert broken.value.law == BROKEN[kind]
    assert str(broken.value).startswith("Nameless: " if kind is Nameless else "spring: ")
