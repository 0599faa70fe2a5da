"""Trackers by name, with their settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from estimator.cost.model import CostModel, CostSettings
from estimator.imaging.cues import CueSettings
from estimator.search.mode_search import ModeSearch, ModeSearchSettings
from estimator.smoothing import SmoothSettings
from estimator.trackers.css import PAPER, CovarianceScaledSampling, CssSettings
from estimator.trackers.setting_changes import changed
from estimator.trackers.single_mode import SingleMode, SingleModeSettings
from estimator.trackers.tracker import Tracker
from humanoid.body import Body
from humanoid.clearance import Clearance
from humanoid.errors import InputError

TRACKERS = {
    "css": "covariance scaled sampling with transitions and exchanged readings",
    "css-paper": "covariance scaled sampling as printed (CSS Figure 6)",
    "single-mode": "robust single mode with joint limits (CSS section 6)",
}


@dataclass(frozen=True)
class Settings:
    """Everything that decides a track, besides subject, clip and seed.

    cost: the energy. search: how its minima are found. css, single_mode: the trackers. smooth: the smoothing after the
    last frame. cues: what is taken from the pictures.
    """

    cost: CostSettings = field(default_factory=CostSettings)
    search: ModeSearchSettings = field(default_factory=ModeSearchSettings)
    css: CssSettings = field(default_factory=CssSettings)
    single_mode: SingleModeSettings = field(default_factory=SingleModeSettings)
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
    InputError: unknown tracker, unknown setting (the valid ones are listed) or a value of the wrong kind.
    """
    _check_name(name)
    settings = Settings()
    if name == "css-paper":
        settings = replace(settings, css=PAPER, search=replace(settings.search, exchange=False))
    if name != "css":  # the trackers of the paper only filter
        settings = replace(settings, smooth=replace(settings.smooth, enabled=False))
    settings = changed(settings, changes or {}, source)
    if modes is not None:
        if modes < 1:
            raise InputError("modes", f"{modes} hypotheses cannot be kept", remedy="at least 1")
        settings = replace(settings, css=replace(settings.css, modes=modes))
    return settings


def make_tracker(name: str, body: Body, settings: Settings | None = None) -> Tracker:
    """A tracker for a body; one object serves one clip. Raises InputError for an unknown name."""
    _check_name(name)
    settings = settings or settings_for(name)
    clearance = Clearance(body) if settings.cost.interpenetration_weight > 0.0 else None
    search = ModeSearch(CostModel(body, settings.cost, clearance), settings.search)
    if name == "single-mode":
        return SingleMode(search, settings.single_mode)
    return CovarianceScaledSampling(search, settings.css)


def _check_name(name: str) -> None:
    if name not in TRACKERS:
        raise InputError("tracker", f"no tracker {name!r}", remedy="one of " + ", ".join(TRACKERS))
