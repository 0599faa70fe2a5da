"""A term of another package: one joint held near an angle. Registered by being imported."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.search.cost_terms import TermContext, TermSource, register
from humanoid.kinematics.body import PosedBody
from humanoid.support.settings import setting


@dataclass(frozen=True)
class HeldSettings:
    """Which joint is held.

    joint: its name, nothing is held where it is empty. angle [rad]: at which. std [rad]: how firmly.
    """

    joint: str = ""
    angle: float = 0.0
    std: float = setting(0.05, above=0)


class Held:
    """1/2 ((q - angle) / std)^2 of one joint."""

    name = "held joint"

    def __init__(self, q_index: int, v_index: int, settings: HeldSettings) -> None:
        self._q, self._v, self._settings = q_index, v_index, settings

    def value(self, posed: PosedBody) -> float:
        return 0.5 * float((posed.q[self._q] - self._settings.angle) / self._settings.std) ** 2

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        precision = 1.0 / self._settings.std**2
        gradient[self._v] += precision * (posed.q[self._q] - self._settings.angle)
        hessian[self._v, self._v] += precision
        return self.value(posed)


def held(context: TermContext, settings: HeldSettings) -> list[Held]:
    model = context.body.model
    if not settings.joint:
        return []
    joint = model.getJointId(settings.joint)
    return [Held(model.idx_qs[joint], model.idx_vs[joint], settings)]


register(TermSource("held", held, HeldSettings()))
