"""A source's motion on a body, from landmarks to configurations, with the source's other hypotheses as its spread."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from estimator.data.sequence import Progress
from estimator.retargeting.contacts import SourceContacts, source_contacts, with_standing
from estimator.retargeting.correspondence import Correspondence, check_correspondence, common_correspondence
from estimator.retargeting.following import best_branch, best_start, follow, searched, start_from
from estimator.retargeting.problem import TRUST, MotionProblem, Obstacles, RetargetSettings, constrained_step
from estimator.retargeting.source import SourceMotion
from estimator.retargeting.stances import SIDES_PARTS, stances_at
from estimator.retargeting.targets import Targets, targets_of
from estimator.retargeting.windows import improve
from humanoid.kinematics.body import Body

_STEPS = 8


@dataclass(frozen=True)
class SourceHypotheses:
    """The other hypotheses of a source's frames: points (T, K, L, 3) [m] of its landmarks, NaN where there are fewer;
    weight (T, 1 + K), that of the motion itself first."""

    points: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True)
class CarriedHypotheses:
    """q (T, K, nq), NaN where the source has fewer; energy (T, K), of directions and places; weight (T, 1 + K), that of
    the motion itself first."""

    q: np.ndarray
    energy: np.ndarray
    weight: np.ndarray


def carried_hypotheses(
    problem: MotionProblem,
    q: np.ndarray,
    source: SourceMotion,
    match: Correspondence,
    floor: float | None,
    others: SourceHypotheses,
) -> CarriedHypotheses:
    """Each hypothesis of each frame on the body, searched from the motion q (T, nq) within limits and clear of parts
    and floor; feet that stand stay where they stand in the motion."""
    count = others.points.shape[1]
    carried, energy = np.full((len(q), count, problem.body.nq), np.nan), np.full((len(q), count), np.nan)
    scaled = replace(match, scale=problem.targets.scale)
    for k in range(count):
        own = replace(source, points=others.points[:, k])
        targets = targets_of(problem.body, own, scaled, floor)
        case = problem.with_targets(targets, _feet(problem, targets))
        for t in np.flatnonzero((targets.weight > 0.0).any(axis=1)):
            carried[t, k], _ = searched(case, q[t], frame=int(t), steps=_STEPS)
            energy[t, k] = case.model(int(t), carried[t, k]).value
    return CarriedHypotheses(carried, energy, others.weight)


def _feet(problem: MotionProblem, targets: Targets) -> np.ndarray:
    """Places of the feet (T, F, 3, 3): where they stand in the motion, or where the hypothesis has them."""
    stands = np.asarray(problem.stances.stands.any(axis=2))[:, :, None, None]
    return np.where(stands, problem.stances.place, targets.place)


_SWEEPS = 40
_HELD = 30.0  # rad/s^2 or m/s^2: standard deviation of what a frame moves away from where it is, as an acceleration
_ALONE = 1.0 / 30.0  # s: for which a frame without neighbours moves


@dataclass(frozen=True)
class RetargetedMotion:
    """q (T, nq) at times (T,) [s]. energy (T,): of directions and places. keeps (T,) bool: frames that keep to all they
    have to, after a final check: stances, parts and the floor within `KEPT`; the others are as near as the solver came.
    overlap (T,) [m]: the deepest of parts, 0 without any. contacts: of the source. targets: what the body was led to.
    stands (T, F, 2) bool: heel and toe of its feet. others: the source's other hypotheses, if requested."""

    q: np.ndarray
    times: np.ndarray
    energy: np.ndarray
    keeps: np.ndarray
    overlap: np.ndarray
    contacts: SourceContacts
    targets: Targets
    stands: np.ndarray
    notes: tuple[str, ...]
    others: CarriedHypotheses | None = None


def retarget_motion(
    body: Body,
    source: SourceMotion,
    match: Correspondence | None = None,
    *,
    settings: RetargetSettings | None = None,
    seed: int = 0,
    others: SourceHypotheses | None = None,
    standing: Mapping[str, np.ndarray] | None = None,
    start: np.ndarray | None = None,
    progress: Progress | None = None,
) -> RetargetedMotion:
    """A source's motion on a body: frame by frame from the best of several starts, then in windows.

    standing: whether points of the source's soles stand (T,) bool, by name, where that is known. others: hypotheses of
    the source to carry through. start (nq,): what the first frame is searched from, in place of several; it need not be
    within the limits. match: by the landmarks' names unless given. Gaps of the source are to be filled before; what is
    missing then is ignored.

    Raises
    ------
    InputError: nothing corresponds, or a landmark that the correspondence names is missing.
    """
    settings = settings or RetargetSettings()
    contacts = contacts_of(source, standing)
    problem = problem_of(body, source, match, settings, contacts)
    if start is None:
        first = best_start(problem, np.random.default_rng(seed), settings.starts)
    else:
        first = start_from(problem, start)
    if settings.rounds:
        done = improve(problem, best_branch(problem, first, progress))
    else:
        done = follow(problem, first, progress).q
    made = _with_notes(problem, *mend(problem, done), source, contacts)
    if others is None:
        return made
    match = match or common_correspondence(body.landmark_names, source.names)
    carried = carried_hypotheses(problem, made.q, source, match, made.contacts.floor, others)
    return replace(made, others=carried)


def _with_notes(
    problem: MotionProblem, q: np.ndarray, keeps: np.ndarray, source: SourceMotion, contacts: SourceContacts
) -> RetargetedMotion:
    """A motion with its figures, recomputed from its configurations."""
    energy, overlap = np.empty(len(q)), np.zeros(len(q))
    for t, each in enumerate(q):
        model = problem.model(t, each)
        energy[t] = model.value
        if problem.collision is not None:
            overlap[t] = problem.collision.penetration(model.posed)
    targets = problem.targets
    no_floor = contacts.floor is None
    notes = [*source.notes, *([contacts.note] if contacts.note and (targets.feet or no_floor) else [])]
    if problem.body.has_free_root and not targets.feet and not (no_floor and contacts.names):
        notes.append("the subject or the source has no feet: nothing is held on a floor")
    return RetargetedMotion(
        q, source.times, energy, keeps, overlap, contacts, targets, problem.stances.stands, tuple(notes)
    )


def contacts_of(source: SourceMotion, standing: Mapping[str, np.ndarray] | None = None) -> SourceContacts:
    """When the source's feet stand: as found, or where it is given (T,) bool by the points' names."""
    own = source_contacts(source, feet_alone=standing is not None)
    return own if standing is None else with_standing(own, standing)


def problem_of(
    body: Body,
    source: SourceMotion,
    match: Correspondence | None,
    settings: RetargetSettings,
    contacts: SourceContacts | None = None,
    obstacles: Obstacles | None = None,
) -> MotionProblem:
    """The problem of moving a body as a source does; contacts: found unless given; obstacles: made
    unless given."""
    match = match or common_correspondence(body.landmark_names, source.names)
    check_correspondence(match, body.landmark_names, source.names)
    contacts = contacts or contacts_of(source)
    stands = stands_of(contacts, len(source.times))
    targets = targets_of(body, source, match, contacts.floor, np.asarray(stands.all(axis=2)))
    stances = stances_at(targets.feet, targets.place, stands[:, [foot.number for foot in targets.feet]], source.times)
    return MotionProblem(body, targets, stances, source.times, settings, obstacles)


def stands_of(contacts: SourceContacts, frames: int) -> np.ndarray:
    """Whether heel and toe stand (T, 2, 2) bool, of the left foot and the right one."""
    stands = np.zeros((frames, 2, 2), dtype=bool)
    for k, name in enumerate(contacts.names):
        side, part = SIDES_PARTS[name]
        stands[:, side, part] = contacts.standing[:, k]
    return stands


def mend(problem: MotionProblem, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The final check of a motion: q (T, nq) with the frames that do not keep to their rows moved until they do, each
    within what the velocities to its neighbours leave it; these move along where that is too little. And which keep to
    them (T,) then."""
    q = q.copy()
    bad = np.array([not problem.keeps(t, each) for t, each in enumerate(q)], dtype=bool)
    for sweep in range(_SWEEPS):
        if not bad.any():
            break
        wide = bad if sweep % 2 == 0 else bad | np.r_[bad[1:], False] | np.r_[False, bad[:-1]]
        for t in np.flatnonzero(wide)[:: 1 if sweep % 4 < 2 else -1].tolist():
            q[t], bad[t] = _mended(problem, q, t)
    return q, ~bad


def _mended(problem: MotionProblem, q: np.ndarray, t: int) -> tuple[np.ndarray, bool]:
    """Frame t after one step, and whether it still does not keep to its rows."""
    body = problem.body
    model = problem.model(t, q[t])
    dt = float(problem.dt[min(t, len(problem.dt) - 1)]) if len(problem.dt) else _ALONE
    hessian = model.hessian
    hessian[np.diag_indices(body.nv)] += 1.0 / (_HELD * problem.stiff / problem.stiff.max() * dt**2) ** 2
    box = problem.box(q[t], t, q[t - 1] if t > 0 else None, q[t + 1] if t + 1 < len(q) else None)
    step, _ = constrained_step(hessian, model.gradient, np.clip(box, -TRUST, TRUST), problem.rows(t, model))
    moved = body.integrate(q[t], step)
    return moved, not problem.keeps(t, moved)
