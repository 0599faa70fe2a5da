"""Clothes of the rendered body: colours and patterns of its parts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import cv2
import numpy as np

from humanoid.shape.surface import Surface

_NO_GRAIN = np.zeros((0, 0, 0))
_GRAIN = 32  # samples of the periodic noise along each axis


class Garment(NamedTuple):
    """Colour BGR; strengths of the coarse and the fine mottling; strength and period [m] of stripes."""

    colour: tuple[float, float, float]
    coarse: float
    fine: float
    stripes: float = 0.0
    period: float = 0.06


SKIN = 128.0, 158.0, 214.0
"""Colour BGR of skin."""
_SKIN = Garment(SKIN, 0.06, 0.05)
_SHIRT = Garment((150.0, 92.0, 38.0), 0.16, 0.12, 0.22, 0.075)
_TROUSERS = Garment((82.0, 76.0, 80.0), 0.2, 0.16)
_SHOES = Garment((48.0, 52.0, 150.0), 0.15, 0.12)
_HAIR = np.array([28.0, 36.0, 52.0])
_CLOTHES = {
    "pelvis": _TROUSERS, "thigh": _TROUSERS, "shank": _TROUSERS, "foot": _SHOES, "torso": _SHIRT, "upper_arm": _SHIRT,
    "neck": _SKIN, "head": _SKIN, "forearm": _SKIN, "hand": _SKIN,
}  # fmt: skip
LONG_SLEEVES = {"forearm": _SHIRT}
"""For `dressed`: a shirt with long sleeves, which leaves only the hands bare."""
_COARSE_SIZE, _FINE_SIZE = 0.022, 0.008  # [m] between samples of the mottling


class Clothes(NamedTuple):
    """Colour (N, 3) BGR of every node of a surface, and what `raster.paint_cloth` needs: pattern (B, 7), grain."""

    colour: np.ndarray
    pattern: np.ndarray
    grain: np.ndarray


def dressed(surface: Surface, rng: np.random.Generator, others: Mapping[str, Garment] | None = None) -> Clothes:
    """Clothe a surface by the names of its links; links without a known name wear the shirt. others: by the endings of
    links' names what they wear instead, "" for the links without a known name."""
    worn_by = {**_CLOTHES, **(others or {})}
    garments = [next((g for name, g in worn_by.items() if link.endswith(name)), _SHIRT) for link in surface.links]
    worn = _worn(surface, garments, _NO_GRAIN, rng)
    for part, link in enumerate(surface.links):
        if link == "head":
            nodes = np.flatnonzero(surface.part == part)
            x, _, z = (surface.local[nodes] - surface.local[nodes].mean(axis=0)).T
            worn.colour[nodes[z > 0.45 * x + 0.035]] = _HAIR
    return worn._replace(grain=periodic_noise(rng))


def dressed_at_random(surface: Surface, grain: np.ndarray, rng: np.random.Generator) -> Clothes:
    """Any colours and patterns, alike on both sides of the body; parts of the same name wear one garment, see
    `dressed`. grain: of `periodic_noise`."""
    known = {id(g): g for g in _CLOTHES.values()}
    by_garment = {key: _random_garment(rng) for key in known}
    sleeves = rng.random() < 0.5  # whether forearms wear the shirt
    garments = []
    for link in surface.links:
        name = "upper_arm" if sleeves and link.endswith("forearm") else link
        garments.append(by_garment[id(next((g for n, g in _CLOTHES.items() if name.endswith(n)), _SHIRT))])
    return _worn(surface, garments, grain, rng)


def _random_garment(rng: np.random.Generator) -> Garment:
    grey = rng.uniform(25.0, 220.0)
    colour = np.clip(grey + 40.0 * rng.standard_normal(3), 8.0, 240.0)
    stripes = rng.uniform(0.1, 0.3) if rng.random() < 0.3 else 0.0
    coarse, fine = rng.uniform(0.03, 0.22, 2)
    return Garment((colour[0], colour[1], colour[2]), coarse, fine, stripes, rng.uniform(0.04, 0.1))


def _worn(surface: Surface, garments: list[Garment], grain: np.ndarray, rng: np.random.Generator) -> Clothes:
    """Garments by part."""
    colour = np.array([g.colour for g in garments])[surface.part]
    pattern = np.array([[g.coarse, _COARSE_SIZE, g.fine, _FINE_SIZE, g.stripes, g.period, 0.0] for g in garments])
    pattern[:, 6] = rng.uniform(0.0, _GRAIN, len(garments))
    return Clothes(colour, pattern, grain)


def periodic_noise(rng: np.random.Generator) -> np.ndarray:
    """For `raster.paint_cloth`: noise of unit variance on a periodic grid, each sample averaged with its neighbours."""
    noise = rng.standard_normal((_GRAIN,) * 3)
    for axis in range(3):
        noise = 0.5 * noise + 0.25 * (np.roll(noise, 1, axis) + np.roll(noise, -1, axis))
    return noise / noise.std()


def wall_grain(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Brightness (H, W, 1) float32 around 1 of painted walls and boards."""
    noise = cv2.GaussianBlur(rng.standard_normal((*shape, 1)).astype(np.float32), (0, 0), 3.0)
    grain: np.ndarray = np.float32(1.0) + np.float32(0.6) * noise[..., None]
    return grain
