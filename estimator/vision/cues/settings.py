"""Settings that all cues share."""

from __future__ import annotations

from dataclasses import dataclass

from humanoid.support.settings import setting


@dataclass(frozen=True)
class SurfaceSettings:
    """Settings of the comparison of a body's surface with the pictures, common to all cues.

    Neighbouring nodes see nearly the same pixels, so the nodes of a cue together count as its `evidence` of independent
    measurements however fine the mesh is. The extent, of which noises are fractions, is the root mean square distance
    of the subject's landmarks from their centre in the image; noises are never below half a pixel.

    nodes: surface nodes, about. fineness: cells of the depth buffer.
    beside_keypoints: factor of the image likelihood where there are keypoints of the whole person too: both come from
        the same pixels, and errors of the body's shape or the background affect every node at once.
    visibility_evidence: of the visibility penalties (CSS eqs. 5 to 7). back_facing: energy of a back-facing node, nu of
        the equations. occluded: k, how many times that an occluded one costs.
    rounds: how often features are assigned again during a search.
    """

    nodes: int = setting(1000, at_least=1)
    fineness: int = setting(6000, at_least=1)
    beside_keypoints: float = setting(0.15, above=0)
    visibility_evidence: float = setting(10.0, at_least=0)
    back_facing: float = setting(0.5, above=0)
    occluded: float = setting(1.2, above=0)
    rounds: int = setting(3, at_least=1)
