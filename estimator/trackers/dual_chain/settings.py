"""Settings of dual chain."""

from __future__ import annotations

from dataclasses import dataclass, field

from estimator.inference.chains.evidence import EvidenceSettings
from estimator.inference.chains.exchange import EXCHANGES, GATED
from estimator.inference.chains.kalman import PointSettings
from estimator.trackers.dual_chain.outline_values import OutlineSettings
from estimator.trackers.dual_chain.pose_chain import PoseChainSettings
from estimator.trackers.dual_chain.seen_features import (
    KINDS,
    SKIN,
)
from estimator.trackers.dual_chain.skin import SkinSettings
from humanoid.support.settings import CheckedSettings, setting


@dataclass(frozen=True)
class DualChainSettings(CheckedSettings):
    """The chains.

    features: what they share, "skin", face and hands as blobs in the picture, or "keypoints", all landmarks. pose: how
    poses are drawn. points: how points move. chain: whether there is a chain of points at all. exchange: the messages
    between chains, see `estimator.inference.chains.exchange.messages`. past: whether poses also come from the past, see
    `PoseChain`. evidence, skin, outline: of the image evidence. face_model: file of a face detector, used where
    features are of skin; none by default. modes: hypotheses reported at most. cluster: radius of a hypothesis, root
    mean square distance of landmarks as a fraction of the body's size.
    Raises InputError where a value is outside its range.
    """

    features: str = setting(SKIN, one_of=KINDS)
    pose: PoseChainSettings = field(default_factory=PoseChainSettings)
    points: PointSettings = field(default_factory=PointSettings)
    chain: bool = True
    exchange: str = setting(GATED, one_of=EXCHANGES)
    past: bool = True
    evidence: EvidenceSettings = field(default_factory=EvidenceSettings)
    skin: SkinSettings = field(default_factory=SkinSettings)
    face_model: str = ""
    outline: OutlineSettings = field(default_factory=OutlineSettings)
    modes: int = setting(5, at_least=1)
    cluster: float = setting(0.1, above=0)
