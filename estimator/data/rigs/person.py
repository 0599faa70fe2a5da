"""The person as a body in place of free points: its pose at every instant, its proportions, and where a detector marks
its joints.

A body bends as its joints do and keeps within their limits; that constrains the cameras' places more than lengths
alone. Poses are eliminated instant by instant (the Schur complement of Triggs et al., Bundle adjustment - a modern
synthesis, 2000, section 6.1): what is left is as large as cameras, proportions and marks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.data.rigs.bundle import BIAS, RigRays, RigState, bent, by_place, by_radial, robust_cost, robust_weights
from estimator.data.rigs.lengths import SegmentLengths
from humanoid.kinematics.proportions import ProportionedBody

_MARKS = 0.03  # m: how far from a landmark a detector marks it, in its link
_NEAREST = 0.05  # m: least depth of a point


@dataclass(frozen=True)
class FilmedBody:
    """The adjusted state. rig: cameras and lenses. q (T, nq): poses in the rig's frame. scales (P,): of the
    proportions. marks (J, 3) [m]: from landmarks to where they are marked, in the frames of their links."""

    rig: RigState
    q: np.ndarray
    scales: np.ndarray
    marks: np.ndarray


class PersonSystem(NamedTuple):
    """Gauss and Newton's: of what is common A (S, S), g (S,), of poses H (T, nv, nv), h (T, nv), both B (T, S, nv)."""

    A: np.ndarray
    g: np.ndarray
    H: np.ndarray
    h: np.ndarray
    B: np.ndarray


class PersonProblem:
    """Residuals of rays by a body's poses and what all instants have in common: turns and shifts of the cameras but the
    first (6 each), of lenses that are not known the logarithms of focal lengths, and radial terms, scales and marks."""

    def __init__(self, body: ProportionedBody, seen: RigRays, lengths: SegmentLengths) -> None:
        self._body, self._seen, self._lengths, self._landmark = body, seen, lengths, lengths.landmark
        self._joint = body.base.landmark_joint[lengths.landmark]
        self._known = np.isfinite(seen.rays).all(axis=3)
        cameras, joints = seen.std.shape
        self._focal, self._radial = (np.flatnonzero(std > 0.0) for std in (seen.focal_std, seen.radial_std))
        sizes = [6 * (cameras - 1), len(self._focal), len(self._radial), len(body.mean), 3 * joints]
        self._at = np.cumsum([0, *sizes])
        base = body.base
        resting = [s for s in base.subject.stabilisers if base.model.existJointName(s.joint)]
        joint = [base.model.getJointId(s.joint) for s in resting]
        self._rest_q = np.array([base.model.idx_qs[j] for j in joint], dtype=np.int64)
        self._rest_v = np.array([base.model.idx_vs[j] for j in joint], dtype=np.int64)
        moments = np.array([s.moments for s in resting]).reshape(-1, 2)
        self._rest, self._rest_std = moments.T

    def cost(self, at: FilmedBody) -> float:
        """Half the sum of robust squares of rays, and of squares of what is known besides."""
        return self._evaluated(at, derivatives=False)[0]

    def system(self, at: FilmedBody) -> PersonSystem:
        """The normal equations."""
        return self._evaluated(at, derivatives=True)[1]

    def moved(self, at: FilmedBody, common: np.ndarray, poses: np.ndarray) -> FilmedBody:
        """The state after a step of the common unknowns (S,) and of the poses (T, nv)."""
        rig, base = at.rig, self._body.base
        moves = common[: self._at[1]].reshape(-1, 6)
        R, t, focal, radial = rig.R.copy(), rig.t.copy(), rig.focal.copy(), rig.radial.copy()
        for c, move in enumerate(moves, start=1):
            R[c], t[c] = pin.exp3(move[:3]) @ R[c], t[c] + move[3:]
        focal[self._focal] *= np.exp(common[self._at[1] : self._at[2]])
        radial[self._radial] += common[self._at[2] : self._at[3]]
        scales = np.clip(at.scales + common[self._at[3] : self._at[4]], self._body.low, self._body.high)
        marks = at.marks + common[self._at[4] :].reshape(-1, 3)
        q = np.array([base.integrate(pose, step) for pose, step in zip(at.q, poses, strict=True)])
        return FilmedBody(replace(rig, R=R, t=t, focal=focal, radial=radial), q, scales, marks)

    def points(self, at: FilmedBody) -> np.ndarray:
        """The places where joints are marked (T, J, 3), in the rig's frame."""
        return self._placed(at, derivatives=False)[0]

    def _placed(self, at: FilmedBody, *, derivatives: bool) -> tuple[np.ndarray, ...]:
        """Marks (T, J, 3); their derivatives by poses (T, J, 3, nv), by scales (T, J, 3, P); turns of links."""
        body, some = self._body.at(at.scales), self._landmark
        body.landmark_local = body.landmark_local.copy()
        body.landmark_local[some] += at.marks
        points, by_pose, by_scale, turns = [], [], [], []
        for q in at.q:
            posed = body.at(q)
            points.append(body.landmarks(posed)[some])
            if derivatives:
                turns.append(posed.rotations[self._joint])
                by_pose.append(body.landmark_jacobians(posed, some))
                by_scale.append(self._body.landmark_derivatives(posed)[some])
        return tuple(np.array(part) for part in (points, by_pose, by_scale, turns))

    def _evaluated(self, at: FilmedBody, *, derivatives: bool) -> tuple[float, PersonSystem]:
        points, *by = self._placed(at, derivatives=derivatives)
        cost, system = self._known_besides(at)
        for c in range(len(self._seen.rays)):
            off, depth, seen = self._off(at, points, c)
            cost += robust_cost(off[self._known[c]])
            if derivatives:
                weight = np.where(self._known[c][..., None], robust_weights(off), 0.0)
                by_common, by_pose = self._ray_derivatives(at, c, seen, depth, *by)
                self._add(system, weight, off, by_common, by_pose)
        return cost, system

    def _off(self, at: FilmedBody, points: np.ndarray, c: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residuals (T, J, 2), 0 of what is not seen; depths (T, J) and places (T, J, 3) in the camera."""
        place = points @ at.rig.R[c].T + at.rig.t[c]
        depth = np.maximum(place[..., 2], _NEAREST)
        flat = bent(place[..., :2] / depth[..., None], at.rig.focal[c], at.rig.radial[c])
        return np.nan_to_num((flat - self._seen.rays[c]) / self._seen.std[c][:, None]), depth, place

    def _ray_derivatives(
        self, at: FilmedBody, c: int, place: np.ndarray, depth: np.ndarray, by_pose: np.ndarray, by_scale: np.ndarray,
        turns: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Derivatives of a camera's residuals by the common unknowns (T, J, 2, S) and by poses (T, J, 2, nv)."""
        rig, std = at.rig, self._seen.std[c][:, None]
        flat, focal, radial = place[..., :2] / depth[..., None], rig.focal[c], rig.radial[c]
        of_flat = by_place(flat, focal, radial) / (depth[..., None] * std)[..., None]
        of_place = np.concatenate([of_flat, -(of_flat @ flat[..., None])], axis=-1)
        by_world = of_place @ rig.R[c]
        common = np.zeros((*place.shape[:2], 2, self._at[-1]))
        if c > 0:
            own = 6 * (c - 1)
            turned = place - rig.t[c]
            common[..., own : own + 3] = np.cross(turned[:, :, None], of_place)
            common[..., own + 3 : own + 6] = of_place
        if c in self._focal:
            column = self._at[1] + int(np.searchsorted(self._focal, c))
            common[..., column] = bent(flat, focal, radial) / std
        if c in self._radial:
            column = self._at[2] + int(np.searchsorted(self._radial, c))
            common[..., column] = by_radial(flat, focal) / std
        common[..., self._at[3] : self._at[4]] = by_world @ by_scale
        by_mark = by_world @ turns
        for j in range(by_mark.shape[1]):
            first = self._at[4] + 3 * j
            common[:, j, :, first : first + 3] = by_mark[:, j]
        return common, by_world @ by_pose

    @staticmethod
    def _add(system: PersonSystem, weight: np.ndarray, off: np.ndarray, common: np.ndarray, poses: np.ndarray) -> None:
        T = len(off)
        S, w, r = common.reshape(T, -1, common.shape[-1]), weight.reshape(T, -1), off.reshape(T, -1)
        P = poses.reshape(T, -1, poses.shape[-1])
        weighted, of_poses = S * w[..., None], np.swapaxes(P, 1, 2)
        flat = S.reshape(-1, S.shape[-1])
        system.A[:] += flat.T @ weighted.reshape(flat.shape)
        system.g[:] += np.einsum("tns,tn->s", weighted, r)
        system.H[:] += of_poses @ (P * w[..., None])
        system.h[:] += np.einsum("tnv,tn->tv", P, w * r)
        system.B[:] += np.swapaxes(weighted, 1, 2) @ P

    def _known_besides(self, at: FilmedBody) -> tuple[float, PersonSystem]:
        """Energy and system of lenses, scales, marks and rest positions."""
        T, nv, S = len(at.q), self._body.base.nv, int(self._at[-1])
        system = PersonSystem(
            np.zeros((S, S)), np.zeros(S), np.zeros((T, nv, nv)), np.zeros((T, nv)), np.zeros((T, S, nv))
        )
        off = np.concatenate([
            np.log(at.rig.focal[self._focal]) / self._seen.focal_std[self._focal],
            at.rig.radial[self._radial] / self._seen.radial_std[self._radial],
            (at.scales - self._body.mean) / self._body.std, at.marks.ravel() / _MARKS,
        ])  # fmt: skip
        slope = np.concatenate([
            1.0 / self._seen.focal_std[self._focal], 1.0 / self._seen.radial_std[self._radial],
            1.0 / self._body.std, np.full(at.marks.size, 1.0 / _MARKS),
        ])  # fmt: skip
        own = np.arange(self._at[1], S)
        system.A[own, own] += slope**2
        system.g[own] += slope * off
        cost = 0.5 * float(off @ off) + self._add_joints(at.q, system)
        return cost, system

    def _add_joints(self, q: np.ndarray, system: PersonSystem) -> float:
        rest = (q[:, self._rest_q] - self._rest) / self._rest_std
        diagonal = np.einsum("tvv->tv", system.H)
        diagonal[:, self._rest_v] += self._rest_std**-2.0
        system.h[:, self._rest_v] += rest / self._rest_std
        return float(0.5 * np.square(rest).sum())

    def held(self, q: np.ndarray, h: np.ndarray) -> np.ndarray:
        """Degrees of freedom (T, nv) of poses q (T, nq) that are at a limit, and would go beyond it by the gradients h
        (T, nv)."""
        base, held = self._body.base, np.zeros(h.shape, dtype=bool)
        angle, slope = q[:, base.bounded_q], h[:, base.bounded_v]
        low, high = base.lower[base.bounded_q], base.upper[base.bounded_q]
        held[:, base.bounded_v] = ((angle <= low) & (slope > 0.0)) | ((angle >= high) & (slope < 0.0))
        return held

    def size_slope(self, at: FilmedBody) -> np.ndarray:
        """Derivative of the person's size by what is common (S,): of the mean logarithm of the segments' lengths."""
        body, some = self._body.at(at.scales), self._landmark
        posed = body.at(body.neutral)
        turns = posed.rotations[self._joint]
        points = body.landmarks(posed)[some] + np.einsum("jab,jb->ja", turns, at.marks)
        by_scale = self._body.landmark_derivatives(posed)[some]
        slope = np.zeros(self._at[-1])
        for first, second in zip(self._lengths.first, self._lengths.second, strict=True):
            way = points[first] - points[second]
            way /= (way @ way) * len(self._lengths.first)
            slope[self._at[3] : self._at[4]] += way @ (by_scale[first] - by_scale[second])
            for end, sign in ((first, 1.0), (second, -1.0)):
                own = self._at[4] + 3 * end
                slope[own : own + 3] += sign * way @ turns[end]
        return slope

    @property
    def places(self) -> np.ndarray:
        """Indices of each camera's turn, shift and focal length in the covariance of the common unknowns (C, 7), or
        -1."""
        column = np.full((len(self._seen.rays), 7), -1)
        column[1:, :6] = np.arange(self._at[1]).reshape(-1, 6)
        column[self._focal, 6] = np.arange(self._at[1], self._at[2])
        return column

    def radial_std(self, covariance: np.ndarray) -> np.ndarray:
        """Deviations of the cameras' radial terms (C,), from the covariance of the common unknowns."""
        std = np.zeros(len(self._seen.rays))
        std[self._radial] = np.sqrt(np.diagonal(covariance)[self._at[2] : self._at[3]])
        return std

    def pulls(self, at: FilmedBody, system: PersonSystem, inverse: np.ndarray) -> np.ndarray:
        """How a bias of each camera's rays to a joint, by `BIAS` of their deviation to the right or down, pulls what is
        common once poses have followed (S, C J 2); inverse (T, nv, nv): of the poses' Hessians."""
        points, *by = self._placed(at, derivatives=True)
        pulls = []
        for c in range(len(self._seen.rays)):
            off, depth, place = self._off(at, points, c)
            weight = np.where(self._known[c][..., None], robust_weights(off), 0.0)
            common, poses = self._ray_derivatives(at, c, place, depth, *by)
            left = common - np.einsum("tjxv,tsv->tjxs", poses, system.B @ inverse)
            pulls.append(BIAS * np.einsum("tjxs,tjx->sjx", left, weight).reshape(self._at[-1], -1))
        return np.hstack(pulls)
