"""Where limbs may be if the past is wrong about them: anywhere, or at another depth on the same lines of sight."""

from __future__ import annotations

import numpy as np

from estimator.inference.steps import Steps
from estimator.search.pose_parts import PoseParts
from estimator.search.pose_target import Elsewhere, Expected

_BY_IMAGE = 0.6  # share of a part that may be anywhere
_TRIES = 8  # for each sample of it that is kept: of arms by inverse kinematics a fifth are inside their limits
_GUIDED = 0.5


def anywhere(parts: PoseParts, prior: Expected) -> Elsewhere:
    """Steps from rest that lead where joints are as a rule (`Rest.guess`)."""
    steps = prior.steps
    rest, spread = parts.rest.guess(parts.body, prior.reference)
    reach = Steps(spread, steps.lower, steps.upper, steps.groups, 0.0, 1.0).reach(rest[None], np.ones(1))
    return Elsewhere(reach, _BY_IMAGE, _TRIES, _GUIDED)
