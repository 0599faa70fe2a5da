"""Settings of edges."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.vision.cues.edges.edge_map import EdgeSettings
from humanoid.support.idle import idle_where
from humanoid.support.settings import setting


@dataclass(frozen=True)
class EdgeCueSettings(EdgeSettings):
    """How edges are found, and how they enter the energy.

    evidence: independent measurements that all contour points together count as, 0 for none. noise: standard deviation,
        as a fraction of the subject's extent. window: how far along the normal edges are looked for, in extents.
        candidates: how many are kept (CSS eq. 8). nu: Leclerc spread.
    motion_boundary: k of W = 1 - k S_p, 0.2 to 0.4 in CSS; where there is flow.
    """

    evidence: float = setting(40.0, at_least=0)
    noise: float = setting(0.02, above=0)
    window: float = setting(0.12, above=0)
    candidates: int = setting(4, at_least=1)
    nu: float = setting(6.0, above=0)
    motion_boundary: float = setting(0.3, at_least=0, at_most=1)


_MATCHING = "cues.edges.noise cues.edges.window cues.edges.candidates cues.edges.nu"
_READING = "cues.edges.smoothing cues.edges.contrast_window cues.edges.contrast_floor cues.edges.noise_floor"
_SEEN = "cues.surface.back_facing cues.surface.occluded"
IDLE = (
    idle_where(f"cues.edges.motion_boundary {_MATCHING}", cues__edges__evidence=0.0),
    idle_where(_READING, cues__edges__evidence=0.0, cues__use_silhouette=False),
    idle_where(_SEEN, cues__surface__visibility_evidence=0.0, cues__edges__evidence=0.0),
    idle_where(_SEEN, cues__surface__visibility_evidence=0.0, cues__use_edges=False),
)
