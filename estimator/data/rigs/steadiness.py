"""Which camera of a rig disagrees with the others, during a part of the clip, or with a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.data.rigs.bundle import RigRays, RigState, adjusted
from estimator.data.rigs.first import meeting_share, triangulated
from estimator.data.rigs.lengths import SegmentLengths
from estimator.data.rigs.search import RigFit, RigViews, exchanged, with_exchanged
from estimator.data.rigs.views import read

_BETTER = 1.1  # times that rays fit better where cameras may stand otherwise in a part: it is 1.05 where they stood
_LEAST_TURN, _LEAST_SHIFT = 1.0, 0.03  # degrees; of the distance to the person: smaller moves do not matter
_SPLITS = 6  # parts, between which a camera may have moved
_MEET = 0.7  # share of the rays of two cameras that meet where they see one person: of others it is 0.3 to 0.7
_INSTANTS, _STEPS = 40, 15  # of a part, and of its adjustment


@dataclass(frozen=True)
class CameraMove:
    """A camera that stands otherwise. cameras: which one; two where one of two does. after: the instant [s] from which
    on, about. turn [deg], shift [of the first camera's distance to the person]: by how much."""

    cameras: tuple[int, ...]
    after: float
    turn: float
    shift: float

    @property
    def matters(self) -> bool:
        """Whether the move is large enough to matter."""
        return self.turn > _LEAST_TURN or self.shift > _LEAST_SHIFT


@dataclass(frozen=True)
class RigPart:
    """The fit to a part of a clip. state: of the rig that is adjusted to it. cost: of a ray by it; before: by the
    rig that it was adjusted from. seen: the rays, free of the lenses."""

    state: RigState
    cost: float
    before: float
    seen: RigRays

    @staticmethod
    def of(
        views: RigViews, lengths: SegmentLengths, state: RigState, late: np.ndarray, instants: np.ndarray
    ) -> RigPart:  # fmt: skip
        """The fit at instants (T,) [s], from a state; late (C,) [s]: how much later the clocks are read."""
        cameras = len(views.views)
        known = np.zeros(cameras)
        rays, slope = read(views.views, instants, late)
        flips = exchanged(state, rays, views.std, lengths.mirror)
        right = state.straight(with_exchanged(rays, flips, lengths.mirror))
        seen = RigRays(right, np.zeros_like(slope), views.std, known, known, known)
        points = triangulated(right, state.R, state.t, range(cameras))
        placed = replace(state, late=known, focal=np.ones(cameras), radial=known, points=points)
        whole = adjusted(placed, seen, lengths, most=_STEPS, free=())
        own = adjusted(whole.state, seen, lengths, most=_STEPS)
        count = max(1, int(np.isfinite(right).sum()))
        return RigPart(own.state, own.cost / count, whole.cost / count, seen)


def camera_move(views: RigViews, lengths: SegmentLengths, fit: RigFit) -> CameraMove | None:
    """The camera that was moved during a clip, and when; None where all stood still according to the rays.

    Where a camera moves, no placement fits before and after. For several instants the rig is adjusted to what is seen
    before and to what is seen after, from where it was found for all. views: with the noise as it was taken before.
    """
    begin, end = fit.instants[0], fit.instants[-1]
    best: tuple[float, float, RigPart, RigPart] | None = None
    for k in range(1, _SPLITS):
        share = k / _SPLITS
        middle = float(begin + share * (end - begin))
        before, after = (
            RigPart.of(views, lengths, fit.state, fit.late, instants)
            for instants in (np.linspace(begin, middle, _INSTANTS), np.linspace(middle, end, _INSTANTS))
        )
        whole = share * before.before + (1.0 - share) * after.before
        own = share * before.cost + (1.0 - share) * after.cost
        if whole > (_BETTER * own if best is None else best[0] * own):
            best = whole / own, middle, before, after
    if best is None:
        return None
    _, middle, before, after = best
    if min(_meeting(part.seen.rays, views.std, lengths.mirror).min() for part in (before, after)) <= _MEET:
        return None  # no placement fits a part either
    move = changed_camera(before.state, after.seen, lengths, middle)
    return move if move.matters else None


def changed_camera(state: RigState, seen: RigRays, lengths: SegmentLengths, after: float) -> CameraMove:
    """The camera without which a rig fits what is seen: the one that makes it fit best when it alone is placed
    again."""
    points = triangulated(seen.rays, state.R, state.t, range(len(state.R)))
    placed = adjusted(replace(state, points=points), seen, lengths, most=_STEPS, free=()).state
    alone = [adjusted(placed, seen, lengths, most=_STEPS, free=(c,)) for c in range(len(state.R))]
    moved = int(np.argmin([each.cost for each in alone]))
    new = alone[moved].state
    turn = Rotation.from_matrix(new.R[moved] @ state.R[moved].T).magnitude()
    centre, old = (-of.R[moved].T @ of.t[moved] for of in (new, state))
    distance = float(np.nanmedian(np.linalg.norm(new.points, axis=-1)))
    cameras: Sequence[int] = (0, 1) if len(state.R) == 2 else (moved,)
    return CameraMove(tuple(cameras), after, float(np.degrees(turn)), float(np.linalg.norm(centre - old)) / distance)


def strange_cameras(views: RigViews, lengths: SegmentLengths, fit: RigFit) -> tuple[int, ...]:
    """The camera whose rays meet no other camera's in most frames, as of one that sees another person; both where two
    are all there are; none where each meets one. views: as for `camera_move`."""
    meet = _meeting(fit.state.straight(fit.rays.rays), views.std, lengths.mirror)
    if meet.min() > _MEET:
        return ()
    return (0, 1) if len(meet) == 2 else (int(np.argmin(meet)),)


def _meeting(rays: np.ndarray, std: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """Share of each camera's rays (C, T, J, 2) that meet those of the one that it suits best (C,)."""
    cameras = range(len(rays))
    shares = {pair: meeting_share(rays, std, mirror, *pair) for pair in combinations(cameras, 2)}
    return np.array([max(share for pair, share in shares.items() if c in pair) for c in cameras])
