"""Covariance scaled sampling beside a chain of keypoints."""

from __future__ import annotations

from dataclasses import dataclass, field

from estimator.search.mode_search import ModeSearch
from estimator.trackers.css.points_beside import BesideSettings, PointsBeside
from estimator.trackers.css.settings import UNUSED, CssSettings
from estimator.trackers.css.tracker import CovarianceScaledSampling
from estimator.trackers.spec import Spec, by_search
from humanoid.support.settings import unused_where

_GROUP = "css_dual"


@dataclass(frozen=True)
class CssDualSettings(CssSettings):
    """The settings of `CssSettings`, and:

    beside: the chain of keypoints.
    """

    beside: BesideSettings = field(default_factory=BesideSettings)


class CssDual(PointsBeside):
    """`CovarianceScaledSampling`, which keeps keypoints that are missing for a while (see `PointsBeside`)."""

    def __init__(self, search: ModeSearch, settings: CssDualSettings | None = None) -> None:
        settings = settings or CssDualSettings()
        super().__init__(CovarianceScaledSampling(search, settings), search, settings.beside)


SPEC = Spec(
    name="css-dual",
    sentence="css beside a chain of keypoints, which keeps those that are missing for a while",
    make=by_search(CssDual),
    group=_GROUP,
    settings=CssDualSettings(),
    unused=(
        *(rule.of_group("css", _GROUP) for rule in UNUSED),
        unused_where(
            f"{_GROUP}.beside.evidence.shared {_GROUP}.beside.points.mistaken {_GROUP}.beside.points.lost",
            "a keypoint is of one landmark",
        ),
    ),
    may_look_up=lambda own: own.examples > 0 or own.lost_examples > 0,
)
