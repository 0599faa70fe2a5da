"""Obstacles of a body: its own parts, or a floor, with signed distance and gradient of each part in closed form or by
coal.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import coal
import numpy as np
import pinocchio as pin

from humanoid.collision import witness
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody
from humanoid.shape.solids import ConvexSolid, solids_of
from humanoid.support.compiled import jit


class SignedDistances(Protocol):
    """distance (M,) [m], negative in overlap; gradient (M, nv): its derivative in the tangent space [m per unit of
    v]."""

    @property
    def distance(self) -> np.ndarray:
        """See `SignedDistances`."""
        ...

    @property
    def gradient(self) -> np.ndarray:
        """See `SignedDistances`."""
        ...


class Clearance(Protocol):
    """Something with signed distances from a body."""

    def near(self, posed: PosedBody, margin: float | None = None) -> SignedDistances:
        """All that are below a margin [m], by default its own."""
        ...

    def penetration(self, posed: PosedBody) -> float:
        """The deepest overlap [m], 0 if none."""
        ...


class Distances(NamedTuple):
    """See `SignedDistances`."""

    distance: np.ndarray
    gradient: np.ndarray


class Clearances:
    """Several of them as one."""

    def __init__(self, parts: Sequence[Clearance]) -> None:
        self._parts = tuple(parts)

    def near(self, posed: PosedBody, margin: float | None = None) -> Distances:
        """See `Clearance`."""
        near = [part.near(posed, margin) for part in self._parts]
        return Distances(np.concatenate([n.distance for n in near]), np.concatenate([n.gradient for n in near]))

    def penetration(self, posed: PosedBody) -> float:
        """See `Clearance`."""
        return max((part.penetration(posed) for part in self._parts), default=0.0)


def stiff_hands(body: Body) -> tuple[str, ...]:
    """Links that carry a wrist and do not move about it."""
    frames = body.model.frames
    wrists = {landmark.link for landmark in body.subject.landmarks if landmark.name.endswith("_wrist")}
    own = {link: frames[body.model.getFrameId(link, pin.FrameType.BODY)].parentFrame for link in wrists}
    return tuple(sorted(link for link, joint in own.items() if frames[joint].type == pin.FrameType.FIXED_JOINT))


class RoundPieces(NamedTuple):
    """Balls and ellipsoids, P of them, whose lowest points have a closed form.

    joint, column (P,): the joint of each, and the last column of the spatial Jacobian that moves it. centre (P, 3) and
    half_axes (P, 3, 3), one a row, in the joint's frame [m].
    """

    joint: np.ndarray
    column: np.ndarray
    centre: np.ndarray
    half_axes: np.ndarray


class FloorDistances:
    """Signed distances of a body's solids to the half-space normal . x <= height.

    A capsule counts with both of its ends, so that one which lies has two contacts. Solids that no joint moves are left
    out, and hands that the subject holds stiffly on the forearms: a real wrist bends, so that a person whose hands are
    on the floor would have to lift the forearms. One object serves one thread: it reuses coal's queries.

    normal (3,): unit vector in the world, upwards. height [m]: along it. margin [m]: below which a part is near.
    round_pieces: the solids, None where one is neither a capsule nor a ball nor an ellipsoid, and coal measures all.
    """

    def __init__(self, body: Body, normal: np.ndarray, height: float, margin: float = 0.02) -> None:
        self.margin = margin
        self.body, self.normal, self.height = body, np.asarray(normal, float), float(height)
        stiff = stiff_hands(body)
        counted = [solid for solid in solids_of(body) if solid.joint > 0 and solid.link not in stiff]
        pieces = [piece for solid in counted for piece in _pieces(solid)]
        self._joint = np.array([piece.joint for piece in pieces], dtype=np.int64)
        columns = body.last_columns(self._joint)
        self._columns = np.stack((np.full_like(columns, -1), columns), axis=1)  # none moves the floor
        self._local = np.array([piece.place for piece in pieces]).reshape(-1, 3)
        self._rotation = [piece.rotation for piece in pieces]
        self._reach = np.array([piece.reach for piece in pieces])
        self.round_pieces = _round_pieces(pieces, self._columns[:, 1])
        half_space, self._still = coal.Halfspace(self.normal, self.height), coal.Transform3s()
        self._queries = [coal.ComputeDistance(piece.geometry, half_space) for piece in pieces]
        self._kept = [piece.geometry for piece in pieces], half_space  # the queries hold no references of their own
        self._place, self._request, self._result = coal.Transform3s(), coal.DistanceRequest(), coal.DistanceResult()

    def near(self, posed: PosedBody, margin: float | None = None) -> Distances:
        """Every part whose signed distance is below the margin [m], by default the constructor's."""
        index, distance, point = self._measure(posed.placements, self.margin if margin is None else margin)
        rows = witness.gradients(
            posed.spatial_jacobian, self.body.tree.column_parent, self._columns[index], point, point,
            np.tile(self.normal, (len(index), 1)),
        )  # fmt: skip
        return Distances(distance, self.body.collected(rows))

    def distances(self, placed: PlacedBodies, margin: float = np.inf) -> list[np.ndarray]:
        """The signed distances below a margin [m] of each of N poses."""
        return [self._measure(placements, margin)[1] for placements in placed.placements]

    def lowest(self, placed: PlacedBodies) -> np.ndarray:
        """Height (N,) [m] of the lowest part of each of N poses above the floor; infinite without any part."""
        return np.array([distance.min(initial=np.inf) for distance in self.distances(placed)])

    def penetration(self, posed: PosedBody) -> float:
        """Depth of the lowest part below the floor [m], 0 if none is."""
        return max(0.0, -float(self.distances(posed.alone, 0.0)[0].min(initial=0.0)))

    def _measure(self, placements: np.ndarray, margin: float) -> tuple[list[int], np.ndarray, np.ndarray]:
        """Which pieces are below the margin, their distances (M,) and lowest points (M, 3).

        placements (njoints, 12): see `PosedBody`.
        """
        if self.round_pieces is None:
            return self._measure_by_coal(placements, margin)
        joint, _, centre, half_axes = self.round_pieces
        distances, points = np.empty(len(joint)), np.empty((len(joint), 3))
        lowest_points(placements, joint, centre, half_axes, self.normal, self.height, distances, points)
        near = np.flatnonzero(distances < margin)
        return near.tolist(), distances[near], points[near]

    def _measure_by_coal(self, placements: np.ndarray, margin: float) -> tuple[list[int], np.ndarray, np.ndarray]:
        """See `_measure`."""
        index, distances, points = [], [], []
        axes = placements[:, :9].reshape(-1, 3, 3)  # the rotations' columns as rows
        along = np.column_stack([axes @ self.normal, placements[:, 9:] @ self.normal])[self._joint]
        heights = (along[:, :3] * self._local).sum(axis=1) + along[:, 3]  # of the pieces' origins
        for i in np.flatnonzero(heights - self.height - self._reach < margin).tolist():
            R = axes[self._joint[i]].T
            self._place.setRotation(R @ self._rotation[i])
            self._place.setTranslation(R @ self._local[i] + placements[self._joint[i], 9:])
            self._result.clear()
            distance = self._queries[i](self._place, self._still, self._request, self._result)
            if distance < margin:
                index.append(i)
                distances.append(distance)
                points.append(self._result.getNearestPoint1().copy())
        return index, np.array(distances), np.array(points).reshape(-1, 3)


class _Piece(NamedTuple):
    """A shape of one joint: rotation (3, 3) and place (3,) [m] in the joint's frame; reach [m]: of its farthest point
    from there."""

    joint: int
    geometry: Any
    rotation: np.ndarray
    place: np.ndarray
    reach: float


def _pieces(solid: ConvexSolid) -> list[_Piece]:
    """A solid, or a capsule's ends."""
    R, t = solid.rotation, solid.translation
    if not isinstance(solid.geometry, coal.Capsule):
        reach = float(np.linalg.norm(solid.core_centre) + np.linalg.norm(solid.core_half) + solid.core_radius)
        return [_Piece(solid.joint, solid.geometry, R, t, reach)]
    ball = coal.Sphere(solid.core_radius)
    ends = (t + R @ (solid.core_centre + sign * solid.core_half) for sign in (-1.0, 1.0))
    return [_Piece(solid.joint, ball, np.eye(3), end, solid.core_radius) for end in ends]


def _round_pieces(pieces: list[_Piece], column: np.ndarray) -> RoundPieces | None:
    if not all(isinstance(piece.geometry, (coal.Sphere, coal.Ellipsoid)) for piece in pieces):
        return None
    joint, half_axes = np.array([piece.joint for piece in pieces], dtype=np.int64), np.zeros((len(pieces), 3, 3))
    for piece, rows in zip(pieces, half_axes, strict=True):
        shape = piece.geometry
        radii = np.full(3, shape.radius) if isinstance(shape, coal.Sphere) else np.array(shape.radii)
        rows[:] = radii[:, None] * piece.rotation.T
    return RoundPieces(joint, column.copy(), np.array([piece.place for piece in pieces]).reshape(-1, 3), half_axes)


@jit
def lowest_point(placement, centre, half_axes, normal, point):  # type: ignore[no-untyped-def]
    """Height of the lowest point of an ellipsoid along `normal` (3,) [m]; fills point (3,) with it in the world.

    placement (12,): of its joint, see `PosedBody`. centre (3,), half_axes (3, 3): see `RoundPieces`.
    """
    M, size = placement, 0.0
    x, along = np.empty(3), np.empty(3)
    for r in range(3):
        along[r] = 0.0
        for k in range(3):
            turned = M[3 * k] * normal[0] + M[3 * k + 1] * normal[1] + M[3 * k + 2] * normal[2]
            along[r] += half_axes[r, k] * turned
        size += along[r] * along[r]
    size = np.sqrt(size)
    for k in range(3):
        x[k] = centre[k]
        if size > 0.0:
            x[k] -= (half_axes[0, k] * along[0] + half_axes[1, k] * along[1] + half_axes[2, k] * along[2]) / size
    height = 0.0
    for k in range(3):
        point[k] = M[9 + k] + M[k] * x[0] + M[3 + k] * x[1] + M[6 + k] * x[2]
        height += normal[k] * point[k]
    return height


@jit
def lowest_points(placements, joint, centre, half_axes, normal, height, distances, points):  # type: ignore[no-untyped-def]
    """Fill distances (P,) to the floor, points (P, 3) with the lowest ones; placements (njoints, 12), normal (3,),
    joint (P,), centre (P, 3), half_axes (P, 3, 3): see `RoundPieces`."""
    for i in range(joint.shape[0]):
        distances[i] = lowest_point(placements[joint[i]], centre[i], half_axes[i], normal, points[i]) - height
