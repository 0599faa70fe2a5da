"""The damped Newton loop (Levenberg-Marquardt) behind every descent that is not compiled.

A problem gives models of its energy and steps of a model; the loop decides which steps are taken, how much the next one
is damped, and when it is enough. It returns a status and never raises. How a step is solved stays with the problem: by
a dense or a sparse factorisation, part by part, or within bounds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, Literal, NamedTuple, Protocol, TypeVar

# How a descent ended: the condition of a minimum holds; a step gained too little for another; no step helps; the
# budget was spent.
CONVERGED, SETTLED, STALLED, ITERATIONS = "converged", "settled", "stalled", "iterations"
RETRIED = 4.0, 1e-3  # factor on the damping of a model that had no step, and the least that it is then damped by
LEAST_PROMISE = 1e-300  # divides
LARGEST_RATIO = 1e100  # its cube is finite


class Valued(Protocol):
    """A model of an energy at some point."""

    @property
    def value(self) -> float:
        """The energy there."""
        ...


Model = TypeVar("Model", bound=Valued)
State = TypeVar("State")
Expansion = TypeVar("Expansion")

Step = tuple[Any, float | None]
"""A step, mostly an array, and the decrease of the energy that the undamped model promises of it; None where it is not
needed."""


class Problem(ABC, Generic[Model]):
    """The minimisation problem. The loop requests one trial at a time, and it is taken or refused before the next."""

    @abstractmethod
    def step(self, model: Model, damping: float) -> Step | None:
        """The minimum of the damped model; None where it has none."""

    @abstractmethod
    def at(self, model: Model, step: Step) -> Model:
        """The model at the end of a step: the trial."""

    def converged(self, model: Model) -> bool:
        """Whether the condition of a minimum holds."""
        return False

    def as_good(self, model: Model, trial: Model) -> bool:
        """Whether a trial with too small a decrease is accepted nevertheless."""
        return False

    def taken(self, trial: Model, ratio: float) -> Model:
        """The model to continue from; ratio: decrease of the energy over the one promised, or 1 without a promise."""
        return trial


@dataclass(frozen=True)
class Damping:
    """Settings of the damping.

    first: of the first step. least: never less. most: with more the descent has stalled. growth: factor after a step
    that was refused, on no less than `grown_from`. shrink: factor after one that was taken. by_ratio: growth doubles
    with every further refusal, and the factor after a step taken is 1 - (2 ratio - 1)^3, no less than `shrink`, with
    the ratio of actual to promised decrease (Nielsen, Damping parameter in Marquardt's method, IMM-REP-1999-05).
    """

    first: float = 1e-3
    least: float = 1e-9
    most: float = 1e6
    growth: float = 10.0
    shrink: float = 0.1
    grown_from: float = 0.0
    by_ratio: bool = False

    def lowered(self, damping: float, ratio: float) -> float:
        """After a step that was taken."""
        factor = self.shrink
        if self.by_ratio and ratio < 1.0:  # from 1 on it is the smallest
            factor = max(factor, 1.0 - (2.0 * max(ratio, -LARGEST_RATIO) - 1.0) ** 3)
        return max(self.least, damping * factor)


@dataclass(frozen=True)
class NewtonSettings:
    """Which steps are taken and when the descent ends.

    iterations: steps tried, or with `count_taken` steps taken, however often each was damped. accepted: a step is taken
    that brings more than this share of the decrease promised (without promises: that brings any).
    least_promise: the descent has stalled when less is promised. enough, share: it is settled after a step that was
    taken and neither brought nor promised `enough` and, of energies that are never negative, this share of the energy
    that is left. unsolved: what a model without a step means: a step refused, another try at once with more damping
    (not counted), or the end.
    """

    iterations: int
    damping: Damping = Damping()
    accepted: float = 0.0
    least_promise: float = 0.0
    enough: float = 0.0
    share: float = 0.0
    count_taken: bool = False
    unsolved: Literal["refuse", "retry", "stop"] = "refuse"


class DescentResult(NamedTuple, Generic[Model]):
    """End of a descent: the last model taken, CONVERGED, SETTLED, STALLED or ITERATIONS, and how many steps were
    tried."""

    model: Model
    status: str
    tried: int


def minimise(problem: Problem[Model], model: Model, settings: NewtonSettings) -> DescentResult[Model]:
    """Descend from a model; the energy never rises, but for trials that the problem calls as good."""
    schedule, accepted, unsolved = settings.damping, settings.accepted, settings.unsolved
    damping, growth = schedule.first, schedule.growth
    converged, solved, evaluated = problem.converged, problem.step, problem.at  # bound once: this is a hot loop
    tried, left = 0, settings.iterations
    while left > 0:
        if converged(model):
            return DescentResult(model, CONVERGED, tried)
        step = solved(model, damping)
        while step is None and unsolved == "retry" and damping < schedule.most:
            damping = max(RETRIED[0] * damping, RETRIED[1])
            step = solved(model, damping)
        if step is not None:
            promised = step[1]
            if promised is not None and promised < settings.least_promise:
                return DescentResult(model, STALLED, tried)
            trial = evaluated(model, step)
            gain = float(model.value - trial.value)
            ratio = float(gain > 0.0) if promised is None else gain / max(promised, LEAST_PROMISE)
            if ratio > accepted or problem.as_good(model, trial):
                model, damping, growth = problem.taken(trial, ratio), schedule.lowered(damping, ratio), schedule.growth
                tried, left = tried + 1, left - 1
                enough = settings.enough + settings.share * model.value if settings.share else settings.enough
                if gain < enough and (promised is None or promised < enough):
                    return DescentResult(model, SETTLED, tried)
                continue
        elif unsolved != "refuse":
            return DescentResult(model, STALLED, tried)
        tried, left = tried + 1, left - (not settings.count_taken)
        damping = max(damping, schedule.grown_from) * growth
        if schedule.by_ratio:
            growth *= 2.0
        if damping > schedule.most:
            return DescentResult(model, STALLED, tried)
    return DescentResult(model, CONVERGED if converged(model) else ITERATIONS, tried)


@dataclass
class Evaluated(Generic[State, Expansion]):
    """A state with its energy, and what steps from it are made of, such as normal equations, once requested."""

    state: State
    value: float
    expand: Callable[[State], Expansion]

    @cached_property
    def expansion(self) -> Expansion:
        """The expansion of the energy about the state."""
        return self.expand(self.state)


@dataclass(frozen=True)
class _States(Problem[Evaluated[State, Expansion]]):
    energy: Callable[[State], float]
    expand: Callable[[State], Expansion]
    stepped: Callable[[State, Expansion, float], State]

    def step(self, model: Evaluated[State, Expansion], damping: float) -> Step:
        return self.stepped(model.state, model.expansion, damping), None

    def at(self, model: Evaluated[State, Expansion] | None, step: Step) -> Evaluated[State, Expansion]:
        return Evaluated(step[0], self.energy(step[0]), self.expand)


def descend(
    start: State, energy: Callable[[State], float], expand: Callable[[State], Expansion],
    step: Callable[[State, Expansion, float], State], settings: NewtonSettings,
) -> DescentResult[Evaluated[State, Expansion]]:  # fmt: skip
    """Descend from a state of any type whose energies are cheap beside their derivatives.

    expand: what steps from a state are made of, once for all of them. step: the state that is tried from a state, its
    expansion and a damping.
    """
    problem = _States(energy, expand, step)
    return minimise(problem, problem.at(None, (start, None)), settings)
