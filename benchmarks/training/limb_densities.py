"""Densities of what limbs look like, learned from rendered pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.papers_loose_limbed.limb_pictures import Shown, jittered, nowhere
from estimator.trackers.loose_limbed.limbs.features import FEATURES, SWAPPED
from estimator.trackers.loose_limbed.limbs.models import Gibbs, LimbModels, all_pairs, fitted
from humanoid.limbs.limb import LimbGraph

QUANTILES = {"edge": 5, "ridge": 5}  # levels of the filters' answers, evenly filled
SHARES = {"inside": (0.2, 0.6, 0.9), "beside": (0.1, 0.5, 0.9), "beyond": (0.2, 0.8)}  # borders of the person's
COPIES = 2  # of every true pose, moved a little
JITTER = 0.01, 0.05  # m, rad: as near as that is as good as true
BORDER = 0.15, 1.0  # m from its own place, where there is no limb
PLACES = 60  # without a limb, of an instant


class Examples(NamedTuple):
    """Features (N, 9) of limbs (N,) int where they are, and (M, 9) of places where they are not; of one view each."""

    limb: np.ndarray
    features: np.ndarray
    scene: np.ndarray


def examples_of(instants: Iterable[Shown], rng: np.random.Generator) -> Examples:
    """Measures in every view of true poses, occluded or not, and of places without the limb; each measure is known."""
    limb, features, scene = [], [], []
    for shown in instants:
        absent, t, R = nowhere(rng, shown, PLACES, *BORDER)
        for i, limb_here in enumerate(shown.limbs):
            near = jittered(rng, shown.t[i], shown.R[i], COPIES, *JITTER)
            here = absent == i
            for view in shown.views:
                features.append(view.features(limb_here, *near))
                limb += [i] * COPIES
                scene.append(view.features(limb_here, t[here], R[here]))
    shown_limb, positive, negative = np.array(limb), np.concatenate(features), np.concatenate(scene)
    known = np.isfinite(positive).all(axis=1)
    return Examples(shown_limb[known], positive[known], negative[np.isfinite(negative).all(axis=1)])


def learned(graph: LimbGraph, examples: Sequence[Examples]) -> LimbModels:
    """The densities that examples of a graph's limbs have; limbs of one name, and those of both sides, share one.

    Pictures and their mirror images have equal weight, and all joint marginals of two features are kept.
    """
    limb, positive, negative = (np.concatenate(part) for part in zip(*examples, strict=True))
    bins = tuple(_borders(name, np.concatenate([positive, negative])[:, i]) for i, name in enumerate(FEATURES))
    levels, pairs = tuple(len(b) + 1 for b in bins), all_pairs(len(FEATURES))

    def model(features: np.ndarray) -> Gibbs:
        both = np.concatenate([features, features[:, SWAPPED]])
        states = [np.searchsorted(b, f) for b, f in zip(bins, both.T, strict=True)]
        return fitted(np.stack(states, axis=1), levels, pairs)

    names = [limb.name for limb in graph.limbs]
    kinds = np.array([min(name, names[k]) for name, k in zip(names, graph.mirror, strict=True)])
    of_kind = {kind: model(positive[kinds[limb] == kind]) for kind in sorted(set(kinds))}
    by_name = {name: of_kind[kind] for name, kind in zip(names, kinds, strict=True)}
    return LimbModels(bins, model(negative), by_name, model(positive))


def _borders(name: str, values: np.ndarray) -> np.ndarray:
    """Borders between the levels of a feature."""
    for word, count in QUANTILES.items():
        if word in name:
            # of left and right together, one set of borders would do; symmetric pictures make them alike
            return np.asarray(np.quantile(values, np.arange(1, count) / count))
    return np.array(next(borders for word, borders in SHARES.items() if word in name))
