"""Settings of the fit of a person."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class DescentSettings:
    """When a descent of the later stages ends and how far it steps.

    iterations: steps tried. enough: decrease of the energy that a step has to bring for another to follow.
    max_turn [rad], max_slide [m]: half-width of the trust box of the poses.
    """

    iterations: int = 6
    enough: float = 1e-2
    max_turn: float = 0.3
    max_slide: float = 0.2


@dataclass(frozen=True)
class FleshSettings:
    """Settings of the second and third stage.

    frames: pictures used, evenly spread over the frames of the first stage. rounds: times that features
    are assigned again, in either stage. edge_noise, outline_noise: as shares of tracking's noise, most of which stands
    for flesh of another shape; less of the outlines', as silhouettes are a pixel too large or too small on their own.
    agreement: share of the body's outline that has to lie on the silhouettes' in the end; with less, or with `worse`
    less than before, they are another person's, and the first stage stands. overlap [m]: of parts in the fitted poses,
    above which the new flesh is drawn back.
    """

    frames: int = 3
    rounds: int = 3
    edge_noise: float = 0.4
    outline_noise: float = 0.7
    agreement: float = 0.5
    worse: float = 0.1
    overlap: float = 0.01
    descent: DescentSettings = field(default_factory=DescentSettings)


@dataclass(frozen=True)
class FitSettings:
    """Settings of the fit.

    seconds, frames, pieces: it uses this many frames, evenly spread over pieces of the clip that are so long together
    (`estimator.fitting.fit`). rounds: times the poses are found again with the lengths of the round before.
    iterations: Newton steps a round. effective_frames: detectors repeat their errors from frame to frame, so that all
    frames together count as this many, in every stage. flesh: of the second and third stage.
    """

    seconds: float = 4.0
    frames: int = 30
    pieces: int = 3
    rounds: int = 2
    iterations: int = 15
    effective_frames: float = 4.0
    flesh: FleshSettings = field(default_factory=FleshSettings)
