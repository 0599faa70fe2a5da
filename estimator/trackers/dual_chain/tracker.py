"""Several simple trackers that correct each other through the image features they share (Taycher, Fisher and Darrell
2004): a chain of poses, drawn by likelihood sampling, and a chain of points in the image."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estimator.data.formats.checked_arrays import DamageError, Field, check_arrays, check_configurations, length_of
from estimator.data.observation import Observation
from estimator.inference.annealing import Particles, normalised, systematic
from estimator.inference.chains.evidence import Detections, Evidence, evidence_of
from estimator.inference.chains.exchange import APART, PRINTED, messages
from estimator.inference.chains.feature_density import FeatureDensity
from estimator.inference.chains.kalman import PointChain, PointStates
from estimator.inference.chains.repeated import as_news, new_share
from estimator.inference.mixture import Mixture
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.mode_search import ModeSearch
from estimator.trackers.base import Capabilities, Initialisation
from estimator.trackers.dual_chain.alternative import Alternative
from estimator.trackers.dual_chain.outline_values import OutlineLikelihood
from estimator.trackers.dual_chain.pose_chain import ParticleSet, PoseChain, PoseChainSettings
from estimator.trackers.dual_chain.pose_parts import PoseParts
from estimator.trackers.dual_chain.seen_features import (
    SKIN,
    KeypointFeatures,
    SeenFeatures,
    SkinFeatures,
)
from estimator.trackers.dual_chain.settings import DualChainSettings
from estimator.trackers.dual_chain.skin import SkinModel
from estimator.trackers.dual_chain.walk import TemperingSettings
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.mixture_state import MixtureState, classify_frame, result_of
from estimator.trackers.particle_set import DYNAMICS_ALONE, FrameEnergy, Summary, first_particle_set, summarised
from estimator.trackers.spec import AS_DETECTED, ONLY_FILTERS, ONLY_TO_BEGIN, Spec, by_search, together
from humanoid.limbs.graph import limb_graph
from humanoid.subject.landmarks import mirror_index
from humanoid.support.settings import PICTURES, unused_where, unused_without

_FIELDS = {
    "pose_q": Field("f", ("N", "nq")),
    "pose_owner": Field("i", ("N",)),
    "point_mean": Field("f", ("F", "4")),
    "point_covariance": Field("f", ("D", "D")),
}
_SKIN = "skin_"


@dataclass(frozen=True, eq=False)
class DualState:
    """The hypotheses, the time [s] they belong to, the poses q (N, nq) they were made of with the hypothesis of each,
    owner (N,), the points, what skin looks like, None where features are keypoints, and an alternative to the poses."""

    mixture: Mixture
    time: float
    q: np.ndarray
    owner: np.ndarray
    points: PointStates
    skin: SkinModel | None
    alternative: Alternative | None = None

    def arrays(self) -> dict[str, np.ndarray]:
        """See `estimator.trackers.base.State`."""
        return {
            **MixtureState(self.mixture, self.time).arrays(),
            **self.points.arrays(),
            "pose_q": self.q,
            "pose_owner": self.owner,
            **({_SKIN + name: value for name, value in self.skin.arrays().items()} if self.skin else {}),
            **(self.alternative.arrays() if self.alternative else {}),
        }


class DualChain(Initialisation):
    """The recipe. It starts like every tracker, and learns the colour of skin from the keypoints of that frame.

    For every frame it reports samples, how many poses could be drawn, effective_sample_size, and the beliefs of the
    points: features (F, 2) [px] with feature_covariance (F, 2, 2).
    """

    def __init__(self, search: ModeSearch, settings: DualChainSettings | None = None) -> None:
        self.search = search
        self.body = search.body
        s = self.settings = settings or DualChainSettings()
        self._summary = Summary.of(self.body, s.modes, s.cluster)
        # a keypoint is of one landmark; what hides a hand makes no keypoint of it
        self._evidence = s.evidence if s.features == SKIN else replace(s.evidence, shared=0.0)
        self.seen: SeenFeatures = (
            SkinFeatures(search.model, s.skin, s.face_model) if s.features == SKIN else KeypointFeatures(search.model)
        )

    @property
    def capabilities(self) -> Capabilities:
        """It needs the cues of its features, too."""
        inherited = super().capabilities
        return replace(inherited, needed_cues=self.seen.needed_cues or inherited.needed_cues)

    @cached_property
    def parts(self) -> PoseParts:
        """The body's parts, with what is seen as features."""
        return PoseParts.of(self.body, anatomy_of(self.body), self.seen.features, limb_graph(self.body))

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[DualState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`. The first poses are those that the search finds by keypoints,
        weighed by the picture, which shows more of their depth.

        Raises
        ------
        InputError: a body without such features, several cameras; no picture, or no skin in it, where that is needed.
        """
        s, parts = self.settings, self.parts
        self.seen.check(observation)
        first, result = first_particle_set(self.search, rng, observation, s.modes, s.pose.particles)
        camera, particles = observation.cameras[0], first.particles
        outlines = self._outlines(observation, first.mixture.modes[0].q)
        if outlines is not None:
            weights, _ = normalised(outlines.log_likelihood(self.body.placed(particles.states)))
            kept = systematic(rng, weights, len(weights))
            particles = replace(particles, states=particles.states[kept], owner=particles.owner[kept])
        states = particles.states
        pixels = camera.project(parts.features.points(self.body.placed(states))).reshape(len(states), -1)
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        middle = (
            pixels.mean(axis=0) if len(pixels) else np.tile(0.5 * np.array(camera.image_size), parts.features.count)
        )
        covariance = (pixels - middle).T @ (pixels - middle) / max(len(pixels), 1) + 4.0 * np.eye(len(middle))
        skin = self.seen.learned(observation, middle.reshape(-1, 2))
        extent = self.search.model.extent(camera, first.mixture.modes[0].q)
        points = self._points(extent).initial_state(middle.reshape(-1, 2), covariance)
        return DualState(first.mixture, first.time, states, particles.owner, points, skin), result

    def step(
        self, rng: np.random.Generator, state: DualState, observation: Observation
    ) -> tuple[DualState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        s, dt = self.settings, observation.time - state.time
        camera, reference = observation.cameras[0], state.mixture.modes[0].q
        std = s.pose.noise * self.search.model.transition_std(dt)
        outlines, pose_prior = self._outlines(observation, reference), self.search.model.pose_prior
        if_hidden = s.evidence.if_hidden if s.features == SKIN else (0.0, 0.0)
        pose = PoseChain(rng, self.parts, camera, outlines, std, s.pose, s.past, pose_prior, if_hidden)
        points = self._points(self.search.model.extent(camera, reference), new_share(s.evidence.inside, dt))
        detections = self.seen.detected(observation, state.skin)
        samples, after = self._updated(state, pose, points, detections, dt)
        energy = FrameEnergy(self.search, observation, state.mixture)
        particles = Particles(samples.q, samples.weights, np.zeros(len(samples.q), dtype=np.int64))
        mixture, owner = summarised(self.search, energy, particles, samples.q, state.mixture, dt, self._summary)
        diagnostics = {name: np.array(value) for name, value in pose.diagnostics.items()} | _of_points(
            points.features(after)
        )
        if observation.is_observed or len(detections.mean):
            _, result = classify_frame(self.search, observation, mixture, diagnostics)
        else:
            result = result_of(observation, mixture, "unobserved", diagnostics)
        return DualState(mixture, observation.time, samples.q, owner, after, state.skin, samples.alternative), result

    def _points(self, size: float, news: float = 1.0) -> PointChain:
        """For a person of a size [px]. Blobs of both hands are alike; a keypoint has a name."""
        names = self.parts.features.names
        pairs = tuple((a, int(b)) for a, b in enumerate(mirror_index(names)) if a < b)
        return PointChain(names, size, self.settings.points, pairs if self.settings.features == SKIN else (), news)

    def _updated(
        self, state: DualState, pose: PoseChain, points: PointChain, detections: Detections, dt: float
    ) -> tuple[ParticleSet, PointStates]:
        """Both chains after the four steps of section 3; without a chain of points these are only predicted."""
        s = self.settings
        even, reference = np.full(len(state.q), 1.0 / len(state.q)), state.mixture.modes[0].q
        samples = ParticleSet(state.q, even, reference, state.alternative)
        expected, going = pose.predict(samples, dt), points.predict(state.points, dt)
        said = [pose.features(expected), points.features(going)] if s.chain else [pose.features(expected)]
        evidence = evidence_of(detections, self._evidence, said[-1])
        if not s.past and not s.chain:
            evidence = _of_all(evidence)
        received = messages(said, evidence, s.exchange if s.chain else APART)
        # without the past a pose can be drawn only where image or points place every feature
        if s.past or received[0].guide.known.all():
            new = as_news(received[0].evidence, said[0], points.news)
            samples, _ = pose.update(expected, replace(received[0], evidence=new))
        else:
            samples, _ = pose.without_samples(expected)
        return samples, points.update(going, received[1])[0] if s.chain else going

    def state_from(self, arrays: Mapping[str, np.ndarray]) -> DualState:
        """See `estimator.trackers.base.TrackerProtocol`."""
        summary = MixtureState.from_arrays(arrays, self.body, minima=False)
        count = self.parts.features.count
        sizes = {"nq": self.body.nq, "F": count, "4": 4, "D": 4 * count}
        check_arrays(arrays, _FIELDS, {**sizes, "N": length_of(arrays, "pose_owner")})
        check_configurations(self.body, arrays["pose_q"], "pose_q")
        owner = arrays["pose_owner"]
        if not ((owner >= 0) & (owner < len(summary.mixture.weights))).all():
            raise DamageError("pose_owner is not a hypothesis")
        if np.linalg.eigvalsh(arrays["point_covariance"])[0] <= 0.0:
            raise DamageError("point_covariance is not a covariance")
        own = {name.removeprefix(_SKIN): value for name, value in arrays.items() if name.startswith(_SKIN)}
        skin = SkinModel.from_arrays(own) if self.settings.features == SKIN else None
        points, other = PointStates.from_arrays(arrays), Alternative.from_arrays(arrays, self.body)
        return DualState(summary.mixture, summary.time, arrays["pose_q"], owner, points, skin, other)

    def _outlines(self, observation: Observation, q: np.ndarray) -> OutlineLikelihood | None:
        """The image likelihood of whole poses, None without a picture; q (nq,): about where the body is."""
        if not observation.cues:
            return None
        cues = observation.cues[0]
        return OutlineLikelihood(
            self.body, self.parts.graph, cues, self.search.model.extent(cues.camera, q), self.settings.outline
        )


def _of_points(believed: FeatureDensity) -> dict[str, np.ndarray]:
    """Diagnostics of the chain of points in a frame."""
    blocks = [believed.covariance[0, 2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(len(believed.names))]
    return {"features": believed.mean[0], "feature_covariance": np.array(blocks)}


def _of_all(evidence: Evidence) -> Evidence:
    """The associations in which every feature is detected, if there are any: what likelihood sampling can draw from."""
    whole = evidence.density.known.all(axis=1)
    if not whole.any():
        return evidence
    return Evidence(evidence.density.of(np.flatnonzero(whole)), evidence.detection[whole])


_PLAIN = PoseChainSettings(particles=1000, tempering=TemperingSettings(powers=1))
_UNUSED = (
    ONLY_TO_BEGIN,
    *DYNAMICS_ALONE,
    unused_where("dual_chain.points dual_chain.exchange", dual_chain__chain=False),
    unused_where(
        "dual_chain.pose.by_past dual_chain.pose.by_image dual_chain.pose.lost dual_chain.pose.renewed",
        dual_chain__past=False,
    ),
    unused_where("dual_chain.pose.groups", dual_chain__chain=False),
    unused_where(
        "dual_chain.pose.tempering.survival dual_chain.pose.tempering.moves", dual_chain__pose__tempering__powers=1
    ),
    unused_without(PICTURES, "dual_chain.outline"),
)


def _spec(name: str, sentence: str, settings: DualChainSettings) -> Spec:
    return Spec(
        name=name,
        sentence=sentence,
        make=by_search(DualChain),
        group="dual_chain",
        settings=settings,
        defaults=together(ONLY_FILTERS, AS_DETECTED),
        unused=_UNUSED,
    )


SPECS = (
    _spec(
        "dual-chain",
        "poses and points in the image that correct each other (Taycher et al. 2004)",
        DualChainSettings(),
    ),
    _spec(
        "dual-chain-paper",
        "dual-chain as printed: poses by likelihood sampling, without a past of their own, beside points",
        DualChainSettings(past=False, exchange=PRINTED, pose=_PLAIN),
    ),
    _spec(
        "likelihood-sampling",
        "poses drawn from where the image shows face and hands, without points (Taycher and Darrell 2003)",
        DualChainSettings(chain=False, past=False, pose=_PLAIN),
    ),
)
