"""Trackers by name, with their settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from estimator.cost.model import CostModel, CostSettings
from estimator.imaging.cues import CueSettings
from estimator.search.mode_search import ModeSearch
from estimator.search.settings import ModeSearchSettings
from estimator.smoothing import SmoothSettings
from estimator.trackers.annealed import Annealed, AnnealedSettings
from estimator.trackers.base import Tracker
from estimator.trackers.condensation import Condensation, CondensationSettings
from estimator.trackers.css import PAPER, CovarianceScaledSampling, CssSettings
from estimator.trackers.multiple_hypothesis import MultipleHypothesis, MultipleHypothesisSettings
from estimator.trackers.single_mode import SingleMode, SingleModeSettings
from estimator.tracking.setting_changes import MOST, changed
from humanoid.collision.clearance import Clearance
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError, shown

TRACKERS = {
    "css": "covariance scaled sampling with transitions and exchanged readings",
    "css-paper": "covariance scaled sampling as printed (CSS Figure 6)",
    "spherical": "the same with spherical samples of equal volume (CSS section 7)",
    "gaussian-single-mode": "single mode, Gaussian potentials, no physical constraints (CSS section 6)",
    "robust-single-mode": "robust single mode, no physical constraints (CSS section 6)",
    "single-mode": "robust single mode with joint limits (CSS section 6)",
    "condensation": "particle filter (Isard and Blake 1998)",
    "annealed": "annealed particle filter (Deutscher, Blake and Reid 2000)",
    "multiple-hypothesis": "multiple hypotheses, robust, with constraints (Cham and Rehg 1999, CSS section 6)",
    "gaussian-multiple-hypothesis": "the same with Gaussian potentials and no physical constraints",
}
GROUPS = {
    "css": "css",
    "css-paper": "css",
    "spherical": "css",
    "gaussian-single-mode": "single_mode",
    "robust-single-mode": "single_mode",
    "single-mode": "single_mode",
    "condensation": "condensation",
    "annealed": "annealed",
    "multiple-hypothesis": "multiple_hypothesis",
    "gaussian-multiple-hypothesis": "multiple_hypothesis",
}
"""The group of `Settings` that each tracker goes by."""
GAUSSIAN = ("gaussian-single-mode", "gaussian-multiple-hypothesis")
UNCONSTRAINED = ("gaussian-single-mode", "robust-single-mode", "gaussian-multiple-hypothesis")

NEARLY_GAUSSIAN = 1e4
"""nu, in squared standard deviations, of a cue's potential that is to be Gaussian."""
EDGES_NEARLY_GAUSSIAN = 200.0
"""The same of edges. They are looked for within six standard deviations, where this is Gaussian to 9 %; and nu / 2 is
what a missing edge costs, which must not drown all else."""


_RECIPES: dict[str, Callable[..., Tracker]] = {
    "css": CovarianceScaledSampling,
    "single_mode": SingleMode,
    "condensation": Condensation,
    "annealed": Annealed,
    "multiple_hypothesis": MultipleHypothesis,
}


@dataclass(frozen=True)
class Settings:
    """Everything that decides a track, besides subject, clip and seed.

    cost: the energy. search: how its minima are found. css, single_mode, condensation, annealed, multiple_hypothesis:
    the trackers. smooth: the smoothing after the last frame. cues: what is taken from the pictures.
    """

    cost: CostSettings = field(default_factory=CostSettings)
    search: ModeSearchSettings = field(default_factory=ModeSearchSettings)
    css: CssSettings = field(default_factory=CssSettings)
    single_mode: SingleModeSettings = field(default_factory=SingleModeSettings)
    condensation: CondensationSettings = field(default_factory=CondensationSettings)
    annealed: AnnealedSettings = field(default_factory=AnnealedSettings)
    multiple_hypothesis: MultipleHypothesisSettings = field(default_factory=MultipleHypothesisSettings)
    smooth: SmoothSettings = field(default_factory=SmoothSettings)
    cues: CueSettings = field(default_factory=CueSettings)

    def to_dict(self) -> dict[str, Any]:
        """Plain nested dictionary, as stored in run files."""
        return asdict(self)


def settings_for(
    name: str,
    *,
    modes: int | None = None,
    changes: Mapping[str, Any] | None = None,
    source: str | Path | None = None,
) -> Settings:
    """Defaults of a tracker, then nested `changes` (the layout of `Settings.to_dict`), then `modes`.

    source: the file that the changes are from, for errors.

    Raises
    ------
    InputError: unknown tracker, unknown setting (the valid ones are listed), a value of the wrong kind, or several
        modes of a tracker that keeps one.
    """
    _check_name(name)
    settings = changed(_defaults(name), changes or {}, source)
    if modes is None:
        return settings
    if not 1 <= modes <= MOST:
        raise InputError("modes", f"{shown(modes)} hypotheses cannot be kept", remedy=f"at least 1, at most {MOST}")
    if not keeps_several(name):
        if modes > 1:
            several = ", ".join(n for n in TRACKERS if keeps_several(n))
            raise InputError("modes", f"{name} keeps a single hypothesis", remedy=f"leave it out; several: {several}")
        return settings
    return replace(settings, **{GROUPS[name]: replace(getattr(settings, GROUPS[name]), modes=modes)})


def keeps_several(name: str) -> bool:
    """Whether a tracker can keep several hypotheses."""
    _check_name(name)
    return hasattr(getattr(Settings(), GROUPS[name]), "modes")


def shares_work(name: str, settings: Settings) -> bool:
    """Whether the work on a frame is shared where there are several processes: the searches of many hypotheses, within
    the body's own joint limits."""
    return GROUPS[name] == "css" or (GROUPS[name] == "multiple_hypothesis" and settings.multiple_hypothesis.limits)


def _defaults(name: str) -> Settings:
    settings = Settings()
    if name != "css":  # the trackers of the paper only filter
        settings = replace(settings, smooth=replace(settings.smooth, enabled=False))
    if name not in ("css", "single-mode"):  # the trackers of the papers take keypoints as they are
        settings = replace(settings, search=replace(settings.search, exchange=False))
    if name == "css-paper":
        settings = replace(settings, css=PAPER)
    if name == "spherical":
        settings = replace(settings, css=replace(PAPER, shape="spherical"))
    if name in GAUSSIAN:
        settings = replace(settings, cost=_gaussian(settings.cost))
    if name in UNCONSTRAINED:
        settings = _unconstrained(settings, GROUPS[name])
    return settings


def _gaussian(cost: CostSettings) -> CostSettings:
    """Least squares: no observation ever loses its pull."""
    wide = NEARLY_GAUSSIAN
    image = replace(cost.image, edge_nu=EDGES_NEARLY_GAUSSIAN, outline_nu=wide, flow_nu=wide)
    return replace(cost, potential="gaussian", transition_potential="gaussian", image=image)


def _unconstrained(settings: Settings, group: str) -> Settings:
    """Without the physical constraints: neither joint limits nor parts that keep apart."""
    free = replace(getattr(settings, group), limits=False)
    cost = replace(settings.cost, interpenetration_weight=0.0)
    return replace(settings, cost=cost, **{group: free})


def make_tracker(name: str, body: Body, settings: Settings | None = None) -> Tracker:
    """A tracker for a body; one object serves one clip. Raises InputError for an unknown name."""
    _check_name(name)
    settings = settings or settings_for(name)
    clearance = Clearance(body) if settings.cost.interpenetration_weight > 0.0 else None
    search = ModeSearch(CostModel(body, settings.cost, clearance), settings.search)
    group = GROUPS[name]
    return _RECIPES[group](search, getattr(settings, group))


def _check_name(name: str) -> None:
    if name not in TRACKERS:
        raise InputError("tracker", f"no tracker {name!r}", remedy="one of " + ", ".join(TRACKERS))
