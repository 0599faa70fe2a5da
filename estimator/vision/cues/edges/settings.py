"""Settings of edges in the image likelihood."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.vision.cues.settings import SurfaceSettings
from humanoid.support.idle import idle_where
from humanoid.support.settings import setting


@dataclass(frozen=True)
class EdgeLikelihoodSettings(SurfaceSettings):
    """How edges enter the energy.

    edge_evidence, edge_noise: of the contour points' edges. edge_window: how far along the normal edges are looked for,
        in extents. edge_candidates: how many are kept (CSS eq. 8). edge_nu: Leclerc spread.
    motion_boundary: k of W = 1 - k S_p, 0.2 to 0.4 in CSS.
    """

    edge_evidence: float = setting(40.0, at_least=0)
    edge_noise: float = setting(0.02, above=0)
    edge_window: float = setting(0.12, above=0)
    edge_candidates: int = setting(4, at_least=1)
    edge_nu: float = setting(6.0, above=0)
    motion_boundary: float = setting(0.3, at_least=0, at_most=1)


_MATCHING = "cost.image.edge_noise cost.image.edge_window cost.image.edge_candidates cost.image.edge_nu"
_SEEN = "cost.image.back_facing cost.image.occluded"
IDLE = (
    idle_where(f"cost.image.edge_evidence cost.image.motion_boundary {_MATCHING}", cues__use_edges=False),
    idle_where(f"cost.image.motion_boundary {_MATCHING}", cost__image__edge_evidence=0.0),
    idle_where("cues.edges", cost__image__edge_evidence=0.0, cues__use_silhouette=False),
    idle_where(_SEEN, cost__image__visibility_evidence=0.0, cost__image__edge_evidence=0.0),
    idle_where(_SEEN, cost__image__visibility_evidence=0.0, cues__use_edges=False),
)
