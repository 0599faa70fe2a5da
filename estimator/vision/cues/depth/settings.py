"""Settings of depth."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.vision.stereo import StereoSettings
from humanoid.support.settings import setting


@dataclass(frozen=True)
class DepthSettings(StereoSettings):
    """Settings of depth: its reading, and its part in the energy (ELMO eqs. 1 and 2); the first settings are for stereo
    pairs.

    points: of the person's surface, at most. farthest [m]: points beyond are scenery. depth_noise [m]: standard
    deviation of a depth camera's depths at 1 m, which grows with their square. gap [m]: points this far apart in space
    are not one object. floor [m]: points lower above the floor than this count as floor, besides the noise of depth.
    With a larger value the feet are removed with the floor, and they distinguish front from back.
    evidence: independent measurements that all points together count as, 0 for none: half from the nodes that should be
    seen to the points, half from the points to these. surface_noise [m]: standard deviation of the body's surface from
    the person's. slide [m]: standard deviation along the surface, where a point may be paired with a neighbour of its
    own node. nu: Lorentzian.
    """

    points: int = setting(1200, at_least=20)
    farthest: float = setting(8.0, above=0)
    depth_noise: float = setting(0.003, above=0)
    gap: float = setting(0.1, above=0)
    floor: float = setting(0.02, at_least=0)
    evidence: float = setting(100.0, at_least=0)
    surface_noise: float = setting(0.02, above=0)
    slide: float = setting(0.1, above=0)
    nu: float = setting(6.0, above=0)
