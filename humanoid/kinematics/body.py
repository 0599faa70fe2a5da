"""Kinematics of a subject: q -> PosedBody, by Pinocchio."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from humanoid.kinematics.compiled_tree import CompiledTree, clamp_limits, compiled_tree
from humanoid.kinematics.placements import columns_of, kinematics_of
from humanoid.subject.joint_names import JointPlace, joint_place, q_names, v_names
from humanoid.subject.subject import Subject
from humanoid.support.compiled import jit
from humanoid.support.summary import Facts, Summarised

_LEAST_EXTENT = 0.05  # m
SHORTEST_STEP = 1e-3
"""[s] Frames nearer in time count as this far apart: no clip has more frames a second than 1000, but equal time stamps
occur, and a velocity must stay finite."""
_BATCH = 256  # configurations
ROOT_JOINT = 1
"""Pinocchio's joint of a free root."""
ROOT_Q, ROOT_PLACE_Q, ROOT_TURN_Q = slice(0, 7), slice(0, 3), slice(3, 7)
"""Entries of a free root in q: all of it, its place [m], its quaternion xyzw."""
ROOT_V, ROOT_PLACE_V, ROOT_TURN_V = slice(0, 6), slice(0, 3), slice(3, 6)
"""Entries of a free root in the tangent space: all of it, its linear and its angular part."""


class PosedBody(NamedTuple):
    """The body at one configuration: proof that kinematics has been run.

    q (nq,): configuration, Pinocchio order.
    placements (njoints, 12): T_world_joint of every joint: the rotation column by column, then the translation [m].
    spatial_jacobian (nc, 6): column of each degree of freedom of the spatial Jacobian in the world frame, as a row:
        (linear at the world origin, angular); a point p fixed to the body moves with linear + angular x p. Joints that
        follow others have columns of their own, per unit of the degree of freedom they follow: see `Tree`. Without such
        joints nc = nv.
    """

    q: np.ndarray
    placements: np.ndarray
    spatial_jacobian: np.ndarray

    @property
    def rotations(self) -> np.ndarray:
        """Rotation of T_world_joint, (njoints, 3, 3)."""
        return self.placements[:, :9].reshape(-1, 3, 3).transpose(0, 2, 1)

    @property
    def translations(self) -> np.ndarray:
        """Translation of T_world_joint [m], (njoints, 3)."""
        return self.placements[:, 9:]

    @property
    def alone(self) -> PlacedBodies:
        """This configuration as one of many."""
        return PlacedBodies(self.q[None], self.placements[None])


def batches(q: np.ndarray) -> list[np.ndarray]:
    """Configurations (N, nq) in parts, at least one, for callers that need many numbers of each."""
    return np.array_split(q, max(1, -(-len(q) // _BATCH)))


class PlacedBodies(NamedTuple):
    """The body at N configurations, without derivatives.

    q (N, nq): configurations. placements (N, njoints, 12): as those of `PosedBody`.
    """

    q: np.ndarray
    placements: np.ndarray

    def of(self, rows: np.ndarray | slice) -> PlacedBodies:
        """The selected ones: an index of rows."""
        return PlacedBodies(self.q[rows], self.placements[rows])

    def rotations_of(self, joint: int) -> np.ndarray:
        """Rotation of a joint's T_world_joint, (N, 3, 3)."""
        return self.placements[:, joint, :9].reshape(-1, 3, 3).transpose(0, 2, 1)


@dataclass(frozen=True)
class Tree:
    """The kinematic tree as plain arrays, for compiled kernels.

    joint_parent (njoints,): parent joint, the universe being joint 0.
    dof_joint (nv,): joint of each degree of freedom.
    dof_parent (nv,): the degree of freedom before it on the way to the root, -1 at the root; within a joint of
        several degrees of freedom the previous one.
    column_joint, column_parent (nc,): the same of the columns of the spatial Jacobian, one for each degree of freedom
        and one for each joint that follows another, parents first.
    column_dof (nc,): the degree of freedom that drives each column. What moves with several columns moves with their
        sum: `Body.collected`.
    dof_column (nv,): the column of the joint that a degree of freedom is named after.
    """

    joint_parent: np.ndarray
    dof_joint: np.ndarray
    dof_parent: np.ndarray
    column_joint: np.ndarray
    column_parent: np.ndarray
    column_dof: np.ndarray
    dof_column: np.ndarray


def _tree(model: pin.Model) -> Tree:
    joint_parent = np.array(list(model.parents), dtype=np.int64)
    column_joint = np.zeros(model.nvExtended, dtype=np.int64)
    column_parent = np.full(model.nvExtended, -1, dtype=np.int64)
    column_dof, dof_column = np.zeros(model.nvExtended, dtype=np.int64), np.zeros(model.nv, dtype=np.int64)
    last_column = np.full(model.njoints, -1, dtype=np.int64)
    for j in range(1, model.njoints):
        previous = last_column[joint_parent[j]]
        for i, k in enumerate(columns_of(model, j)):
            column_joint[k], column_parent[k], column_dof[k] = j, previous, model.idx_vs[j] + i
            if model.nvs[j] > 0:
                dof_column[model.idx_vs[j] + i] = k
            previous = k
        last_column[j] = previous
    parent = column_parent[dof_column]
    dof_parent = np.where(parent >= 0, column_dof[parent], -1)
    return Tree(joint_parent, column_joint[dof_column], dof_parent, column_joint, column_parent, column_dof, dof_column)


def _supports(model: pin.Model) -> np.ndarray:
    """Which columns of the spatial Jacobian move each joint, (njoints, nc) bool."""
    moved = np.zeros((model.njoints, model.nvExtended), dtype=bool)
    for j in range(1, model.njoints):
        moved[j] = moved[model.parents[j]]
        moved[j, columns_of(model, j)] = True
    return moved


class Body(Summarised):
    """A subject's kinematics on plain arrays.

    Attributes
    ----------
    subject, model: where it comes from.
    nq, nv: sizes of configuration and tangent.
    has_free_root: whether q and the tangent begin with a root, see `ROOT_Q` and `ROOT_V`. first_joint_dof: the first
    degree of freedom after the root's.
    tree: see `Tree`.
    landmark_names (L), landmark_joint (L,), landmark_local (L, 3): points in the frames of their joints [m].
    landmark_support (L, nv) bool: which degrees of freedom move each landmark.
    keypoint_local (L, 3), keypoint_std (L,): where in the same frames detectors mark the landmarks, and the standard
    deviation of that [m], NaN where unknown, see `humanoid.subject.urdf_elements.Landmark`.
    marker_names (M), marker_joint (M,), marker_local (M, 3), marker_std (M,): the same of markers, and the standard
    deviations of their places [m].
    zero_std (nv,): standard deviation of each degree of freedom's common error in all frames [rad, m], NaN where the
    subject does not give it (`humanoid.subject.urdf_elements.Zero`).
    column_support (njoints, nc) bool: which columns of the spatial Jacobian move each joint. follows: whether joints
    follow others, so that nc > nv.
    lower, upper (nq,): hard limits of q (infinite where there are none).
    neutral (nq,): root at the origin, joints at their means, inside the limits.
    bounded_v, bounded_q: the degrees of freedom with limits and their places in q.
    """

    def __init__(self, subject: Subject, model: pin.Model | None = None) -> None:
        self.subject = subject
        self.model = model = subject.model if model is None else model
        self.nq, self.nv, self.njoints = model.nq, model.nv, model.njoints
        self.has_free_root = subject.base == "free"
        self.first_joint_dof = ROOT_V.stop if self.has_free_root else 0
        self.tree = _tree(model)
        self.landmark_names = tuple(landmark.name for landmark in subject.landmarks)
        self.landmark_joint, self.landmark_local = points_on_links(
            model, [(landmark.link, landmark.xyz) for landmark in subject.landmarks]
        )
        self.keypoint_local = points_on_links(
            model, [(m.link, tuple(np.add(m.xyz, m.keypoint).tolist())) for m in subject.landmarks]
        )[1]
        self.keypoint_std = np.array([np.nan if m.keypoint_std is None else m.keypoint_std for m in subject.landmarks])
        self.marker_names = tuple(marker.name for marker in subject.markers)
        self.marker_std = np.array([marker.std for marker in subject.markers])
        self.marker_joint, self.marker_local = points_on_links(
            model, [(marker.link, marker.xyz) for marker in subject.markers]
        )
        zeros = {zero.name: zero.std for zero in subject.zeros}
        self.zero_std = np.array([zeros.get(name, np.nan) for name in v_names(model)])
        self.column_support = _supports(model)
        more = set(range(model.nvExtended)) - set(self.tree.dof_column.tolist())
        self._more_columns = [(k, int(self.tree.column_dof[k])) for k in sorted(more)]
        self.follows = bool(more)
        self._support = self.collected(self.column_support)
        self.landmark_support = self._support[self.landmark_joint]
        self._limits(model)
        self._kinematics = kinematics_of(model)
        self.neutral = self._rest()

    def _limits(self, model: pin.Model) -> None:
        lower, upper = model.lowerPositionLimit.copy(), model.upperPositionLimit.copy()
        bounded = [(model.idx_vs[j], model.idx_qs[j]) for j in range(1, model.njoints) if model.nqs[j] == 1]
        bounded = [(v, q) for v, q in bounded if np.isfinite(lower[q]) and np.isfinite(upper[q])]
        self.bounded_v = np.array([v for v, _ in bounded], dtype=np.int64)
        self.bounded_q = np.array([q for _, q in bounded], dtype=np.int64)
        self.lower, self.upper = np.full(model.nq, -np.inf), np.full(model.nq, np.inf)
        self.lower[self.bounded_q] = lower[self.bounded_q]
        self.upper[self.bounded_q] = upper[self.bounded_q]

    def _rest(self) -> np.ndarray:
        """Neutral configuration with the stabilisers' joints at their means, inside the limits."""
        q = pin.neutral(self.model)
        for stabiliser in self.subject.stabilisers:
            if self.model.existJointName(stabiliser.joint):
                q[self.model.idx_qs[self.model.getJointId(stabiliser.joint)]] = stabiliser.moments[0]
        return self.clamp(q)

    @cached_property
    def compiled(self) -> CompiledTree | None:
        """The joints for compiled loops, see `compiled_tree`; None where these cannot have them."""
        return compiled_tree(self.model, self.bounded_q, self.lower, self.upper)

    @cached_property
    def extent(self) -> float:
        """Root mean square distance [m] of the landmarks from their centre, seen from the front with the body in its
        neutral pose: the counterpart of the extent of keypoints in a picture."""
        if not self.landmark_names:
            return _LEAST_EXTENT
        points = self.landmarks(self.at(self.neutral))[:, 1:]
        return max(float(np.sqrt(np.square(points - points.mean(axis=0)).sum(axis=1).mean())), _LEAST_EXTENT)

    def at(self, q: np.ndarray) -> PosedBody:
        """Forward kinematics and joint Jacobians at q (nq,); the result owns its arrays."""
        return PosedBody(q, *self._kinematics.at(q))

    def placed(self, q: np.ndarray) -> PlacedBodies:
        """Forward kinematics alone at q (N, nq): the placements of `at`, to the last bit."""
        q = np.require(q, requirements="W")  # kernels are compiled once more for read-only arrays
        return PlacedBodies(q, self._kinematics.placed(q))

    def spatial_jacobians(self, q: np.ndarray) -> np.ndarray:
        """The spatial Jacobians (N, nc, 6) of `at`, to the last bit, at q (N, nq)."""
        return self._kinematics.columns(q)

    def integrate(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """q (+) v on the configuration manifold, (nq,); angles are kept inside the limits to the last bit."""
        return self.clamp(pin.integrate(self.model, q, v))

    def integrated(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """`integrate` of many: q (N, nq) (+) v (N, nv), (N, nq)."""
        if self.nq == self.nv:  # joints of one degree of freedom alone, to which it is added
            moved = q + v
        else:
            moved = np.empty_like(q)
            for row, each, step in zip(moved, q, v, strict=True):
                row[:] = pin.integrate(self.model, each, step)
        _clamp_each(moved, self.bounded_q, self.lower, self.upper)
        return moved

    def interpolated(self, q0: np.ndarray, q1: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Configurations (N, nq) at shares (N,) of the shortest ways from q0 to q1 (N, nq), within the limits."""
        return np.array(
            [self.clamp(pin.interpolate(self.model, a, b, s)) for a, b, s in zip(q0, q1, share, strict=True)]
        ).reshape(-1, self.nq)

    def differences(self, q0: np.ndarray, q: np.ndarray) -> np.ndarray:
        """`difference` to many: tangents (N, nv) at q0 (nq,) to q (N, nq)."""
        tangents = np.empty((len(q), self.nv))
        for row, each in zip(tangents, q, strict=True):
            row[:] = pin.difference(self.model, q0, each)
        return tangents

    def velocity(self, q0: np.ndarray, q1: np.ndarray, dt: float) -> np.ndarray:
        """Tangent velocity (nv,) [1/s] that leads from q0 to q1 (nq,) in `dt` [s], see `SHORTEST_STEP`."""
        return self.difference(q0, q1) / max(dt, SHORTEST_STEP)

    def difference(self, q0: np.ndarray, q1: np.ndarray) -> np.ndarray:
        """Tangent v (nv,) at q0 with q0 (+) v = q1."""
        return pin.difference(self.model, q0, q1)

    def clamp(self, q: np.ndarray) -> np.ndarray:
        """q with its bounded joints moved into their limits, and onto them from within rounding; quaternions stay."""
        q = q.copy()
        clamp_limits(q, self.bounded_q, self.lower, self.upper)
        return q

    def tangent_bounds(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bounds (nv,), (nv,) on a step from q; infinite where a degree of freedom has no limit."""
        low, high = np.full(self.nv, -np.inf), np.full(self.nv, np.inf)
        low[self.bounded_v] = self.lower[self.bounded_q] - q[self.bounded_q]
        high[self.bounded_v] = self.upper[self.bounded_q] - q[self.bounded_q]
        return low, high

    def landmarks(self, posed: PosedBody) -> np.ndarray:
        """Landmarks in the world [m], (L, 3)."""
        return points_in_world(posed, self.landmark_joint, self.landmark_local)

    def keypoints(self, posed: PosedBody) -> np.ndarray:
        """Places (L, 3) [m] where detectors mark the landmarks, in the world."""
        return points_in_world(posed, self.landmark_joint, self.keypoint_local)

    def landmarks_of(self, placed: PlacedBodies) -> np.ndarray:
        """Landmarks of N configurations in the world [m], (N, L, 3); each as `landmarks` has them, to the last bit."""
        return points_of_each(placed, self.landmark_joint, self.landmark_local)

    def markers_of(self, placed: PlacedBodies) -> np.ndarray:
        """Places of the markers of N configurations in the world [m], (N, M, 3)."""
        return points_of_each(placed, self.marker_joint, self.marker_local)

    def landmarks_beside(self, measured: np.ndarray) -> np.ndarray:
        """Which landmarks (..., L) have on their joint one of the markers that are measured (..., M) bool."""
        same = self.marker_joint[:, None] == self.landmark_joint
        return np.asarray((measured[..., None] & same).any(axis=-2))

    def landmark_jacobians(self, posed: PosedBody, some: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Derivative of every landmark [m per unit of v], or of some by their numbers, world frame, (L, 3, nv)."""
        return self.point_jacobians(posed, self.landmark_joint[some], self.landmarks(posed)[some])

    def point_jacobians(self, posed: PosedBody, joints: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Derivative [m per unit of v] of points (N, 3) in the world [m] that are fixed to joints (N,), world frame,
        (N, 3, nv)."""
        vx, vy, vz, wx, wy, wz = posed.spatial_jacobian.T
        x, y, z = points.T[:, :, None]
        velocity = np.stack([vx + (wy * z - wz * y), vy + (wz * x - wx * z), vz + (wx * y - wy * x)], axis=1)
        return self.collected(np.where(self.column_support[joints][:, None, :], velocity, 0.0))

    def collected(self, columns: np.ndarray) -> np.ndarray:
        """Values of the columns of the spatial Jacobian (..., nc), summed by degree of freedom, (..., nv); for booleans
        whether any is true. Unchanged where no joint follows another."""
        if not self.follows:
            return columns
        first = self.tree.dof_column
        out = columns[..., first].copy()
        for k, dof in self._more_columns:
            out[..., dof] += columns[..., k]
        return out

    def collected_hessian(self, hessian: np.ndarray) -> np.ndarray:
        """A Hessian by the columns (nc, nc) as one by degrees of freedom (nv, nv)."""
        return self.collected(self.collected(hessian).T).T

    def dof_jacobian(self, posed: PosedBody) -> np.ndarray:
        """The columns of the joints that the degrees of freedom are named after, (nv, 6): their axes."""
        return posed.spatial_jacobian[self.tree.dof_column] if self.follows else posed.spatial_jacobian

    def drives_several(self, dof: int) -> bool:
        """Whether other joints follow a degree of freedom, so that no single axis describes its motion."""
        return int(np.count_nonzero(self.tree.column_dof == dof)) > 1

    def last_columns(self, joints: np.ndarray) -> np.ndarray:
        """Last column of the spatial Jacobian on the way from the root to (and with) each joint (N,), -1 if none."""
        last = [columns_of(self.model, joint)[-1] if joint > 0 else -1 for joint in joints.tolist()]
        return np.array(last, dtype=np.int64)

    def support(self, joint: int) -> np.ndarray:
        """Which degrees of freedom move a joint, (nv,) bool."""
        return self._support[joint].copy()

    def __reduce__(self) -> tuple[Any, ...]:
        """Rebuilt when it is sent to another process: its views refer to this process' memory."""
        if not self.follows:
            return Body, (self.subject, self.model)
        model = self.model  # Pinocchio cannot send it; it differs from the subject's by lengths and limits alone
        placements = np.array([placement.homogeneous for placement in model.jointPlacements])
        return _remade, (self.subject, placements, model.lowerPositionLimit, model.upperPositionLimit)

    @property
    def q_names(self) -> tuple[str, ...]:
        """A name for each entry of q, see `humanoid.subject.joint_names`."""
        return q_names(self.model)

    @property
    def v_names(self) -> tuple[str, ...]:
        """A name for every degree of freedom (nv), see `humanoid.subject.joint_names`."""
        return v_names(self.model)

    def _called(self) -> str:
        return self.subject.name

    def _facts(self) -> Facts:
        root = "free" if self.has_free_root else "fixed"
        facts = [("degrees of freedom", self.nv), ("root", root), ("joints with limits", len(self.bounded_q))]
        return [*facts, ("landmarks", len(self.landmark_names))]

    def place(self, joint: str) -> JointPlace:
        """Entries of a joint in q and in the tangent space; see `joint_place`, for the InputError too."""
        return joint_place(self.model, joint)


def _remade(subject: Subject, placements: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> Body:
    model = pin.Model(subject.model)
    for j, placement in enumerate(placements):
        model.jointPlacements[j] = pin.SE3(placement)
    model.lowerPositionLimit, model.upperPositionLimit = lower, upper
    return Body(subject, model)


@jit
def _place_points(placements, joints, local, points):  # type: ignore[no-untyped-def]
    """Fill points (N, P, 3) in the world, of local (P, 3) on joints (P,), for placements (N, njoints, 12)."""
    for n in range(placements.shape[0]):
        for i in range(joints.shape[0]):
            M, x = placements[n, joints[i]], local[i]
            for k in range(3):
                points[n, i, k] = (M[k] * x[0] + M[3 + k] * x[1] + M[6 + k] * x[2]) + M[9 + k]


@jit
def _clamp_each(q, bounded_q, lower, upper):  # type: ignore[no-untyped-def]
    """`clamp_limits` of q (N, nq), bounded_q (B,), lower, upper (nq,)."""
    for n in range(q.shape[0]):
        clamp_limits(q[n], bounded_q, lower, upper)


def points_on_links(
    model: pin.Model, points: list[tuple[str, tuple[float, float, float]]]
) -> tuple[np.ndarray, np.ndarray]:
    """Points given on links -> their joints (N,) and places in those joints' frames (N, 3)."""
    joints = np.zeros(len(points), dtype=np.int64)
    local = np.zeros((len(points), 3))
    for i, (link, xyz) in enumerate(points):
        frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
        joints[i] = frame.parentJoint
        local[i] = frame.placement.act(np.array(xyz))
    return joints, local


def points_in_world(posed: PosedBody, joints: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Points fixed to joints, in the world [m], (N, 3)."""
    points = np.empty((1, *local.shape))
    _place_points(posed.placements[None], joints, local, points)
    return points[0]


def points_of_each(placed: PlacedBodies, joints: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Points (P, 3) fixed to joints (P,), in the world [m], (N, P, 3), of N configurations; each as `points_in_world`
    has them, to the last bit."""
    points = np.empty((len(placed.q), *local.shape))
    _place_points(placed.placements, joints, local, points)
    return points


def directions_in_world(posed: PosedBody, joints: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Directions fixed to joints, such as normals, in the world, (N, 3)."""
    return np.einsum("nij,nj->ni", posed.rotations[joints], local)
