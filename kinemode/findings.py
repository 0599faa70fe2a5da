"""Findings of a run: its frames' statuses with their meaning, and contradictions with its subject or input."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from estimator.data.cameras.camera import nearest_axis
from estimator.data.observation import Observation
from estimator.data.standing import StandingPoints
from estimator.energy.balance import Balance, BalanceSettings, balance_terms
from estimator.fitting.fit import bound_note
from estimator.inference.contacts import floor_of, height_above, is_believed
from estimator.numerics.stretches import stretches
from estimator.numerics.vectors import mean_direction
from estimator.runs.contact import contact_of_run
from estimator.runs.diagnosis import Diagnosis, contradicted, diagnose
from estimator.runs.run_reader import Run
from estimator.search.jumps.readings import trunk_depths
from estimator.trackers.frame_result import STATUS_MEANINGS, TRACKED
from estimator.tracking.leaps import leap_note, leaps, limb_leaps, limb_note
from estimator.tracking.registry import TRACKERS
from humanoid.support.errors import first_of
from kinemode.explain import run_settings
from kinemode.initialisation import (
    note_on_beginning,
)

_STEADY, _UPRIGHT = 0.8, 0.5  # length of the mean direction of a person who does not turn over; its part along z
_DOUBTFUL, _LONG = 0.1, 0.3  # probability of the other reading of the trunk, and for how long [s], to be noted
_DEEP = 0.1  # m: depth of the shoulders beyond the hips of a trunk that leans
_FIRST = 5  # frames that are named
_FAR = 5.7
"""Standard deviations from over the feet that one in a hundred captured instants on both feet exceeds, sitting,
acrobatics and jumps among them (`python -m benchmarks balance`)."""
_STAYS = 0.5  # s
_HELD = 0.5  # probability of sitting from which a person is held


def findings(run: Run) -> tuple[str, ...]:
    """Contradictions between a run and its subject or input, with remedies, a sentence each: as stored when it was
    finished; diagnosed where it is not, or was made before that was stored."""
    return diagnosed(run).sentences if run.header.findings is None else run.header.findings


def diagnosed(run: Run, frame: int | None = None) -> Diagnosis:
    """Contradictions with subject or input, of one frame or of the run."""
    settings = run_settings(run)
    limited = TRACKERS[run.header.tracker].keeps_limits(settings.own)
    return diagnose(run, settings.cost, frame, limited=limited)


def upright_note(run: Run, R_upright_points: np.ndarray | None = None, *, has_world: bool = True) -> str:
    """Warning about a person who does not stand along z, empty where one does, or that is unknown.

    Exports, gait and previews use z as up; angles do not depend on it. R_upright_points (3, 3): how the axes of files
    of points were turned, None for the run's own world, or that of its cameras. has_world: whether --up can be given.
    """
    names = run.body.landmark_names
    if not run.body.has_free_root or not {"head_top", "left_ankle", "right_ankle"} <= set(names):
        return ""
    head, left, right = (run.landmarks[:, names.index(n)] for n in ("head_top", "left_ankle", "right_ankle"))
    mean = mean_direction(head - 0.5 * (left + right))
    if np.linalg.norm(mean) < _STEADY or mean[2] > _UPRIGHT:
        return ""
    here = nearest_axis(mean)
    stands = f"the person does not stand along z, but about along {here}: trc, mot, c3d and osim, gait and the preview"
    if not has_world:
        return f"{stands} use z as up. If the film lies on its side, turn it, or give a camera file with the axis"
    R_upright_file = run.header.R_upright_given if R_upright_points is None else R_upright_points
    there = here if R_upright_file is None else nearest_axis(R_upright_file.T @ mean)
    whose = "the cameras' world" if R_upright_points is None else "the file"
    return f"{stands} use z as up. If {there} points up in {whose}, track with --up {there}"


def reading_note(run: Run) -> str:
    """Note on stretches in which a trunk that leans may lean the other way, empty where none does."""
    open_frames = run.other_reading > _DOUBTFUL
    if not open_frames.any():
        return ""
    rows = np.flatnonzero(open_frames)
    open_frames[rows] = np.abs(trunk_depths(run.body, run.q[rows], run.header.cameras[0])) > _DEEP
    doubtful = [s for s in stretches(open_frames) if run.time[s[1] - 1] - run.time[s[0]] >= _LONG]
    if not doubtful:
        return ""
    spans = [f"{run.time[first]:.1f} to {run.time[after - 1]:.1f} s" for first, after in doubtful]
    listed = ", ".join(spans[:_FIRST]) + (f" and {len(spans) - _FIRST} more" if len(spans) > _FIRST else "")
    most = max(float(run.other_reading[first:after].max()) for first, after in doubtful)
    return (
        f"the trunk may lean the other way, towards the camera or away from it, from {listed} (up to {most:.0%}): one"
        " camera before or behind a person leaves that open, one 20 degrees aside does not"
    )


def balance_note(run: Run, rows: Sequence[int]) -> str:
    """Warning about frames (see `out_of_balance`) in which the person would fall over."""
    first, last = run.time[rows[0]], run.time[rows[-1]]
    return (
        f"in {len(rows)} frames from {first:.1f} to {last:.1f} s both feet stand but the centre of mass is far from"
        " over them: the person may lean on something or be held, else the trunk's depth or up is wrong: check"
        " that the camera is level, or give --up with a camera file"
    )


def floor_note(run: Run) -> str:
    """Warning about a floor that is not where the person is, empty without one."""
    known = run.header.floor
    if known is None and run.floor is None:
        return _raised_note(run)
    floor = floor_of(run.body, run.header.cameras, known)
    height = np.nan if floor is None else height_above(floor, run.body, run.q)
    if is_believed(height):
        return ""
    where = f"{abs(height):.1f} m {'above' if height > 0.0 else 'below'}"
    problem = f"the floor is given at {known:g} m, and the person's lowest part is {where} it, so it was not used"
    return f"{problem}: check --floor, and whether the cameras' unit is the metre"


def _raised_note(run: Run) -> str:
    contact = contact_of_run(run)
    if contact is None or contact.raised is None:
        return ""
    return (
        f"the feet rest at {contact.raised.height:.2f} m and the body lies below, so no floor was put under them: give"
        " its height with --floor, or off"
    )


def far_note(rows: Sequence[int]) -> str:
    """Warning about frames whose keypoints or markers lie far from the body, empty without."""
    if not len(rows):
        return ""
    count = f"{len(rows)} frame{'s' * (len(rows) != 1)} ({first_of(rows, _FIRST)})"
    return f"keypoints or markers lie far from the body in {count}, which are marked hard: check them in the overlay"


def status_counts(statuses: Iterable[str]) -> str:
    """The number of frames of each status, as "98 tracked, 2 hard"."""
    return ", ".join(f"{count} {status}" for status, count in Counter(statuses).most_common())


def status_meanings(statuses: Iterable[str]) -> list[str]:
    """One line for each of these statuses that needs explanation."""
    given = set(statuses)
    return [f"{name}: {meaning}" for name, meaning in STATUS_MEANINGS.items() if name in given and name != TRACKED]


def status_lines(statuses: Sequence[str]) -> list[str]:
    """The same for all frames of a run, with the numbers of the first frames concerned."""
    lines = []
    for name in STATUS_MEANINGS:
        frames = [str(t) for t, status in enumerate(statuses) if status == name]
        if frames and name != TRACKED:
            more = f" and {len(frames) - _FIRST} more" if len(frames) > _FIRST else ""
            lines.append(f"{name} (frame {', '.join(frames[:_FIRST])}{more}): {STATUS_MEANINGS[name]}")
    return lines


def out_of_balance(run: Run, settings: BalanceSettings) -> tuple[int, ...]:
    """Rows of tracked frames of `Run.q`, ascending, in which both feet stand and the centre of mass stays far from
    above them for half a second, while the person does not seem to sit."""
    if not run.has_keypoints or settings.weight <= 0.0:
        return ()
    far = np.zeros(len(run), dtype=bool)
    for t, observation in enumerate(_resting(run)):
        if run.status[t] == TRACKED and observation.seated < _HELD and np.isfinite(run.q[t]).all():
            terms = balance_terms(run.body, observation, settings)
            far[t] = any(b.stance.feet == 2 and b.deviations(run.body.at(run.q[t])) > _FAR for b in terms)
    rows = [np.arange(*s) for s in stretches(far) if run.time[s[1] - 1] - run.time[s[0]] >= _STAYS]
    return tuple(int(t) for t in np.concatenate(rows)) if rows else ()


def _resting(run: Run) -> Iterator[Observation]:
    """The observation of each frame, with the points at rest in it."""
    points = StandingPoints(run.body.landmark_names)
    for t in range(len(run)):
        observation = run.observation(t)
        yield points.with_rest(observation)
        points.add(observation)


def run_findings(
    run: Run, cause: Callable[[], str] = lambda: "", **of_world: Any
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Contradictions between a complete run and its subject or input, and the rows of the frames that each
    speaks against. cause: called for the likely one where keypoints and landmarks do not belong together. of_world: see
    `upright_note`."""
    leapt, limbs = leap_note(leaps(run.body, run.streamed())), limb_leaps(run.body, run.landmarks, run.time)
    own = [leapt, limb_note(limbs), bound_note(run.subject), upright_note(run, **of_world)]
    diagnosis, cost = diagnosed(run), run_settings(run).cost
    falling, far = out_of_balance(run, cost.terms[Balance.name]), contradicted(run, cost)
    own += [balance_note(run, falling) if falling else "", reading_note(run)]
    against: Sequence[int] = far
    if diagnosis.contradicts_input:
        because = cause()
        own.insert(0, because)
        against = range(len(run)) if because else far
    else:
        own.append(far_note(far))
    notes = [note for note in (*own, *diagnosis.sentences, floor_note(run)) if note]
    against = sorted({*against, *falling, *limbs})
    return (*note_on_beginning(run.header.tracker, run.paths()), *notes), tuple(against)
