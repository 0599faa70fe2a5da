"""Directions of bones, drawn to those of a pose that a network has lifted from one picture: weak evidence of depth.

Such a network sees a crop as if the person stood on the optical axis: its axes are turned to the ray to the person.
Only directions are taken of it, as its lengths are those of its training data.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.energy.kernels.points import to_world
from estimator.energy.points import LoadedPoints, accumulate_points, add_by_column
from estimator.energy.term import BatchTerm
from estimator.numerics.robust import LORENTZIAN, rho
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody
from humanoid.support.compiled import jit

_OF_SIDE = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"), ("shoulder", "hip"))
BONES = (
    *((f"{side}_{a}", f"{side}_{b}") for side in ("left", "right") for a, b in _OF_SIDE),
    ("left_hip", "right_hip"),
)
"""The landmarks at the ends of each. Feet and head are left out."""
ACROSS = 0.15
ALONG = {"shoulder": 0.25, "elbow": 0.45, "hip": 0.25, "knee": 0.25}
"""Standard deviations of a direction across the ray to the person, and along it by where a bone begins: forearms are
known least."""
NU = 7.0
_AXIS = np.array([0.0, 0.0, 1.0])


class LiftedDirections(BatchTerm):
    """1/2 sum weight rho(e' W e) of bones, e = their unit vector - the lifted one in the world, Lorentzian with `NU`.

    Parameters
    ----------
    ends (B, 2): landmarks of the body, at which each bone begins and ends.
    direction (B, 3): unit vectors in the world.
    precision (B, 3, 3): W, symmetric and positive semi-definite.
    weight (B,): of each.

    One object serves one thread: it reuses buffers.
    """

    name = "lifted"

    def __init__(
        self, body: Body, ends: np.ndarray, direction: np.ndarray, precision: np.ndarray, weight: np.ndarray
    ) -> None:
        places = ends.T.ravel()
        self._body, self._joint, self._local = body, body.landmark_joint[places], body.landmark_local[places]
        self._given = direction, precision, weight
        self._loaded = LoadedPoints.on(self._joint)
        self._load = np.zeros((len(ends), 3, 3))

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        body, loaded = self._body, self._loaded
        value: float = direction_loads(
            posed.placements, self._joint, self._local, *self._given, exact, loaded.points, loaded.force, self._load
        )
        accumulate_points(body, posed, loaded, gradient, hessian, exact)  # whose weights stay 0: two ends go together

        def add(_: np.ndarray, hessian: np.ndarray) -> None:
            add_loads(posed.spatial_jacobian, body.column_support, self._joint, loaded.points, self._load, hessian)

        add_by_column(body, gradient, hessian, add)
        return value

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        direction_values(placed.placements, self._joint, self._local, *self._given, values)
        return values


def lifted_directions(body: Body, observation: Observation, weight: float) -> list[LiftedDirections]:
    """Terms that pull the bones of a body to a frame's lifted pose; none where it has no such pose, or no bone's ends
    are seen.

    A bone counts as much as the less sure of its two keypoints.
    """
    lifted = observation.lifted
    if lifted is None or weight * lifted.share <= 0.0:
        return []
    places = {name: i for i, name in enumerate(body.landmark_names)}
    confidence = np.where(np.isfinite(observation.pixels[0]).all(axis=1), observation.confidence[0], 0.0)
    pairs = [pair for pair in BONES if pair[0] in places and pair[1] in places]
    ends = np.array([(places[a], places[b]) for a, b in pairs], dtype=np.int64).reshape(-1, 2)
    bones = lifted.points[ends[:, 1]] - lifted.points[ends[:, 0]]
    lengths = np.linalg.norm(bones, axis=1)
    sure = confidence[ends].min(axis=1)
    known = (lengths > 0.0) & (sure > 0.0)
    if not known.any():
        return []
    camera = observation.cameras[0]
    ray = _ray_to(camera, observation.pixels[0][np.unique(ends[known])].mean(axis=0))
    if not np.isfinite(ray).all():
        return []
    R_world_camera = camera.R_camera_world.T
    R_camera_seen = pin.Quaternion.FromTwoVectors(_AXIS, ray).matrix()  # the shortest turn
    directions = bones[known] / lengths[known, None] @ (R_world_camera @ R_camera_seen).T
    away = R_world_camera @ ray
    on_ray, along = np.outer(away, away), np.array([ALONG[pair[0].split("_")[1]] for pair in pairs])[known, None, None]
    precision = (np.eye(3) - on_ray) / ACROSS**2 + on_ray / along**2
    return [LiftedDirections(body, ends[known], directions, precision, weight * lifted.share * sure[known])]


def _ray_to(camera: Camera, pixel: np.ndarray) -> np.ndarray:
    """Unit vector (3,) of the ray that a pixel (2,) shows, in the camera."""
    ray = _AXIS if camera.parallel else camera.directions(pixel)
    return np.asarray(ray / np.linalg.norm(ray))


@jit
def direction_loads(  # type: ignore[no-untyped-def]
    placements, joint, local, direction, precision, weight, exact, points, force, load
):
    """Value of B bones; fills points (N, 3), their beginnings and then their ends in the world, N = 2 B; force (N, 3),
    the gradient of the value with respect to these; and load (B, 3, 3), its Hessian with respect to end - beginning.

    placements (njoints, 12). joint (N,), local (N, 3). direction (B, 3), precision (B, 3, 3), weight (B,).
    """
    value = 0.0
    unit, pull, turned = np.empty(3), np.empty(3), np.empty(3)
    count = direction.shape[0]
    for n in range(count):
        a, b = points[n], points[count + n]
        square, length = _misfit(placements, joint, local, n, direction, precision, a, b, unit, pull)
        cost, slope, bending = rho(LORENTZIAN, square, NU)
        value += 0.5 * weight[n] * cost
        slope = weight[n] * slope
        curve = 2.0 * weight[n] * bending if exact else 0.0
        along = pull[0] * unit[0] + pull[1] * unit[1] + pull[2] * unit[2]
        stiffness = 0.0  # unit' W unit
        for i in range(3):
            turned[i] = 0.0
            for k in range(3):
                turned[i] += precision[n, i, k] * unit[k]
            stiffness += unit[i] * turned[i]
        for i in range(3):
            pull[i] -= along * unit[i]  # across the bone
            force[count + n, i] = slope * pull[i] / length
            force[n, i] = -force[count + n, i]
        for i in range(3):
            for k in range(3):
                load[n, i, k] = curve * pull[i] * pull[k] / length**2
                if exact:  # of the unit vector itself
                    flat = (1.0 if i == k else 0.0) - unit[i] * unit[k]
                    load[n, i, k] -= slope * (pull[i] * unit[k] + unit[i] * pull[k] + along * flat) / length**2
                # P W P with P = 1 - unit unit'
                inner = precision[n, i, k] - unit[i] * turned[k] - turned[i] * unit[k] + unit[i] * stiffness * unit[k]
                load[n, i, k] += slope * inner / length**2
    return value


@jit
def add_loads(J, column_support, joint, points, load, hessian):  # type: ignore[no-untyped-def]
    """Add to hessian (nc, nc) what bones load (B, 3, 3) by the way from their beginnings to their ends.

    J (nc, 6): spatial Jacobian by columns, column_support (njoints, nc). joint (N,), points (N, 3) [m], N = 2 B: of the
    beginnings, then of the ends.
    """
    count, columns = load.shape[0], J.shape[0]
    some = np.empty(columns, np.int64)
    moved, pulled = np.empty((columns, 3)), np.empty((columns, 3))
    for n in range(count):
        used = 0
        for d in range(columns):
            begins, ends = column_support[joint[n], d], column_support[joint[count + n], d]
            if not begins and not ends:
                continue
            sign = (1.0 if ends else 0.0) - (1.0 if begins else 0.0)  # of what moves both the translation has no effect
            p = np.zeros(3)
            for i in range(3):
                p[i] = (points[count + n, i] if ends else 0.0) - (points[n, i] if begins else 0.0)
            w = J[d, 3:]
            x = moved[used]
            x[0] = sign * J[d, 0] + w[1] * p[2] - w[2] * p[1]
            x[1] = sign * J[d, 1] + w[2] * p[0] - w[0] * p[2]
            x[2] = sign * J[d, 2] + w[0] * p[1] - w[1] * p[0]
            for i in range(3):
                pulled[used, i] = load[n, i, 0] * x[0] + load[n, i, 1] * x[1] + load[n, i, 2] * x[2]
            some[used] = d
            used += 1
        for i in range(used):
            for k in range(i + 1):
                s = moved[i, 0] * pulled[k, 0] + moved[i, 1] * pulled[k, 1] + moved[i, 2] * pulled[k, 2]
                hessian[some[i], some[k]] += s
                if i != k:
                    hessian[some[k], some[i]] += s


@jit
def direction_values(placements, joint, local, direction, precision, weight, values):  # type: ignore[no-untyped-def]
    """Fill values (S,) with those of `direction_loads` for placements (S, njoints, 12)."""
    a, b, unit, pull = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for s in range(placements.shape[0]):
        value = 0.0
        for n in range(direction.shape[0]):
            square = _misfit(placements[s], joint, local, n, direction, precision, a, b, unit, pull)[0]
            value += 0.5 * weight[n] * rho(LORENTZIAN, square, NU)[0]
        values[s] = value


@jit
def _misfit(placements, joint, local, n, direction, precision, a, b, unit, pull):  # type: ignore[no-untyped-def]
    """e' W e of bone n, and its length [m]; fills its ends a, b (3,) in the world, its unit vector (3,), and pull (3,)
    = W e. placements (njoints, 12), joint (N,), local (N, 3), direction (B, 3), precision (B, 3, 3)."""
    end = direction.shape[0] + n
    to_world(placements[joint[n]], local[n], a)
    to_world(placements[joint[end]], local[end], b)
    length = np.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
    for i in range(3):
        unit[i] = (b[i] - a[i]) / length
    square = 0.0
    for i in range(3):
        pull[i] = 0.0
        for k in range(3):
            pull[i] += precision[n, i, k] * (unit[k] - direction[n, k])
        square += pull[i] * (unit[i] - direction[n, i])
    return square, length
