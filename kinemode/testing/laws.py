"""The error of a broken promise."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body


class ContractError(AssertionError):
    """A violated law of a contract. law: its name."""

    def __init__(self, who: str, law: str, detail: str) -> None:
        super().__init__(f"{who}: {law}: {detail}")
        self.law = law


def require(kept: bool, who: str, law: str, detail: str) -> None:
    """Raise ContractError unless the law is kept; `detail`: what was seen instead."""
    if not kept:
        raise ContractError(who, law, detail)


def differing(ours: Mapping[str, np.ndarray], theirs: Mapping[str, np.ndarray]) -> str:
    """The difference of two mappings of arrays, in value to the last bit, in shape or in type; empty if they do not."""
    if set(ours) != set(theirs):
        return f"the names are {', '.join(sorted(ours)) or 'none'} and {', '.join(sorted(theirs)) or 'none'}"
    for name in ours:
        a, b = np.asarray(ours[name]), np.asarray(theirs[name])
        if a.shape != b.shape or a.dtype != b.dtype:
            return f"{name} is {a.shape} {a.dtype} and {b.shape} {b.dtype}"
        if a.tobytes() != b.tobytes() and not np.array_equal(a, b, equal_nan=a.dtype.kind in "fc"):
            return f"{name} differs{_by_how_much(a, b)}"
    return ""


def _by_how_much(a: np.ndarray, b: np.ndarray) -> str:
    if a.dtype.kind not in "fc":
        return f" in {np.count_nonzero(a != b)} of {a.size} entries"
    return f" by up to {np.nanmax(np.abs(a - b)):.3g}"


def slope(f: Callable[[np.ndarray], np.ndarray], body: Body, q: np.ndarray, v: np.ndarray, step: float) -> np.ndarray:
    """Derivative of f at q (nq,) along v (nv,): the central difference through `pin.integrate`, one order of the step's
    error removed (Richardson)."""

    def central(h: float) -> np.ndarray:
        ahead, behind = (np.asarray(f(pin.integrate(body.model, q, s * h * v))) for s in (1.0, -1.0))
        return (ahead - behind) / (2.0 * h)

    return (4.0 * central(step) - central(2.0 * step)) / 3.0
