"""Sequences started by an index of examples, and in which the person may be hidden: whether they are found, and
when."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimator.runs.evaluation import HIPS, mpjpe
from estimator.runs.run_reader import Run
from estimator.synthesis.settings import SceneSettings, ViewSettings

FOUND = 120.0  # mm
WITHIN = 5  # frames
_BASELINE = 0.12  # m


@dataclass(frozen=True)
class Beginning:
    """How a track without an initial pose starts. index: of human34. hidden [s]: intervals in which a screen hides the
    person."""

    index: Path
    hidden: tuple[tuple[float, float], ...] = ()

    @property
    def name(self) -> str:
        """The name of the clip, after its motion's."""
        return "_pair" + "".join(f"_{begin:g}-{end:g}" for begin, end in self.hidden)

    @property
    def rendered(self) -> dict[str, Any]:
        """Arguments of `kinemode.render`: depth takes a stereo pair and a room that is speckled."""
        scene = SceneSettings(background="textured", hidden=self.hidden)
        return {"subject": "human34", "scene": scene, "view": ViewSettings(baseline=_BASELINE)}

    @property
    def tracked(self) -> dict[str, Any]:
        """Arguments of `kinemode.track`."""
        return {"stereo": {"cam01": "cam01_right"}, "start": "index", "index": self.index}


@dataclass(frozen=True)
class StartErrors:
    """Errors over all landmarks, hips aligned [mm]. first, first_best: of the likeliest hypothesis in the first frame,
    and of the nearest. after: of the likeliest in the first `WITHIN` frames after each time in which the person was
    hidden."""

    first: float
    first_best: float
    after: list[list[float]]


def start_errors(run: Run, truth: Path, fps: float, hidden: tuple[tuple[float, float], ...]) -> StartErrors:
    """Measure a run against the truth that was rendered."""
    with np.load(truth) as true:
        names, points = true["landmark_names"].tolist(), true["landmarks"]
    order = [names.index(name) for name in run.body.landmark_names]
    root = [run.body.landmark_names.index(name) for name in HIPS]
    modes = run.mode_landmarks
    error = 1e3 * mpjpe(modes, points[: len(modes), None, order], root)
    ends = [round(end * fps) for _, end in hidden]
    first = error[0]
    return StartErrors(
        float(first[0]), float(np.nanmin(first)), [error[end : end + WITHIN, 0].tolist() for end in ends]
    )


def verdict(start: StartErrors) -> str:
    """The figures beside the targets."""
    said = f"first frame, hips aligned: nearest hypothesis {start.first_best:.0f} mm (target at most {FOUND:.0f}),"
    said += f" likeliest {start.first:.0f} mm"
    for errors in start.after:
        back = next((str(k + 1) for k, error in enumerate(errors) if error <= FOUND), "none")
        shown = ", ".join(f"{error:.0f}" for error in errors)
        said += f"; frames after an occlusion: {shown} mm, back in frame {back} (target {WITHIN} at most)"
    return said
