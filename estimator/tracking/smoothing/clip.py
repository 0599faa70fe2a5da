"""Smoothing over a whole clip."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.floor import KnownFloor
from estimator.data.observation import Observation
from estimator.data.sequence import Cues, Progress
from estimator.energy.cost import Cost
from estimator.energy.descent.contact import separate
from estimator.energy.descent.solution import Solution
from estimator.energy.interpenetration import AboveFloor
from estimator.energy.priors import Transition
from estimator.energy.term import Term
from estimator.inference.best_path import best_path, path_weights
from estimator.inference.contacts import believed_floor, floor_of
from estimator.inference.ground import Ground
from estimator.inference.motion import MotionPrior, frame_shares
from estimator.numerics.newton import STALLED
from estimator.search.hypothesis import EXCHANGED
from estimator.search.jumps.readings import ACROSS, has_both
from estimator.search.mode_search import ModeSearch
from estimator.trackers.frame_result import FrameResult, backtrack_results
from estimator.tracking.smoothing.chain import FrameChain
from estimator.tracking.smoothing.filtered_mode import filtered_pulls, without_filtered_modes
from estimator.tracking.smoothing.frames import frame_costs, frame_energies, frame_shifts, only, spill_of, standing_ties
from estimator.tracking.smoothing.lasting_errors import by_whole_error, without_lasting
from estimator.tracking.smoothing.pace import pace_of
from estimator.tracking.smoothing.readings import bridged, reading_bars, reading_hold, reading_weights
from estimator.tracking.smoothing.renewal import Renewal, Trajectory
from estimator.tracking.smoothing.settings import SmoothSettings
from estimator.tracking.smoothing.smoothed import Smoothed, smooth
from estimator.tracking.smoothing.stances import SUNK, Stances
from estimator.tracking.smoothing.ties import Ties
from estimator.vision.cues.learned import with_learned
from humanoid.collision.floor import Clearances, FloorDistances
from humanoid.kinematics.body import SHORTEST_STEP, Body
from humanoid.support.spilled import MadeList, Spill, SpilledList

_FEW = 3  # Newton steps between two estimates of the pace
_HOLDS = 2  # rounds in which the points that stand are found again
_DOUBTED = 64.0  # of its squares, from which a found floor is rejected: 4 cm
_SAME = 5e-3  # rad or m: how near descents end that have come to one minimum
NEAR = 0.05  # rad or m: how far parting two limbs may move the smoothed pose
_MOVEMENT = 0.06  # s for which a movement counts among modes: accelerations of captured motion hang together
_MARGIN = 30  # frames beyond some by which these are computed
_DRAWN, _SEED = 16, 0


def smooth_track(
    search: ModeSearch,
    observations: Sequence[Observation],
    results: Sequence[FrameResult],
    settings: SmoothSettings | None = None,
    *,
    cues: Cues | None = None,
    floor: KnownFloor = None,
    progress: Progress | None = None,
) -> Smoothed:
    """The best trajectory, smoothed.

    Two paths through the modes are smoothed: the tracker's own back through the parents, and the one that the motion
    prior likes best, with the better reading of the trunk in every stretch. The one of lower energy after smoothing is
    taken; where both come to the same poses they are one. Each frame's keypoints are read as the path's mode reads
    them, `cues` are what its pictures show: at first those of the modes, then those of the smoothed poses (`Renewal`).
    Heels and toes of that path that stand are held in one place (`Stances`), and nothing is below the floor, given or
    found. Parts that the smoothing pushed into each other or into the floor are parted again
    (`estimator.energy.descent.contact`). Before that, what lasts of the keypoints' errors is taken from them, and the
    trajectory follows the rest (`lasting_errors`). `progress` is called with how many frames of how many are done.
    """
    settings = settings or SmoothSettings()
    track = _Track(search, observations, results, settings, cues, floor)
    body = search.body
    q = np.full((len(results), body.nq), np.nan)
    if not track.some:
        return Smoothed(q)
    end = track.best(progress)
    clearance = Clearances([part for part in (search.self_collision, end.distances) if part is not None])
    q[track.some] = [_parted(search, clearance, c, x) for c, x in zip(end.costs, end.q, strict=True)]
    return track.smoothed(end, q)


class _Held(NamedTuple):
    """Costs (T), modes (T,) and poses q (T, nq) of a held trajectory, the one before, the floor that it is above and
    the distances to it, None without one."""

    costs: Sequence[Cost]
    before: Trajectory
    modes: np.ndarray
    q: np.ndarray
    floor: Ground | None
    distances: FloorDistances | None


class _Track:
    """The frames of a track that have modes, and the paths through these."""

    def __init__(
        self,
        search: ModeSearch,
        observations: Sequence[Observation],
        results: Sequence[FrameResult],
        settings: SmoothSettings,
        cues: Cues | None,
        floor: KnownFloor,
    ) -> None:
        self._search, self._settings, self._cues, self._floor = search, settings, cues, floor
        self._observations, self._results = observations, results
        self._motion, self._plain = settings.motion(search.model), settings.plain_motion(search.model)
        self._energies: list[np.ndarray] = []  # of the modes of each frame, once `best` has computed them
        self._readings: list[np.ndarray] = []  # the same
        self._spill, self._spilled_ties = (spill_of(search, observations, settings) for _ in range(2))
        path = backtrack_results(results)
        self.some = np.flatnonzero(path >= 0).tolist()
        self._times = np.array([observations[t].time for t in self.some])
        self._shares = frame_shares(np.maximum(np.diff(self._times), SHORTEST_STEP), settings.lasting)
        self._path = path[self.some]

    def best(self, progress: Progress | None) -> _Held:
        """The better path, smoothed."""
        costs: SpilledList[Cost] = self._spill.list()
        self._energies, self._readings, shifts = [], [], list[np.ndarray]()
        for t, k in zip(self.some, self._path, strict=True):
            of_frame = frame_costs(self._search, self._seen(t), self._results[t])
            energy = frame_energies(self._search, of_frame, self._results[t])
            shifts.append(frame_shifts(self._search, self._observations[t], energy, self._results[t]))
            self._energies.append(energy + shifts[-1])
            self._readings.append(self._search.readings(self._results[t].q, self._only_camera))
            costs.append(self._tied(len(costs), k, of_frame[k]))
        paths, rivals = [self._path], [self._smoothed(costs, self._path, progress)]
        other = self._other_path()
        if not np.array_equal(other, self._path):
            changed = (self._cost(i, k) if k != self._path[i] else costs[i] for i, k in enumerate(other.tolist()))
            rival = self._smoothed(self._spill.list(changed), other, None)
            if not _coincide(self._search.body, rivals[0], rival):
                paths.append(other)
                rivals.append(rival)
        rivals = [self._paced(rival) for rival in rivals]
        renewal = Renewal(self._search, self._place, self.some, self._times, self._motion, self._settings)
        if self._cues is not None and self._settings.rounds > 0:
            renewal(rivals)
        penalty = self._search.model.settings.exchange_penalty
        total = [
            renewal.energy(r)
            + penalty * sum(a == EXCHANGED for a in r.association)
            + sum(float(shift[k]) for shift, k in zip(shifts, path, strict=True))
            for r, path in zip(rivals, paths, strict=True)
        ]
        best = int(np.argmin(total))
        return self._followed(self._held(rivals[best], paths[best]))

    def _followed(self, end: _Held) -> _Held:
        """A trajectory that was smoothed and held with the whole error of the keypoints, smoothed again with the new
        error of each frame."""
        body, before = self._search.body, end.before
        if self._settings.lasting <= 0.0:
            return end
        costs = without_lasting(body, end.costs, self._times, end.q, self._settings.lasting)
        if costs is None:
            return end
        q = smooth(body, costs, self._times, end.q, before.motion, self._settings, ties=before.ties)
        return end._replace(costs=costs, q=q)

    def _other_path(self) -> np.ndarray:
        """The path (T,) of least energy; where one camera has both readings of the trunk, that with the better one in
        every stretch."""
        bars = reading_bars(self._readings, self._energies, self._times)
        energies = self._energies
        if bars is not None:
            energies = [energy + bar for energy, bar in zip(self._energies, bars, strict=True)]
        return best_path(self._search.body, self._modes(), energies, self._times, self._plain)

    @property
    def _only_camera(self) -> Camera | None:
        """The clip's camera; None with several."""
        cameras = self._observations[self.some[0]].cameras
        return cameras[0] if len(cameras) == 1 else None

    def _held(self, trajectory: Trajectory, modes: np.ndarray) -> _Held:
        """The trajectory smoothed with standing feet held in place and the body above the floor. Which feet stand, and
        where the floor is, comes from the trajectory itself."""
        body, stance = self._search.body, self._settings.stance
        seen = [self._observations[t] for t in self.some]
        q = trajectory.q
        known = believed_floor(body, seen[0].cameras, self._floor, q)  # if it is not, the run's findings report it
        distances = floor_of(body, seen[0].cameras, known)
        floor: Ground | None = None
        costs: Sequence[Cost] = trajectory.costs
        for _ in range(_HOLDS):
            before, stances = costs, Stances.of(body, q, seen, known, hands=self._settings.hands)
            costs = trajectory.costs
            if stances is not None:
                if stances.hold and stance > 0.0:
                    costs = stances.held(body, costs, stance)
                floor = stances.floor if floor is None else floor
                if distances is None and floor is not None:
                    distances = FloorDistances(body, floor.normal, floor.height)
            if distances is not None:
                costs = _above(costs, AboveFloor(distances, SUNK, _DOUBTED if known is None else None))
            if costs is before:
                break  # nothing stands, or it is not seen: the trajectory is already smoothed by these
            q = smooth(body, costs, self._times, q, trajectory.motion, self._settings, ties=trajectory.ties)
        return _Held(costs, trajectory, modes, q, floor, distances)

    def smoothed(self, end: _Held, q: np.ndarray) -> Smoothed:
        """Poses q (T, nq) of all frames, at which a trajectory ended, and their uncertainty."""
        prior, motion = self._search.model.cost(None), end.before.motion
        uncertainty = TrajectoryUncertainty(prior, self._times, motion, self._settings)
        whole = MadeList(len(end.costs), lambda t: by_whole_error(without_filtered_modes(end.costs[t])))
        moved = np.zeros((len(self.some), _DRAWN, self._search.body.nv), dtype=np.float32)
        covariance = self._each(uncertainty.covariances(whole, end.before.ties, q[self.some], moved), len(q))
        draws = None if covariance is None else np.full((len(q), *moved.shape[1:]), np.nan, dtype=moved.dtype)
        if draws is not None:
            draws[self.some] = moved
        mode, weight = np.full(len(q), -1), np.full((len(q), max(map(len, self._energies))), np.nan)
        mode[self.some] = end.modes
        weights = uncertainty.weights(self._modes(), self._energies, self._plain)
        for t, *frame in zip(self.some, self._readings, self._energies, weights, strict=True):
            weight[t, : len(frame[0])] = reading_weights(*frame)
        return Smoothed(q, end.floor, covariance, mode, weight, draws)

    def _each(self, covariances: Iterator[np.ndarray], count: int) -> SpilledList[np.ndarray] | None:
        """Covariances of all frames, NaN for one without hypotheses; None where they are not determined."""
        every: SpilledList[np.ndarray] = Spill(self._settings.window).list()
        nothing, some = np.full((self._search.body.nv, self._search.body.nv), np.nan), set(self.some)
        try:
            for t in range(count):
                every.append(next(covariances).copy() if t in some else nothing)
        except np.linalg.LinAlgError:
            return None
        return every

    def _modes(self) -> MadeList[np.ndarray]:
        """Modes (K, nq) of each frame."""
        return MadeList(len(self.some), lambda i: self._results[self.some[i]].q)

    def _smoothed(self, costs: SpilledList[Cost], path: np.ndarray, progress: Progress | None) -> Trajectory:
        """Along a path, with the features of its modes."""
        start, associations = np.empty((len(path), self._search.body.nq)), list[str]()
        for i, k in enumerate(path.tolist()):
            result = self._results[self.some[i]]
            start[i] = result.q[k]
            associations.append(result.association[k])
        camera = self._only_camera
        if camera is not None:
            readings = self._search.readings(start, camera)
            start = bridged(self._search.body, start, readings, self._times, camera)
        ties = self._ties(associations)
        body, motion = self._search.body, self._motion
        q = smooth(body, costs, self._times, start, motion, self._settings, progress, ties=ties)
        pulls = MadeList(len(path), lambda i: self._pulls(i, int(path[i])))
        return Trajectory(q, associations, costs, ties, motion, pulls)

    def _paced(self, trajectory: Trajectory) -> Trajectory:
        """A smoothed trajectory, smoothed again with the pace of its frames."""
        body, q, costs, ties, motion = self._search.body, trajectory.q, trajectory.costs, trajectory.ties, self._motion
        few = replace(self._settings, iterations=min(_FEW, self._settings.iterations))
        for left in reversed(range(self._settings.pace_rounds)):
            motion = motion._replace(pace=pace_of(body, costs, self._times, q, motion, self._settings, ties=ties))
            q = smooth(body, costs, self._times, q, motion, few if left else self._settings, ties=ties)
        return replace(trajectory, q=q, motion=motion)

    def _ties(self, associations: Sequence[str]) -> SpilledList[Ties]:
        """Terms that tie each frame's feet to the one before."""
        ties: SpilledList[Ties] = self._spilled_ties.list([()])
        for i in range(1, len(self.some)):
            t, dt = self.some[i], self._times[i] - self._times[i - 1]
            adjacent = t - self.some[i - 1] == 1
            ties.append(standing_ties(self._search, self._observations[t], associations[i], dt) if adjacent else ())
        return ties

    def _place(self, i: int) -> Observation:
        return self._seen(self.some[i])

    def _cost(self, i: int, k: int) -> Cost:
        t = self.some[i]
        (cost,) = frame_costs(self._search, self._seen(t), only(self._results[t], k))
        return self._tied(i, k, cost)

    def _tied(self, i: int, k: int, cost: Cost) -> Cost:
        """The cost by mode k with its pull, and its reading of the trunk."""
        return self._read(i, k, cost).plus(self._pulls(i, k))

    def _pulls(self, i: int, k: int) -> Sequence[Term]:
        """Pull of a frame with pictures towards its mode k."""
        if self._cues is None:
            return ()
        t, body, overconfidence = self.some[i], self._search.body, self._settings.overconfidence
        share = float(self._shares[i])
        return filtered_pulls(body, self._observations[t], self._results[t], k, overconfidence, share)

    def _read(self, i: int, k: int, cost: Cost) -> Cost:
        """The cost by mode k, which holds its reading of the trunk where the frame has both."""
        camera, std = self._only_camera, self._settings.reading
        if camera is None or std <= 0.0 or not has_both(self._readings[i]):
            return cost
        if self._readings[i][k] == ACROSS:
            return cost
        return cost.plus([reading_hold(self._search.body, self._results[self.some[i]].q[k], camera, std)])

    def _seen(self, t: int) -> Observation:
        observation = self._observations[t]
        if self._cues is None:
            return observation
        return with_learned(replace(observation, cues=self._cues.at(observation.index)), self._results[t].extra)


def _above(costs: Sequence[Cost], above: AboveFloor) -> Sequence[Cost]:
    return MadeList(len(costs), lambda t: costs[t].plus([above]))


def _coincide(body: Body, first: Trajectory, other: Trajectory) -> bool:
    """Whether two trajectories ended in the same poses, and in one reading of them, however their paths went."""
    apart = (body.difference(a, b) for a, b in zip(first.q, other.q, strict=True))
    return list(first.association) == list(other.association) and all(np.abs(v).max() < _SAME for v in apart)


def _parted(search: ModeSearch, clearance: Clearances, cost: Cost, q: np.ndarray) -> np.ndarray:
    """q (nq,) itself unless parts overlap each other or the floor, else a pose near it where they do not."""
    body = search.body
    contact = search.settings.contact
    if clearance.penetration(body.at(q)) <= contact.tolerance:
        return q
    held = Cost(body, [*cost.terms, Transition(body, q, np.full(body.nv, NEAR))])
    start = Solution(held.at(q), STALLED, np.inf, 0)
    return separate(search.seeker, clearance, held, start, contact).q


class TrajectoryUncertainty:
    """Uncertainty of trajectories through frames at times (T,) [s], rising.

    prior: energy that does not depend on observations. The evidence of frames is correlated for `settings.lasting`.
    """

    def __init__(self, prior: Cost, times: np.ndarray, motion: MotionPrior, settings: SmoothSettings) -> None:
        self._prior, self._body, self._times, self._settings = prior, prior.body, times, settings
        self._motion = motion

    def covariances(
        self, costs: Sequence[Cost], ties: Sequence[Ties], q: np.ndarray, moved: np.ndarray
    ) -> Iterator[np.ndarray]:
        """(nv, nv) of each of the poses q (T, nq), see `FrameChain.covariances`. costs (T): energy of each frame. ties
        (T): of each frame to the one before.

        moved (T, S, nv), zeros: filled on the way with movements away from q, draws from the normal density that the
        energy has there, whose velocities and accelerations are as uncertain as the trajectory's. Where windows meet,
        two independent draws are added by weights whose squares add up to one, so that their covariance is kept.

        Raises
        ------
        numpy.linalg.LinAlgError: a pose is not constrained.
        """
        window, count, rng = self._settings.window, len(q), np.random.default_rng(_SEED)
        for first in range(0, count, window):
            last = min(count, first + window)
            low, high = max(0, first - _MARGIN), min(count, last + _MARGIN)
            chain = FrameChain(
                self._body, costs[low:high], self._times[low:high], self._motion.frames(low, high),
                self._settings.tolerance, ties[low + 1 : high],
            )  # fmt: skip
            frames = chain.of_frames(q[low:high])
            own = chain.draw(q[low:high], moved.shape[1], rng, frames).transpose(0, 2, 1)
            moved[low:high] += _faded(np.arange(low, high), first, last, window, count)[:, None, None] * own
            prior = np.array([self._prior.at(pose).hessian for pose in q[low:high]])
            yield from chain.covariances(q[low:high], self._settings.lasting, prior, frames)[first - low : last - low]

    def weights(
        self, q: Sequence[np.ndarray], energies: Sequence[np.ndarray], between: MotionPrior
    ) -> list[np.ndarray]:
        """See `path_weights`: of modes q (T) of (K, nq) with energies (T) of (K,); between: the prior between them."""
        dt = np.maximum(np.diff(self._times), SHORTEST_STEP)
        shares = frame_shares(dt, self._settings.lasting)
        counted = [share * energy for share, energy in zip(shares, energies, strict=True)]
        between = between._replace(correlation=max(between.correlation, _MOVEMENT))
        return path_weights(self._body, q, counted, self._times, between)


def _faded(frames: np.ndarray, first: int, last: int, window: int, count: int) -> np.ndarray:
    """Weights of a window's draws in frames (n,) of `count`: 1 within the window, 0 far from it. About its ends they
    rise and fall so that the squares of both windows' add up to one."""
    half = min(_MARGIN, window // 2)
    weight = ((frames >= first - half) & (frames < last + half)).astype(float)
    for end, turned in ((first, np.sin), (last, np.cos)):
        if 0 < end < count and half:
            ramp = np.arange(end - half, min(end + half, count))
            own = np.isin(frames, ramp)
            weight[own] *= turned(0.5 * np.pi * (frames[own] - ramp[0] + 0.5) / len(ramp))
    return weight
