"""The observation of one instant, in the order of the body's landmarks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.image_cues import ImageCues

MIN_POINTS = 4
"""Keypoints and markers; fewer do not constrain a search."""


class PoseEstimate(NamedTuple):
    """A pose q (nq,) and its covariance (nv, nv) in the tangent space there, zero where active limits hold it."""

    q: np.ndarray
    covariance: np.ndarray


class LiftedPose(NamedTuple):
    """Landmarks in space, lifted from the only camera's picture by a network.

    points (L, 3) [m]: axes x right, y down, z away, as if the person were seen on the optical axis; where they begin
    does not count. NaN where there is none. share: its weight, 0 to 1 (`estimator.data.sequence`).
    """

    points: np.ndarray
    share: float = 1.0


@dataclass(frozen=True)
class Observation:
    """The observation of one instant by every camera.

    index: number of the instant among those observed.
    time: seconds since the clip's start, or since that of the cameras' common clock.
    cameras (C): the cameras, in the order of the arrays.
    pixels (C, L, 2): keypoint of each landmark of the body [px], NaN where missing.
    confidence (C, L): 0 to 1; 0 where missing.
    jitter (C,): standard deviation of the frame-to-frame jitter of the whole clip's keypoints [px].
    noise (C,): factor on a detector's expected noise for each camera, as measured by a fit; empty without one.
    given: whether a person gave the keypoints, who does not confuse left and right as detectors do.
    cues (C): image cues, in the order of the cameras; empty where pictures are not used.
    estimate: a fit's estimate of the pose, None where there was none.
    spread (C, L): standard deviation [px] of keypoints that were not detected but come from elsewhere, beside that of a
        detector, 0 for all others; None where all are as detected.
    standing (L,): probability that a landmark has not moved in the last moments (`estimator.data.standing`); None where
        that was not computed.
    seated: probability that the hips rest on something: they are low and have not moved for a while, see there.
    lifted: the pose in space that the keypoint file has beside the keypoints of the only camera; None without.
    markers (M, 3): measured places of the body's markers in the world [m], NaN where missing; None where none are
        given.
    """

    index: int
    time: float
    cameras: tuple[Camera, ...]
    pixels: np.ndarray
    confidence: np.ndarray
    jitter: tuple[float, ...] = ()
    given: bool = False
    cues: tuple[ImageCues, ...] = ()
    estimate: PoseEstimate | None = None
    spread: np.ndarray | None = None
    standing: np.ndarray | None = None
    seated: float = 0.0
    lifted: LiftedPose | None = None
    markers: np.ndarray | None = None
    noise: tuple[float, ...] = ()

    @property
    def count(self) -> int:
        """Number of keypoints in all cameras."""
        return int(np.count_nonzero(self.confidence > 0.0))

    @property
    def known_markers(self) -> np.ndarray:
        """Numbers of the markers that were measured."""
        if self.markers is None:
            return np.zeros(0, dtype=np.int64)
        return np.flatnonzero(np.isfinite(self.markers).all(axis=1))

    @property
    def has_enough_points(self) -> bool:
        """Whether keypoints and markers are enough for a pose."""
        return self.count + len(self.known_markers) >= MIN_POINTS

    @property
    def is_observed(self) -> bool:
        """Whether there is enough to search from a known pose: keypoints, or images in which some cue has features."""
        return self.has_enough_points or any(len(cues) for cues in self.cues)

    @property
    def only_camera(self) -> Camera | None:
        """The camera that alone sees the body; None where several do, since depth is then known."""
        if self.cues:
            return self.cameras[0] if len(self.cues) == 1 else None
        seeing = np.flatnonzero((self.confidence > 0.0).any(axis=1))
        return self.cameras[int(seeing[0])] if len(seeing) == 1 else None

    @property
    def known_pixels(self) -> np.ndarray:
        """`pixels`, NaN where the confidence is 0."""
        return np.where((self.confidence > 0.0)[..., None], self.pixels, np.nan)

    @property
    def extents(self) -> np.ndarray:
        """Size of the person in each picture (C,) [px], see `image_extent`."""
        return np.array([image_extent(*seen) for seen in zip(self.pixels, self.confidence, strict=True)])

    def exchanged(self, mirror: np.ndarray) -> Observation:
        """The same instant with left and right swapped; `mirror` (L,) is the index of each landmark's other side."""
        spread = None if self.spread is None else self.spread[:, mirror]
        standing = None if self.standing is None else self.standing[mirror]
        lifted = None if self.lifted is None else self.lifted._replace(points=self.lifted.points[mirror])
        pixels, confidence = self.pixels[:, mirror], self.confidence[:, mirror]
        return replace(self, pixels=pixels, confidence=confidence, spread=spread, standing=standing, lifted=lifted)

    @property
    def alone(self) -> Observation:
        """The same instant as if none had been observed before it: all of its lifted pose counts."""
        return self if self.lifted is None else replace(self, lifted=self.lifted._replace(share=1.0))


def image_extent(pixels: np.ndarray, confidence: np.ndarray) -> float:
    """Root mean square distance [px] of the seen keypoints (L, 2) from their centre; 100 if fewer than two are seen."""
    seen = confidence > 0.0
    if np.count_nonzero(seen) < 2:
        return 100.0
    return float(np.sqrt(np.square(pixels[seen] - pixels[seen].mean(axis=0)).sum(axis=1).mean()))
