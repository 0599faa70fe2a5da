"""Runs of the failure table: CSS as it is, every other tracker with as much processor time a frame."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from benchmarks.common import tell
from benchmarks.scores import Outcome, outcome
from benchmarks.sequences import Task, rendered, track_clip
from estimator.tracking.registry import TRACKERS, changes_for, settings_for
from kinemode.rendering.files import RenderedClip
from kinemode.settings import choose

CSS = "css"
SIZES = {
    "css": "css.budget.searches",
    "multiple_hypothesis": "multiple_hypothesis.starts",
    "condensation": "condensation.particles",
    "annealed": "annealed.particles",
}
"""By group of settings, the one that says how much a tracker does in a frame: time grows with it in a straight line."""
TRIAL = (0.1, 0.4)
"""The sizes that are tried, as shares of a tracker's own."""
EQUAL = 1.15  # times that differ by less count as equal
FARTHEST = 3.0  # a line through two short trials is not followed further, in terms of what would be in proportion


@dataclass(frozen=True)
class Attempt:
    """One tracker on one clip.

    size: its setting of `SIZES`, None where it has none. cpu: seconds of processor time a frame. times: `cpu` in
    terms of CSS's. frames, fps: of the clip.
    """

    tracker: str
    size: int | None
    cpu: float
    times: float
    frames: int
    outcome: Outcome


@dataclass(frozen=True)
class Race:
    """A tracker on a rendered clip with a budget of processor time a frame [s]; `trial` frames decide its size."""

    task: Task
    clip: RenderedClip
    tracker: str
    budget: float
    trial: int


def css_run(task: Task) -> tuple[RenderedClip, Attempt]:
    """Render the clip and track it with CSS, whose time is everybody's."""
    clip = rendered(task)
    attempt = _attempt(task, clip, CSS, None, None)
    return clip, attempt


def race(r: Race) -> Attempt:
    """Track with the size that takes about the budget: by trial, and once more where the whole clip took other time."""
    own = own_size(r.tracker, r.task.how["settings"])
    if own is None:
        return _attempt(r.task, r.clip, r.tracker, None, r.budget)
    sizes = [max(1, round(share * own)) for share in TRIAL]
    times = [_tried(r, size) for size in sizes]
    size = size_for(r.budget, sizes, times)
    attempt = _attempt(r.task, r.clip, r.tracker, size, r.budget)
    if 1.0 / EQUAL <= attempt.times <= EQUAL:
        return attempt
    better = size_for(r.budget, [sizes[0], size], [times[0], attempt.cpu])
    return _attempt(r.task, r.clip, r.tracker, better, r.budget)


def own_size(tracker: str, changes: Mapping[str, Any]) -> int | None:
    """A tracker's size by its own settings with these changes, None where it has none."""
    group = TRACKERS[tracker].group
    if group not in SIZES:
        return None
    own = settings_for(tracker, changes=changes_for(tracker, changes)).own
    return int(attrgetter(SIZES[group].removeprefix(f"{group}."))(own))


def resized(tracker: str, changes: Mapping[str, Any], size: int | None) -> dict[str, Any]:
    """The changes to the settings that also give a tracker its size."""
    changed = deepcopy(dict(changes))
    if size is not None:
        *groups, name = SIZES[TRACKERS[tracker].group].split(".")
        place = changed
        for group in groups:
            place = place.setdefault(group, {})
        place[name] = size
    return changed


def size_for(budget: float, sizes: list[int], times: list[float]) -> int:
    """The size that takes `budget` on the straight line through two that took these times; at least 1."""
    (small, large), (quick, slow) = sizes, times
    proportional = large * budget / max(slow, 1e-9)
    if (slow - quick) * (large - small) <= 0.0:  # too quick to tell
        return max(1, round(proportional))
    on_line = small + (budget - quick) * (large - small) / (slow - quick)
    return max(1, round(min(on_line, FARTHEST * proportional)))


def _tried(r: Race, size: int) -> float:
    """Processor time a frame [s] with this size."""
    _, times = track_clip(r.task, r.clip, f"{r.tracker}-trial", frames=r.trial, **_how(r.task, r.tracker, size))
    return times.cpu


def _attempt(task: Task, clip: RenderedClip, tracker: str, size: int | None, budget: float | None) -> Attempt:
    run, times = track_clip(task, clip, tracker, **_how(task, tracker, size))
    scored = outcome(run, times, clip.truth)
    share = times.cpu / budget if budget else 1.0
    sized = "" if size is None else f" of size {size}"
    lost = scored.errors["smoothed"].lost
    ending = "to the end" if lost is None else f"lost in frame {lost}"
    tell(f"{task.label}: {tracker}{sized}, {1e3 * times.cpu:.0f} ms a frame, {share:.2f} of CSS's, {ending}")
    return Attempt(tracker, size, times.cpu, share, len(run), scored)


def _how(task: Task, tracker: str, size: int | None) -> dict[str, Any]:
    """Arguments of `timed_track` beside the task's: the settings that have an effect; modes are asked for of CSS alone,
    the others keep their own."""
    modes = task.how["modes"] if TRACKERS[tracker].group == TRACKERS[CSS].group else None
    changes = resized(tracker, changes_for(tracker, task.how["settings"]), size)
    settings = choose(tracker, changes).used(fits=False)
    return {"tracker": tracker, "settings": settings, "modes": modes}
