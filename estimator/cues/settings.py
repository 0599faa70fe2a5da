"""Weights and scales of the image terms."""

from __future__ import annotations

from dataclasses import dataclass

from humanoid.support.settings import setting


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

    nodes: int = setting(1000, at_least=1)
    fineness: int = setting(6000, at_least=1)
    edge_evidence: float = setting(20.0, at_least=0)
    edge_noise: float = setting(0.02, above=0)
    edge_window: float = setting(0.12, above=0)
    edge_candidates: int = setting(4, at_least=1)
    edge_nu: float = setting(6.0, above=0)
    motion_boundary: float = setting(0.3, at_least=0, at_most=1)
    outline_evidence: float = setting(40.0, at_least=0)
    outline_noise: float = setting(0.02, above=0)
    outline_nu: float = setting(8.0, above=0)
    beside_keypoints: float = setting(0.15, above=0)
    flow_evidence: float = setting(60.0, at_least=0)
    flow_noise: float = setting(0.5, above=0)
    flow_share: float = setting(0.1, at_least=0)
    flow_nu: float = setting(4.0, above=0)
    visibility_evidence: float = setting(10.0, at_least=0)
    back_facing: float = setting(0.5, above=0)
    occluded: float = setting(1.2, above=0)
    rounds: int = setting(3, at_least=1)
