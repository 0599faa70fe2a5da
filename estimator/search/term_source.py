"""Kinds of terms in every frame's energy."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.energy.term import Term
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body

if TYPE_CHECKING:
    from estimator.search.cost_settings import CostSettings


@dataclass(frozen=True)
class TermContext:
    """The context for which terms are made.

    cost: all weights of the energy. self_collision: distances between body parts, None where they may overlap. cameras:
    those that observe the body, None where none is known. observation: the frame's, None for terms of every frame.
    """

    body: Body
    cost: CostSettings
    self_collision: SelfCollision | None = None
    cameras: tuple[Camera, ...] | None = None
    observation: Observation | None = None


PER_BODY, PER_CAMERAS, PER_FRAME = "body", "cameras", "frame"


@dataclass(frozen=True)
class TermSource:
    """A kind of term; `estimator.search.cost_terms.register` makes it part of every frame's energy.

    name: as in the settings' table `[cost.terms.NAME]`. make: its terms for a context and its settings, none where it
    does not apply. settings: a frozen dataclass with the defaults, described in its docstring; None for none.
    made: how often its terms are made: once for a body (`PER_BODY`), for the cameras of a clip (`PER_CAMERAS`), or for
        what is observed in each frame (`PER_FRAME`).
    """

    name: str
    make: Callable[[TermContext, Any], Iterable[Term]]
    settings: Any = None
    made: str = PER_BODY
