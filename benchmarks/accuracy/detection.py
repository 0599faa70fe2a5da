"""Keypoints that `kinemode detect` finds in beam4cam's videos beside the shipped ones, and what a track from each of
the two is worth: `kinemode track --detect` against the same track with the shipped keypoints. And all four videos by
that one command, with a camera file as Pose2Sim writes it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

import kinemode as km
from benchmarks.accuracy.beam4cam import CAMERAS, TOGETHER
from benchmarks.support.camera_files import write_pose2sim
from benchmarks.support.common import Data, Json, Several, Work, beam_folder, check_known, save, tell, work_folder
from benchmarks.support.scores import Scores, score
from benchmarks.support.tracking import timed_track
from estimator.data.formats.cameras import load_cameras
from estimator.data.formats.keypoints import load_keypoints
from estimator.runs.reference_motion import Reference
from kinemode.terminal import report

MOST_PX, MOST_RATIO, MOST_MM = 3.0, 1.1, 25.0


@dataclass(frozen=True)
class Difference:
    """How far the keypoints that were found are from the shipped ones.

    median, most: of all keypoints' distances [px], the 95th percentile of them. missing: frames without anybody.
    """

    median: float
    most: float
    missing: int


def difference(detected: Path, shipped: Path) -> Difference:
    ours, theirs = load_keypoints(detected), load_keypoints(shipped)
    distance = np.linalg.norm(ours.pixels - theirs.pixels, axis=2)
    seen = distance[np.isfinite(distance)]
    missing = int(np.isnan(ours.pixels).all(axis=(1, 2)).sum())
    return Difference(float(np.median(seen)), float(np.percentile(seen, 95)), missing)


def main(
    *,
    data: Data = None,
    views: Annotated[tuple[str, ...], Several] = ("cam01", TOGETHER),
    detector: str = "mediapipe",
    seed: int = 0,
    work: Work = None,
    json: Json = None,
) -> None:
    """Detect in beam4cam's videos and track: each camera alone, next to a track from the shipped keypoints, and all
    four.

    Parameters
    ----------
    views
        Cameras to track from alone, and "four" for all together.
    detector
        As in `kinemode detect`.
    seed
        Of the tracker.
    """
    folder = beam_folder(data)
    check_known("--views", views, (*CAMERAS, TOGETHER))
    with work_folder(work) as kept:
        rows = {view: measured(view, folder, detector, seed, kept) for view in views if view != TOGETHER}
        four = together(folder, detector, seed, kept) if TOGETHER in views else None
    show(rows, four)
    figures = {
        view: {"keypoints": asdict(apart), "detected": asdict(ours), "shipped": asdict(theirs)}
        for view, (apart, ours, theirs) in rows.items()
    }
    figures |= {TOGETHER: asdict(four)} if four is not None else {}
    save(json, {"measure": "detection", "detector": detector, "seed": seed, "views": figures})


def show(rows: Mapping[str, tuple[Difference, Scores, Scores]], four: Scores | None) -> None:
    """Print the figures of single cameras, and of all together."""
    made = report.table(
        "beam4cam, one camera: detected and shipped keypoints",
        "view", "median [px]", "95 %", "missing", "MPJPE [mm]", "shipped", "ratio", "PA [mm]", "shipped ", "ratio ",
    )  # fmt: skip
    for view, (apart, ours, theirs) in rows.items():
        made.add_row(
            view, f"{apart.median:.2f}", f"{apart.most:.2f}", str(apart.missing),
            f"{ours.mpjpe:.1f}", f"{theirs.mpjpe:.1f}", f"{ours.mpjpe / theirs.mpjpe:.3f}",
            f"{ours.pa:.1f}", f"{theirs.pa:.1f}", f"{ours.pa / theirs.pa:.3f}",
        )  # fmt: skip
    if rows:
        report.console().print(made)
        print(f"targets: median at most {MOST_PX:g} px; errors at most {MOST_RATIO:g} times the shipped ones'")
    if four is not None:
        errors = f"MPJPE {four.mpjpe:.1f} mm, PA {four.pa:.1f} mm"
        print(f"four videos with cameras in Pose2Sim's layout: {errors}; target at most {MOST_MM:g} mm")


def measured(view: str, folder: Path, detector: str, seed: int, work: Path) -> tuple[Difference, Scores, Scores]:
    """The keypoints' distances, and the errors with those found and with those shipped."""
    video, shipped = folder / "videos" / f"{view}.mp4", folder / "keypoints" / f"{view}.json"
    cameras, reference = folder / "calibration.json", Reference.load(folder / "reference3d.npz")
    theirs, _ = timed_track({view: shipped}, cameras, work / f"{view}_shipped.run", seed=seed)
    out = work / f"{view}_detected.run"
    ours = km.track(
        "human34", video, cameras=cameras, detect=True, detector=detector,
        cues="off", seed=seed, out=out, overwrite=True,
        progress=km.reported,
    )  # fmt: skip
    apart = difference(out.with_suffix(".keypoints") / f"{view}.json", shipped)
    both_scores = score(ours, reference), score(theirs, reference)
    tell(f"{view}: {apart.median:.2f} px; {both_scores[0].mpjpe:.1f}, {both_scores[0].pa:.1f} mm")
    return apart, *both_scores


def together(folder: Path, detector: str, seed: int, work: Path) -> Scores:
    """The errors of all four videos by one command, with the cameras in a file of Pose2Sim's layout."""
    cameras = write_pose2sim(work / "Calib.toml", list(load_cameras(folder / "calibration.json").values()))
    videos, out = [folder / "videos" / f"{name}.mp4" for name in CAMERAS], work / f"{TOGETHER}.run"
    words = ["track", *videos, "--cameras", cameras, "--detect", "--detector", detector, "--seed", seed, "--out", out]
    subprocess.run([sys.executable, "-m", "kinemode", *map(str, words), "--overwrite"], check=True)
    return score(km.open_run(out), Reference.load(folder / "reference3d.npz"))
