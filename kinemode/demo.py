"""The built-in demonstration: a clip with known motion, tracked from one camera, measured and shown."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from estimator.runs.evaluation import Evaluation, evaluate
from estimator.runs.reference_motion import Reference
from estimator.runs.run_reader import Run
from estimator.synthesis.motion import MOTION_SECONDS, authored_motion
from estimator.synthesis.settings import DetectorSettings, SceneSettings
from estimator.synthesis.views import scene_cameras
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError
from kinemode.demo_occlusion import demo_subject
from kinemode.progress import Reporter, reported
from kinemode.public.tracking import track
from kinemode.shot import FilmedMotion, RandomSources, RenderedClip, WantedFiles, write_shot
from kinemode.target import made_folder
from kinemode.terminal import report
from viz.pictures.overlay import write_overlay
from viz.pictures.sheet import write_sheet
from viz.preview.page import write_html

FPS = 30.0
CAMERA = "front_right"  # the one that is tracked from
_CLIP_SEED = 34  # the clip stays the same; the seed a user gives is the tracker's


def make_clip(
    folder: str | Path,
    *,
    seed: int = _CLIP_SEED,
    frames: int | None = None,
    videos: bool = True,
    progress: Reporter = reported,
) -> RenderedClip:
    """Write the built-in clip into a folder: 3 s at 30 frames per second, two cameras.

    seed: of the room, the clothes and the errors of the keypoints. frames: only so many of the first.
    videos: False leaves the pictures out, where the keypoints are enough.
    Raises InputError where the folder cannot be written.
    """
    body, cameras = Body(demo_subject()), scene_cameras()
    times = np.arange(round(FPS * MOTION_SECONDS) if frames is None else frames) / FPS
    q = authored_motion(body, times)
    scene = np.random.default_rng((seed, 1))
    # the sensors' noise continues where the scene's random numbers end, so the clip is that of earlier versions
    draws = RandomSources(np.random.default_rng((seed, 0)), scene, [scene] * len(cameras))
    shot = FilmedMotion(body, q, times, FPS, cameras, SceneSettings())
    return write_shot(folder, shot, draws, DetectorSettings(), wanted=WantedFiles(videos), progress=progress)


def track_clip(
    clip: RenderedClip, out: str | Path, *, seed: int = 0, camera: str = CAMERA, progress: Reporter = reported
) -> tuple[Run, float]:
    """Track the clip from one camera with the public interface; the run, and frames per second with the fit."""
    start = time.perf_counter()
    run = track(
        "human34",
        {camera: clip.videos[camera]} if clip.videos else None,
        cameras=clip.cameras,
        keypoints={camera: clip.keypoints[camera]},
        seed=seed,
        out=out,
        overwrite=True,
        progress=progress,
    )
    seconds = time.perf_counter() - start
    return run, len(run) / max(seconds, 1e-9)


def run_demo(out: str | Path, seed: int = 0, *, frames: int | None = None, progress: Reporter = reported) -> Evaluation:
    """Render the built-in clip, track it from one camera, print the errors, write the images, print where they are.

    out: folder for everything, made if it is not there; files of an earlier demonstration are replaced.
    seed: of the tracker. frames: only so many of the first. progress: opens a progress report under a label.
    Raises InputError where the folder cannot be written.
    """
    folder = made_folder(Path(out))
    clip = make_clip(folder, frames=frames, progress=progress)
    run, rate = track_clip(clip, folder / "demo.run", seed=seed, progress=progress)
    result = evaluate(run, Reference.load(clip.truth))
    report.print_evaluation(result)
    console = report.console()
    console.print(f"{rate:.1f} frames per second, start, fit and smoothing included (a first run also compiles)")
    pictures = _draw(run, folder, progress)
    console.print("\nlook at:")
    for path in pictures:
        console.print(f"  {path}", soft_wrap=True)
    return result


def shown(out: str | Path, seed: int = 0, *, occlusion: bool = False, index: str | Path | None = None) -> None:
    """The work of `kinemode demo`: `run_demo`, or that of a person whom a screen hides, by an index of examples where
    one is given. Raises InputError for an index that is not used, and as these do."""
    if occlusion:
        from kinemode.demo_occlusion import run_occlusion_demo  # it has the body from here

        run_occlusion_demo(out, seed, index=index)
        return
    if index is not None:
        raise InputError("index", "the demonstration looks nothing up in it", remedy="leave it out, or --occlusion")
    run_demo(out, seed)


def _draw(run: Run, folder: Path, progress: Reporter) -> list[Path]:
    with progress("overlay") as report_progress:
        overlay = write_overlay(run, folder / "overlay.mp4", progress=report_progress)
    return [overlay, write_html(run, folder / "preview.html"), write_sheet(run, folder / "contact_sheet.png")]
