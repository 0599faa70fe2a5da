"""Which potentials a body's limbs have: those of a file, the shipped ones, or what its joints allow."""

from __future__ import annotations

import numpy as np

from estimator.inference.beliefs.learning import LearnSettings
from estimator.trackers.loose_limbed.limbs.potential_learning import drawn_poses, learned_potentials
from estimator.trackers.loose_limbed.limbs.potentials import LimbPotentials, load_potentials, shipped_potentials
from humanoid.kinematics.body import Body
from humanoid.limbs.limb import LimbGraph

_STEPS = (1.0 / 30.0, 1.0 / 10.0)  # s
_DRAWN = 400  # poses
_SEED = 0


def potentials_for(graph: LimbGraph, body: Body, speed: np.ndarray, path: str = "") -> LimbPotentials:
    """Potentials of a body's limb graph, for its lengths.

    path: a file of `LimbPotentials.save`. Without one the shipped ones where they are of a graph with these limbs, else
    they are learned from poses drawn within the joint limits, whose joints move at speed (nv,) [1/s], a standard
    deviation; the same ones every time.

    Raises
    ------
    InputError: the file is not readable, or is of another graph.
    """
    if path:
        return load_potentials(path).of_graph(graph, body, path)
    shipped = shipped_potentials()
    if set(shipped.limbs) == set(graph.names):
        return shipped.of_graph(graph, body)
    poses = drawn_poses(body, graph, _DRAWN, _STEPS, speed, np.random.default_rng(_SEED))
    return learned_potentials(graph, body, poses, LearnSettings())
