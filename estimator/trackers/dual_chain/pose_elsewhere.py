"""Where limbs may be if the past is wrong about them: anywhere."""

from __future__ import annotations

import numpy as np

from estimator.inference.steps import Reach, TruncatedSteps
from estimator.trackers.dual_chain.pose_parts import PoseParts
from estimator.trackers.dual_chain.pose_target import Expected

BY_IMAGE = 0.6  # share of a limb that may be anywhere
TRIES = 8  # for each sample of it that is kept: of arms by inverse kinematics a fifth are inside their limits
GUIDED = 0.5  # the power of what its outlines say by which these are chosen, beside what is told of its features


def anywhere(parts: PoseParts, prior: Expected) -> Reach:
    """Steps from rest that lead where joints are as a rule (`Rest.guess`)."""
    steps = prior.steps
    rest, spread = parts.rest.guess(parts.body, prior.reference)
    return TruncatedSteps(spread, steps.lower, steps.upper, steps.groups, 0.0, 1.0).reach(rest[None], np.ones(1))
