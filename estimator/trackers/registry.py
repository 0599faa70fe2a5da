"""Trackers by name, with their settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

from estimator.cost.model import CostModel, CostSettings
from estimator.cost.potentials import POTENTIALS
from estimator.search.mode_search import ModeSearch, ModeSearchSettings
from estimator.smoothing import SmoothSettings
from estimator.trackers.css import PAPER, CovarianceScaledSampling, CssSettings
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
MAY_BE_ZERO = {
    "stabiliser_weight", "upright_weight", "interpenetration_weight", "exchange_penalty", "landmark_mismatch",
    "forgetting", "samples", "flips", "flip_penalty", "spare", "decrease_tolerance", "exact_below", "tolerance",
    "distinct",
}  # fmt: skip


@dataclass(frozen=True)
class Settings:
    """Everything that decides a track, besides subject, clip and seed."""

    cost: CostSettings = field(default_factory=CostSettings)
    search: ModeSearchSettings = field(default_factory=ModeSearchSettings)
    css: CssSettings = field(default_factory=CssSettings)
    single_mode: SingleModeSettings = field(default_factory=SingleModeSettings)
    smooth: SmoothSettings = field(default_factory=SmoothSettings)

    def to_dict(self) -> dict[str, Any]:
        """Plain nested dictionary, as stored in run files."""
        return asdict(self)


def settings_for(name: str, *, modes: int | None = None, changes: Mapping[str, Any] | None = None) -> Settings:
    """Defaults of a tracker, then `modes`, then nested `changes` (the layout of `Settings.to_dict`).

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
    if modes is not None:
        if modes < 1:
            raise InputError("modes", f"{modes} hypotheses cannot be kept", remedy="at least 1")
        settings = replace(settings, css=replace(settings.css, modes=modes))
    return _changed(settings, changes or {}, "settings")


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


T = TypeVar("T")


def _changed(settings: T, changes: Mapping[str, Any], place: str) -> T:
    """A frozen dataclass with nested changes, every name and kind checked."""
    assert is_dataclass(settings)
    known = {f.name: getattr(settings, f.name) for f in fields(settings)}
    new: dict[str, Any] = {}
    for name, value in changes.items():
        if name not in known:
            raise InputError(place, f"no setting {name!r}", remedy="one of " + ", ".join(known))
        old = known[name]
        if is_dataclass(old):
            if not isinstance(value, Mapping):
                raise InputError(place, f"{name} is a group of settings", remedy="give a table")
            new[name] = _changed(old, value, f"{place}.{name}")
        elif isinstance(old, float) and isinstance(value, (int, float)) and not isinstance(value, bool):
            new[name] = float(value)
        elif type(value) is not type(old):
            raise InputError(f"{place}.{name}", f"{value!r} is no {type(old).__name__}")
        else:
            new[name] = value
        _check(name, new[name], place)
    return replace(settings, **new)  # type: ignore[type-var]


def _check(name: str, value: Any, place: str) -> None:
    """Refuse values that no tracker can work with."""
    if name.endswith("potential") and value not in POTENTIALS:
        raise InputError(f"{place}.{name}", f"no potential {value!r}", remedy="one of " + ", ".join(POTENTIALS))
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        least = 0 if name in MAY_BE_ZERO else 1 if isinstance(value, int) else np.nextafter(0.0, 1.0)
        if not least <= value < np.inf:
            wanted = "0 or more" if name in MAY_BE_ZERO else "1 or more" if isinstance(value, int) else "more than 0"
            raise InputError(f"{place}.{name}", f"{value} cannot work", remedy=f"a finite number, {wanted}")
