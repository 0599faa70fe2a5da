"""Likelihood ratio of pictures with a limb at a pose to those without (section 3 of Sigal et al., CVPR 2004), in the
volume that all cameras see.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.trackers.loose_limbed.limbs.features import (
    CUES,
    FEATURES,
    PERSON,
    UNKNOWN,
    add_ratios,
    cone_of,
    maps_of,
    measured,
)
from estimator.trackers.loose_limbed.limbs.models import LimbModels, shipped_models
from estimator.trackers.loose_limbed.limbs.ridges import Ridges, ridges_of
from humanoid.limbs.limb import Limb
from humanoid.support.errors import InputError
from humanoid.support.settings import CheckedSettings, setting

_NEAREST = 0.3  # m from a camera
_RAYS = 24  # along each side of the first camera's picture
_DEPTHS = 96


def common_box(cameras: Sequence[Camera], farthest: float, margin: float) -> np.ndarray:
    """Lowest and highest corner (2, 3) [m] of the box around all places that every camera sees, nearer than `farthest`
    [m] to each, and `margin` [m] on every side.

    Raises
    ------
    InputError: there is no such place.
    """
    first = cameras[0]
    x, y = (np.linspace(0.0, side - 1.0, _RAYS) for side in first.image_size)
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    ways = first.directions(pixels)
    ways = ways[np.isfinite(ways).all(axis=1)]
    depths = np.linspace(_NEAREST, farthest, _DEPTHS)
    points = (depths[:, None, None] * ways).reshape(-1, 3)
    points = (points - first.t_camera_world) @ first.R_camera_world
    for camera in cameras:
        seen = np.linalg.norm(points - camera.centre_world, axis=1) < farthest
        if camera is not first:
            at, size = camera.project(points), np.array(camera.image_size)
            seen &= ((at > -0.5) & (at < size - 0.5)).all(axis=1)  # NaN is not
        points = points[seen]
    if not len(points):
        named = ", ".join(camera.name for camera in cameras)
        remedy = "leave out those that look elsewhere, or check their calibration"
        raise InputError("cameras", f"{named} see no place in common", remedy=remedy)
    return np.stack([points.min(axis=0) - margin, points.max(axis=0) + margin])


@dataclass(frozen=True)
class LimbSettings(CheckedSettings):
    """Features and limits of the likelihood of a limb.

    edges, ridges, foreground: whether first derivatives on the outline, second derivatives on the axis, and the share
    of the person within and beside the limb count. Those left out are marginalised in the learned densities, so that
    the others keep proper densities. unseen [nats]: log ratio of a view that does not show the limb, while the others
    might. 0 would be neutral, but then places outside a view outweigh by their volume those that all views see and none
    explains. margin [m]: by which limbs may be beyond the smallest box around what all cameras see. farthest [m]: from
    a camera.
    Raises InputError where a value is outside its range.
    """

    edges: bool = True
    ridges: bool = True
    foreground: bool = True
    unseen: float = setting(-8.0, at_most=0)
    margin: float = setting(0.25, at_least=0)
    farthest: float = setting(12.0, above=0)

    @property
    def cues(self) -> tuple[str, ...]:
        """Names of those that count."""
        return tuple(cue for cue in CUES if getattr(self, cue))


@dataclass(frozen=True, eq=False)
class LimbView:
    """One camera's picture at one instant as the likelihood takes it; see `limb_view`."""

    camera: Camera
    ridges: Ridges
    foreground: np.ndarray

    def features(self, limb: Limb, t: np.ndarray, R: np.ndarray) -> np.ndarray:
        """The `estimator.trackers.loose_limbed.limbs.features.FEATURES` (N, 9) of poses t (N, 3), R (N, 3, 3) of a
        limb, NaN where it is not seen or the person's place is not known."""
        values = np.empty((len(t), len(FEATURES)))
        measured(cone_of(limb), *_arrays(t, R), self.camera.arrays, maps_of(self.ridges), self.foreground, values)
        return values


def limb_view(
    camera: Camera, picture: np.ndarray, foreground: np.ndarray | None = None, known: np.ndarray | None = None
) -> LimbView:
    """A view: the camera of a picture (H, W, 3) uint8 BGR, and where the person is (H, W) bool, None without a
    background. known (H, W) bool: where the background is, None everywhere.

    Raises InputError: a parallel camera, in which limbs are not as learned.
    """
    camera.needs_centre()
    if foreground is None:
        return LimbView(camera, ridges_of(picture), np.zeros((0, 0), np.uint8))
    where = np.where(foreground, np.uint8(PERSON), np.uint8(0))
    if known is not None:
        where = np.where(known, where, np.uint8(UNKNOWN))
    return LimbView(camera, ridges_of(picture), np.ascontiguousarray(where))


class LimbLikelihood:
    """Log likelihood ratio of single limbs, against the same places without a limb.

    A limb is a tapered cone of elliptic section. Each view measures edges along its outline, the ridge along its axis
    and the share of the person inside and beside it, at the scales of its width; learned densities give how much more
    probable that is for the limb, with occluded ones among its examples, than for any other place. Views are
    independent given the limb: their ratios are added. Where no view shows the limb the ratio is `LimbSettings.unseen`;
    outside the box around what all cameras see it is minus infinity.

    limbs: of a limb graph. views: of one instant, at least one. models: learned densities, the shipped ones by default.
    box (2, 3) [m]: lowest and highest corner of where limbs can be, for cameras that stand still through many instants;
    `common_box` of the views' cameras unless given.

    Raises
    ------
    InputError: the cameras' fields of view do not overlap.
    """

    def __init__(
        self,
        limbs: Sequence[Limb],
        views: Sequence[LimbView],
        *,
        models: LimbModels | None = None,
        settings: LimbSettings | None = None,
        box: np.ndarray | None = None,
    ) -> None:
        self.settings = settings or LimbSettings()
        models = models or shipped_models()
        if box is None:
            box = common_box([v.camera for v in views], self.settings.farthest, self.settings.margin)
        self.box = box
        self._cones = [cone_of(limb) for limb in limbs]
        tables = {limb.name: models.log_ratios(limb.name, self.settings.cues) for limb in limbs}
        self._tables = [tables[limb.name] for limb in limbs]
        self._views: list[tuple[Any, ...]] = [(v.camera.arrays, maps_of(v.ridges), v.foreground) for v in views]
        most = max(len(b) for b in models.bins)
        self._bins = np.array([np.append(b, np.full(most - len(b), np.inf)) for b in models.bins])

    def log_ratio(self, limb: int, t: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Log ratio of poses of a limb, t (N, 3) [m] of its proximal joint and R (N, 3, 3) in the world: (N,)
        [nats]."""
        t, R = _arrays(t, R)
        cone, total = self._cones[limb], np.zeros(len(t))
        for camera, maps, foreground in self._views:
            add_ratios(
                cone, t, R, camera, maps, foreground, self._bins, *self._tables[limb], self.settings.unseen, total
            )
        middle = t + 0.5 * (cone[0] + cone[1]) * R[:, :, 2]
        total[((middle < self.box[0]) | (middle > self.box[1])).any(axis=1)] = -np.inf
        return total


def _arrays(t: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.ascontiguousarray(t, dtype=float), np.ascontiguousarray(R, dtype=float)
