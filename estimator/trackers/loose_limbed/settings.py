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
    to that. potentials: a file of learned potentials; without one the shipped ones where they are of these limbs, else
    such as the joints allow. outlier: lambda0, share of the potentials' outlier process. propagation: of a frame with
    a past. smoothing: the frame before is inferred again with this one and the next, as in the paper; without, what was
    believed of it stays. tied: share of what the next frame receives of each limb that is as the assembled poses have
    it; 0 in the paper. start_kernels, start_samples, start_iterations, start_proposal_factor: instead of
    `propagation`'s in the first frame, and in the first after so many without the person that the past says nothing.
    start_rounds: then beliefs are propagated so often, again with the poses that were made of them as what limbs say of
    each other at first: two legs that are believed in one image are parted there, which they cannot know of each other.
    seen: what limbs are seen by. part_detectors: who says bottom-up where limbs may be. modes: hypotheses kept.
    assembly: how they are made of the limbs.
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
