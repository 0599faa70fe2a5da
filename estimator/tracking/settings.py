"""Everything that decides a track, besides subject, clip and seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from estimator.search.cost_settings import CostSettings
from estimator.search.settings import ModeSearchSettings
from estimator.tracking.smoothing import SmoothSettings
from estimator.vision.likelihood.settings import CueSettings, cue_settings
from humanoid.support.settings import plain

COMMON = ("cost", "search", "smooth", "cues")
"""The groups that are there for every tracker."""


@dataclass(frozen=True)
class Settings:
    """Everything that decides a track, besides subject, clip and seed.

    cost: the energy. search: how its minima are found. smooth: the smoothing after the last frame. cues: what is taken
    from the pictures. own: the tracker's own settings, None where it has none; table: the group that these are in files
    and changes, as "css".
    """

    cost: CostSettings = field(default_factory=CostSettings)
    search: ModeSearchSettings = field(default_factory=ModeSearchSettings)
    own: Any = None
    smooth: SmoothSettings = field(default_factory=SmoothSettings)
    cues: CueSettings = field(default_factory=cue_settings)
    table: str = ""

    def members(self) -> dict[str, Any]:
        """The groups by name, as `humanoid.support.settings.members` takes them."""
        own = {} if self.own is None else {self.table: self.own}
        return {"cost": self.cost, "search": self.search, **own, "smooth": self.smooth, "cues": self.cues}

    def with_members(self, new: Mapping[str, Any]) -> Settings:
        """With some of the groups exchanged."""
        groups = dict(new)
        own = groups.pop(self.table, self.own)
        return replace(self, own=own, **groups)

    def to_dict(self) -> dict[str, Any]:
        """Plain nested dictionary, as stored in run files; groups that only plugins fill are left out where empty."""
        return _without_empty(plain(self))


def _without_empty(group: Mapping[str, Any]) -> dict[str, Any]:
    filled = {name: _without_empty(value) if isinstance(value, Mapping) else value for name, value in group.items()}
    return {name: value for name, value in filled.items() if value != {}}
