"""Settings of the energy of a frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from estimator.energy.point_targets import MarkerNoise
from estimator.numerics.robust import POTENTIALS
from estimator.search.cost_terms import term_settings
from humanoid.support.settings import setting


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
