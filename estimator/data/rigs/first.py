"""Initial relative placements of cameras: two by their essential matrix, the others by the points these see.

OpenCV's robust estimators (USAC: Raguram et al., A universal framework for random sample consensus, 2013; its local
optimisation with sigma consensus, Barath et al., MAGSAC, 2019).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from estimator.data.cameras.epipolar import essential_of, nearest_points, sampson
from estimator.data.rigs.bundle import RigState
from estimator.data.rigs.lengths import SegmentLengths
from estimator.data.rigs.views import with_depth

_THRESHOLD = 2.0  # standard deviations of a ray
_ITERATIONS = 3000
FEWEST = 100
"""Points that two cameras have to have in common."""
_PARALLAX = 0.3  # sine of the angle between two cameras' rays, from which more adds nothing
_PARALLEL = 1e-6  # see `nearest_points`
_I = np.eye(3)


@dataclass(frozen=True)
class PairPose:
    """Camera b from camera a: R (3, 3), t (3,) of length 1. count: of the points that agree, and lie before both.
    strength: count, less where the rays hardly differ."""

    a: int
    b: int
    R: np.ndarray
    t: np.ndarray
    count: int
    strength: float


def pair_poses(rays: np.ndarray, std: np.ndarray, a: int, b: int, seeds: Sequence[int] = (0, 1)) -> list[PairPose]:
    """Poses of camera b from camera a by rays (C, T, J, 2), one for each seed of the sampling; none with too few."""
    x, y = rays[a].reshape(-1, 2), rays[b].reshape(-1, 2)
    both = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    if np.count_nonzero(both) < FEWEST:
        return []
    x, y = np.ascontiguousarray(x[both]), np.ascontiguousarray(y[both])
    poses = []
    for seed in seeds:
        try:
            E, agree = cv2.findEssentialMat(x, y, _I, _I, None, None, _sampling(_THRESHOLD * float(np.mean(std)), seed))
        except cv2.error:  # uninformative points, as all in one place
            continue
        if E is None or E.shape[0] < 3:
            continue
        count, R, t, _ = cv2.recoverPose(E[:3], x, y, _I, mask=agree.copy())
        poses.append(PairPose(a, b, R, t[:, 0], int(count), count * min(1.0, _angle(R, x, y) / _PARALLAX)))
    return poses


def meeting_share(rays: np.ndarray, std: np.ndarray, mirror: np.ndarray, a: int, b: int) -> float:
    """Share of the rays (C, T, J, 2) of two cameras that meet by the pose that suits most, the sides of each frame as
    they suit; 0 where they have too few in common. Of two different people some meet as well."""
    first, others = with_depth(rays[a]), [with_depth(seen) for seen in (rays[b], rays[b][:, mirror])]
    near = _THRESHOLD * np.hypot(std[a], std[b])
    common = np.isfinite(rays[[a, b]]).all(axis=(0, 3)).sum()
    shares = [0.0]
    for seen in (rays[b], rays[b][:, mirror]):
        for pose in pair_poses(np.stack([rays[a], seen]), std[[a, b]], 0, 1):
            E = essential_of(pose.R, pose.t)
            meet = [(sampson(E, first, second) < near).sum(axis=1) for second in others]
            shares.append(float(np.maximum(*meet).sum() / common))
    return max(shares)


def _sampling(threshold: float, seed: int) -> cv2.UsacParams:
    how = cv2.UsacParams()
    how.threshold, how.confidence, how.maxIterations = threshold, 0.9999, _ITERATIONS
    how.score, how.randomGeneratorState = cv2.SCORE_METHOD_MAGSAC, seed
    how.loMethod, how.loIterations, how.loSampleSize = cv2.LOCAL_OPTIM_SIGMA, 20, 50
    return how


def _angle(R: np.ndarray, x: np.ndarray, y: np.ndarray) -> float:
    """Sine of the angle between rays x, y (N, 2) of two cameras, the median."""
    first, second = with_depth(x), with_depth(y)
    across = np.linalg.norm(np.cross(first @ R.T, second), axis=1)
    return float(np.median(across / np.linalg.norm(first, axis=1) / np.linalg.norm(second, axis=1)))


def state_of_pair(rays: np.ndarray, pose: PairPose, std: np.ndarray, lengths: SegmentLengths) -> RigState | None:
    """All cameras, added one after the other to a pair, the one first that sees most of what is placed; None where one
    sees too little of it."""
    cameras = len(rays)
    R, t = np.tile(np.eye(3), (cameras, 1, 1)), np.zeros((cameras, 3))
    R[pose.b], t[pose.b] = pose.R, pose.t
    placed = [pose.a, pose.b]
    while len(placed) < cameras:
        points = triangulated(rays, R, t, placed)
        left = {c: _placed(points, rays[c], float(np.mean(std[c]))) for c in range(cameras) if c not in placed}
        best = max(left, key=lambda c: left[c][0])
        count, R[best], t[best] = left[best]
        if count < FEWEST // 4:
            return None
        placed.append(best)
    return _scaled(rays, R, t, lengths)


def _placed(points: np.ndarray, rays: np.ndarray, std: float) -> tuple[int, np.ndarray, np.ndarray]:
    """A camera that sees points (T, J, 3) by rays (T, J, 2): how many agree, its R and t."""
    both = np.isfinite(points).all(axis=2) & np.isfinite(rays).all(axis=2)
    if np.count_nonzero(both) < 6:
        return 0, np.eye(3), np.zeros(3)
    size = float(np.median(np.abs(points[both] - np.median(points[both], axis=0))))
    cv2.setRNGSeed(0)
    done, turn, t, agree = cv2.solvePnPRansac(
        points[both] / size, rays[both], _I, None, iterationsCount=1000, reprojectionError=3.0 * std,
        flags=cv2.SOLVEPNP_SQPNP,
    )  # fmt: skip
    return (len(agree), cv2.Rodrigues(turn)[0], size * t[:, 0]) if done else (0, np.eye(3), np.zeros(3))


def triangulated(rays: np.ndarray, R: np.ndarray, t: np.ndarray, some: Sequence[int]) -> np.ndarray:
    """Points (T, J, 3) nearest to the rays (C, T, J, 2) of some cameras; NaN where fewer than two see one, or its rays
    are parallel."""
    some = list(some)
    ways = np.einsum("cnx,cxy->cny", with_depth(rays[some].reshape(len(some), -1, 2)), R[some])
    centres = -np.einsum("cyx,cy->cx", R[some], t[some])
    return nearest_points(centres, ways, _PARALLEL).reshape(*rays.shape[1:3], 3)


def _scaled(rays: np.ndarray, R: np.ndarray, t: np.ndarray, lengths: SegmentLengths) -> RigState:
    """The rig in the first camera's frame, at the subject's size."""
    t = t - np.einsum("cxy,y->cx", R @ R[0].T, t[0])
    R = R @ R[0].T
    points = triangulated(rays, R, t, range(len(rays)))
    late, radial = np.zeros((2, len(R)))
    scale = float(np.nanmedian(1.0 / lengths.ratios(points)))
    return RigState(R, scale * t, late, np.ones(len(R)), radial, lengths.mean.copy(), scale * points)


def best_pairs(rays: np.ndarray, mirror: np.ndarray, std: np.ndarray, most: int) -> list[tuple[PairPose, bool]]:
    """The pairs that most points agree on, each with its second camera's sides as they are or all exchanged."""
    poses = []
    for a, b in combinations(range(len(rays)), 2):
        for exchanged in (False, True):
            seen = rays.copy()
            seen[b] = seen[b][:, mirror] if exchanged else seen[b]
            poses += [(pose, exchanged) for pose in pair_poses(seen, std, a, b)]
    return sorted(poses, key=lambda pair: -pair[0].strength)[:most]
