"""Facts of a run in a report, beside its motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from estimator.runs.keypoint_residuals import KeypointResiduals
    from estimator.runs.marker_residuals import MarkerResiduals


@dataclass(frozen=True)
class Figure:
    """A picture of the page. title: what it shows. data: the file's content. kind: its media type."""

    title: str
    data: bytes
    kind: str = "image/svg+xml"


@dataclass(frozen=True)
class Facts:
    """Facts reported beside the motion.

    findings: what contradicts the subject or the input. assumed: what was not measured, a sentence each. lengths: name
    and scale of fitted lengths. command: that repeats the run. blanks: what the command leaves to be filled in.
    motion: name and value of each figure of a motion that was made from another, none of one that was tracked.
    errors: distance of each camera's keypoints from the body, by the camera's name [px]. keypoints, markers: measured
    distances of both from the body, None for a run without. settings: name, value and default of those that differ.
    files: each file's role in the run, its path, and its digest or why there is none. versions: of programs, name and
    number.
    """

    findings: Sequence[str] = ()
    assumed: Sequence[str] = ()
    lengths: Sequence[tuple[str, float]] = ()
    command: str = ""
    blanks: str = ""
    motion: Sequence[tuple[str, str]] = ()
    errors: Mapping[str, float] = field(default_factory=dict)
    settings: Sequence[tuple[str, str, str]] = ()
    keypoints: KeypointResiduals | None = None
    markers: MarkerResiduals | None = None
    files: Sequence[tuple[str, str, str]] = ()
    versions: Sequence[tuple[str, str]] = ()
