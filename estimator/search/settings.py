"""Settings of the search of modes."""

from __future__ import annotations

from dataclasses import dataclass, field

from estimator.energy.descent.contact import ContactSettings
from estimator.energy.descent.qp import PROXQP, STEP_SOLVERS
from estimator.energy.descent.seek import SeekSettings
from humanoid.support.settings import CheckedSettings, setting

BY_KEYPOINTS, BY_INDEX = STARTS = ("keypoints", "index")
BY_HEIGHT, BY_VOLUME, BY_IMPORTANCE = WEIGHINGS = ("height", "volume", "importance")


@dataclass(frozen=True)
class ModeSearchSettings(CheckedSettings):
    """Settings of the search for modes.

    start: source of the first pose: "keypoints", or "index", the examples similar to the frame's picture, which needs
    no keypoints. index: file of these (`kinemode train-index`), for trackers that look poses up. explore: search given
    to every start. follow: before it, on keypoints and flow alone, where there are pictures. refine: search given to
    those kept. spare: how many more than requested are refined, since refined modes may coincide. reassign_tolerance:
    features of the pictures are assigned again until a search moves no joint by more [rad or m]. distinct: two modes
    differ if some landmark is further apart than this fraction of the body's size. exchange: also search every frame
    with left and right of its keypoints exchanged (detectors do confuse them). readings: keep a mode of either reading
    of a trunk that one camera sees, leading towards it or away from it, however small its weight, and search for the
    missing one. readings_rest: share of the rest-position priors that counts between them.
    start_samples: of the first frame, drawn by the covariance of its pose and searched too: by that of the fit where
    the person is fitted, else by those of the first modes (CSS section 5). contact: how modes whose parts overlap are
    treated. flow_in_covariance: a mode's covariance includes the flow, like all image terms (CSS eq. 12). step_solver:
    solver of the steps of all searches within limits and clearance: "proxqp", ProxQP wherever the free minimum lies
    outside; "active-set", a compiled active set, whose steps are the same; "proxqp-always", ProxQP for every convex
    step, for checking. weigh: how a mode is weighted: "height", its probability density (CSS Figure 6, step 3);
    "volume", its probability by the second-order model; "importance", the same by `weigh_samples` importance samples
    about each mode (CSS section 8).
    Raises InputError for other words.
    """

    start: str = setting(BY_KEYPOINTS, one_of=STARTS)
    index: str = ""
    explore: SeekSettings = field(default_factory=lambda: SeekSettings(max_iterations=8, decrease_tolerance=0.05))
    refine: SeekSettings = field(default_factory=SeekSettings)
    follow: SeekSettings = field(default_factory=lambda: SeekSettings(max_iterations=5, decrease_tolerance=0.1))
    spare: int = setting(3, at_least=0)
    distinct: float = setting(0.03, at_least=0)
    reassign_tolerance: float = setting(0.01, at_least=0)
    exchange: bool = True
    readings: bool = True
    readings_rest: float = setting(0.1, at_least=0, at_most=1)
    start_samples: int = setting(20, at_least=0)
    contact: ContactSettings = field(default_factory=ContactSettings)
    flow_in_covariance: bool = True
    step_solver: str = setting(PROXQP, one_of=STEP_SOLVERS)
    weigh: str = setting(BY_HEIGHT, one_of=WEIGHINGS)
    weigh_samples: int = setting(60, at_least=1)
