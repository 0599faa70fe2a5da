"""Widths of the body's outline beside those of the real clip's silhouettes, across limbs, hips and head.

The body stands where four cameras' keypoints put it, with its flesh as shipped: nothing of it was fitted to pictures. A
section counts where body and silhouette are both separated from their surroundings, which arms beside the trunk seldom
allow.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from benchmarks.accuracy.beam4cam import CAMERAS
from benchmarks.support.common import Data, Json, beam_folder, save, work_folder
from benchmarks.support.tracking import timed_track
from estimator.data.cameras.camera import Camera
from estimator.data.image_cues import ImageCues
from estimator.runs.run_reader import Run
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from humanoid.kinematics.body import points_in_world
from humanoid.shape.surface import Surface, surface_of
from kinemode.terminal import report

# part: landmarks at its ends (means of those given), where between them, and the width [m] above which it is not alone
SECTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...], float, float]] = {
    "head": (("neck",), ("head_top",), 0.75, 0.25),
    "hips": (("left_shoulder", "right_shoulder"), ("left_hip", "right_hip"), 1.0, 0.45),
} | {
    f"{side} {part}": ((f"{side}_{upper}",), (f"{side}_{lower}",), at, widest)
    for side in ("left", "right")
    for part, upper, lower, at, widest in (
        ("upper arm", "shoulder", "elbow", 0.55, 0.18),
        ("forearm", "elbow", "wrist", 0.3, 0.15),
        ("thigh", "hip", "knee", 0.5, 0.26),
        ("calf", "knee", "ankle", 0.3, 0.2),
    )
}
_STEP = 0.25  # px between samples of a mask
_SILHOUETTE = (0.6, 1.7)  # of the body's width: allowed range of a silhouette's, beyond it something else is included


class Width(NamedTuple):
    """A section in one picture: widths [px] of the body's outline and of the silhouette."""

    part: str
    body: float
    silhouette: float


def widths(run: Run, clips: list[Path], every: int, size: int) -> list[Width]:
    """All sections that count, in every so many frames of every camera, in pictures of `size` px."""
    surface = surface_of(run.body, 4000)
    settings = cue_settings(["silhouette"], working_size=size)
    measured = []
    with closing(CueReader(clips, run.header.cameras, settings)) as reader:
        for t in range(0, len(run), every):
            for cues in reader.at(t):
                measured += _in_picture(run, surface, t, cues)
    return measured


def _in_picture(run: Run, surface: Surface, t: int, cues: ImageCues) -> list[Width]:
    if "silhouette" not in cues:
        return []
    posed = run.body.at(run.q[t])
    body = mesh_mask(cues.camera, points_in_world(posed, surface.joint, surface.local), surface.faces)
    silhouette = cues["silhouette"].mask & cues["silhouette"].known
    landmarks = dict(zip(run.body.landmark_names, run.body.landmarks(posed), strict=True))
    measured = []
    for name, (upper, lower, at, widest) in SECTIONS.items():
        a, b = (np.mean([landmarks[n] for n in names], axis=0) for names in (upper, lower))
        centre = a + at * (b - a)
        x, along = cues.camera.project(centre[None])[0], np.diff(cues.camera.project(np.stack([a, b])), axis=0)[0]
        if np.linalg.norm(along) * 2.0 < np.linalg.norm(b - a) * _pixels_per_metre(cues.camera, centre):
            continue  # seen from its end
        across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        own, seen = (sum(_reach(mask, x, s * across) for s in (-1, 1)) for mask in (body, silhouette))
        limit = widest * _pixels_per_metre(cues.camera, centre)
        if 0.0 < own < limit and _SILHOUETTE[0] < seen / own < _SILHOUETTE[1]:
            measured.append(Width(name.removeprefix("left ").removeprefix("right "), own, seen))
    return measured


def _pixels_per_metre(camera: Camera, point: np.ndarray) -> float:
    depth = camera.R_camera_world[2] @ point + camera.t_camera_world[2]
    return float(camera.K[0, 0] / depth)


def mesh_mask(camera: Camera, world: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Where faces (F, 3) of points (N, 3) in the world are in a camera's picture, (H, W) bool."""
    width, height = camera.image_size
    mask = np.zeros((height, width), np.uint8)
    for corners in np.round(16.0 * camera.project(world)[faces]).astype(np.int32):
        cv2.fillConvexPoly(mask, corners, 1, shift=4)
    return mask > 0


def _reach(mask: np.ndarray, x: np.ndarray, direction: np.ndarray) -> float:
    """How far a mask continues from x [px]; not at all from outside, without end where it leaves the picture."""
    steps = np.arange(0.0, max(mask.shape), _STEP)
    column, row = np.round(x + steps[:, None] * direction).astype(int).T
    inside = (column >= 0) & (column < mask.shape[1]) & (row >= 0) & (row < mask.shape[0])
    on = mask[row.clip(0, mask.shape[0] - 1), column.clip(0, mask.shape[1] - 1)]
    ends = np.flatnonzero(~on | ~inside)
    return np.inf if not len(ends) or not inside[ends[0]] else float(steps[ends[0]])


def main(
    *,
    data: Data = None,
    run: Path | None = None,
    every: int = 3,
    size: int = 1280,
    json: Json = None,
) -> None:
    """Compare the body's outline with the silhouettes of beam4cam, part by part.

    Parameters
    ----------
    run
        A run of the four cameras from keypoints alone; tracked first unless given. It brings its own flesh.
    every
        Look at every so many frames.
    size
        Longest side of the pictures [px].
    """
    folder = beam_folder(data)
    clips = [folder / "videos" / f"{name}.mp4" for name in CAMERAS]
    if run is not None:
        measured = widths(Run.open(run), clips, every, size)
    else:
        keypoints = {name: folder / "keypoints" / f"{name}.json" for name in CAMERAS}
        with work_folder(None) as kept:
            tracked, _ = timed_track(keypoints, folder / "calibration.json", kept / "four.run")
            measured = widths(tracked, clips, every, size)
    figures = summed(measured)
    made = report.table("outline of the body over that of the silhouette", "part", "median", "quartiles", "sections")
    for part, (median, low, high, count) in figures.items():
        made.add_row(
            part, f"{100 * (median - 1):+.0f} %", f"{100 * (low - 1):+.0f}, {100 * (high - 1):+.0f}", str(count)
        )
    report.console().print(made)
    save(json, {"measure": "outline", "parts": figures})


def summed(measured: list[Width]) -> dict[str, tuple[float, float, float, int]]:
    """Of every part: median and quartiles of the body's width over the silhouette's, and how many sections."""
    figures = {}
    for part in dict.fromkeys(w.part for w in measured):
        ratios = [w.body / w.silhouette for w in measured if w.part == part]
        low, median, high = np.quantile(ratios, [0.25, 0.5, 0.75])
        figures[part] = (float(median), float(low), float(high), len(ratios))
    return figures
