"""The real clip beam4cam from four cameras with files that disagree: keypoints of half the size, at half the frame
rate, and cameras that started 0.1 s late. With declarations the track is as good as from the originals; without, the
disagreement is reported."""

from __future__ import annotations

import json as json_text
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import kinemode as km
from benchmarks.accuracy.beam4cam import CAMERAS
from benchmarks.support.common import Data, Json, Work, beam_folder, save, tell, work_folder
from estimator.data.media.clip import Clip
from estimator.data.media.film import write_film
from estimator.runs.evaluation import evaluate_points
from estimator.runs.reference_motion import Reference
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.inputs.load import load_inputs
from kinemode.request import FileOptions
from kinemode.target import made_folder
from kinemode.terminal import report

FPS = 60.0
LATE, LATE_FRAMES = ("cam02", "cam04"), 6
SHARE = 0.10
FAULTS = ("size", "rate", "offset")
CASES: dict[str, tuple[str, ...]] = {**{fault: (fault,) for fault in FAULTS}, "all": FAULTS}


@dataclass(frozen=True)
class Files:
    """A case's clips and keypoint files by camera, and what a user has to declare of them."""

    clips: dict[str, Path]
    keypoints: dict[str, Path]
    declared: dict[str, Any]


def disagreeing(folder: Path, work: Path, faults: tuple[str, ...]) -> Files:
    """Copies of the clip's files with some faults, none of which the files declare."""
    keypoints: dict[str, Path] = {}
    clips: dict[str, Path] = {}
    sizes: dict[str, tuple[int, int]] = {}
    declared: dict[str, Any] = {}
    for name in CAMERAS:
        content = json_text.loads((folder / "keypoints" / f"{name}.json").read_text())
        clips[name] = folder / "videos" / f"{name}.mp4"
        if "offset" in faults and name in LATE:
            content["frames"] = content["frames"][LATE_FRAMES:]
            clips[name] = cut(clips[name], work / f"{name}.mp4")
            declared["offset"] = dict.fromkeys(LATE, LATE_FRAMES / FPS)
        if "rate" in faults:
            content["frames"] = content["frames"][::2]
            del content["fps"]
            declared["fps"] = FPS / 2.0
        if "size" in faults:
            width, height = content.pop("image_size")
            sizes[name] = (width // 2, height // 2)
            declared["keypoint_size"] = sizes
            halved = [np.array(frame["keypoints"]) for frame in content["frames"]]
            for points in halved:
                points[:, :2] = (points[:, :2] + 0.5) / 2.0 - 0.5
            content["frames"] = [{"keypoints": points.tolist()} for points in halved]
        keypoints[name] = work / f"{name}.json"
        keypoints[name].write_text(json_text.dumps(content))
    return Files(clips, keypoints, declared)


def cut(clip: Path, out: Path) -> Path:
    """The clip without its first frames."""
    opened = Clip.open(clip)
    write_film(out, opened.frames(LATE_FRAMES), FPS)
    opened.close()
    return out


def tracked(folder: Path, files: Files, out: Path, declared: dict[str, Any]) -> Run:
    return km.track(
        "human34", files.clips, cameras=folder / "calibration.json", keypoints=files.keypoints, cues="off", out=out,
        overwrite=True, **declared,
    )  # fmt: skip


def error(run: Run, reference: Reference, times: np.ndarray) -> float:
    """MPJPE [mm] of the smoothed trajectory over the reference's frames near these times (T,) [s]."""
    assert reference.time is not None
    near = np.abs(reference.time[:, None] - times).min(axis=1) < 0.25 / FPS
    part = Reference(reference.names, reference.points[near], reference.time[near])
    return 1e3 * float(
        evaluate_points(run.body.landmark_names, run.landmarks, run.mode_landmarks, run.time, part)["mpjpe"]
    )


def response(folder: Path, files: Files) -> tuple[str, tuple[str, ...]]:
    """The response without declarations: refused, warned or silent, and the messages."""
    try:
        loaded = load_inputs(
            Body(load_subject("human34")),
            FileOptions(files.clips, keypoints=files.keypoints, cameras=folder / "calibration.json"),
        )
    except InputError as problem:
        return "refused", (str(problem),)
    return ("warned" if loaded.notes else "silent"), loaded.notes


def main(
    *,
    data: Data = None,
    work: Work = None,
    json: Json = None,
) -> None:
    """Track beam4cam with files that disagree, with and without declarations."""
    folder = beam_folder(data)
    reference = Reference.load(folder / "reference3d.npz")
    figures: dict[str, Any] = {}
    with work_folder(work) as kept:
        files = disagreeing(folder, made_folder(kept / "original"), ())
        original = tracked(folder, files, kept / "original.run", {})
        outcome, messages = response(folder, files)
        figures["original"] = {"declared": {}, "undeclared": outcome, "messages": messages}
        for case, faults in CASES.items():
            files = disagreeing(folder, made_folder(kept / case), faults)
            run = tracked(folder, files, kept / f"{case}.run", files.declared)
            mpjpe, usual = (error(shown, reference, run.time) for shown in (run, original))
            outcome, messages = response(folder, files)
            figures[case] = {
                "declared": files.declared, "frames": len(run), "mpjpe": mpjpe, "original": usual,
                "ratio": mpjpe / usual, "undeclared": outcome, "messages": messages, "notes": run.header.notes,
            }  # fmt: skip
            tell(f"{case}: {mpjpe:.1f} mm, originals {usual:.1f} mm; undeclared: {outcome}")
    print_figures(figures)
    save(json, {"measure": "disagreement", "cases": figures})


def print_figures(figures: dict[str, Any]) -> None:
    made = report.table(
        "beam4cam, four cameras, files that disagree",
        "case",
        "frames",
        "declared [mm]",
        "originals [mm]",
        "ratio",
        "undeclared",
    )
    for case in CASES:
        f = figures[case]
        made.add_row(
            case, str(f["frames"]), f"{f['mpjpe']:.1f}", f"{f['original']:.1f}", f"{f['ratio']:.3f}", f["undeclared"]
        )
    out = report.console()
    out.print(made)
    for case in ("original", *CASES):
        for message in figures[case]["messages"]:
            out.print(f"{case}, undeclared: {message}", soft_wrap=True)
    passed = all(figures[c]["ratio"] <= 1.0 + SHARE and figures[c]["undeclared"] != "silent" for c in CASES)
    passed &= figures["original"]["undeclared"] == "silent"
    out.print(f"declared within {SHARE:.0%} of the originals, undeclared never silent: {'yes' if passed else 'NO'}")
