"""Outermost limbs proposed by what a pose leaves over of the person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimator.trackers.loose_limbed.limb_choices import outermost
from estimator.trackers.loose_limbed.limb_places import PlacementCluster
from estimator.trackers.loose_limbed.limbs.likelihood import LimbLikelihood, LimbView
from estimator.trackers.loose_limbed.part_detectors.hull import HullSettings, hull_proposals
from humanoid.limbs.limb import LimbGraph

_POSES, _KEPT, _COUNT = 1500, 60, 6  # instead of those of `HullSettings`: what is left over is small
_STD = np.repeat([0.04, 0.3, 1.5], [3, 2, 1])  # m, rad: of a place, which hardly tells the turn about its axis


def left_over_places(
    rng: np.random.Generator,
    graph: LimbGraph,
    likelihood: LimbLikelihood,
    left: Sequence[LimbView],
    settings: HullSettings,
) -> dict[int, list[PlacementCluster]]:
    """By outermost limb, places in the hull of the person as views show them where what is explained is not known
    (`estimator.trackers.loose_limbed.limbs.left_over.LeftOver.views`), by the likelihood of the whole views."""
    settings = replace(settings, poses=_POSES, survivors=_KEPT, count=_COUNT)
    part_proposals, covariance = hull_proposals(rng, graph, likelihood, left, settings), np.diag(_STD**2)
    places = {
        i: [PlacementCluster(point, covariance, 1.0) for point in part_proposals[i].points] for i in outermost(graph)
    }
    return {i: there for i, there in places.items() if there}
