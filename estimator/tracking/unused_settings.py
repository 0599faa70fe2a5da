"""Settings that were changed and have no effect, for messages to the user."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from estimator.search.settings import BY_KEYPOINTS
from estimator.tracking.registry import DEFAULT, TRACKERS, Settings, settings_for
from estimator.tracking.setting_changes import refused
from estimator.vision.cues.settings import unused_rules
from humanoid.support.errors import InputError
from humanoid.support.settings import ONE_CAMERA, PICTURES, UnusedRule, every_setting, unused_where, unused_without

FIT_GROUPS = ("cost", "search", "cues")
"""The groups that a fit of the subject uses, with any tracker; the fit itself tracks with the default one."""


_NOT_IN_FIT = ("search.follow", "search.start", "search.index")

RULES = (
    unused_where("cost.nu", cost__potential="gaussian"),
    unused_where("cost.transition_nu", cost__transition_potential="gaussian"),
    unused_where("cost.pose_prior_file", cost__pose_prior_weight=0.0),
    unused_where("cost.clearance_scale search.contact", cost__interpenetration_weight=0.0),
    unused_where("cost.exchange_penalty", search__exchange=False),
    unused_where("search.readings_rest smooth.reading", search__readings=False),
    unused_where("search.start_samples", search__start="index"),
    unused_where("search.weigh_samples", search__weigh="height"),
    unused_where("search.weigh_samples", search__weigh="volume"),
    unused_where("smooth.lag smooth.lag_iterations", "they are for live use; a clip is smoothed as a whole"),
    unused_where(
        "smooth.turn_acceleration smooth.root_turn_acceleration smooth.root_slide_acceleration smooth.iterations"
        " smooth.tolerance smooth.window smooth.rounds smooth.round_gain smooth.renewed smooth.memory"
        " smooth.pace_rounds smooth.pace_span smooth.pace_count smooth.lasting smooth.reading"
        " smooth.overconfidence",
        smooth__enabled=False,
    ),
    unused_without(ONE_CAMERA, "search.readings search.readings_rest smooth.reading"),
    unused_without(
        PICTURES,
        "cues search.follow search.reassign_tolerance search.flow_in_covariance smooth.rounds smooth.round_gain"
        " smooth.renewed smooth.overconfidence",
    ),
)  # fmt: skip
"""Which of the common settings have no effect under which others; the rules of a tracker stand in its `Spec`.

There is a rule where a mistake is likely: what makes the settings unused is a default, or the input.
Turning a part off and still setting its details is taken as deliberate.
"""


class UnusedSetting(NamedTuple):
    """A changed setting without effect: its name with its groups in front, and why."""

    name: str
    because: str

    def refused(self, source: object = None) -> InputError:
        """The error for it. source: the file that it is from, None where a program gave it."""
        table, _, name = self.name.rpartition(".")
        return refused(source, table, name, f"has no effect: {self.because}", "leave it out")


def fit_settings(tracker: str, settings: Settings, changes: Mapping[str, Any]) -> Settings:
    """The settings of a fit before a tracker with these `settings`, made by `changes`: the default tracker's own
    settings, and those of the changes that are not about a tracker. It always starts from keypoints, without an
    index."""
    if tracker != DEFAULT:
        settings = settings_for(DEFAULT, changes={name: changes[name] for name in FIT_GROUPS if name in changes})
    return replace(settings, search=replace(settings.search, start=BY_KEYPOINTS, index=""))


def unused_settings(tracker: str, settings: Settings, changes: Mapping[str, Any], *, fits: bool) -> list[UnusedSetting]:
    """The settings that `changes` make other than the tracker's own and that nevertheless have no effect.

    settings: with the changes. fits: whether the subject is fitted to the clip, which some act on.
    """
    reasons, acting = _reasons(tracker, settings), set()
    changed = changed_names(tracker, settings)
    if fits and tracker != DEFAULT:
        in_fit = _reasons(DEFAULT, fit_settings(tracker, settings, changes)) | dict.fromkeys(_NOT_IN_FIT, "")
        acting = {name for name in changed if name.startswith(FIT_GROUPS) and not _covered(name, in_fit)}
    return [
        UnusedSetting(name, _why(name, reasons)) for name in changed if name not in acting and _covered(name, reasons)
    ]


def unused_with_input(
    tracker: str, settings: Settings, changes: Mapping[str, Any], *, fits: bool, pictures: bool, cameras: int
) -> list[UnusedSetting]:
    """Those that have no effect on this input, where no pictures are used, or not for this, or several cameras are
    there. settings: with the cues that were chosen; the rest is as in `unused_settings`."""
    reasons: dict[str, str] = {}
    if cameras > 1:
        reasons |= dict.fromkeys(_needing(tracker, ONE_CAMERA), f"it is for one camera, there are {cameras}")
    if not pictures:
        reasons |= dict.fromkeys(_needing(tracker, PICTURES), "no pictures are used")
    changed = [name for name in changed_names(tracker, settings) if not name.startswith("cues.use_")]
    unused = [UnusedSetting(name, _why(name, reasons)) for name in changed if _covered(name, reasons)]
    known = {i.name for i in unused}
    more = unused_settings(tracker, settings, changes, fits=fits) if pictures else []
    return unused + [i for i in more if i.name not in known and not i.name.startswith("cues.use_")]


def changed_names(tracker: str, settings: Settings) -> list[str]:
    """Names, with their groups in front, of the settings that differ from the tracker's own."""
    return [name for name, _, _ in changed_values(tracker, settings)]


def changed_values(tracker: str, settings: Settings) -> list[tuple[str, Any, Any]]:
    """The same with their values, and those that the tracker has of its own."""
    own = _values(settings_for(tracker))
    return [(name, value, own[name]) for name, value in _values(settings).items() if value != own[name]]


def without(changes: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    """Nested changes without some settings, which are named with their groups in front."""
    left = {name: value for name, value in changes.items() if name not in names}
    for group, value in left.items():
        if isinstance(value, Mapping):
            left[group] = without(value, [n.removeprefix(f"{group}.") for n in names if n.startswith(f"{group}.")])
    return left


def _reasons(tracker: str, settings: Settings) -> dict[str, str]:
    """Names of settings and groups without effect, and why."""
    values, reasons = _values(settings), dict[str, str]()
    for rule in _rules(tracker):
        if not rule.needs and all(values[name] == value for name, value in rule.where):
            reasons |= {name: rule.reason for name in rule.names if name not in reasons}
    return reasons


def _needing(tracker: str, needs: str) -> list[str]:
    """Names of settings and groups that need something of the input."""
    return [name for rule in _rules(tracker) if rule.needs == needs for name in rule.names]


def _rules(tracker: str) -> tuple[UnusedRule, ...]:
    return (*RULES, *unused_rules(), *TRACKERS[tracker].unused)


def _values(settings: Settings) -> dict[str, Any]:
    return {f"{table}.{name}": value for table, name, value in every_setting(settings)}


def _covered(name: str, reasons: Mapping[str, str]) -> bool:
    return any(name == n or name.startswith(f"{n}.") for n in reasons)


def _why(name: str, reasons: Mapping[str, str]) -> str:
    return next(because for n, because in reasons.items() if name == n or name.startswith(f"{n}."))
