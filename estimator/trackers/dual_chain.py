"""Several simple trackers that correct each other through the image features they share (Taycher, Fisher and Darrell
2004): a chain of poses, drawn by likelihood sampling, and a chain of points in the image."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from estimator.cameras.camera import Camera
from estimator.cost.model import image_extent
from estimator.formats.checked_arrays import DamageError, Field, check_arrays, check_configurations, length_of
from estimator.imaging.image_cues import ImageCues
from estimator.imaging.observation import Observation
from estimator.imaging.skin import SkinModel, SkinSettings, learned_skin, skin_blobs
from estimator.inference.chains.evidence import Detections, Evidence, EvidenceSettings, evidence_of
from estimator.inference.chains.exchange import APART, EXCHANGES, GATED, messages
from estimator.inference.chains.feature_density import FeatureDensity
from estimator.inference.chains.kalman import PointChain, Points, PointSettings
from estimator.inference.particles import Particles
from estimator.likelihood.outline_values import OutlineLikelihood, OutlineSettings
from estimator.modes.mixture import Mixture
from estimator.search.feature_detections import of_blobs
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.mode_search import ModeSearch
from estimator.search.point_features import HEAD, skin_features
from estimator.search.pose_chain import Crowd, PoseChain, PoseChainSettings
from estimator.search.pose_parts import PoseParts
from estimator.trackers.beginning import Begins
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.mixture_state import MixtureState, judged
from estimator.trackers.particle_set import FrameEnergy, Summary, first_particle_set, summarised
from humanoid.limbs.graph import limb_graph
from humanoid.support.errors import InputError
from humanoid.support.settings import check, setting

_FIELDS = {
    "pose_q": Field("f", ("N", "nq")),
    "pose_owner": Field("i", ("N",)),
    "point_mean": Field("f", ("F", "4")),
    "point_covariance": Field("f", ("D", "D")),
}
_SKIN = "skin_"


@dataclass(frozen=True)
class DualChainSettings:
    """The chains.

    pose: how poses are drawn. points: how points move. chain: whether there is a chain of points at all. exchange: what
    chains tell each other, see `estimator.inference.chains.exchange.messages`. past: whether poses also come from the
    past, see `PoseChain`. evidence, skin, outline: what pictures say. modes: hypotheses reported at most. cluster:
    radius of a hypothesis, root mean square distance of landmarks as a fraction of the body's size.
    Raises InputError where a value cannot be.
    """

    pose: PoseChainSettings = field(default_factory=PoseChainSettings)
    points: PointSettings = field(default_factory=PointSettings)
    chain: bool = True
    exchange: str = setting(GATED, one_of=EXCHANGES)
    past: bool = True
    evidence: EvidenceSettings = field(default_factory=EvidenceSettings)
    skin: SkinSettings = field(default_factory=SkinSettings)
    outline: OutlineSettings = field(default_factory=OutlineSettings)
    modes: int = setting(5, at_least=1)
    cluster: float = setting(0.1, above=0)

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, eq=False)
class DualState:
    """The hypotheses, the time [s] they belong to, the poses q (N, nq) they were made of with the hypothesis of each,
    owner (N,), the points, and what skin looks like."""

    mixture: Mixture
    time: float
    q: np.ndarray
    owner: np.ndarray
    points: Points
    skin: SkinModel

    def arrays(self) -> dict[str, np.ndarray]:
        """See `estimator.trackers.base.State`."""
        return {
            **MixtureState(self.mixture, self.time).arrays(),
            **self.points.arrays(),
            "pose_q": self.q,
            "pose_owner": self.owner,
            **{_SKIN + name: value for name, value in self.skin.arrays().items()},
        }


class DualChain(Begins):
    """The recipe. It begins as every tracker does, and learns the colour of skin from the keypoints of that frame.

    Of every searched frame it tells samples, how many poses could be drawn, effective_sample_size, and features
    (F, 2) [px] with feature_covariance (F, 2, 2), what is believed of the points.
    """

    def __init__(self, search: ModeSearch, settings: DualChainSettings | None = None) -> None:
        self.search = search
        self.body = search.body
        self.settings = settings or DualChainSettings()
        self._summary = Summary.of(self.body, self.settings.modes, self.settings.cluster)

    @cached_property
    def parts(self) -> PoseParts:
        """The body's parts, with face and hands as features."""
        anatomy = anatomy_of(self.body)
        return PoseParts.of(self.body, anatomy, skin_features(self.body, anatomy), limb_graph(self.body))

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[DualState, FrameResult]:
        """See `estimator.trackers.base.Tracker`.

        Raises
        ------
        InputError: no picture, several cameras, or no skin in the first picture.
        """
        s = self.settings
        first, result = first_particle_set(self.search, rng, observation, s.modes, s.pose.particles)
        cues = _only_picture(observation)
        extent = self._extent(cues.camera, first.mixture.modes[0].q)
        features = self.parts.features
        pixels = cues.camera.project(features.points(self.body.placed(first.particles.states)))
        middle = np.nanmean(pixels, axis=0)
        assert cues.picture is not None
        faces = np.array([name == HEAD for name in features.names])
        source = f"frame {observation.index} of {cues.camera.name}"
        skin = learned_skin(cues.picture, middle, faces, extent, s.skin, source, _foreground(cues))
        flat = pixels.reshape(len(pixels), -1) - middle.ravel()
        covariance = flat.T @ flat / len(flat) + 4.0 * np.eye(flat.shape[1])
        points = PointChain(features.names, extent, s.points).begun(middle, covariance)
        q, owner = first.particles.states, first.particles.owner
        return DualState(first.mixture, first.time, q, owner, points, skin), result

    def step(
        self, rng: np.random.Generator, state: DualState, observation: Observation
    ) -> tuple[DualState, FrameResult]:
        """See `estimator.trackers.base.Tracker`."""
        s, dt = self.settings, observation.time - state.time
        cues, reference = _only_picture(observation), state.mixture.modes[0].q
        extent = self._extent(cues.camera, reference)
        outlines = OutlineLikelihood(self.body, self.parts.graph, cues, extent, s.outline)
        std = s.pose.noise * self.search.model.transition_std(dt)
        pose = PoseChain(rng, self.parts, cues.camera, outlines, std, s.pose, s.past, {})
        points = PointChain(self.parts.features.names, extent, s.points)
        weights = np.full(len(state.q), 1.0 / len(state.q))
        expected = pose.predict(Crowd(state.q, weights, reference), dt)
        going = points.predict(state.points, dt)
        said = [pose.features(expected), points.features(going)] if s.chain else [pose.features(expected)]
        evidence = evidence_of(self._detected(cues, state.skin), s.evidence, said[-1])
        if not s.past:
            evidence = _of_all(evidence)
        told = messages(said, evidence, s.exchange if s.chain else APART)
        if s.past or evidence.density.known.all():
            crowd, _ = pose.update(expected, told[0])
        else:
            crowd, _ = pose.without_samples(expected)
        after = points.update(going, told[1])[0] if s.chain else going
        energy = FrameEnergy(self.search, observation, state.mixture)
        particles = Particles(crowd.q, crowd.weights, np.zeros(len(crowd.q), dtype=np.int64))
        mixture, owner = summarised(self.search, energy, particles, crowd.q, state.mixture, dt, self._summary)
        extra = {name: np.array(value) for name, value in pose.told.items()}
        believed = points.features(after)
        extra["features"] = believed.mean[0]
        extra["feature_covariance"] = np.array(
            [believed.covariance[0, 2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(len(believed.names))]
        )
        _, result = judged(self.search, observation, mixture, extra)
        return DualState(mixture, observation.time, crowd.q, owner, after, state.skin), result

    def state_from(self, arrays: Mapping[str, np.ndarray]) -> DualState:
        """See `estimator.trackers.base.Tracker`."""
        summary = MixtureState.from_arrays(arrays, self.body, minima=False)
        count = len(self.parts.features.names)
        sizes = {"nq": self.body.nq, "F": count, "4": 4, "D": 4 * count}
        check_arrays(arrays, _FIELDS, {**sizes, "N": length_of(arrays, "pose_owner")})
        check_configurations(self.body, arrays["pose_q"], "pose_q")
        owner = arrays["pose_owner"]
        if not ((owner >= 0) & (owner < len(summary.mixture.weights))).all():
            raise DamageError("pose_owner is no hypothesis")
        if np.linalg.eigvalsh(arrays["point_covariance"])[0] <= 0.0:
            raise DamageError("point_covariance is none")
        own = {name.removeprefix(_SKIN): value for name, value in arrays.items() if name.startswith(_SKIN)}
        skin = SkinModel.from_arrays(own)
        return DualState(summary.mixture, summary.time, arrays["pose_q"], owner, Points.from_arrays(arrays), skin)

    def _detected(self, cues: ImageCues, skin: SkinModel) -> Detections:
        """Blobs of skin in the picture, in the foreground where that is known."""
        if cues.picture is None:
            return Detections.none(self.parts.features.names)
        blobs = skin_blobs(cues.picture, skin, _foreground(cues), self.settings.skin)
        return of_blobs(self.parts.features.names, blobs)

    def _extent(self, camera: Camera, q: np.ndarray) -> float:
        """The body's size in the image [px] at q (nq,)."""
        pixels = camera.project(self.body.landmarks(self.body.at(q)))
        return image_extent(pixels, np.isfinite(pixels).all(axis=1).astype(float))


def _only_picture(observation: Observation) -> ImageCues:
    """The cues of the only camera; InputError where there are none, or several."""
    if len(observation.cues) != 1:
        problem = f"goes by the picture of one camera, there are {len(observation.cues) or 'no'} to look at"
        raise InputError("dual-chain", problem, remedy="one clip, with --cues edges,silhouette")
    return observation.cues[0]


def _foreground(cues: ImageCues) -> np.ndarray | None:
    """(H, W) bool: where the person can be, None where that is not known."""
    silhouette = cues.get("silhouette")
    return None if silhouette is None else silhouette.mask


def _of_all(evidence: Evidence) -> Evidence:
    """The associations in which every feature is detected, if there are any: what likelihood sampling can draw from."""
    whole = evidence.density.known.all(axis=1)
    if not whole.any():
        return evidence
    d = evidence.density
    density = FeatureDensity(d.names, d.log_weight[whole], d.known[whole], d.mean[whole], d.covariance[whole])
    return Evidence(density, evidence.detection[whole])
