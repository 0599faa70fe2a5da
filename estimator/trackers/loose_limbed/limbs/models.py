"""Learned densities of the appearance of limbs and of the background, and their file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.formats.checked_json import mapping, member, numbers, read_json, sequence, shaped
from estimator.trackers.loose_limbed.limbs.features import CUES, FEATURES
from estimator.trackers.loose_limbed.limbs.gibbs import Gibbs, all_pairs, log_marginal
from humanoid.support.atomic import replacing
from humanoid.support.errors import InputError

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
