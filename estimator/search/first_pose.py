"""First poses from keypoints, or from an index of examples: no manual initialisation."""

from __future__ import annotations

import numpy as np

from estimator.data.observation import Observation
from estimator.inference.mixture import Mixture
from estimator.numerics.alignment import similarity_onto
from estimator.search.frame_search import FrameProblem
from estimator.search.from_examples import example_modes
from estimator.search.hypothesis import Hypothesis
from estimator.search.mode_search import ModeSearch
from estimator.search.proposals import CovarianceScaledProposal
from estimator.search.settings import BY_INDEX
from estimator.search.views import random_configuration, view_sphere, with_root
from humanoid.kinematics.body import ROOT_JOINT, Body, points_in_world

RANDOM_STARTS = 24
SCALE = 8.0**0.5
"""Factor on the standard deviations of the samples of the first frame: about eight on the covariance (CSS section
4.2)."""
STARTS_OF_MARKERS = 8
_FEWEST = 3  # markers that place a root


def start_modes(search: ModeSearch, rng: np.random.Generator, observation: Observation, count: int) -> Mixture:
    """The `count` best modes of one frame; from an index if `ModeSearchSettings.start` is "index" (`example_modes`).

    A free root is placed for every heading and pitch (`estimator.search.views`); a fixed one is tried at rest and at
    random configurations within the limits. Where only one camera sees the body, the limbs of these first modes are
    also tried at their other depths, which headings alone do not reach. Then samples are drawn about the modes found,
    see `ModeSearchSettings.start_samples`. Where there are pictures, the covariance includes their terms. The frame
    counts as the first that is seen.
    """
    observation = observation.alone
    if search.settings.start == BY_INDEX:
        return example_modes(search, rng, observation, count)
    associations = search.associations(observation)
    case = FrameProblem(associations)
    starts = [Hypothesis(q, k) for q in _starts(search.body, rng, observation) for k in range(len(associations))]
    modes = search.best_modes(starts, case, count)
    likelihood = search.likelihood(observation, modes.modes[0].q)
    case = case._replace(likelihood=likelihood)
    names = [association.name for association in associations]
    camera = observation.only_camera
    if likelihood.cameras or (camera is not None and (search.jumps.limbs or search.jumps.parts)):
        again = [
            Hypothesis(q, names.index(mode.association))
            for mode in modes.modes
            for q in (mode.q, *(search.jumps.of(mode.q, camera) if camera is not None else ()))
        ]
        modes = search.best_modes(again, case, count, rng)
    if search.settings.start_samples == 0:
        return modes
    reached = [Hypothesis(mode.q, names.index(mode.association)) for mode in modes.modes]
    samples = _samples(search, rng, observation, modes, case)
    # all are searched to convergence: before it, samples on their way to one mode would seem better than other modes
    return search.best_modes([*reached, *samples], case, count, rng, every=True)


def _starts(body: Body, rng: np.random.Generator, observation: Observation) -> list[np.ndarray]:
    if observation.markers is not None and len(observation.known_markers):
        return marker_starts(rng, body, observation.markers)
    if body.has_free_root:
        return view_sphere(body, body.neutral, observation)
    return [body.neutral, *(random_configuration(rng, body) for _ in range(RANDOM_STARTS))]


def _samples(
    search: ModeSearch, rng: np.random.Generator, observation: Observation, modes: Mixture, case: FrameProblem
) -> list[Hypothesis]:
    """Drawn by the covariance of the fit's pose, in the association that it explains better; without a fit by those of
    the modes, chosen by their weights."""
    count, estimate = search.settings.start_samples, observation.estimate
    if estimate is not None:
        readings = [Hypothesis(estimate.q, k) for k in range(len(case.associations))]
        (best,) = search.screened(readings, case, 1, pictures=False)
        proposal = CovarianceScaledProposal(search.body, estimate.q, estimate.covariance, SCALE)
        return [best._replace(q=proposal.sample(rng)) for _ in range(count)]
    names = [association.name for association in case.associations]
    samples = []
    for i, drawn in enumerate(rng.multinomial(count, modes.weights)):
        mode = modes.modes[i]
        proposal = CovarianceScaledProposal(search.body, mode.q, mode.covariance, SCALE)
        samples += [Hypothesis(proposal.sample(rng), names.index(mode.association)) for _ in range(drawn)]
    return samples


def marker_starts(rng: np.random.Generator, body: Body, markers: np.ndarray) -> list[np.ndarray]:
    """Configurations (nq,) with the root placed by markers (M, 3) [m], NaN where missing: the joints at rest, and drawn
    evenly within their limits.

    A free root is placed by all markers, and by those of the root's own link and of the next ones, which joints turn
    little against it.
    """
    some = np.isfinite(markers).all(axis=1)
    joints = [body.neutral, *(random_configuration(rng, body) for _ in range(STARTS_OF_MARKERS))]
    if not body.has_free_root:
        return joints
    near = some & (_distance_to_root(body)[body.marker_joint] <= _trunk(body, some))
    return [_placed(body, q, markers, used) for q in joints for used in (some, near) if used.sum() >= _FEWEST]


def _trunk(body: Body, some: np.ndarray) -> int:
    """Number of joints from the root within which there are enough markers."""
    away = np.sort(_distance_to_root(body)[body.marker_joint[some]])
    return int(away[min(_FEWEST, len(away)) - 1]) if len(away) else 0


def _distance_to_root(body: Body) -> np.ndarray:
    """(njoints,): how many joints lie between each and the root."""
    away = np.zeros(body.njoints, dtype=np.int64)
    for j in range(ROOT_JOINT + 1, body.njoints):
        away[j] = away[body.tree.joint_parent[j]] + 1
    return away


def _placed(body: Body, q: np.ndarray, markers: np.ndarray, used: np.ndarray) -> np.ndarray:
    """q (nq,) with its root moved so that the markers used (M,) are nearest to where they were measured."""
    posed = body.at(q)
    places = points_in_world(posed, body.marker_joint, body.marker_local)[used]
    moved = similarity_onto(places, markers[used])
    return with_root(q, moved.R @ posed.rotations[ROOT_JOINT], moved.of(posed.translations[ROOT_JOINT]))
