"""Kinematic jumps: the same image at another depth (CSS footnote 1; Sminchisescu and Triggs, CVPR 2003)."""

from estimator.search.jumps.jumps import KinematicJumps
from estimator.search.jumps.limb_solutions import REACHED, ROUGHLY

__all__ = ["REACHED", "ROUGHLY", "KinematicJumps"]
