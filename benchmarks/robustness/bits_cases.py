"""The cases whose bits are compared: inputs with fixed seeds, and the resulting arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import kinemode as km
from benchmarks.accuracy.beam4cam import CAMERAS
from benchmarks.papers_css.sequences import FPS as SEQUENCE_FPS
from benchmarks.support.common import CUES, data_folder
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import write_keypoints
from estimator.synthesis import detector
from estimator.synthesis.settings import DetectorSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from estimator.tracking.registry import TRACKERS
from humanoid.kinematics.body import Body
from humanoid.subject.example_robots import PREFIX, installed
from kinemode.demo import CAMERA, make_clip
from kinemode.target import made_folder

BEAM_FPS = 60.0
FPS = 10.0  # of the short clips, whose motion is to be large
CLIP_SEED = 1
SMALL = (320, 240)
INPUT = ("pictures", "keypoints", "confidence")
RESULT = ("q", "mode_q", "mode_weight", "mode_energy", "covariance")
WITH_CUES = ("css", "condensation", "annealed", "multiple-hypothesis")
PICTURES_ALONE = ("elmo", "psh", "icp", "dual-chain", "likelihood-sampling")
"""Trackers that keypoints alone do not suffice for."""
Given = dict[str, Any]
"""Arguments of `kinemode.track`."""


@dataclass(frozen=True)
class Case:
    """One track.

    given: its arguments, from a folder for what is rendered, a number of frames (None: all there are), and the folder
    of the evaluation data. frames: default number. needs: "beam4cam", or an example robot; "" nothing.
    """

    given: Callable[[Path, int | None, Path | None], Given]
    frames: int | None
    needs: str = ""

    def absent(self, data: Path | None) -> str:
        """Why the case cannot be run here; empty where it can."""
        folder = data_folder(data)
        if self.needs == "beam4cam" and (folder is None or not (folder / "beam4cam" / "calibration.json").is_file()):
            return "the clip beam4cam is not here: --data DIR or KINEMODE_DATA names its folder"
        if self.needs.startswith(PREFIX) and self.needs[len(PREFIX) :] not in installed():
            return "example-robot-data is not installed"
        return ""


def _demo(folder: Path, frames: int | None, _: Path | None, *, cues: str | tuple[str, ...] = "auto") -> Given:
    """As `kinemode.demo.track_clip` tracks it; cues beside the keypoints have the flesh fitted too."""
    clip = make_clip(folder, frames=frames)
    return {"subject": "human34", "clips": {CAMERA: clip.videos[CAMERA]}, "cameras": clip.cameras,
            "keypoints": {CAMERA: clip.keypoints[CAMERA]}, "cues": cues}  # fmt: skip


def _beam4cam(_: Path, frames: int | None, data: Path | None, *, cameras: tuple[str, ...]) -> Given:
    parent = data_folder(data)
    assert parent is not None
    folder = parent / "beam4cam"
    return {"subject": "human34", "clips": None, "cameras": folder / "calibration.json",
            "keypoints": {name: folder / "keypoints" / f"{name}.json" for name in cameras},
            "end": None if frames is None else (frames - 0.5) / BEAM_FPS}  # fmt: skip


def _pivot(folder: Path, frames: int | None, _: Path | None) -> Given:
    """The stand-in of `benchmarks.papers_css.sequences`: joints given in the first frame, then pictures alone."""
    fps = SEQUENCE_FPS["pivot"]
    clip = km.render(folder, "pivot", fps=fps, seconds=None if frames is None else frames / fps, seed=CLIP_SEED)
    return {"subject": clip.subject, "clips": clip.videos, "cameras": clip.cameras, "keypoints": clip.first_frame,
            "cues": CUES, "modes": 7, "fit": "off"}  # fmt: skip


def _robot(folder: Path, frames: int | None, _: Path | None, *, name: str) -> Given:
    """Keypoints of a robot whose joints all sway about the middle of their ranges, each at a pace of its own."""
    assert frames is not None
    body, rng = Body(km.load_subject(name)), np.random.default_rng(CLIP_SEED)
    middle, i = body.neutral.copy(), body.bounded_q
    middle[i] = 0.5 * (body.lower[i] + body.upper[i])
    reach, pace, phase = (rng.uniform(*ends, body.nv) for ends in ((0.05, 0.25), (0.3, 1.0), (0.0, 2.0 * np.pi)))
    sway = reach * np.sin(2.0 * np.pi * pace * np.arange(frames)[:, None] / FPS + phase)
    q = np.array([body.clamp(body.integrate(middle, v)) for v in sway])
    cameras = framing_cameras(np.array([body.landmarks(body.at(each)) for each in q]))
    tracks = detector.keypoints(body, q, cameras, rng, fps=FPS)
    files = {camera.name: folder / f"{camera.name}.json" for camera in cameras}
    for camera, track in zip(cameras, tracks, strict=True):
        write_keypoints(files[camera.name], track)
    write_cameras(folder / "cameras.json", cameras)
    return {"subject": name, "clips": None, "cameras": folder / "cameras.json", "keypoints": files}


def _reach(folder: Path, frames: int | None, _: Path | None, *, tracker: str, cues: bool = False) -> Given:
    """human34 reaching, with a small picture; from keypoints, or from pictures after the first frame."""
    clip = km.render(
        folder, "reach", view=ViewSettings(image_size=SMALL), detector=DetectorSettings(noise_px=1.5), fps=FPS,
        seconds=None if frames is None else frames / FPS, seed=CLIP_SEED, videos=cues,
    )  # fmt: skip
    seen = {"clips": clip.videos, "keypoints": clip.first_frame, "cues": CUES} if cues else {
        "clips": None, "keypoints": clip.keypoints}  # fmt: skip
    return {"subject": "human34", "cameras": clip.cameras, "fit": "off", "tracker": tracker, **seen}


_ROBOTS = {name: f"{PREFIX}{name}" for name in ("g1", "panda")}
CASES: dict[str, Case] = {
    "demo": Case(_demo, None),
    "demo-cues": Case(partial(_demo, cues=CUES), 12),
    "cam01": Case(partial(_beam4cam, cameras=CAMERAS[:1]), 60, "beam4cam"),
    "four": Case(partial(_beam4cam, cameras=CAMERAS), 40, "beam4cam"),
    "pivot": Case(_pivot, 15),
    **{name: Case(partial(_robot, name=source), 20, source) for name, source in _ROBOTS.items()},
    **{name: Case(partial(_reach, tracker=name), 10) for name in TRACKERS if name not in PICTURES_ALONE},
    **{f"{name}-cues": Case(partial(_reach, tracker=name, cues=True), 6) for name in WITH_CUES},
}
ENDLESS = ("g1", "panda")
"""Cases whose motion has no end, so that there is no whole clip."""


def outcome(name: str, frames: int | None, seed: int, data: Path | None, folder: Path) -> Mapping[str, np.ndarray]:
    """Run a case in a folder of its own: the arrays of `INPUT` and `RESULT`; no pictures where none are used."""
    given = CASES[name].given(made_folder(folder), frames, data)
    run = km.track(**given, seed=seed, out=folder / "track.run", overwrite=True)
    arrays = {"keypoints": run.pixels, "confidence": run.confidence}
    if given["clips"]:
        arrays["pictures"] = np.concatenate([pictures(path) for path in given["clips"].values()])
    arrays |= {array: getattr(run, array) for array in RESULT}
    return {array: arrays[array] for array in (*INPUT, *RESULT) if array in arrays}


def pictures(path: Path) -> np.ndarray:
    """All frames of a video (T, H, W, 3)."""
    capture, frames = cv2.VideoCapture(str(path)), []
    while (read := capture.read())[0]:
        frames.append(read[1])
    capture.release()
    return np.array(frames)
