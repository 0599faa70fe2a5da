"""Settings of edges."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.vision.cues.edges.edge_map import EdgeSettings
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
