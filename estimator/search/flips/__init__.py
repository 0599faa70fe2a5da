"""Kinematic jumps: the same image at another depth (CSS footnote 1; Sminchisescu and Triggs, CVPR 2003)."""

from estimator.search.flips.camera import only_camera
from estimator.search.flips.flips import Flips
from estimator.search.flips.readings import REACHED, ROUGHLY

__all__ = ["REACHED", "ROUGHLY", "Flips", "only_camera"]
