"""Kinds of terms in every frame's energy, except keypoints and the transition, which belongs to a hypothesis and its
past.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.energy.balance import Balance, BalanceSettings, balance_terms
from estimator.energy.interpenetration import Interpenetration
from estimator.energy.lifted import LiftedDirections, lifted_directions
from estimator.energy.point_targets import NAME as MARKERS, PointTargets, marker_targets
from estimator.energy.pose_prior import PosePrior, load_mixture, misfit, shipped_mixture
from estimator.energy.priors import GravityPrior, Stabilisers, world_up
from estimator.energy.standing import LEAST, LevelFeet, Soles
from estimator.energy.term import Term
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.support.plugins import Registry

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
    """A kind of term; `register` makes it part of every frame's energy.

    name: as in the settings' table `[cost.terms.NAME]`. make: its terms for a context and its settings, none where it
    does not apply. settings: a frozen dataclass with the defaults, described in its docstring; None for none.
    made: how often its terms are made: once for a body (`PER_BODY`), for the cameras of a clip (`PER_CAMERAS`), or for
        what is observed in each frame (`PER_FRAME`).
    """

    name: str
    make: Callable[[TermContext, Any], Iterable[Term]]
    settings: Any = None
    made: str = PER_BODY


def without_prior(body: Body, settings: CostSettings) -> str | None:
    """The requirement of the shipped mixture that a body lacks, which is then left out; None where it suits, or a file
    is given, which has to suit."""
    return None if settings.pose_prior_file else misfit(body, shipped_mixture())


def _rest_priors(context: TermContext, _: None) -> list[Term]:
    """The stabilisers, a learned mixture, or a share of each; the stabilisers alone for joints that the mixture leaves
    out, and for a body that the shipped mixture does not suit."""
    body, cost = context.body, context.cost
    strength, share = cost.stabiliser_weight, cost.pose_prior_weight
    if strength * share <= 0.0 or without_prior(body, cost) is not None:
        return [Stabilisers(body, strength)] if strength > 0.0 else []
    mixture = load_mixture(cost.pose_prior_file) if cost.pose_prior_file else shipped_mixture()
    others = Stabilisers(body, strength, relative=dict.fromkeys(mixture.joints, 1.0 - share))
    return [others, PosePrior(body, mixture, strength * share)]


def _interpenetration(context: TermContext, _: None) -> list[Term]:
    cost = context.cost
    if context.self_collision is None or cost.interpenetration_weight <= 0.0:
        return []
    return [Interpenetration(context.self_collision, cost.clearance_scale, cost.interpenetration_weight)]


def _upright(context: TermContext, _: None) -> list[Term]:
    """Which way is up depends on the cameras alone."""
    body, weight = context.body, context.cost.stabiliser_weight * context.cost.upright_weight
    if context.cameras is None or weight <= 0.0 or not body.has_free_root or body.subject.upright is None:
        return []
    return [GravityPrior(body, world_up(context.cameras), weight)]


def _lifted(context: TermContext, _: None) -> list[LiftedDirections]:
    assert context.observation is not None
    return lifted_directions(context.body, context.observation, context.cost.lifted_weight)


def _level_feet(context: TermContext, _: None) -> list[LevelFeet]:
    """Terms of the feet of which heel and toes stand."""
    assert context.observation is not None
    cost, soles, standing = context.cost, Soles.of(context.body), context.observation.standing
    if standing is None or cost.standing_weight <= 0.0:
        return []
    both = np.minimum(standing[soles.heel], standing[soles.toe])
    if not np.any(both >= LEAST):
        return []
    up = world_up(context.observation.cameras)
    return [LevelFeet(context.body, soles, cost.standing_weight * both, up, cost.standing_tilt)]


def _markers(context: TermContext, _: None) -> list[PointTargets]:
    assert context.observation is not None
    return marker_targets(context.body, context.observation, context.cost.markers)


def _balance(context: TermContext, settings: BalanceSettings) -> list[Balance]:
    assert context.observation is not None
    return balance_terms(context.body, context.observation, settings)


TERMS: Registry[TermSource] = Registry(
    "term",
    (
        TermSource("rest priors", _rest_priors),
        TermSource(Interpenetration.name, _interpenetration),
        TermSource(GravityPrior.name, _upright, made=PER_CAMERAS),
        TermSource(LiftedDirections.name, _lifted, made=PER_FRAME),
        TermSource(LevelFeet.name, _level_feet, made=PER_FRAME),
        TermSource(MARKERS, _markers, made=PER_FRAME),
        TermSource(Balance.name, _balance, BalanceSettings(), made=PER_FRAME),
    ),
)
"""All kinds by name, in the order in which their energies are summed."""
register = TERMS.register


def term_settings() -> dict[str, Any]:
    """The default settings of the kinds that have any, by name."""
    return {source.name: source.settings for source in TERMS.values() if source.settings is not None}


def terms_of(context: TermContext, made: str = PER_BODY) -> list[Term]:
    """The terms of all kinds with this frequency, see `TermSource`."""
    settings = context.cost.terms
    sources = [source for source in TERMS.values() if source.made == made]
    return [term for source in sources for term in source.make(context, settings.get(source.name))]
