"""The film, the stills, the joint curves and the facts of a report, small enough to stand in its page."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from estimator.data.media.film import write_film
from estimator.runs.contact import Contact
from estimator.runs.events import Event
from estimator.runs.forces import Forces
from estimator.runs.run_reader import Run
from viz.palette import ON_PAPER, web
from viz.pictures.contact_plot import contact_drawing
from viz.pictures.forces_plot import forces_drawing
from viz.pictures.joint_plot import JointPanel, draw_panel, panels_of
from viz.pictures.overlay import Progress, drawn, pictures, side_by_side
from viz.pictures.painter import BodyPainter, camera_view
from viz.pictures.rig_picture import ABOVE, RigPlan, draw_rig, name_cameras, path_of
from viz.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from estimator.runs.keypoint_residuals import KeypointResiduals, MarkerResiduals


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


FILM_BYTES = 8_000_000
"""A film takes at most about so much; in the page a third more."""
MOST_SPANS = 12
_FILM_WIDTH, _LEAST_WIDTH = 960, 240  # of all cameras together, and of each [px]
_LONGEST = 720  # of a camera's picture in the film [px]
_PROBE = 60  # frames by which the size of a film is foretold
_STILL_WIDTH = 960  # of all cameras together [px]
_STILL_LONGEST = 640  # of a camera's picture [px]
_QUALITY = 82  # of a JPEG


@dataclass(frozen=True)
class Span:
    """Frames of one status that follow each other: first and last, by their places in the run; the place of the frame
    that is shown for them, and its picture as JPEG."""

    status: str
    first: int
    last: int
    shown: int
    picture: bytes

    @property
    def count(self) -> int:
        """Number of frames."""
        return self.last - self.first + 1


def film(scene: Scene, progress: Progress | None = None) -> bytes | None:
    """The overlay of all cameras as H.264 in MP4, None where it would have to be too small to be of use.

    A long clip is drawn smaller, so that the film stays near `FILM_BYTES`.
    """
    count = len(scene.cameras)
    longest = min(_LONGEST, max(_LEAST_WIDTH, _FILM_WIDTH // count))
    probe = evenly_near(len(scene), _PROBE)
    foretold = len(_encoded(scene, probe, longest, None)) * len(scene) / len(probe)
    if foretold > FILM_BYTES:
        longest = int(longest * np.sqrt(FILM_BYTES / foretold))
    if longest < _LEAST_WIDTH:
        return None
    return _encoded(scene, range(len(scene)), longest, progress)


def evenly_near(count: int, wanted: int) -> range:
    """The middle `wanted` of `count` frames, all where there are fewer."""
    first = max(0, (count - wanted) // 2)
    return range(first, min(count, first + wanted))


def _encoded(scene: Scene, rows: range, longest: int, progress: Progress | None) -> bytes:
    everybody = list(range(len(scene.cameras)))
    with tempfile.TemporaryDirectory() as folder:
        frames = pictures(scene, everybody, True, progress, rows=rows, longest=longest)
        return write_film(Path(folder) / "film.mp4", scene.paced(frames, rows), scene.rate).read_bytes()


def without_picture(scene: Scene) -> list[str]:
    """The cameras without their clip."""
    return [camera.name for camera, frames in zip(scene.cameras, scene.frames, strict=True) if frames is None]


def spans_of(status: tuple[str, ...]) -> list[tuple[str, int, int]]:
    """Runs of equal statuses other than "tracked": the status, first and last frame."""
    spans, first = [], 0
    for name, group in groupby(status):
        last = first + len(list(group)) - 1
        if name != "tracked":
            spans.append((name, first, last))
        first = last + 1
    return spans


def untrusted(scene: Scene, energy: np.ndarray) -> tuple[list[Span], int]:
    """The spans of frames that are not to be trusted, with a picture each, and how many more there are.

    Of more than `MOST_SPANS` the longest are shown. The picture is that of the frame with the highest energy (T,), the
    worst, or of the middle one where none is known.
    """
    everything = spans_of(scene.status)
    chosen = sorted(sorted(everything, key=lambda s: s[1] - s[2])[:MOST_SPANS], key=lambda s: s[1])
    shown = [_worst(energy, first, last) for _, first, last in chosen]
    stills = dict(zip(shown, stills_of(scene, shown), strict=True))
    return (
        [Span(name, first, last, t, stills[t]) for (name, first, last), t in zip(chosen, shown, strict=True)],
        len(everything) - len(chosen),
    )


def _worst(energy: np.ndarray, first: int, last: int) -> int:
    own = energy[first : last + 1]
    return first + int(np.nanargmax(own)) if np.isfinite(own).any() else (first + last) // 2


def stills_of(scene: Scene, rows: list[int]) -> list[bytes]:
    """The overlay of all cameras at some instants, rising, as JPEG."""
    count = len(scene.cameras)
    views = [camera_view(camera, min(_STILL_LONGEST, _STILL_WIDTH // min(count, 4))) for camera in scene.cameras]
    painter = BodyPainter(scene.body)
    streams = [scene.images(c, rows) for c in range(count)]
    stills = []
    for t, *images in zip(rows, *streams, strict=True):
        tiles = [
            drawn(scene, painter, view, c, t, image) for c, (view, image) in enumerate(zip(views, images, strict=True))
        ]
        encoded = cv2.imencode(".jpg", side_by_side(tiles), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
        stills.append(encoded.tobytes())
    return stills


COLOURS = {side: web(colour) for side, colour in ON_PAPER.items()}
"""Colours of the sides."""
_SIZE = (3.6, 2.3)  # inches
_RIG, _RIG_SHAPE = 5.5, (0.5, 1.2)  # inches: width of the picture of the cameras; its least and greatest height over it


def angle_figures(run: Run) -> list[Figure]:
    """A picture for every joint, those of both sides in one, in degrees, or metres where it slides, as `kinemode plot`
    draws them."""
    return [_figure(panel, run) for panel in panels_of([angle.degrees for angle in run.joints.values()])]


def contact_figure(contact: Contact, events: Sequence[Event]) -> Figure:
    """When the feet stand, as `kinemode contact` draws it, with events of gait."""
    return _as_svg(contact_drawing(contact, events), "when the feet stand")


def forces_figure(forces: Forces) -> Figure:
    """Forces and moments, as `kinemode forces` draws them."""
    return _as_svg(forces_drawing(forces), "forces on the feet and moments of joints")


def rig_figure(run: Run) -> Figure:
    """The cameras and the person's path from above."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Drawing

    cameras, path = run.header.cameras, path_of(run.body.landmark_names, run.landmarks)
    plan = RigPlan(cameras, path, {camera.name: camera.place_std for camera in cameras})
    low, high = plan.limits(ABOVE, path)
    wide, tall = high - low
    drawing = Drawing(figsize=(_RIG, _RIG * float(np.clip(tall / wide, *_RIG_SHAPE))), layout="constrained")
    FigureCanvasAgg(drawing)
    axes = drawing.subplots()
    draw_rig(axes, plan, ABOVE, path)
    name_cameras(drawing, plan, {ABOVE: axes})
    return _as_svg(drawing, "the cameras and the person's path from above")


def _figure(panel: JointPanel, run: Run) -> Figure:
    from matplotlib.figure import Figure as Drawing

    drawing = Drawing(figsize=_SIZE)
    drawing.subplots_adjust(left=0.19, right=0.985, bottom=0.19, top=0.89)  # alike in all, so that they line up
    axes = drawing.subplots()
    draw_panel(axes, run, panel)
    axes.set_xlabel("time [s]")
    return _as_svg(drawing, panel.title)


def _as_svg(drawing: Drawing, title: str) -> Figure:
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    FigureCanvasSVG(drawing)  # no window, and none of pyplot's global state
    file = io.BytesIO()
    style: Any = {"svg.fonttype": "none", "svg.hashsalt": title, "font.family": "sans-serif", "font.size": 9.0}
    with mpl.rc_context(style):
        drawing.savefig(file, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    return Figure(title.replace("_", " "), file.getvalue())
