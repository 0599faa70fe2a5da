"""Labels of left and right that change places for some frames, as tracking software lets them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from estimator.data.formats.opensim import frame_rate
from estimator.data.markers.track import MarkerTrack
from humanoid.support.errors import first_of

_ACCELERATION = 60.0  # [m/s^2] of a foot in its swing
_NOISE = 0.015  # [m] by which a path may jump beside
_RECENT = 0.25  # [s] that a path may be missing and still be continued
_FIT = 4  # frames whose line continues a path
_CONFIRMING = 9  # frames on either side of a change that have to agree with it, of which a quarter may be outliers
_LISTED = 4


def mirrored_swaps(track: MarkerTrack, pairs: Sequence[tuple[str, str]]) -> tuple[MarkerTrack, tuple[str, ...]]:
    """The track with the labels of each pair corrected, and a note of the exchanged ones.

    Labels change where, exchanged, they continue the paths of both markers and, unchanged, neither: paths continue
    along their line of the last frames, and may leave it by what a limb can accelerate. Labels stay where the two are
    too near to decide, or have both been missing for long. They also stay where the vector between the two, over
    several frames before and after, does not turn round: one point that was measured elsewhere changes no labels.
    Between such gaps the labels of most frames are right.
    """
    points, notes = track.points.copy(), []
    for left, right in pairs:
        if left not in track.names or right not in track.names:
            continue
        i, k = track.names.index(left), track.names.index(right)
        wrong = _exchanged(points[:, i], points[:, k], track.time)
        if wrong.any():
            points[wrong, i], points[wrong, k] = track.points[wrong, k], track.points[wrong, i]
            first, last = track.time[np.flatnonzero(wrong)[[0, -1]]]
            notes.append(f"{left} and {right} in {wrong.sum()} frames from {first:.3g} to {last:.3g} s")
    told = (f"labels of left and right were exchanged and are corrected: {first_of(notes, _LISTED)}",) if notes else ()
    return track._replace(points=points, notes=(*track.notes, *told)), told


def _exchanged(a: np.ndarray, b: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Frames (T,) in which the labels of two markers (T, 3) are exchanged."""
    paths = np.stack([a, b], axis=1)
    seen = np.isfinite(paths).all(axis=2)
    state = np.zeros(len(time), dtype=bool)
    begins = _pieces(seen, time)
    for start, stop in pairwise([*begins, len(time)]):
        doubtful = set((_doubtful(paths[start:stop], seen[start:stop]) + start).tolist())
        now = False
        for t in range(start, stop) if doubtful else ():
            if t in doubtful and _changes(paths, seen, time, t, start):
                now = not now
                paths[t:stop], seen[t:stop] = paths[t:stop, ::-1].copy(), seen[t:stop, ::-1].copy()
            state[t] = now
        state[start:stop] = _confirmed(state[start:stop], paths[start:stop], seen[start:stop], time[start:stop])
        if state[start:stop][seen[start:stop].any(axis=1)].mean() > 0.5:
            state[start:stop] ^= True
    return state


def _pieces(seen: np.ndarray, time: np.ndarray) -> list[int]:
    """Starts of the stretches before which both markers were missing for long."""
    at = np.flatnonzero(seen.any(axis=1))
    if not len(at):
        return [0] if len(time) else []
    return [0, *at[1:][np.diff(time[at]) > _RECENT].tolist()]


def _doubtful(paths: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Frames in which exchanged labels are nearer to where both were last, or a marker is there again."""
    last = np.maximum.accumulate(np.where(seen, np.arange(len(seen))[:, None], -1), axis=0)
    before = np.vstack([[[-1, -1]], last[:-1]])
    were = np.where((before >= 0)[..., None], paths[before, np.arange(2)], np.nan)
    kept = np.nansum((paths - were) ** 2, axis=(1, 2))
    other = np.nansum((paths - were[:, ::-1]) ** 2, axis=(1, 2))
    again = seen & (before < np.arange(len(seen))[:, None] - 1) & (before >= 0)
    return np.flatnonzero((other < kept) | again.any(axis=1))


def _changes(paths: np.ndarray, seen: np.ndarray, time: np.ndarray, t: int, start: int) -> bool:
    """Whether labels change in frame t: of the markers seen, exchanged all continue a path and otherwise none does."""
    expected = [_continued(paths[start:t, k], seen[start:t, k], time[start : t + 1]) for k in range(2)]
    where = [k for k in range(2) if seen[t, k]]
    if not where or any(place is None for place in expected):
        return False
    fits = np.array([[np.linalg.norm(paths[t, k] - place[0]) for place in expected if place] for k in where])
    allowed = np.array([place[1] for place in expected if place])
    own, other = fits[range(len(where)), where], fits[range(len(where)), [1 - k for k in where]]
    slack, slack_other = allowed[where], allowed[[1 - k for k in where]]
    return bool((own > slack).all() and (other <= slack_other).all() and (own > 2.0 * other).all())


def _confirmed(state: np.ndarray, paths: np.ndarray, seen: np.ndarray, time: np.ndarray) -> np.ndarray:
    """The frames (T,) that are exchanged in `state`, without those changes that frames on either side contradict; paths
    (T, 2, 3) with the labels corrected by `state`.

    A path of which a few points are outliers may seem to change once, and never back. At a true change, the vector from
    one marker to the other is the same on both sides. A marker that is seen alone is read as where both are seen,
    before and after, where these agree.
    """
    both = np.flatnonzero(seen.all(axis=1))
    between, state = (paths[:, 1] - paths[:, 0])[both], state.copy()
    for change in np.flatnonzero(np.diff(state[both])) + 1:
        before, after = slice(max(0, change - _CONFIRMING), change), slice(change, change + _CONFIRMING)
        moment = 0.5 * (time[both[change - 1]] + time[both[change]])
        were, are = (_at_moment(time[both[part]] - moment, between[part]) for part in (before, after))
        if were @ are < 0.0:
            state[both[change] :] ^= True
            between[change:] *= -1.0
    for first, last in pairwise(both):
        if state[first] == state[last]:
            state[first:last] = state[first]
    return state


def _at_moment(time: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Place of a path (N, 3) at time 0, by the medians of the slopes between its points and of the residuals, so that a
    few outliers do not matter."""
    i, k = np.triu_indices(len(time), 1)
    slope = np.median((path[k] - path[i]) / (time[k] - time[i])[:, None], axis=0) if len(time) > 2 else np.zeros(3)
    return np.asarray(np.median(path - time[:, None] * slope, axis=0))


def _continued(path: np.ndarray, seen: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, float] | None:
    """The predicted place of a path at the last time, and its tolerance [m]; None where it ended long ago."""
    at = np.flatnonzero(seen)[-_FIT:]
    if not len(at) or time[-1] - time[at[-1]] > _RECENT:
        return None
    at = at[time[at] >= time[at[-1]] - _FIT / frame_rate(time) - 1e-9] if len(time) > 2 else at
    late = time[-1] - time[at]
    reach = _NOISE + 0.5 * _ACCELERATION * float(late[-1]) ** 2
    if len(at) < 2:
        return path[at[-1]], reach + 3.0 * float(late[-1])  # its speed is not known
    line = np.polynomial.polynomial.polyfit(late, path[at], 1)
    return line[0], reach + 0.5 * _ACCELERATION * float(late[0] - late[-1]) * float(late[-1])
