"""The captured clips that the pose prior is learned from; and clips tracked from poor keypoints in one camera, with
shares of a prior that has not seen the person."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import kinemode as km
from benchmarks.support.common import NO_CAPTURE_HERE, data_folder, tell
from benchmarks.support.mocap_person import DETECTOR, FPS, person
from benchmarks.support.scores import TrackErrors, trajectories
from benchmarks.support.tracking import timed_track
from estimator.runs.reference_motion import Reference
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.settings import DetectorSettings, ViewSettings
from humanoid.support.errors import InputError
from kinemode.shot import RenderedClip

LEFT_OUT = ("wave_hello_fair1",)  # another skeleton: on human34 knees and back lie on their limits
FOLDERS = ("mocap_more", "mocap")
NO_CAPTURED_FILES = f"{NO_CAPTURE_HERE}, and mocap_more"
"""What a measure prints that finds none of `captured_files`."""
_TINY = 1e-6  # s
_TRIAL = re.compile(r"(\d\d)_(\d\d)$")  # how the name of a clip ends: subject and trial of the CMU database


def captured_files(data: Path | None) -> list[Path]:
    """One BVH file of every trial; none where no folder was given and the data is absent.

    Raises
    ------
    InputError: the folder that was given lacks mocap or mocap_more.
    """
    folder = data_folder(data)
    files = [sorted((folder / name).glob("*.bvh")) if folder else [] for name in FOLDERS]
    if not all(files):
        if data is None:
            return []
        raise InputError(data, "lacks BVH files in mocap or mocap_more", remedy="the prior is learned from both")
    by_trial: dict[str, Path] = {}
    for path in (*files[0], *files[1]):  # a trial in both is longer in the first
        if path.stem not in LEFT_OUT:
            by_trial.setdefault(trial_of(path.stem), path)
    return [by_trial[trial] for trial in sorted(by_trial)]


def subject_of(name: str) -> str:
    """Number of the captured person, from the name of a clip."""
    return _trial(name).group(1)


def trial_of(name: str) -> str:
    """Numbers of the captured person and the trial, from the name of a clip: the same of its copy in the other
    folder."""
    return _trial(name).group()


def learned_person(name: str) -> str | None:
    """Number of the person of a clip if the shipped prior was learned from them, None otherwise."""
    return subject_of(name) if name not in LEFT_OUT and _TRIAL.search(name) else None


def _trial(name: str) -> re.Match[str]:
    match = _TRIAL.search(name)
    if match is None:
        raise InputError(name, "does not end with the numbers of subject and trial", remedy="as in walk_07_01.bvh")
    return match


def spread_of(files: Sequence[Path], count: int) -> list[Path]:
    """At most `count` clips of each person, the middle ones of as many equal parts of that person's trials."""
    chosen = []
    for who in dict.fromkeys(subject_of(f.stem) for f in files):
        own = [f for f in files if subject_of(f.stem) == who]
        parts = min(count, len(own))
        chosen += [own[int((i + 0.5) * len(own) / parts)] for i in range(parts)]
    return chosen


def windows_of(whole: float, seconds: float, count: int) -> list[float]:
    """Where windows of so many seconds begin in a clip that is `whole` [s] long: at most `count`, spread evenly, that
    do not overlap; the first at the clip's beginning, where a shorter clip has its only one."""
    fits = max(1, min(count, int(whole / seconds + _TINY)))
    apart = (whole - seconds) / (fits - 1) if fits > 1 else 0.0
    return [round(i * apart - _TINY, 2) + 0.0 for i in range(fits)]


def cut_motion(motion: Path, start: float, out: Path) -> Path:
    """Write a BVH file without its first seconds, and return its path."""
    head, mark, rows = motion.read_text(encoding="utf-8").partition("Frame Time:")
    step, *frames = rows.strip().splitlines()
    left = frames[round(start / float(step)) :]
    if not mark or not left:
        raise InputError(motion, f"has no frame after {start:g} s")
    head = re.sub(r"Frames:\s*\d+", f"Frames: {len(left)}", head)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text("\n".join([f"{head}{mark} {step.strip()}", *left]) + "\n", encoding="utf-8")
    return out


def render_captured(
    motion: Path,
    seconds: float | None,
    seed: int,
    folder: Path,
    *,
    videos: bool = False,
    masks: bool = False,
    detector: DetectorSettings = DETECTOR,
    fps: float = FPS,
    cameras: int = 1,
) -> RenderedClip:
    """At most so many seconds of a captured motion, all of it for None, by the person in the pictures before one
    camera or more: the files of the clip, whose keypoints have the detector's errors; no videos and masks unless they
    are requested."""
    return km.render(
        folder, motion, subject=person(), detector=detector, fps=fps, seed=seed, videos=videos, masks=masks,
        view=ViewSettings(count=cameras),
        seconds=None if seconds is None else min(seconds, load_mocap(motion).seconds),
    )  # fmt: skip


@dataclass(frozen=True)
class Task:
    """One clip.

    prior: file of the mixture learned from other people. weights: its shares to try. seed: of noise and tracker.
    """

    motion: Path
    prior: Path
    weights: tuple[float, ...]
    seconds: float
    seed: int
    folder: Path


def tracked(task: Task) -> dict[str, dict[str, TrackErrors]]:
    """Errors by share of the prior and trajectory; the person has other lengths than human34, which is fitted."""
    clip = render_captured(task.motion, task.seconds, task.seed, task.folder)
    truth, by_weight = Reference.load(clip.truth), {}
    for weight in task.weights:
        named = {"pose_prior_file": str(task.prior)} if weight > 0.0 else {}
        changes = {"cost": {"pose_prior_weight": weight, **named}}
        run, _ = timed_track(
            clip.keypoints, clip.cameras, task.folder / f"{weight:g}.run", seed=task.seed, settings=changes
        )
        by_weight[f"{weight:g}"] = trajectories(run, truth)
    said = ", ".join(f"{w}: {e['smoothed'].aligned:.1f}, {e['smoothed'].pa:.1f}" for w, e in by_weight.items())
    tell(f"{task.motion.stem}, seed {task.seed}: hips aligned, PA [mm], by share of the prior, {said}")
    return by_weight
