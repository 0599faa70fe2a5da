"""Settings of flow in the image likelihood."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.vision.cues.settings import SurfaceSettings
from humanoid.support.idle import idle_where
from humanoid.support.settings import setting


@dataclass(frozen=True)
class FlowLikelihoodSettings(SurfaceSettings):
    """How flow enters the energy.

    flow_evidence, flow_nu: of inside nodes (CSS eq. 9), Lorentzian. flow_noise [px], flow_share: standard deviation of
        the flow, and its part that grows with the flow's length.
    flow_leading: measurements it counts as while it leads a hypothesis to where the other cues are looked at, at least
        `flow_evidence`. There it has to win over the transition; as evidence it counts less, since it is relative to a
        pose that is itself uncertain.
    """

    flow_evidence: float = setting(10.0, at_least=0)
    flow_leading: float = setting(60.0, at_least=0)
    flow_noise: float = setting(0.5, above=0)
    flow_share: float = setting(0.1, at_least=0)
    flow_nu: float = setting(4.0, above=0)


_MATCHING = "cost.image.flow_leading cost.image.flow_noise cost.image.flow_share cost.image.flow_nu"
IDLE = (
    idle_where(f"cost.image.flow_evidence cost.image.motion_boundary {_MATCHING}", cues__use_flow=False),
    idle_where(_MATCHING, cost__image__flow_evidence=0.0),
    idle_where("cues.flow", cost__image__flow_evidence=0.0, cost__image__motion_boundary=0.0),
    idle_where("cues.flow", cost__image__flow_evidence=0.0, cost__image__edge_evidence=0.0),
    idle_where("cues.flow", cost__image__flow_evidence=0.0, cues__use_edges=False),
)
