"""Options of functions on a run, each option declared once (see `kinemode.request`)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from kinemode.option import about, option
from kinemode.request import ProgressOptions

if TYPE_CHECKING:
    from estimator.runs.reference_motion import Reference
    from estimator.runs.run_reader import Run
    from kinemode.named import PathLike
    from kinemode.request import CameraName, Direction, OutPath

    RunLike = Run | PathLike
    JointNames = str | Iterable[str] | None  # by commas on the command line
    LandmarkNames = Sequence[str] | None
    KnownMotion = Reference | PathLike


@dataclass(frozen=True)
class OfRun:
    """A run."""

    run: RunLike = field(
        metadata=about("A run file.", python="Or a `Run`. Of an unfinished one the frames that are there are used.")
    )


@dataclass(frozen=True, kw_only=True)
class PageOptions:
    """The page that is served to a browser on this machine."""

    port: int = option(0, "Port on 127.0.0.1; 0 takes a free one.", low=0, high=65535)
    browser: bool = option(True, "Whether the page is opened; its address is printed.")


@dataclass(frozen=True, kw_only=True)
class _Weighed:
    mass: float | None = option(
        None,
        "Mass in kg of the person with what is worn and carried: adds ground reaction forces, see `kinemode forces`.",
        low=2.0, high=500.0,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class _Filtered:
    filter: float | None = option(
        None,
        "Cut-off in Hz of a Butterworth filter (fourth order, without lag) of the best path; off unless given.",
        python="See `kinemode.Run.butterworth`.",
    )


@dataclass(frozen=True, kw_only=True)
class ViewRequest(_Weighed, PageOptions, OfRun):
    """The request of `kinemode.view`."""

    html: OutPath | None = option(
        None, "Write a self-contained page here and start nothing. Otherwise the page is served until Ctrl-C."
    )


@dataclass(frozen=True, kw_only=True)
class OverlayRequest(ProgressOptions, OfRun):
    """The request of `kinemode.overlay`."""

    file: OutPath = field(
        kw_only=False,
        metadata=about(
            "A file ending in .mp4 (H.264), .webm (VP9) or .gif (smaller, 12.5 frames per second).", called="out"
        ),
    )
    camera: CameraName | None = option(None, "Name of one camera; all of them side by side unless given.")
    limbs: bool = option(
        False,
        "Draw the loose-limbed tracker's beliefs about each limb instead of the body: samples as outlines, stronger the"
        " more they weigh, and their means as cones.",
    )


@dataclass(frozen=True, kw_only=True)
class ReportRequest(_Weighed, ProgressOptions, OfRun):
    """The request of `kinemode.report`."""

    file: OutPath = field(
        kw_only=False, metadata=about("A file ending in .html or .htm; one that is there is replaced.", called="out")
    )


@dataclass(frozen=True, kw_only=True)
class PlotRequest(_Filtered, OfRun):
    """The request of `kinemode.plot`."""

    file: OutPath = field(kw_only=False, metadata=about("A file ending in .png, .svg or .pdf.", called="out"))
    joints: JointNames = option(
        None,
        "Names of joints, parts of them, or left and right, with commas between; hips, knees, ankles, shoulders and"
        " elbows unless given, or all joints of a body with few.",
    )


@dataclass(frozen=True, kw_only=True)
class SamplesRequest(OfRun):
    """The request of `kinemode.samples`."""

    file: OutPath = field(kw_only=False, metadata=about("A file ending in .png.", called="out"))
    frames: int = option(6, "Instants, evenly spaced among those with a pose.", low=1)
    count: int = option(
        40, "Poses of each instant, drawn from its calibrated posterior, all hypotheses together.", low=1
    )
    seed: int = option(0, "Seed of the samples.", low=0)
    camera: CameraName | None = option(None, "Name of the camera to look through; the first unless given.")


@dataclass(frozen=True, kw_only=True)
class ExportRequest(_Filtered, OfRun):
    """The request of `kinemode.export`."""

    file: OutPath = field(kw_only=False, metadata=about("Where to write."))
    format: str | None = option(
        None,
        "npz, csv, trc, mot, osim, gait2392-mot, rajagopal-mot, c3d, bvh, motion-npz, motion-csv, glb, rrd, or that of"
        " a plug-in; the file's ending unless given.",
    )
    degrees: bool = option(
        False, "Of csv: joint angles in degrees, with their standard deviations beside them.", python="Else in radians."
    )


@dataclass(frozen=True, kw_only=True)
class ContactRequest(OfRun):
    """The request of `kinemode.contact`."""

    hands: bool = option(
        False, "Also when hands stand on the floor; the setting smooth.hands holds them while smoothing."
    )
    plot: OutPath | None = option(
        None,
        "Draw probabilities and heights over time, a PNG, with heel strikes and toe-offs where the person walks.",
    )


@dataclass(frozen=True)
class GaitRequest(OfRun):
    """The request of `kinemode.gait`."""


@dataclass(frozen=True, kw_only=True)
class ForcesRequest(ProgressOptions, OfRun):
    """The request of `kinemode.forces`."""

    filter: float | None = option(
        None,
        "Cut-off in Hz of a Butterworth filter (fourth order, without lag) of the poses, 0 for none; 12 unless given,"
        " or none in runs of 24 frames/s or fewer.",
        low=0,
    )

    mass: float | None = option(
        None,
        "Mass in kg of the person with what is worn and carried; that of the URDF, or of adults as tall, unless given.",
        low=2.0, high=500.0,
    )  # fmt: skip
    out: OutPath | None = option(
        None,
        "Write there by its ending: .csv everything with bands, for OpenSim .mot external loads, .sto joint moments.",
    )
    plot: OutPath | None = option(
        None, "Draw forces of the feet and moments of the legs over time with 90 % bands, a PNG."
    )
    seed: int = option(0, "Seed of the samples that the bands come from.", low=0)


@dataclass(frozen=True, kw_only=True)
class EvaluateRequest(OfRun):
    """The request of `kinemode.evaluate`."""

    reference: KnownMotion = field(
        kw_only=False,
        metadata=about(
            "npz of `kinemode export`, truth.npz of `kinemode render`, npz with points (T, L, 3) in metres, names and"
            " fps, trc or c3d (markers, of which joint centres are compared), or joint angles: mot, sto or csv.",
            python="Or a `kinemode.Reference`.",
        ),
    )
    joints: LandmarkNames = option(
        None,
        "The landmarks to compare; unless given the twelve limb joints, or all that both have where fewer than three"
        " are limb joints.",
    )
    up: Direction = option(
        None,
        "The axis of the world of a trc or c3d that points up: x, y, z, -x, -y or -z; unless given y of trc, and of c3d"
        " the file's.",
    )
    offset: float = option(0.0, "Seconds that the reference's first moment is after the clip's.")
