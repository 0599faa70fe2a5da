"""The smoothest motion that the whole clip supports: all frames of the best path estimated together.

A filter has only the past to hold on to, and one camera sees depth so badly that single poses scatter along it. Here
the poses of the path minimise the sum of the frames' own energies and of a motion prior, long-tailed, on velocities and
accelerations in the tangent space; the modes, and so all decisions between interpretations, stay those of the tracker
(CSS footnote 2). Newton's method on the block-banded system, joint limits as bounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.linalg import solveh_banded

from estimator.cost.kernels import LORENTZIAN, robust_square
from estimator.cost.model import per_dof
from estimator.cost.priors import Transition
from estimator.cost.term import Cost
from estimator.filtering.paths import backtrack_results
from estimator.frame_result import FrameResult
from estimator.imaging.observation import Observation
from estimator.runner import Cues, Progress
from estimator.search.contact import separate
from estimator.search.covariance import free_mask
from estimator.search.mode_search import ModeSearch
from estimator.search.seek import Found
from estimator.trackers.tracker import observable
from humanoid.body import Body

NEAR = 0.05  # rad or m: how far parting two limbs may move the smoothed pose
TAIL = 8.0  # nu of the Lorentzian (`estimator.cost.potentials`): a sudden movement is dear but possible


@dataclass(frozen=True)
class SmoothSettings:
    """Motion prior and effort.

    turn_acceleration, root_turn_acceleration [rad/s^2], root_slide_acceleration [m/s^2]: standard deviations of the
    accelerations of joints, of the root's orientation and of its position. The velocities' are those of the transition
    (`CostSettings`). iterations: Newton steps at most. tolerance: energy a step must gain. window: frames solved at
    once, which bounds the memory on long clips. enabled: off leaves the path as the tracker chose it.
    """

    enabled: bool = True
    turn_acceleration: float = 10.0
    root_turn_acceleration: float = 5.0
    root_slide_acceleration: float = 2.5
    iterations: int = 30
    tolerance: float = 1e-3
    window: int = 240


def smooth_track(
    search: ModeSearch,
    observations: Sequence[Observation],
    results: Sequence[FrameResult],
    settings: SmoothSettings | None = None,
    *,
    cues: Cues | None = None,
    progress: Progress | None = None,
) -> np.ndarray:
    """Smoothed configurations (T, nq) of the best path through the results, NaN where a frame has no hypothesis.

    Each frame's keypoints are read as the path's mode reads them, `cues` are what its pictures show. Parts that the
    smoothing pushed into each other are parted again (`estimator.search.contact`). `progress` is told how many frames
    of how many are done.
    """
    body, path = search.body, backtrack_results(results)
    q = np.full((len(results), body.nq), np.nan)
    some = [t for t, k in enumerate(path.tolist()) if k >= 0]
    if not some:
        return q
    costs = [_frame_cost(search, observations[t], results[t], int(path[t]), cues) for t in some]
    times = np.array([observations[t].time for t in some])
    start = np.array([results[t].q[path[t]] for t in some])
    found = smooth(body, costs, times, start, search.model.transition_std(1.0), settings, progress)
    q[some] = [_parted(search, cost, x) for cost, x in zip(costs, found, strict=True)]
    return q


def _frame_cost(search: ModeSearch, observation: Observation, result: FrameResult, k: int, cues: Cues | None) -> Cost:
    """Static energy of a frame as its hypothesis k sees it; image features stay assigned as they are there."""
    if cues is not None:
        observation = replace(observation, cues=cues.at(observation.index))
    if not observable(observation):
        return search.model.cost(None)
    evidence = search.evidence(observation, result.q[k])
    assigned = [] if evidence is None else evidence.assigned(search.body.at(result.q[k]))
    return search.model.cost(search.term(observation, result.association[k]), image_terms=assigned)


def _parted(search: ModeSearch, cost: Cost, q: np.ndarray) -> np.ndarray:
    """q (nq,) itself unless parts overlap, else a pose near it where they do not."""
    body = search.body
    contact = search.settings.contact
    if search.clearance is None or search.clearance.penetration(body.at(q)) <= contact.tolerance:
        return q
    held = Cost(body, [*cost.terms, Transition(body, q, np.full(body.nv, NEAR))])
    found = Found(held.at(q), "stalled", np.inf, 0)
    return separate(search.seeker, search.clearance, held, found, contact).q


def smooth(
    body: Body,
    costs: Sequence[Cost],
    times: np.ndarray,
    q: np.ndarray,
    velocity_std: np.ndarray,
    settings: SmoothSettings | None = None,
    progress: Progress | None = None,
) -> np.ndarray:
    """Smoothed configurations (T, nq), within the limits; the total energy is never higher than at `q`.

    costs (T): static energy of each frame. times (T,) [s], rising. q (T, nq): the path. velocity_std (nv,): standard
    deviation of the velocity [per second].
    """
    settings = settings or SmoothSettings()
    q = np.array([body.clamp(x) for x in q])
    half = max(1, settings.window // 2)
    for first in range(0, max(1, len(q) - half), half):
        last = min(len(q), first + settings.window)
        low, high = max(0, first - 2), min(len(q), last + 2)
        held = np.ones(high - low, dtype=bool)
        held[first - low : last - low] = False
        chain = _Chain(body, costs[low:high], times[low:high], velocity_std, settings)
        q[low:high] = chain.descend(q[low:high], held)
        if progress is not None:
            progress(last, len(q))
    return q


class _Chain:
    """Frames tied by the motion prior."""

    def __init__(
        self, body: Body, costs: Sequence[Cost], times: np.ndarray, velocity_std: np.ndarray, settings: SmoothSettings
    ) -> None:
        self._body, self._costs, self._settings = body, costs, settings
        self._dt = np.maximum(np.diff(times), 1e-3)
        self._velocity_precision = 1.0 / np.square(velocity_std)
        acceleration = per_dof(
            body, settings.turn_acceleration, settings.root_turn_acceleration, settings.root_slide_acceleration
        )
        self._acceleration_precision = 1.0 / np.square(acceleration)

    def descend(self, q: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Damped Newton from q (T, nq); the frames in `held` (T,) stay."""
        energy, gradient, blocks = self._model(q)
        damping = 1e-6
        for _ in range(self._settings.iterations):
            step = self._step(q, gradient, blocks, held, damping)
            trial = np.array([self._body.integrate(a, v) for a, v in zip(q, step, strict=True)])
            model = self._model(trial)
            if model[0] < energy:
                gained = energy - model[0]
                q, (energy, gradient, blocks), damping = trial, model, max(1e-9, 0.1 * damping)
                if gained < self._settings.tolerance:
                    break
            else:
                damping *= 10.0
                if damping > 1e6:
                    break
        return q

    def _model(self, q: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Energy, gradient (T, nv), Hessian blocks (3, T, nv, nv): block k couples frame t with frame t + k."""
        count, nv = len(q), self._body.nv
        gradient, blocks = np.zeros((count, nv)), np.zeros((3, count, nv, nv))
        energy = 0.0
        for t, cost in enumerate(self._costs):
            here = cost.at(q[t])
            energy += here.value
            gradient[t] += here.gradient
            blocks[0, t] += here.hessian
        energy += self._motion(q, gradient, blocks)
        return energy, gradient, blocks

    def _motion(self, q: np.ndarray, gradient: np.ndarray, blocks: np.ndarray) -> float:
        model, energy = self._body.model, 0.0
        before: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        for t, dt in enumerate(self._dt):
            v = pin.difference(model, q[t], q[t + 1]) / dt
            J0, J1 = (x / dt for x in pin.dDifference(model, q[t], q[t + 1]))
            energy += _add(v, self._velocity_precision, {t: J0, t + 1: J1}, gradient, blocks)
            if before is not None:
                span = 0.5 * (dt + self._dt[t - 1])
                v_before, J0_before, J1_before = before
                parts = {t - 1: -J0_before / span, t: (J0 - J1_before) / span, t + 1: J1 / span}
                energy += _add((v - v_before) / span, self._acceleration_precision, parts, gradient, blocks)
            before = v, J0, J1
        return energy

    def _step(
        self, q: np.ndarray, gradient: np.ndarray, blocks: np.ndarray, held: np.ndarray, damping: float
    ) -> np.ndarray:
        """Newton step (T, nv) of the variables that neither a limit nor `held` stops."""
        count, nv = gradient.shape
        free = free_mask(self._body, q, gradient) & ~held[:, None]
        blocks = blocks * free[None, :, :, None]
        for k in range(3):
            blocks[k, : count - k] *= free[k:, None, :]
        diagonal = np.einsum("tii->ti", blocks[0])
        diagonal *= 1.0 + damping
        diagonal[~free] = 1.0
        step = solveh_banded(_banded(blocks), np.where(free, -gradient, 0.0).ravel(), lower=True, check_finite=False)
        return np.asarray(step).reshape(count, nv)


def _add(
    e: np.ndarray, precision: np.ndarray, parts: dict[int, np.ndarray], gradient: np.ndarray, blocks: np.ndarray
) -> float:
    """Add the Lorentzian of e' P e, e (nv,) depending on the frames in `parts` through their Jacobians (nv, nv)."""
    pull, weight = np.empty_like(e), np.empty_like(e)
    value: float = robust_square(e, precision, LORENTZIAN, TAIL, False, pull, weight)
    for t, J in parts.items():
        gradient[t] += J.T @ pull
        for s, K in parts.items():
            if s >= t:
                blocks[s - t, t] += J.T @ (weight[:, None] * K)
    return value


def _banded(blocks: np.ndarray) -> np.ndarray:
    """Lower banded form of the symmetric matrix whose blocks (t, t + k) are `blocks[k, t]`."""
    _, count, nv, _ = blocks.shape
    n = count * nv
    bands = np.zeros((3 * nv, n))
    for k in range(3):
        for i in range(nv):  # row of the upper block: variable i of frame t, column j of frame t + k
            for j in range(nv):
                offset = k * nv + j - i
                if offset >= 0:
                    bands[offset, i : n - k * nv : nv] = blocks[k, : count - k, i, j]
    return bands
