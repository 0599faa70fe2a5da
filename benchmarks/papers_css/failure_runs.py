"""Runs of the failure table: CSS, and every other tracker with as much processor time a frame, all smoothed alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from operator import attrgetter
from typing import Any

import numpy as np

from benchmarks.papers_css.sequences import Task, rendered, track_clip
from benchmarks.support.result_store import Figures, ResultStore, removed
from benchmarks.support.scores import Outcome, TrackErrors, outcome
from estimator.trackers.base import capabilities_of
from estimator.tracking.registry import TRACKERS, Settings, changes_for, make_tracker, settings_for
from estimator.tracking.smoothing import SmoothSettings
from humanoid.support.errors import InputError
from kinemode.settings import choose
from kinemode.shot import RenderedClip

CSS = "css"
SIZES = {
    "css": "css.budget.searches",
    "css_dual": "css_dual.budget.searches",
    "multiple_hypothesis": "multiple_hypothesis.starts",
    "condensation": "condensation.particles",
    "annealed": "annealed.particles",
}
"""By group of settings, the one that sets the work of a tracker per frame: time grows linearly with it."""
TRIAL = (0.1, 0.4)
"""The sizes that are tried, as shares of a tracker's own."""
EQUAL = 1.15  # times that differ by less count as equal
FARTHEST = 3.0  # a line through two short trials is not followed further, in terms of what would be in proportion


@dataclass(frozen=True)
class Attempt:
    """One tracker on one clip.

    size: its setting of `SIZES`, None where that was left to it. cpu: seconds of processor time a frame, of tracking
    alone. frames: of the clip. smooths: whether its hypotheses have energies that smoothing can use; where not, the
    smoothed trajectory is the filtered path.
    """

    tracker: str
    motion: str
    clip_seed: int
    seed: int
    size: int | None
    cpu: float
    frames: int
    smooths: bool
    outcome: Outcome

    @staticmethod
    def of(figures: Figures) -> Attempt:
        """From JSON."""
        scored = figures["outcome"]
        errors = {name: TrackErrors(**e) for name, e in scored["errors"].items()}
        return Attempt(**figures | {"outcome": Outcome(errors, scored["fps"], tuple(scored["notes"]))})

    @property
    def clip(self) -> tuple[str, int]:
        """Which of all clips."""
        return self.motion, self.clip_seed

    @property
    def key(self) -> tuple[str, int, int]:
        """The key that another tracker's run must share to be compared with it."""
        return self.motion, self.clip_seed, self.seed


@dataclass(frozen=True)
class Tracking:
    """A piece of work: a tracker on a rendered clip.

    The task's `how` has the cues, the modes that css and css-paper keep, and changes to the settings. size: see
    `Attempt`.
    """

    task: Task
    tracker: str
    seed: int
    size: int | None = None

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"{self.task.motion}_{self.task.clip_seed}_{self.tracker}_{self.seed}"

    @property
    def what(self) -> dict[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        t = self.task
        return {
            "motion": t.motion, "clip_seed": t.clip_seed, "seconds": t.seconds, "plate": t.plate,
            "detected": t.detected, "cues": t.how["cues"], "tracker": self.tracker, "seed": self.seed,
            "settings": self.settings.to_dict(),
        }  # fmt: skip

    @property
    def settings(self) -> Settings:
        """All of them."""
        return settings_for(self.tracker, modes=self._modes, changes=self._changes)

    def prepare(self) -> RenderedClip:
        """Render the clip unless it is there."""
        return rendered(self.task)

    def work(self, store: ResultStore) -> Figures:
        """The `Attempt`; the run itself is not kept."""
        out, clip = store.scratch(self, ".run"), self.prepare()
        run, times = track_clip(self.task, clip, out, **self.how)
        smooths = capabilities_of(make_tracker(self.tracker, run.body, self.settings)).energy is not None
        scored = outcome(run, times, clip.truth)
        t, cpu = self.task, times.cpu_tracking
        attempt = Attempt(self.tracker, t.motion, t.clip_seed, self.seed, self.size, cpu, len(run), smooths, scored)
        removed(out)
        return asdict(attempt)

    def tried(self, store: ResultStore, frames: int) -> float:
        """Processor time a frame [s] of the first frames alone."""
        out = store.scratch(self, "_trial.run")
        _, times = track_clip(self.task, self.prepare(), out, frames=frames, **self.how)
        removed(out)
        return times.cpu_tracking

    @property
    def how(self) -> dict[str, Any]:
        """Arguments of `timed_track` beside the task's."""
        return {"tracker": self.tracker, "seed": self.seed, "settings": self._changes, "modes": self._modes}

    @property
    def _modes(self) -> int | None:
        """They are set for CSS alone, the others keep their own number."""
        return self.task.how["modes"] if TRACKERS[self.tracker].group == TRACKERS[CSS].group else None

    @property
    def _changes(self) -> dict[str, Any]:
        """Those that have an effect, and the same smoothing switched on for all."""
        changes = resized(self.tracker, changes_for(self.tracker, self.task.how["settings"]), self.size)
        alike = {"enabled": True, "overconfidence": SmoothSettings().overconfidence}
        changes["smooth"] = alike | changes.get("smooth", {})
        return choose(self.tracker, changes).used(fits=False)


@dataclass(frozen=True)
class Sizing:
    """A piece of work: the size of a tracker for which a frame takes as long as CSS's on this clip.

    rival: its run without a size. css: the runs of CSS whose mean time it is, done before. trial: frames of the short
    runs that it is guessed from.
    """

    rival: Tracking
    css: tuple[Tracking, ...]
    trial: int

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"{self.rival.name}_size"

    @property
    def what(self) -> dict[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return {"size of": self.rival.what, "in the time of": [run.what for run in self.css], "trial": self.trial}

    def work(self, store: ResultStore) -> Figures:
        """The size, from trials, and from a run over the whole clip where that takes other time."""
        own = own_size(self.rival.tracker, self.rival.task.how["settings"])
        assert own is not None
        budget = mean_time([Attempt.of(store.of(run)) for run in self.css])
        sizes = [max(1, round(share * own)) for share in TRIAL]
        times = [self._sized(size).tried(store, self.trial) for size in sizes]
        size = size_for(budget, sizes, times)
        cpu = Attempt.of(store.of(self._sized(size))).cpu
        if not 1.0 / EQUAL <= cpu / budget <= EQUAL:
            size = size_for(budget, [sizes[0], size], [times[0], cpu])
        return {"size": size}

    def _sized(self, size: int) -> Tracking:
        return Tracking(self.rival.task, self.rival.tracker, self.rival.seed, size)


def mean_time(attempts: Sequence[Attempt]) -> float:
    """Processor time a frame [s]. Raises InputError where the clips are too short to measure."""
    mean = float(np.mean([attempt.cpu for attempt in attempts]))
    if not np.isfinite(mean):
        raise InputError("--seconds", "leaves too few frames to measure the time per frame", remedy="5 frames or more")
    return mean


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
    if (slow - quick) * (large - small) <= 0.0:  # too fast to measure
        return max(1, round(proportional))
    on_line = small + (budget - quick) * (large - small) / (slow - quick)
    return max(1, round(min(on_line, FARTHEST * proportional)))
