"""The demonstration of recovery: a person hidden by a screen for a while is found again without a past (ELMO)."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.runs.evaluation import mpjpe
from estimator.runs.pairs import paired
from estimator.runs.reference_motion import Reference
from estimator.runs.run_reader import Run
from estimator.search.examples.index import IndexRecipe
from estimator.synthesis.settings import SceneSettings, ViewSettings
from humanoid.subject.subject import Subject, load_subject
from kinemode.indexing import painting_seconds, write_index
from kinemode.progress import Reporter, reported
from kinemode.public.clips import render
from kinemode.public.tracking import track
from kinemode.shot import RenderedClip
from kinemode.target import made_folder
from kinemode.terminal import report
from viz.pictures.overlay import write_overlay
from viz.pictures.sheet import write_sheet

# other lengths than the built-in subject's but hardly another stature: one camera cannot see absolute size
PROPORTIONS = {
    "left_hip_flexion": 1.03,
    "left_clavicle_elevation": 0.97,
    "left_shoulder_elevation": 1.05,
    "left_elbow_flexion": 1.04,
    "left_wrist": 0.97,
    "left_knee_flexion": 1.04,
    "left_ankle_dorsiflexion": 0.98,
    "skull": 1.02,
}


def demo_subject() -> Subject:
    """The person in the clip: human34 with other proportions."""
    return load_subject("human34").scaled(PROPORTIONS)


HIDDEN = (1.2, 2.0)  # s
_FPS = 15.0
_SEED = 34  # the clip stays the same; the seed a user gives is the tracker's
_LEFT, _RIGHT = "cam01", "cam01_right"
RECIPE = IndexRecipe(examples=4000, headings=120.0, pairs=1000, variants=8)
"""Few examples, so that they are soon painted; an index that is to be good has many more."""


class Recovery(NamedTuple):
    """Mean errors over the limb joints of the likeliest hypothesis, in the world, nothing aligned [mm]: in the last
    frame in which the person was seen, the first in which they are seen again, the third, and over all of these."""

    before: float
    after: float
    third: float
    seen: float


def run_occlusion_demo(
    out: str | Path,
    seed: int = 0,
    *,
    index: str | Path | None = None,
    fps: float = _FPS,
    progress: Reporter = reported,
) -> Recovery:
    """Render a clip of a stereo pair, track it by depth and an index of examples alone, draw it, print its errors.

    out: folder for everything, made if it is not there; files of an earlier demonstration are replaced, but its index
    is used again. seed: of the tracker. index: file of examples of human34, a small one is made unless given. fps: of
    the clip. progress: opens a progress report under a label.
    Raises InputError where the folder cannot be written, or the index cannot be used.
    """
    folder, console = made_folder(Path(out)), report.console()
    path = Path(index) if index is not None else folder / f"examples_{RECIPE.examples}.npz"
    if index is None and not path.exists():
        minutes = painting_seconds(RECIPE) / 60.0
        line = f"first {RECIPE.examples} examples of what poses look like are painted, in about {minutes:.1f} minutes"
        console.print(line)
        write_index(load_subject("human34"), RECIPE, path, workers=1, overwrite=True, progress=progress)
    clip = render(
        folder, "reach", subject=demo_subject(), scene=SceneSettings("textured", hidden=(HIDDEN,)),
        view=ViewSettings(fill=0.85, image_size=(320, 240), baseline=0.12), fps=fps, seed=_SEED, progress=progress,
    )  # fmt: skip
    run = track(
        clip.subject, clip.videos, cameras=clip.cameras, cues="depth", stereo={_LEFT: _RIGHT}, tracker="elmo",
        index=path, seed=seed, fit="off", out=folder / "occlusion.run", overwrite=True, progress=progress,
    )  # fmt: skip
    result = recovery(run, clip)
    console.print(
        f"a screen hides the person from {HIDDEN[0]:g} to {HIDDEN[1]:g} s, no pose is given. Mean error of the joints:"
        f" {result.before:.0f} mm in the last frame before the screen, {result.after:.0f} mm in the first after it,"
        f" {result.third:.0f} mm in the third, {result.seen:.0f} mm over all in which the person is seen (in the world)"
    )
    console.print("\nlook at:")
    with progress("overlay") as report_progress:
        overlay = write_overlay(run, folder / "overlay.mp4", camera=_LEFT, progress=report_progress)
    for picture in (overlay, write_sheet(run, folder / "contact_sheet.png")):
        console.print(f"  {picture}", soft_wrap=True)
    return result


def recovery(run: Run, clip: RenderedClip) -> Recovery:
    """Measure a run against the truth that was rendered."""
    pairs = paired(run.body.landmark_names, run.time, Reference.load(clip.truth))
    true, ours = pairs.truth_of_frames(len(run.time)), run.mode_landmarks[:, 0][:, pairs.shared.ours]
    error = 1e3 * mpjpe(ours, true)
    hidden = np.flatnonzero(np.array([HIDDEN[0] <= time < HIDDEN[1] for time in run.time]))
    seen = np.delete(error, hidden)
    before, first = hidden[0] - 1, hidden[-1] + 1
    return Recovery(float(error[before]), float(error[first]), float(error[first + 2]), float(np.nanmean(seen)))
