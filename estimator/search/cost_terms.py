"""Settings of the energy of a frame, and its kinds of terms, except keypoints and the transition, which belongs to a
hypothesis and its past.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.energy.balance import Balance, BalanceSettings, balance_terms
from estimator.energy.interpenetration import Interpenetration
from estimator.energy.lifted import LiftedDirections, lifted_directions
from estimator.energy.point_targets import NAME as MARKERS, MarkerNoise, PointTargets, marker_targets
from estimator.energy.pose_prior import PosePrior, load_mixture, misfit, shipped_mixture
from estimator.energy.priors import GravityPrior, Stabilisers, world_up
from estimator.energy.standing import LEAST, LevelFeet, Soles
from estimator.energy.term import Term
from estimator.numerics.robust import POTENTIALS
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.support.plugins import Registry
from humanoid.support.settings import setting


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


@dataclass(frozen=True)
class CostSettings:
    """Weights and scales of the energy; all terms are negative log-probabilities, so a weight of 1 is the probabilistic
    one.

    potential, nu: robust potential of a keypoint (`estimator.numerics.robust`).
    keypoint_noise: standard deviation of a shoulder-like keypoint about its place on the body, as a fraction of the
        subject's extent in the image (root mean square distance of its keypoints from their centre): detectors err in
        proportion to the person. keypoint_place: of that place from the landmark, in the same unit, where the subject
        does not give it (`humanoid.subject.urdf_elements.Landmark`); it keeps sharply detected points of the face from
        determining the body's size.
    stabiliser_weight: strength of the rest-position priors. upright_weight: of the root's, relative to these.
    rest_time [s]: a past has been compared with the rest positions already, so that in a frame with a past they count
        only as far as brings joints that nothing holds back to rest in about this time; 0 counts them in full in every
        frame, which brings such joints back within a frame or two. The mixture counts in full.
    pose_prior_weight: share of the rest-position priors, 0 to 1, that is replaced by a mixture learned from captured
        motion (`estimator.energy.pose_prior`); pose_prior_file: its file. By default it is the shipped one, of human34,
        and a body that it does not suit (`estimator.energy.pose_prior.misfit`) has the rest positions alone.
    interpenetration_weight, clearance_scale: repulsion of body parts (CSS 3.2.4): energy at contact, and the distance
        [m] over which it changes e-fold.
    hands_apart: whether hands that a subject holds stiffly on the forearms keep clear of each other; those of a person
        who clasps them bend at the wrists.
    turn_speed [rad/s], root_turn_speed [rad/s], root_slide_speed [m/s]: standard deviation of the change between
        frames, per second, of joints, of the root's orientation and of its position; quickness: whether a joint's own
        factor, which its stabiliser has, counts there and in smoothing; transition_potential, transition_nu: long tails
        let a mode jump on strong image evidence.
    standing_weight: weight by which points of the feet that rest in the pictures are held, 0 not at all; standing_error
        [m]: standard deviation of their place in the frame before, while tracking; standing_slip [m/s]: of their speed;
        standing_tilt [rad]: of the tilt of a foot that stands with heel and toes.
    lifted_weight: weight of the directions of bones that a network has lifted from one camera's picture, where the
        keypoint file has them (`estimator.energy.lifted`), 0 not at all; of successive frames one in 0.3 s counts.
    exchange_penalty: energy of reading a frame's keypoints with left and right swapped.
    marker_noise [m]: standard deviation of a marker's measurement; marker_place: share of the deviation of its place on
        the body that counts as noise of every frame, beside the error common to all frames; marker_nu: of the
        Lorentzian whose long tails tolerate outliers.
    terms: settings of terms registered by plugins, by name.
    """

    potential: str = setting("lorentzian", one_of=tuple(POTENTIALS))
    nu: float = setting(8.0, above=0)
    keypoint_noise: float = setting(0.025, above=0)
    keypoint_place: float = setting(0.021, at_least=0)
    stabiliser_weight: float = setting(1.0, at_least=0)
    upright_weight: float = setting(1.0, at_least=0)
    rest_time: float = setting(0.0, at_least=0)
    pose_prior_weight: float = setting(0.25, at_least=0, at_most=1)
    pose_prior_file: str = ""
    interpenetration_weight: float = setting(1.0, at_least=0)
    clearance_scale: float = setting(0.005, above=0)
    hands_apart: bool = True
    turn_speed: float = setting(6.0, above=0)
    root_turn_speed: float = setting(3.0, above=0)
    root_slide_speed: float = setting(1.5, above=0)
    quickness: bool = True
    transition_potential: str = setting("lorentzian", one_of=tuple(POTENTIALS))
    transition_nu: float = setting(20.0, above=0)
    standing_weight: float = setting(1.0, at_least=0)
    standing_error: float = setting(0.01, above=0)
    standing_slip: float = setting(0.15, above=0)
    standing_tilt: float = setting(0.1, above=0)
    lifted_weight: float = setting(0.3, at_least=0)
    exchange_penalty: float = setting(3.0, at_least=0)
    marker_noise: float = setting(0.005, above=0)
    marker_place: float = setting(0.3, at_least=0, at_most=1)
    marker_nu: float = setting(4.0, above=0)
    terms: Mapping[str, Any] = field(default_factory=term_settings)

    @property
    def markers(self) -> MarkerNoise:
        """The noise of markers."""
        return MarkerNoise(self.marker_noise, self.marker_place, self.marker_nu)
