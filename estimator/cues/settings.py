"""Weights and scales of the image terms."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ImageSettings:
    """How pictures enter the energy.

    Neighbouring nodes see nearly the same pixels, so the nodes of a cue together count as `..._evidence` independent
    measurements however fine the mesh is; 0 leaves the cue out. Noises are standard deviations; `..._noise` of edges
    and outline is a fraction of the subject's extent in the image (root mean square distance of its landmarks from
    their centre), never below half a pixel.

    nodes: surface nodes, about. fineness: cells of the depth buffer.
    edge_evidence, edge_noise: of the contour points' edges. edge_window: how far along the normal edges are looked for,
        in extents. edge_candidates: how many are kept (CSS eq. 8). edge_nu: Leclerc spread.
    motion_boundary: k of W = 1 - k S_p, 0.2 to 0.4 in CSS.
    outline_evidence, outline_noise, outline_nu: of the foreground's outline, half from the model's contour to the
        outline (Leclerc: a limb missing from the foreground must pull nothing), half the other way (Lorentzian).
    beside_keypoints: factor of all this evidence where keypoints see the whole person too: both come from the same
        pixels, and what is wrong with the body's shape or the background is wrong for every node at once.
    flow_evidence, flow_nu: of inside nodes (CSS eq. 9), Lorentzian. flow_noise [px], flow_share: standard deviation of
        the flow, and its part that grows with the flow's length.
    visibility_evidence: of the visibility penalties (CSS eqs. 5 to 7). back_facing: energy of a back-facing node, nu of
        the equations. occluded: k, how many times that an occluded one costs.
    rounds: how often features are assigned anew during a search.
    """

    nodes: int = 1000
    fineness: int = 6000
    edge_evidence: float = 20.0
    edge_noise: float = 0.02
    edge_window: float = 0.12
    edge_candidates: int = 4
    edge_nu: float = 6.0
    motion_boundary: float = 0.3
    outline_evidence: float = 40.0
    outline_noise: float = 0.02
    outline_nu: float = 8.0
    beside_keypoints: float = 0.15
    flow_evidence: float = 60.0
    flow_noise: float = 0.5
    flow_share: float = 0.1
    flow_nu: float = 4.0
    visibility_evidence: float = 10.0
    back_facing: float = 0.5
    occluded: float = 1.2
    rounds: int = 3
