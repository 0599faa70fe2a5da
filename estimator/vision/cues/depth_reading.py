"""The person's surface in the depth of one camera: what is neither floor nor scenery, and nearest; and its closest
pairs with the nodes that should be seen (ELMO eq. 1; ICP).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.energy.priors import world_up
from estimator.numerics.closest import closest
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.depth_person import nearest_thing
from estimator.vision.cues.depth_rays import DepthRays
from estimator.vision.stereo import DepthMap, DepthPoints, StereoPair, StereoSettings
from humanoid.support.settings import setting

BACK = 400  # points that search for a node, at most


class NodePointPairs(NamedTuple):
    """Nodes (P,) int, and the points (P,) int that they are paired with."""

    node: np.ndarray
    point: np.ndarray


def spread_over(count: int, most: int) -> np.ndarray:
    """At most a number of the integers below `count`, evenly spread."""
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).astype(np.int64)


def closest_points(points: DepthPoints, places: np.ndarray, nodes: np.ndarray) -> NodePointPairs:
    """For each of some nodes (N,) int, at places (N, 3) [m], the closest of the points."""
    return NodePointPairs(nodes, closest(places, points.places)[0])


def closest_nodes(points: DepthPoints, places: np.ndarray, nodes: np.ndarray) -> NodePointPairs:
    """For some of the points the closest of the nodes (N,) int at places (N, 3) [m]: what is seen must be explained, or
    an arm could hide in the trunk."""
    chosen = spread_over(len(points), BACK)
    return NodePointPairs(nodes[closest(points.places[chosen], places)[0]], chosen)


def surface_precision(points: DepthPoints, normals: np.ndarray, noise: float, slide: float) -> np.ndarray:
    """Precision (P, 3, 3) [1/m^2] of the difference between a node and the point (P) that it is paired with: across the
    surface, whose normals are (P, 3), that of the point and of the body's shape, `noise` [m]; along it `slide` [m],
    since the point may be a neighbour's (point to plane)."""
    facing = np.einsum("pi,pi->p", normals, points.rays)
    across, along = np.square(points.across), np.square(points.along)
    variance = across + (along - across) * np.square(facing) + noise**2
    rest = 1.0 / slide**2
    outer = normals[:, :, None] * normals[:, None, :]
    return np.asarray((np.maximum(1.0 / variance, rest) - rest)[:, None, None] * outer + rest * np.eye(3))


@dataclass(frozen=True)
class DepthSettings(StereoSettings):
    """Settings of depth: its reading, and its part in the energy (ELMO eqs. 1 and 2); the first settings are for stereo
    pairs.

    points: of the person's surface, at most. farthest [m]: points beyond are scenery. depth_noise [m]: standard
    deviation of a depth camera's depths at 1 m, which grows with their square. gap [m]: points this far apart in space
    are not one object. floor [m]: points lower above the floor than this count as floor, besides the noise of depth.
    With a larger value the feet are removed with the floor, and they distinguish front from back.
    evidence: independent measurements that all points together count as, 0 for none: half from the nodes that should be
    seen to the points, half from the points to these. surface_noise [m]: standard deviation of the body's surface from
    the person's. slide [m]: standard deviation along the surface, where a point may be paired with a neighbour of its
    own node. nu: Lorentzian. rays: weight of what rays contradict, each square of `patch` px a measurement. squares:
    weight of the depth in these squares, which ranks poses; their means keep the share `common` of the deviation of a
    pixel's depth, whose errors are alike in a square, and cost `most` nats at most. repeated: share of it that counts
    in a frame with a past, in which what shape and clothes are off by has counted before.
    """

    points: int = setting(1200, at_least=20)
    farthest: float = setting(8.0, above=0)
    depth_noise: float = setting(0.003, above=0)
    gap: float = setting(0.1, above=0)
    floor: float = setting(0.02, at_least=0)
    evidence: float = setting(100.0, at_least=0)
    surface_noise: float = setting(0.02, above=0)
    slide: float = setting(0.1, above=0)
    nu: float = setting(6.0, above=0)
    rays: float = setting(1.0, at_least=0)
    patch: float = setting(8.0, above=0)
    squares: float = setting(1.0, at_least=0)
    repeated: float = setting(0.3, at_least=0, at_most=1)
    common: float = setting(0.5, above=0)
    most: float = setting(5.0, above=0)


_ON_GRID = 20_000  # pixels sampled, about
_JUMP, _FAR = 0.15, 1e3  # m, of the depth from a pixel to the next
_ASIDE = 0.25  # of a jump that just counts: what is farther behind its near side does not lie on that
_LEAST = 20  # fewest informative points
_SCENE_FRAMES, _FLOOR_POINTS = 9, 2000
TILT = 20.0  # degrees that the floor may differ from level: a camera's upward direction may be inexact
_TRIES = 1000
_LOWEST = 0.25  # share of all points
_NEAR = 0.04  # m of the floor, beside the noise of a point
_BELOW = 0.15  # m
_NARROW = 0.1  # m, standard deviation across a strip that is not floor
_MOST_BELOW, _LEAST_ON = 0.05, 0.03  # largest share of all points far below a floor, and least share on it


class Grid(NamedTuple):
    """Sampled pixels (P,) of a depth picture, every `step`-th, with the directions (P, 3) of their rays."""

    rows: np.ndarray
    columns: np.ndarray
    directions: np.ndarray
    step: int


class DepthScene(NamedTuple):
    """Constants of a clip: the source of its depth, the sampled pixels, up (3,), the floor, and the largest depth of
    each pixel over some instants (P,) [m], NaN without any."""

    source: DepthSource
    grid: Grid
    up: np.ndarray
    floor: Floor | None
    farthest: np.ndarray


@dataclass(frozen=True, eq=False)
class PersonPoints:
    """The person's surface as seen at one instant.

    points: some of it. pixels (M, 2): of the depth picture's pixels that show the person, in the camera of the cues.
    rays: the depth picture itself. floor: that the person is above, None without one.
    """

    points: DepthPoints
    pixels: np.ndarray
    rays: DepthRays
    floor: Floor | None

    def mask(self, shape: tuple[int, ...]) -> np.ndarray:
        """Where the person is in a picture of some (height, width) of the cues, bool."""
        mask = np.zeros(shape[:2], np.uint8)
        x, y = np.round(self.pixels).astype(int).T
        inside = (x >= 0) & (x < mask.shape[1]) & (y >= 0) & (y < mask.shape[0])
        mask[y[inside], x[inside]] = 1
        side = 2 * int(np.ceil(0.5 * self.rays.step)) + 1
        return cv2.dilate(mask, np.ones((side, side), np.uint8)) > 0


class DepthReading:
    """Finds the person in the depth of a clip (`estimator.vision.camera_pictures.PersonMasks`). The last instant is
    kept: several cues use it."""

    def __init__(self, pictures: CameraPictures, settings: DepthSettings, scene: DepthScene) -> None:
        self._pictures, self._settings, self._scene = pictures, settings, scene
        self._last: tuple[int, PersonPoints | None] | None = None

    @staticmethod
    def of(pictures: CameraPictures, settings: DepthSettings) -> DepthReading | None:
        """By floor and scene in some frames of a camera that stands still; None where no depth is given."""
        source = depth_source(pictures, settings)
        return None if source is None else DepthReading(pictures, settings, _scene(pictures, settings, source))

    def at(self, instant: int) -> PersonPoints | None:
        """The person at an instant; None where no person is seen."""
        if self._last is None or self._last[0] != instant:
            self._last = instant, _person(self._pictures, instant, self._settings, self._scene)
        return self._last[1]

    def mask(self, instant: int) -> np.ndarray | None:
        """See `PersonMasks`."""
        person = self.at(instant)
        return None if person is None else person.mask(self._pictures.camera.image_size[::-1])


def _scene(pictures: CameraPictures, settings: DepthSettings, source: DepthSource) -> DepthScene:
    grid, up = _grid(source), world_up((pictures.camera,))
    maps = [source.at(i) for i in pictures.instants(_SCENE_FRAMES)]
    some = [_seen(depth, grid, settings)[0] for depth in maps]
    at_pixels = np.array([depth.depth[grid.rows, grid.columns] for depth in maps])
    farthest = np.fmax.reduce(at_pixels)
    rng = np.random.default_rng(0)
    thinned = [p.some(rng.choice(len(p), min(len(p), _FLOOR_POINTS), replace=False)) for p in some]
    places, along = (np.concatenate([getattr(p, name) for p in thinned]) for name in ("places", "along"))
    return DepthScene(source, grid, up, found_floor(places, along, up, rng), farthest)


def _person(pictures: CameraPictures, instant: int, settings: DepthSettings, scene: DepthScene) -> PersonPoints | None:
    grid = scene.grid
    depth = scene.source.at(instant)
    points, where = _seen(depth, grid, settings)
    jumps, behind = _jumps(depth, grid)
    if scene.floor is not None:
        height = scene.floor.height(points.places)
        above = height > settings.floor + 2.0 * points.along * np.abs(points.rays @ scene.floor.normal)
        points, where = points.some(above), where[above]
    area = np.square(grid.step * points.across)
    values = depth.depth[grid.rows[where], grid.columns[where]]
    moved = scene.farthest[where] - values > _JUMP + 3.0 * depth.noise * np.square(scene.farthest[where])
    between = behind[where] | (jumps[where] & ~moved)  # thin limbs are all edge
    mine = nearest_thing(points, area, scene.up, settings.gap, between, moved, len(grid.rows))
    if np.count_nonzero(mine) < _LEAST:
        return None
    points = points.some(mine)
    pixels = pictures.camera.project(points.places)
    rays = DepthRays.of(depth, grid.rows, grid.columns, grid.step, jumps, points, where[mine])
    some = points.some(spread_over(len(points), settings.points))
    return PersonPoints(some, pixels, rays, scene.floor)


def _grid(source: DepthSource) -> Grid:
    width, height = source.camera.image_size
    step = max(1, round(np.sqrt(width * height / _ON_GRID)))
    rows, columns = (x.ravel() for x in np.mgrid[step // 2 : height : step, step // 2 : width : step])
    directions = source.camera.directions(np.stack([columns, rows], axis=1).astype(float))
    return Grid(rows, columns, directions, step)


def _jumps(depth: DepthMap, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Which of the grid's pixels (P,) lie at a jump of the depth, where what is seen may lie between two things, and
    which of these not on its near side."""
    rows, columns = grid.rows // grid.step, grid.columns // grid.step
    values = np.full((rows.max() + 1, columns.max() + 1), np.nan, np.float32)
    values[rows, columns] = depth.depth[grid.rows, grid.columns]
    around, known = np.ones((3, 3), np.uint8), np.isfinite(values)
    far = cv2.dilate(np.where(known, values, np.float32(0.0)), around)
    near = cv2.erode(np.where(known, values, np.float32(_FAR)), around)
    least = _JUMP + 3.0 * depth.noise * np.square(near)
    jump = far - near > least
    return jump[rows, columns], (jump & (values - near > _ASIDE * least))[rows, columns]


def _seen(depth: DepthMap, grid: Grid, settings: DepthSettings) -> tuple[DepthPoints, np.ndarray]:
    """The places that a depth picture shows, and which of the grid's pixels these are."""
    values = depth.depth[grid.rows, grid.columns]
    where = np.flatnonzero(np.isfinite(values) & (values < settings.farthest))
    return depth.points(grid.rows[where], grid.columns[where], grid.directions[where]), where


class DepthSource(Protocol):
    """Depth of one camera's clip. camera: that the depth pictures are of."""

    camera: Camera

    def at(self, instant: int) -> DepthMap:
        """The depth map of an instant."""
        ...


class FromStereo:
    """Depth from a clip and the one of the camera to its right; raises InputError as `StereoPair` does."""

    def __init__(self, left: CameraPictures, right: CameraPictures, settings: DepthSettings) -> None:
        self._left, self._right = left, right
        self._pair = StereoPair(left.camera, right.camera, settings)
        self.camera = self._pair.camera
        self._noise = float(self._pair.std(np.ones(())))

    def at(self, instant: int) -> DepthMap:
        """See `DepthSource`."""
        depth = self._pair.depth(self._left.picture(instant), self._right.picture(instant))
        return DepthMap(self.camera, depth, self._noise)


class FromFiles:
    """Depth from files beside a clip."""

    def __init__(self, pictures: CameraPictures, settings: DepthSettings) -> None:
        self._pictures, self._noise = pictures, settings.depth_noise
        self.camera = pictures.camera

    def at(self, instant: int) -> DepthMap:
        """See `DepthSource`."""
        depth = self._pictures.depth(instant)
        assert depth is not None
        return DepthMap(self.camera, depth, self._noise)


def depth_source(pictures: CameraPictures, settings: DepthSettings) -> DepthSource | None:
    """The depth source of a camera; None without one."""
    if pictures.right is not None:
        return FromStereo(pictures, pictures.right, settings)
    return FromFiles(pictures, settings) if pictures.has_depth else None


class Floor(NamedTuple):
    """Places x of a plane: normal . x = offset [m]; normal (3,): unit, upwards."""

    normal: np.ndarray
    offset: float

    def height(self, places: np.ndarray) -> np.ndarray:
        """Heights of places (N, 3) above it [m]."""
        return np.asarray(places @ self.normal - self.offset)


def found_floor(places: np.ndarray, std: np.ndarray, up: np.ndarray, rng: np.random.Generator) -> Floor | None:
    """The nearly level plane with most of the places (N, 3) on it and hardly any below it, None where there is none; of
    two the more level one, unless it has much fewer.

    std (N,): of the places [m]. up (3,): about.
    """
    best, most = None, _LEAST_ON * len(places)
    if len(places) < 3:
        return None
    level = places @ up
    low = np.flatnonzero(level <= np.quantile(level, _LOWEST))  # where it is, whatever else there may be more of
    for chosen in rng.integers(0, len(low), (_TRIES, 3)):
        floor = _through(places[low[chosen]], up)
        if floor is None:
            continue
        height = floor.height(places)
        tilt = np.degrees(np.arccos(min(1.0, float(floor.normal @ up))))
        on = float(np.count_nonzero(np.abs(height) < _NEAR + std)) * (1.0 - tilt / TILT)
        if on > most and np.count_nonzero(height < -_BELOW - 2.0 * std) <= _MOST_BELOW * len(places):
            best, most = floor, on
    return best if best is None else _refined(best, places, std, up)


def _through(three: np.ndarray, up: np.ndarray) -> Floor | None:
    """The plane through three places (3, 3), unless it is steep."""
    normal = np.cross(three[1] - three[0], three[2] - three[0])
    length = np.linalg.norm(normal)
    if length < 1e-9:
        return None
    normal = normal / length * (1.0 if normal @ up > 0.0 else -1.0)
    if normal @ up < np.cos(np.radians(TILT)):
        return None
    return Floor(normal, float(normal @ three.mean(axis=0)))


def _refined(floor: Floor, places: np.ndarray, std: np.ndarray, up: np.ndarray) -> Floor | None:
    """Least squares over the places on it; None where these are a strip, as the lower end of a wall."""
    near = np.abs(floor.height(places)) < _NEAR + std
    on, weight = places[near], 1.0 / np.square(_NEAR + std[near])
    centre = np.average(on, axis=0, weights=weight)
    _, lengths, axes = np.linalg.svd(np.sqrt(weight)[:, None] * (on - centre), full_matrices=False)
    if lengths[1] < _NARROW * np.sqrt(weight.sum()):
        return None
    normal = axes[2] * (1.0 if axes[2] @ up > 0.0 else -1.0)
    return Floor(normal, float(normal @ centre)) if normal @ up >= np.cos(np.radians(TILT)) else floor
