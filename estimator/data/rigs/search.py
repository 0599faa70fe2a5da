"""The rig that fits what all cameras see: several beginnings, with left and right as seen or exchanged, the best on
many instants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import pinocchio as pin

from estimator.data.cameras.epipolar import essential_of, sampson
from estimator.data.rigs.bundle import Adjusted, RigRays, RigState, RigUncertainty, adjusted, uncertainty
from estimator.data.rigs.first import PairPose, best_pairs, state_of_pair, triangulated
from estimator.data.rigs.lengths import SegmentLengths
from estimator.data.rigs.views import JointRays, JointView, common_instants, read, with_depth
from humanoid.subject.landmarks import relative_spread

_FAR = 4.0  # standard deviations, beyond which a distance counts no more
_SURE = 0.8  # of the distances of a frame as it is, below which its sides are exchanged
_READING_ROUNDS = 4


def _distances(state: RigState, first: np.ndarray, second: np.ndarray, a: int, b: int) -> np.ndarray:
    """Sampson's distances (T, J) of rays (T, J, 2) of cameras a and b in the plane z = 1."""
    R = state.R[b] @ state.R[a].T
    E = essential_of(R, state.t[b] - R @ state.t[a])
    return sampson(E, with_depth(state.through(a, first)), with_depth(state.through(b, second)))


def exchanged(state: RigState, rays: np.ndarray, std: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """Frames (C, T) bool whose sides have to be exchanged for the rays (C, T, J, 2) to meet best; the first camera's of
    two are as they are. std (C, J): of the rays. mirror (J,): the other side of each joint."""
    cameras, instants = rays.shape[:2]
    flips = np.zeros((cameras, instants), dtype=bool)
    cost = np.zeros((cameras, cameras, 2, instants))  # of two cameras, whether one of both is exchanged
    for a, b in combinations(range(cameras), 2):
        allowed = _FAR * np.hypot(std[a], std[b])
        for k, second in enumerate((rays[b], rays[b][:, mirror])):
            distance = np.minimum(_distances(state, rays[a], second, a, b) / allowed, 1.0)
            cost[a, b, k] = cost[b, a, k] = np.nan_to_num(distance).sum(axis=1)
    frames = np.arange(instants)
    for _ in range(_READING_ROUNDS):
        before = flips.copy()
        for c in range(1 if cameras == 2 else 0, cameras):
            as_is, other = (
                sum(cost[c, o, (flips[c] ^ flips[o] ^ turn).astype(int), frames] for o in range(cameras) if o != c)
                for turn in (False, True)
            )
            flips[c] ^= other < _SURE * as_is
        if np.array_equal(flips, before):
            break
    return flips ^ (flips.mean(axis=0) > 0.5)  # all exchanged is as good as none


def with_exchanged(rays: np.ndarray, flips: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """Rays (C, T, J, 2), or slopes, with the sides of some frames (C, T) exchanged."""
    return np.where(flips[:, :, None, None], rays[:, :, mirror], rays)


_RADIAL = 0.05  # of unknown lenses; phones take most of theirs out of video
_SHOWN = 1.0  # of that, of terms that the motion shows: it adds to what was known
_LATE = 0.1  # s: of a clock that was found from speeds
_NOISE = 0.008  # of the person's size in the picture: what a detector is off
_FEW, _MANY = 40, 120  # instants
_MUCH_IN_COMMON, _MUCH_BETTER = 0.5, 0.5  # share of the longest time in common; of the cost of others
_BEGINNINGS = 4
_ROUNDS = 5
_STEPS, _STEPS_AT_THE_END = 15, 40  # of the adjustment of a beginning, and of what was chosen
_TIMES = 3
_LASTING = 0.5  # s: frames nearer than that err alike
_ALIKE = 3.0  # joints that err alike, as near ones do


@dataclass(frozen=True)
class RigViews:
    """views (C). std (C, J): of rays. focal_std (C,), radial_std (C,), late_std (C,) [s]: see `RigRays`."""

    views: Sequence[JointRays]
    std: np.ndarray
    focal_std: np.ndarray
    radial_std: np.ndarray
    late_std: np.ndarray

    @staticmethod
    def of(views: Sequence[JointView], names: Sequence[str], *, clocks_known: bool) -> RigViews:
        """names (J): of the joints."""
        rays = [JointRays(view) for view in views]
        std = np.array([_NOISE * ray.extent * relative_spread(names) for ray in rays])
        focal_std = np.array([view.camera.focal_std for view in views])
        late_std = np.zeros(len(views)) if clocks_known else np.full(len(views), _LATE)
        told = np.array([view.camera.fisheye or bool(np.any(view.camera.distortion)) for view in views])
        radial_std = np.where((focal_std > 0.0) & ~told, _RADIAL, 0.0)
        return RigViews(rays, std, focal_std, radial_std, late_std)


@dataclass(frozen=True)
class RigFit:
    """state: the rig. unsure: its deviations with the time in mind that errors last, of_bias in the covariance. late
    (C,) [s]: how much later each clock is read. flips (C, T): frames whose sides are exchanged. rays: at the T instants
    [s] of the first clock."""

    state: RigState
    unsure: RigUncertainty
    late: np.ndarray
    flips: np.ndarray
    rays: RigRays
    instants: np.ndarray

    @property
    def misfits(self) -> np.ndarray:
        """Residuals from observed rays to the points (C, T, J, 2), in the plane z = 1 by the given focal
        lengths."""
        state, seen = self.state, self.rays
        at = np.einsum("cij,tnj->ctni", state.R, state.points) + state.t[:, None, None]
        flat = state.bent(at)
        return np.asarray(flat - seen.rays - seen.slope * state.late[:, None, None, None])

    def deviations(self, size: float) -> np.ndarray:
        """(C, 7, K): see `Camera.deviations`; size: metres in a unit of the rig's frame."""
        cameras = len(self.late)
        covariance = self.unsure.covariance.reshape(7 * cameras, 7 * cameras)
        free = np.flatnonzero(np.diagonal(covariance) > 0.0)
        variance, causes = np.linalg.eigh(covariance[np.ix_(free, free)])
        deviations = np.zeros((cameras, 7, len(free)))
        deviations.reshape(7 * cameras, -1)[free] = causes * np.sqrt(np.maximum(variance, 0.0))
        for own, t in zip(deviations, self.state.t, strict=True):
            own[3:6] = size * (pin.skew(t) @ own[:3] + own[3:6])  # the turn was about the rig's origin
        return deviations


def fitted_rig(views: RigViews, lengths: SegmentLengths, lags: Sequence[np.ndarray]) -> RigFit | None:
    """The rig of least cost; None where no two cameras have enough points in common. lags: how much later the clocks
    may be read (C,) [s], of which the one is taken that fits best, see `best_start`."""
    starts: list[RigStart] = []
    for late in lags:
        instants = common_instants(views.views, late, _FEW)
        if not len(instants):
            continue
        rays, slope = read(views.views, instants, late)
        for pose, other in best_pairs(rays, lengths.mirror, views.std, _BEGINNINGS):
            begun = _beginning(views, lengths, rays, slope, pose, other)
            if begun is not None:
                mean = begun.cost / max(1, int(np.count_nonzero(np.isfinite(rays))))
                starts.append(RigStart(mean, float(np.ptp(instants)), late, begun.state))
    best = best_start(starts)
    return None if best is None else rig_near(views, lengths, best.late, best.state)


@dataclass(frozen=True)
class RigStart:
    """A rig that clocks read `late` (C,) [s] later lead to: its cost for each ray, and the time in common then [s]."""

    cost: float
    common: float
    late: np.ndarray
    state: RigState


def best_start(starts: Sequence[RigStart]) -> RigStart | None:
    """The start of least cost, None of none. One whose clocks leave less than half as much time in common as others'
    do must be much better than these: a few poses that are alike fit anything."""
    longest = max((start.common for start in starts), default=0.0)

    def cost(start: RigStart) -> float:
        return start.cost if start.common >= _MUCH_IN_COMMON * longest else start.cost / _MUCH_BETTER

    return min(starts, key=cost, default=None)


def _beginning(
    views: RigViews, lengths: SegmentLengths, rays: np.ndarray, slope: np.ndarray, pose: PairPose, other: bool
) -> Adjusted | None:
    flips = np.zeros(rays.shape[:2], dtype=bool)
    flips[pose.b] = other
    state = state_of_pair(with_exchanged(rays, flips, lengths.mirror), pose, views.std, lengths)
    if state is None:
        return None
    flips = exchanged(state, rays, views.std, lengths.mirror)
    return _alternated(replace(views, radial_std=np.zeros(len(rays))), lengths, rays, slope, state, flips, _STEPS)[0]


def _alternated(
    views: RigViews, lengths: SegmentLengths, rays: np.ndarray, slope: np.ndarray, state: RigState,
    flips: np.ndarray, steps: int,
) -> tuple[Adjusted, np.ndarray, RigRays]:  # fmt: skip
    """Adjusted, and sides exchanged, in turn until these stay."""
    cameras = range(len(rays))
    for _ in range(_ROUNDS):
        seen = RigRays(
            with_exchanged(rays, flips, lengths.mirror), with_exchanged(slope, flips, lengths.mirror), views.std,
            views.focal_std, views.radial_std, views.late_std,
        )  # fmt: skip
        points = triangulated(state.straight(seen.rays), state.R, state.t, cameras)
        result = adjusted(replace(state, points=points), seen, lengths, most=steps)
        state = result.state
        new = exchanged(state, rays, views.std, lengths.mirror)
        if np.array_equal(new, flips):
            break
        flips = new
    return result, flips, seen


def rig_near(views: RigViews, lengths: SegmentLengths, late: np.ndarray, state: RigState) -> RigFit:
    """The rig of least cost near a state: on many instants, with the noise that the residuals show, and clocks read
    where they were found. late (C,) [s]: how much later they are read at first."""
    prior, views = views.radial_std, replace(views, radial_std=np.zeros(len(late)))
    for k in range(_TIMES):
        late = late + state.late
        state = replace(state, late=np.zeros_like(late))
        instants = common_instants(views.views, late, _MANY)
        rays, slope = read(views.views, instants, late)
        flips = exchanged(state, rays, views.std, lengths.mirror)
        result, flips, seen = _alternated(views, lengths, rays, slope, state, flips, _STEPS_AT_THE_END)
        state = result.state
        if k == 0:
            std = views.std * np.clip(result.chi, 0.5, 3.0)
            bending = replace(seen, std=std, radial_std=prior)
            views = replace(views, std=std, radial_std=_shown(bending, state, lengths, instants))
    unsure = lasting(uncertainty(state, seen, lengths), instants)
    return RigFit(state, unsure, late + state.late, flips, seen, instants)


def _shown(seen: RigRays, state: RigState, lengths: SegmentLengths, instants: np.ndarray) -> np.ndarray:
    """Deviations (C,) of the radial terms, as given with the rays, where the motion shows them: where it makes
    them surer by much. Others are left at 0, or cameras would be turned for what lenses do not do."""
    if not np.any(seen.radial_std):
        return seen.radial_std
    known = lasting(uncertainty(state, seen, lengths), instants).radial_std
    return np.where(known < _SHOWN * seen.radial_std, seen.radial_std, 0.0)


def lasting(unsure: RigUncertainty, instants: np.ndarray) -> RigUncertainty:
    """The uncertainty of a rig with lasting errors, and its bias; instants (T,) [s]."""
    span = float(instants[-1] - instants[0])
    fewer = _ALIKE * max(1.0, len(instants) * _LASTING / (span + _LASTING))
    covariance = fewer * unsure.covariance + unsure.of_bias
    more = np.sqrt(fewer)
    return replace(unsure, covariance=covariance, late_std=more * unsure.late_std, radial_std=more * unsure.radial_std)
