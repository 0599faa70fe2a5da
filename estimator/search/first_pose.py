"""First poses from keypoints alone: no manual initialisation."""

from __future__ import annotations

import numpy as np

from estimator.imaging.observation import Observation
from estimator.modes.mixture import Mixture
from estimator.search.frame_search import FrameCase
from estimator.search.hypothesis import Hypothesis
from estimator.search.jumps import only_camera
from estimator.search.mode_search import ModeSearch
from estimator.search.views import view_sphere
from humanoid.kinematics.body import Body

RANDOM_STARTS = 24


def start_modes(search: ModeSearch, rng: np.random.Generator, observation: Observation, count: int) -> Mixture:
    """The `count` best modes of one frame.

    A free root is placed for every heading and pitch (`estimator.search.views`); a fixed one is tried at rest and at
    random configurations within the limits. Where one camera alone sees the body, the limbs of these first modes are
    also tried at their other depths, which headings alone do not reach.
    """
    body = search.body
    if body.has_free_root:
        starts = view_sphere(body, body.neutral, observation)
    else:
        starts = [body.neutral, *(random_configuration(rng, body) for _ in range(RANDOM_STARTS))]
    associations = search.associations(observation)
    case = FrameCase(associations)
    first = search.best_modes((Hypothesis(q, k) for q in starts for k in range(len(associations))), case, count)
    likelihood = search.likelihood(observation, first.modes[0].q)
    camera = only_camera(observation)
    can_jump = camera is not None and bool(search.jumps.limbs or search.jumps.parts)
    if not can_jump and likelihood is None:
        return first
    names = [association.name for association in associations]
    again = [
        Hypothesis(q, names.index(mode.association))
        for mode in first.modes
        for q in (mode.q, *(search.jumps.of(mode.q, camera) if camera is not None else ()))
    ]
    return search.best_modes(again, case._replace(likelihood=likelihood), count, rng)


def random_configuration(rng: np.random.Generator, body: Body) -> np.ndarray:
    """Neutral configuration (nq,) with every limited joint drawn evenly between its limits."""
    q = body.neutral.copy()
    i = body.bounded_q
    q[i] = rng.uniform(body.lower[i], body.upper[i])
    return q
