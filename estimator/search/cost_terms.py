"""The terms of every frame's energy by kind, but the transition, which belongs to a hypothesis and its past."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from estimator.energy.gravity_prior import GravityPrior, world_up
from estimator.energy.interpenetration import Interpenetration
from estimator.energy.pose_mixture import load_mixture, shipped_mixture
from estimator.energy.pose_prior import PosePrior, misfit
from estimator.energy.priors import Stabilisers
from estimator.energy.term import Term
from estimator.search.term_source import TermContext, TermSource
from humanoid.kinematics.body import Body
from humanoid.support.plugins import Registry

if TYPE_CHECKING:
    from estimator.search.cost_settings import CostSettings


def without_prior(body: Body, settings: CostSettings) -> str | None:
    """What a body lacks for the shipped mixture, which is then left out; None where nothing, or a file is named, which
    has to suit it."""
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


TERMS: Registry[TermSource] = Registry(
    "term",
    (
        TermSource("rest priors", _rest_priors),
        TermSource(Interpenetration.name, _interpenetration),
        TermSource(GravityPrior.name, _upright, by_cameras=True),
    ),
)
"""All kinds by name, in the order in which their energies are summed."""
register = TERMS.register


def term_settings() -> dict[str, Any]:
    """The default settings of the kinds that have any, by name."""
    return {source.name: source.settings for source in TERMS.values() if source.settings is not None}


def terms_of(context: TermContext, *, by_cameras: bool) -> list[Term]:
    """The terms of all kinds that depend on the cameras, or of all that do not."""
    settings = context.cost.terms
    sources = [source for source in TERMS.values() if source.by_cameras is by_cameras]
    return [term for source in sources for term in source.make(context, settings.get(source.name))]
