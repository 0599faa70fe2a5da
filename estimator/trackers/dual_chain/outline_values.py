"""Fit of many poses at once to a picture: outlines of limbs against edges, and the silhouette. Values alone.

Weights of particles: some ten thousand poses a second, where the energy that searches descend
(`estimator.vision.cues.image_likelihood`) makes a few hundred. Limbs are tapered cones (`humanoid.limbs`).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from estimator.data.image_cues import ImageCues
from estimator.trackers.dual_chain.outline_kernels import outline_values
from estimator.vision.cues.edges import EdgeMap
from estimator.vision.cues.foreground import Silhouette
from humanoid.kinematics.body import Body, PlacedBodies
from humanoid.limbs.limb import LimbGraph, limbs_on_joints, limbs_placed
from humanoid.support.settings import CheckedSettings, setting

_OUTSIDE = 1e-3  # least share of either in a picture
_FARTHEST = 255  # px to an edge that are distinguished
_NONE = 255  # the orientation of pixels without an edge


@dataclass(frozen=True)
class OutlineSettings(CheckedSettings):
    """Weights of image evidence for poses.

    edge_evidence, silhouette_evidence, cover_evidence: how many independent measurements all outlines, all insides and
    the whole foreground count as, however many points are used; 0 leaves it out.
    edge_noise: standard deviation of an edge from the outline, as a share of the body's size in the image.
    edge_missing: probability that an outline has no edge. strength: of an edge that counts, 0 to 1. orientations: kinds
    of edges that are distinguished. mask_error: share of the silhouette that is wrong. stations: points along each side
    of a limb. cells: points of the foreground. Raises InputError where a value is outside its range.
    """

    edge_evidence: float = setting(25.0, at_least=0)
    silhouette_evidence: float = setting(25.0, at_least=0)
    cover_evidence: float = setting(25.0, at_least=0)
    edge_noise: float = setting(0.012, above=0)
    edge_missing: float = setting(0.3, above=0, below=1)
    strength: float = setting(0.35, at_least=0, at_most=1)
    orientations: int = setting(8, at_least=2, at_most=90)
    mask_error: float = setting(0.1, above=0, below=0.5)
    stations: int = setting(5, at_least=2)
    cells: int = setting(80, at_least=0)


class OutlineLikelihood:
    """The likelihood of poses by one camera's picture, as a log ratio to a picture without the body.

    A limb whose outline has an edge of its direction near it, whose inside is foreground and whose outside is not, is
    likelier than one anywhere. What a nearer limb hides, or what is outside of the picture, is neutral, so that nothing
    is gained by hiding.

    Parameters
    ----------
    body: whose poses. graph: its limbs. cues: of the picture, of which edges and silhouette are used; without either
    every pose is equally likely. extent: the body's size in the image [px].
    """

    def __init__(
        self, body: Body, graph: LimbGraph, cues: ImageCues, extent: float, settings: OutlineSettings | None = None
    ) -> None:
        self._on_joints = limbs_on_joints(graph, body)
        s = self.settings = settings or OutlineSettings()
        width, height = cues.camera.image_size
        self._z = np.array([np.linspace(limb.start, limb.end, s.stations + 2)[1:-1] for limb in graph.limbs])
        self._axes = np.array([limb.semi_axes(z) for limb, z in zip(graph.limbs, self._z, strict=True)])
        edges: EdgeMap | None = cues.get("edges")
        sigma = max(1.0, s.edge_noise * extent)
        self._edges = (
            np.zeros((0, 1, 1), np.float32) if edges is None or s.edge_evidence <= 0.0 else edge_ratios(edges, sigma, s)
        )
        silhouette: Silhouette | None = cues.get("silhouette")
        self._mask, self._ratios, self._cells = _regions(silhouette, (height, width), s)
        self._weights = np.array([s.edge_evidence, s.silhouette_evidence, s.cover_evidence])
        self._camera = cues.camera.arrays

    def values(self, placed: PlacedBodies, limbs: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Log ratios of each limb, (N, L), and of the foreground that limbs explain, (N,) [nats], for N configurations;
        their sum is the log likelihood.

        limbs (L,) bool: those to compute; the others are 0, but still hide and explain.
        """
        nothing = np.zeros((len(placed.q), 0, 3))
        return self._values(placed, limbs, nothing, np.zeros(0, dtype=np.int64))[:2]

    def log_likelihood(self, placed: PlacedBodies) -> np.ndarray:
        """Log-likelihoods (N,) [nats] of N whole poses."""
        values, cover = self.values(placed)
        return np.asarray(values.sum(axis=1) + cover)

    def with_hidden(self, placed: PlacedBodies, points: np.ndarray, owner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The log likelihood (N,) of N poses, and which of points (N, F, 3) [m] in the world they hide, (N, F) bool:
        those behind the axis of a limb that they are inside of in the image, unless it is their own, owner (F,), -1
        for none."""
        values, cover, hidden = self._values(placed, None, np.ascontiguousarray(points), owner)
        return np.asarray(values.sum(axis=1) + cover), hidden

    def _values(
        self, placed: PlacedBodies, limbs: np.ndarray | None, points: np.ndarray, owner: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        t, R = limbs_placed(placed.placements, *self._on_joints)
        wanted = np.ones(t.shape[1], dtype=bool) if limbs is None else limbs
        values, cover = np.empty((len(t), len(wanted))), np.empty(len(t))
        hidden = np.empty(points.shape[:2], dtype=bool)
        outline_values(
            t, R, self._z, self._axes, *self._camera, self._edges, self._mask, self._ratios, self._cells, wanted,
            self._weights, points, owner, values, cover, hidden,
        )  # fmt: skip
        return values, cover, hidden


def edge_ratios(edges: EdgeMap, sigma: float, settings: OutlineSettings) -> np.ndarray:
    """Log ratio (B, H, W) float32 of an outline's point being there, by the orientation of its normal in B steps of pi.

    An outline has an edge of about its direction at a distance that is normal with `sigma` [px], or none; elsewhere the
    distance is distributed as it is all over the picture, so that crowded pictures give little evidence. Its mean over
    a picture in which the body is nowhere is not above 0 (Jensen's inequality).
    """
    count, reach = settings.orientations, 4.0 * sigma
    strong = edges.strength > settings.strength
    angle = np.arctan2(edges.direction[strong, 1], edges.direction[strong, 0]) / np.pi * count
    bins = np.full(strong.shape, _NONE, np.uint8)
    bins[strong] = np.floor(angle + 0.5).astype(np.int64) % count
    out = np.empty((count, *strong.shape), np.float32)
    steps = np.arange(0.0, min(np.ceil(reach), _FARTHEST) + 1.0)
    on = np.exp(-0.5 * np.square(steps / sigma))
    on /= on.sum()
    for b in range(count):
        apart = np.ones(_NONE + 1, np.uint8)
        apart[[b, (b - 1) % count, (b + 1) % count]] = 0
        from_near = cv2.LUT(bins, apart)
        if from_near.all():
            out[b] = 0.0
            continue
        distance = cv2.distanceTransform(from_near, cv2.DIST_L2, 3)
        level = np.minimum(distance, steps[-1], out=distance).astype(np.uint8)
        counts = cv2.calcHist([level], [0], None, [_FARTHEST + 1], [0.0, _FARTHEST + 1.0])
        off = counts.ravel()[: len(steps)].astype(float)
        off = (off + 1.0) / (off + 1.0).sum()
        likely = (1.0 - settings.edge_missing) * on + settings.edge_missing * off
        values = np.zeros(_FARTHEST + 1, np.float32)
        values[: len(steps)] = np.log(likely / off)
        out[b] = cv2.LUT(level, values)
    return out


def _regions(
    silhouette: Silhouette | None, shape: tuple[int, int], settings: OutlineSettings
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """mask (H, W) int8, ratios (2, 2) and cells (2, G) float64, see `outline_kernels.outline_values`."""
    if silhouette is None or not silhouette.known.any():
        return np.full(shape, -1, np.int8), np.zeros((2, 2)), np.zeros((2, 0))
    mask = np.where(silhouette.known, silhouette.mask, -1).astype(np.int8)
    share = float(np.clip((mask == 1).sum() / max((mask >= 0).sum(), 1), _OUTSIDE, 1.0 - _OUTSIDE))
    error = settings.mask_error
    on_body = np.log(np.array([error / (1.0 - share), (1.0 - error) / share]))
    beside = np.log(np.array([(1.0 - error) / (1.0 - share), error / share]))
    places = np.argwhere(mask == 1)[:, ::-1].T.astype(float)
    count = min(settings.cells, places.shape[1]) if settings.cover_evidence > 0.0 else 0
    some = np.linspace(0, places.shape[1] - 1, count).astype(np.int64) if count else np.zeros(0, np.int64)
    return mask, np.array([on_body, beside]), np.ascontiguousarray(places[:, some])
