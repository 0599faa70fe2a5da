"""Settings of loose-limbed people."""

from __future__ import annotations

from dataclasses import dataclass, field

from estimator.inference.beliefs.propagation import BeliefSettings
from estimator.trackers.loose_limbed.assembly import AssemblySettings
from estimator.trackers.loose_limbed.instant import PartDetectorSettings, SeenSettings
from humanoid.limbs.merging import RULES
from humanoid.support.settings import CheckedSettings, setting


@dataclass(frozen=True)
class LooseLimbedSettings(CheckedSettings):
    """The loose-limbed tracker.

    detail: which bodies are limbs of their own, "paper" or "fine" (`humanoid.limbs`). limbs: a TOML file with changes
    to that. potentials: a file of learned potentials; without one the shipped ones where they are of these limbs,
    otherwise potentials from the joints. outlier: lambda0, share of the potentials' outlier process. propagation: of a
    frame with a past. smoothing: the frame before is inferred again with this one and the next, as in the paper;
    without, its beliefs stay. tied: share of the message about each limb to the next frame that comes from the
    assembled poses; 0 in the paper. start_kernels, start_samples, start_iterations, start_proposal_factor: instead of
    `propagation`'s in the first frame, and in the first after so many without the person that the past is
    uninformative. start_rounds: how often beliefs are then propagated, each time with the assembled poses as initial
    messages between limbs: these separate two legs that are believed in one image, which the limbs alone do not. seen:
    of the limb likelihood. part_detectors: of the bottom-up proposals. modes: hypotheses kept. assembly: of hypotheses
    from the limbs.
    """

    detail: str = setting("paper", one_of=tuple(RULES))
    limbs: str = ""
    potentials: str = ""
    outlier: float = setting(0.01, above=0, below=1)
    propagation: BeliefSettings = field(default_factory=BeliefSettings)
    smoothing: bool = False
    tied: float = setting(0.5, at_least=0, at_most=1)
    start_kernels: int = setting(200, at_least=2)
    start_samples: int = setting(200, at_least=1)
    start_iterations: int = setting(15, at_least=1)
    start_rounds: int = setting(2, at_least=1)
    start_proposal_factor: float = setting(0.9, at_least=0, at_most=1)
    seen: SeenSettings = field(default_factory=SeenSettings)
    part_detectors: PartDetectorSettings = field(default_factory=PartDetectorSettings)
    modes: int = setting(5, at_least=1)
    assembly: AssemblySettings = field(default_factory=AssemblySettings)
