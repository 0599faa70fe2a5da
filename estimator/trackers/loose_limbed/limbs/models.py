"""Learned densities of the appearance of limbs and of the background, and their file.

A density is that of maximum entropy, the least committed one of several quantised measurements that has given joint
marginals: p(f) = exp(sum_i <weights_i, xi_i(f)>) / Z, where xi_i selects the entry of one joint marginal, as a one-hot
vector (Zhu, Wu, Mumford, IJCV 27(2), 1998; Roth, Sigal, Black, CVPR 2004; the sign is in the weights). Its parameters
are those of greatest likelihood, a convex problem. With a few measurements of a few levels Z is a sum over all states.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import combinations
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from estimator.data.formats.checked_json import mapping, member, numbers, read_json, sequence, shaped
from estimator.trackers.loose_limbed.limbs.features import CUES, FEATURES
from humanoid.support.errors import InputError
from humanoid.support.files import replacing

REGULARISATION = 1e-4  # of the squared weights, beside the mean log-likelihood of an example


@dataclass(frozen=True, eq=False)
class Gibbs:
    """levels (D): of each measurement. marginals (M): pairs (i, j), i < j, of measurements whose joint marginals the
    density has; weights (M): of each, (levels i, levels j)."""

    levels: tuple[int, ...]
    marginals: tuple[tuple[int, int], ...]
    weights: tuple[np.ndarray, ...]

    def log_density(self) -> np.ndarray:
        """Logarithm of the density of every state, (levels 0, ..., levels D - 1); their sum is 1."""
        energy = np.zeros(self.levels)
        for marginal, weight in zip(self.marginals, self.weights, strict=True):
            energy += weight.reshape([n if i in marginal else 1 for i, n in enumerate(self.levels)])
        return np.asarray(energy - logsumexp(energy))


def all_pairs(count: int) -> tuple[tuple[int, int], ...]:
    """Every pair (i, j), i < j, of `count` measurements."""
    return tuple(combinations(range(count), 2))


def log_marginal(log_density: np.ndarray, measurements: Sequence[int]) -> np.ndarray:
    """Logarithm of the density of some of the measurements, in their order, the others summed over."""
    gone = tuple(i for i in range(log_density.ndim) if i not in measurements)
    return np.asarray(logsumexp(log_density, axis=gone) if gone else log_density)


def fitted(
    states: np.ndarray,
    levels: tuple[int, ...],
    marginals: tuple[tuple[int, int], ...],
    regularisation: float = REGULARISATION,
) -> Gibbs:
    """The density of greatest penalised likelihood of examples, states (N, D) int, each below its measurement's levels.

    Without the penalty its joint marginals are the examples' own; the penalty keeps what was never seen possible.
    """
    counted = np.bincount(np.ravel_multi_index(tuple(states.T), levels), minlength=prod(levels)) / len(states)
    shares = counted.reshape(levels)
    wanted = np.concatenate([_marginal(shares, m).ravel() for m in marginals])

    def made(flat: np.ndarray) -> Gibbs:
        sizes = [levels[i] * levels[j] for i, j in marginals]
        parts = np.split(flat, np.cumsum(sizes)[:-1])
        return Gibbs(
            levels,
            marginals,
            tuple(p.reshape(levels[i], levels[j]) for p, (i, j) in zip(parts, marginals, strict=True)),
        )

    def loss(flat: np.ndarray) -> tuple[float, np.ndarray]:
        log_p = made(flat).log_density()
        p = np.exp(log_p)
        had = np.concatenate([_marginal(p, m).ravel() for m in marginals])
        value = -float((shares * log_p).sum()) + 0.5 * regularisation * float(flat @ flat)
        return value, had - wanted + regularisation * flat

    start = np.zeros(len(wanted))
    solution = minimize(
        loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 1000, "ftol": 1e-12, "gtol": 1e-6}
    )
    return made(solution.x)


def _marginal(density: np.ndarray, measurements: tuple[int, int]) -> np.ndarray:
    return np.asarray(density.sum(axis=tuple(i for i in range(density.ndim) if i not in measurements)))


SHIPPED = Path(__file__).with_name("gibbs.json")
"""Learned from rendered clips of captured motion by `python -m benchmarks limb_likelihood --write`."""

_DECIMALS = 3  # of weights in a file [nats]
_MOST_LEVELS = 12


@dataclass(frozen=True, eq=False)
class LimbModels:
    """Densities of the `FEATURES`, quantised.

    bins (9): borders between the levels of each, rising. background: of places without a limb. limbs: of each limb by
    its name. any_limb: of all of them together, for limbs of other names.
    """

    bins: tuple[np.ndarray, ...]
    background: Gibbs
    limbs: Mapping[str, Gibbs]
    any_limb: Gibbs
    _ratios: dict[tuple[object, ...], tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    def log_ratios(self, name: str, cues: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Log ratio of every state on a limb to the background [nats], by the named cues: flat, by levels of all
        features; and by those of edges and ridge, with the person's place unknown."""
        limb = self.limbs.get(name, self.any_limb)
        key = (id(limb), *cues)  # sums over all states: once, not once a frame
        if key not in self._ratios:
            of_limb, of_scene = limb.log_density(), self.background.log_density()
            filters = min(CUES["foreground"])  # features before these
            coarse = _ratio(of_limb, of_scene, [cue for cue in cues if cue != "foreground"])
            coarse = coarse.reshape(*coarse.shape[:filters], -1)[..., 0]
            self._ratios[key] = _ratio(of_limb, of_scene, cues).ravel(), coarse.ravel()
        return self._ratios[key]

    def save(self, path: Path, about: str) -> None:
        """Write a file that `load_models` reads; about: what it was learned from."""

        def plain(model: Gibbs) -> list[Any]:
            return [weight.round(_DECIMALS).tolist() for weight in model.weights]

        content = {
            "about": about,
            "bins": {name: [float(f"{v:.4g}") for v in b] for name, b in zip(FEATURES, self.bins, strict=True)},
            "marginals": [[FEATURES[i], FEATURES[j]] for i, j in self.background.marginals],
            "background": plain(self.background),
            "any limb": plain(self.any_limb),
            "limbs": {name: plain(model) for name, model in self.limbs.items()},
        }
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(content, separators=(",", ":")) + "\n", encoding="utf-8")


def _ratio(of_limb: np.ndarray, of_scene: np.ndarray, cues: Sequence[str]) -> np.ndarray:
    """log p / p' of every state by some of the cues alone, the others summed over; of the shape of all states."""
    kept = sorted(i for cue in cues for i in CUES[cue])
    shape = [n if i in kept else 1 for i, n in enumerate(of_limb.shape)]
    ratio = (log_marginal(of_limb, kept) - log_marginal(of_scene, kept)).reshape(shape)
    return np.broadcast_to(ratio, of_limb.shape)


def load_models(path: str | Path = SHIPPED) -> LimbModels:
    """Read densities: JSON as `LimbModels.save` writes it.

    Raises
    ------
    InputError: the file is not readable, or something is missing, has another size or is outside its range.
    """
    content = mapping(read_json(path), path)
    listed = mapping(member(content, "bins", path, ""), path, "bins")
    bins = tuple(_borders(member(listed, name, path, "bins"), path, f"bins.{name}") for name in FEATURES)
    pairs = [[name, other] for name, other in (map(FEATURES.__getitem__, p) for p in all_pairs(len(FEATURES)))]
    given = sequence(member(content, "marginals", path, ""), path, "marginals")
    unknown = [m for m in given if m not in pairs]
    if unknown or not given:
        raise InputError(path, "does not name pairs of features", place="marginals", remedy=", ".join(FEATURES))
    marginals = tuple((FEATURES.index(a), FEATURES.index(b)) for a, b in given)
    levels = tuple(len(b) + 1 for b in bins)

    def model(value: Any, place: str) -> Gibbs:
        tables = sequence(value, path, place)
        if len(tables) != len(marginals):
            raise InputError(path, f"{len(marginals)} tables are needed, found {len(tables)}", place=place)
        sizes = [(levels[i], levels[j]) for i, j in marginals]
        weights = (
            shaped(t, size, path, f"{place}[{k}]") for k, (t, size) in enumerate(zip(tables, sizes, strict=True))
        )
        return Gibbs(levels, marginals, tuple(weights))

    limbs = mapping(member(content, "limbs", path, ""), path, "limbs")
    return LimbModels(
        bins,
        model(member(content, "background", path, ""), "background"),
        {name: model(value, f"limbs.{name}") for name, value in limbs.items()},
        model(member(content, "any limb", path, ""), "any limb"),
    )


def _borders(value: Any, path: str | Path, place: str) -> np.ndarray:
    borders = numbers(value, path, place)
    if borders.ndim != 1 or not 1 <= len(borders) < _MOST_LEVELS or (np.diff(borders) <= 0.0).any():
        raise InputError(path, "are not borders between levels", place=place, remedy="a few rising numbers")
    return borders


@cache
def shipped_models() -> LimbModels:
    """The shipped models, read once."""
    return load_models()
