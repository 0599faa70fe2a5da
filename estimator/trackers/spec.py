"""Description of a tracker by its name, before one is made, and its changes to the common settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from estimator.search.cost_model import CostModel, parts_apart
from estimator.search.cost_terms import CostSettings
from estimator.search.mode_search import ModeSearch
from estimator.search.settings import BY_KEYPOINTS, ModeSearchSettings
from estimator.trackers.base import TrackerProtocol
from estimator.vision.cues.settings import CueSettings
from humanoid.kinematics.body import Body
from humanoid.support.settings import UnusedRule, unused_where


class TrackerSettings(Protocol):
    """Settings from which a tracker is made, see `estimator.tracking.registry.Settings`."""

    @property
    def cost(self) -> CostSettings:
        """The energy."""
        ...

    @property
    def search(self) -> ModeSearchSettings:
        """Settings of the search of its minima."""
        ...

    @property
    def cues(self) -> CueSettings:
        """Settings of the image cues."""
        ...

    @property
    def own(self) -> Any:
        """The tracker's own, of the type of its `Spec.settings`."""
        ...


def _no(own: Any) -> bool:
    return False


def _yes(own: Any) -> bool:
    return True


@dataclass(frozen=True)
class Spec:
    """A tracker by name; register it with `estimator.tracking.registry.register`.

    name: by which it is chosen. sentence: its one-line description. make: makes a tracker for a body from all settings,
    for one clip.
    settings: its own, a frozen dataclass of numbers, texts and truth values (`humanoid.support.settings.setting`) with
    the defaults of this name, and group: their table in files; None and empty where it has none. It keeps several
    hypotheses if one of them is `modes`.
    defaults: nested changes that this name makes to the common groups of settings.
    unused: rules of which settings have no effect on it.
    keeps_limits, looks_up, may_look_up: by its own settings: whether poses stay within the joint limits; whether it
    needs an index of examples after the first frame; whether it uses one that is given. Its other capabilities are
    declared by the tracker itself (`estimator.trackers.base.Capabilities`).
    """

    name: str
    sentence: str
    make: Callable[[Body, TrackerSettings], TrackerProtocol]
    group: str = ""
    settings: Any = None
    defaults: Mapping[str, Any] = field(default_factory=dict)
    unused: tuple[UnusedRule, ...] = ()
    keeps_limits: Callable[[Any], bool] = _yes
    looks_up: Callable[[Any], bool] = _no
    may_look_up: Callable[[Any], bool] = _no

    @property
    def keeps_several(self) -> bool:
        """Whether it can keep several hypotheses."""
        return hasattr(self.settings, "modes")


ONLY_TO_BEGIN = unused_where("search.index", "no pose is looked up but the first", search__start=BY_KEYPOINTS)
"""Settings without effect on a tracker that uses no index after the first frame (`Spec.unused`)."""


def mode_search(body: Body, settings: TrackerSettings) -> ModeSearch:
    """The search for modes of a body by the settings' energy; parts keep apart where that is part of the energy."""
    self_collision = parts_apart(body, settings.cost) if settings.cost.interpenetration_weight > 0.0 else None
    return ModeSearch(CostModel(body, settings.cost, self_collision, settings.cues), settings.search)


def by_search(
    recipe: Callable[[ModeSearch, Any], TrackerProtocol],
) -> Callable[[Body, TrackerSettings], TrackerProtocol]:
    """The `Spec.make` of a tracker that is made from a search for modes and its own settings."""
    return lambda body, settings: recipe(mode_search(body, settings), settings.own)


NEARLY_GAUSSIAN = 1e4
"""nu, in squared standard deviations, of a cue's potential that is to be Gaussian."""
EDGES_NEARLY_GAUSSIAN = 200.0
"""The same for edges. They are searched for within six standard deviations, where this is Gaussian to 9 %; and nu / 2
is what a missing edge costs, which must not drown all else."""

ONLY_FILTERS: dict[str, Any] = {"smooth": {"enabled": False, "overconfidence": 0.0}}
"""The trackers of the papers do not look back, and how overconfident they are was not measured."""
AS_DETECTED: dict[str, Any] = {"search": {"exchange": False}}
"""The trackers of the papers use keypoints unchanged."""
NOTHING_STANDS: dict[str, Any] = {"cost": {"standing_weight": 0.0}}
"""They do not depend on standing feet."""
NOT_BALANCED: dict[str, Any] = {"cost": {"terms": {"balance": {"weight": 0.0}}}}
"""Nor whether the person would fall over."""
ONE_READING: dict[str, Any] = {"search": {"readings": False}}
"""They keep no room for the other reading of a trunk."""
ALL_AS_QUICK: dict[str, Any] = {"cost": {"quickness": False}}
"""To them all joints are as quick."""
NOT_LIFTED: dict[str, Any] = {"cost": {"lifted_weight": 0.0}}
"""Nor what another network makes of the picture."""
NO_CAPTURE: dict[str, Any] = {"cost": {"pose_prior_weight": 0.0}}
"""They use no captured poses."""
LEAST_SQUARES: dict[str, Any] = {
    "cost": {
        "potential": "gaussian",
        "transition_potential": "gaussian",
    },
    "cues": {
        "edges": {"nu": EDGES_NEARLY_GAUSSIAN},
        "silhouette": {"nu": NEARLY_GAUSSIAN},
        "flow": {"nu": NEARLY_GAUSSIAN},
    },
}
"""No observation ever loses its pull."""
OVERLAPPING: dict[str, Any] = {"cost": {"interpenetration_weight": 0.0}}
"""Parts need not keep apart."""


def together(*changes: Mapping[str, Any]) -> dict[str, Any]:
    """Nested changes in one; they do not change the same setting."""
    made: dict[str, Any] = {}
    for change in changes:
        for name, value in change.items():
            made[name] = together(made.get(name, {}), value) if isinstance(value, Mapping) else value
    return made


FROM_A_PAPER = together(
    ONLY_FILTERS, AS_DETECTED, NO_CAPTURE, NOTHING_STANDS, NOT_BALANCED, ONE_READING, ALL_AS_QUICK, NOT_LIFTED
)
