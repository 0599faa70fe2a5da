"""The pose prior that is shipped: learned from captured motion, tried on people it was not learned from.

Held-out likelihood rates the number of Gaussians: how much denser than the stabilisers a mixture learned
from the other people is at the poses of a clip. `--write` writes the numbers of the mixture of all clips.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

from benchmarks.support.common import Data, Json, Several, Work, in_processes, save, tell, work_folder
from benchmarks.support.pose_prior_clips import (
    NO_CAPTURED_FILES,
    Task,
    captured_files,
    learned_person,
    spread_of,
    subject_of,
    tracked,
)
from benchmarks.support.scores import TRAJECTORIES, TrackErrors
from benchmarks.training.pose_learning import (
    LEFT_OUT,
    LearnSettings,
    Poses,
    balanced,
    captured_poses,
    learned,
    marginal,
)
from estimator.energy.cost import Cost
from estimator.energy.pose_prior import SHIPPED, PoseMixture, PosePrior
from estimator.energy.priors import Stabilisers
from estimator.trackers.spec import NO_CAPTURE, together
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.target import made_folder
from kinemode.terminal import report

Errors = dict[str, dict[str, list[dict[str, TrackErrors]]]]
"""By clip and share of the prior: errors of every seed by trajectory."""

PriorChoice = Literal["unseen", "shipped", "off"]
"""Learned from all people but the tracked one; the shipped one; or none."""

SUBJECT = "human34"
DRAWN = 5  # seed for subsampling the poses of people with much data
PAIRS = (2, 4, 8, 12)
WEIGHTS = (0.0, 0.25)
ABOUT = (
    "Mixture of Gaussians over joint angles of human34 [rad], each with its mirror image. Made by `python -m"
    " benchmarks pose_prior --write` from motion capture: the data used in this project was obtained from"
    " mocap.cs.cmu.edu; the database was created with funding from NSF EIA-0196217. Clips {}."
)


def main(
    *,
    data: Data = None,
    write: Annotated[bool, Parameter(negative="")] = False,
    track: Annotated[bool, Parameter(negative="")] = False,
    weights: Annotated[tuple[float, ...], Several] = WEIGHTS,
    clips: int = 1,
    seconds: float = 2.0,
    seeds: Annotated[tuple[int, ...], Several] = (0,),
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Learn the pose prior from motion capture and measure it on people who were held out.

    Parameters
    ----------
    write
        Write the numbers that are shipped.
    track
        Also track clips of every person from poor keypoints in one camera, with the prior learned from the others.
    weights
        Shares of the prior in the rest-position priors that are tried then.
    clips
        So many of each person are tracked.
    seconds
        So much of each.
    seeds
        Of the clips' noise and of the tracker.
    jobs
        Clips tracked at a time, each in a process of its own.
    """
    files = captured_files(data)
    if not files:
        print(NO_CAPTURED_FILES)
        return
    body, settings = Body(load_subject(SUBJECT)), LearnSettings()
    poses = {f.stem: captured_poses(body, f, settings.spacing) for f in files}
    if write:
        mixture = mixture_of_all(body, poses, settings)
        mixture.save(SHIPPED, ABOUT.format(", ".join(poses)))
        print(f"{len(mixture.weight)} Gaussians and their mirror images: {SHIPPED.name}")
    gains = {} if write or track else held_out(body, poses, settings)
    if gains:
        show_gains(gains, poses)
    errors: Errors = {}
    if track:
        chosen = spread_of(files, clips)
        with work_folder(work) as folder:
            priors = priors_without(body, poses, dict.fromkeys(subject_of(f.stem) for f in chosen), folder)
            tasks = [
                Task(f, priors[subject_of(f.stem)], tuple(weights), seconds, seed, folder / f"{f.stem}_{seed}")
                for f in chosen
                for seed in seeds
            ]
            for task, by_weight in zip(tasks, in_processes(tracked, tasks, jobs), strict=True):
                for weight, by_trajectory in by_weight.items():
                    errors.setdefault(task.motion.stem, {}).setdefault(weight, []).append(by_trajectory)
        show_errors(errors)
    save(json, {"measure": "pose prior", "gain": gains, "tracked": plain(errors)})


def mixture_of_all(body: Body, poses: Mapping[str, Poses], settings: LearnSettings) -> PoseMixture:
    """The shipped one, of all clips by name."""
    people = [
        [p for name, p in poses.items() if subject_of(name) == who] for who in dict.fromkeys(map(subject_of, poses))
    ]
    chosen = balanced(people, settings.person_poses, np.random.default_rng(DRAWN))
    return marginal(learned(body, chosen, settings, np.random.default_rng(0)), LEFT_OUT)


def without(body: Body, poses: Mapping[str, Poses], person: str, settings: LearnSettings) -> PoseMixture:
    """The clips by name of all people but one."""
    return mixture_of_all(body, {name: p for name, p in poses.items() if subject_of(name) != person}, settings)


def priors_without(body: Body, poses: Mapping[str, Poses], people: Iterable[str], folder: Path) -> dict[str, Path]:
    """By person, the file of the mixture learned from all others."""
    paths = {person: _file_without(person, folder) for person in people}
    for person, path in paths.items():
        without(body, poses, person, LearnSettings()).save(path, f"Without subject {person}.")
    return paths


def _file_without(person: str, folder: Path) -> Path:
    return folder / f"without_{person}.json"


def prior_settings(
    prior: PriorChoice, names: Sequence[str], data: Path | None, changes: Mapping[str, Any], folder: Path
) -> list[dict[str, Any]]:
    """For each of some clips by name, the changes to the settings, with those that give it this prior.

    folder: of the mixtures, which are learned where it does not have them.

    Raises
    ------
    InputError: there is nothing to learn them from.
    """
    if prior != "unseen":
        return [together(NO_CAPTURE if prior == "off" else {}, changes) for _ in names]
    people = [learned_person(name) for name in names]
    paths = _unseen(data, list(dict.fromkeys(p for p in people if p is not None)), folder)
    return [together({} if p is None else {"cost": {"pose_prior_file": str(paths[p])}}, changes) for p in people]


def _unseen(data: Path | None, people: Sequence[str], folder: Path) -> dict[str, Path]:
    """As `priors_without`, from the captured clips in `data`, which are read only where a file is to be made."""
    paths = {person: _file_without(person, folder) for person in people}
    missing = [person for person, path in paths.items() if not path.is_file()]
    if missing:
        files, body = captured_files(data), Body(load_subject(SUBJECT))
        if not files:
            raise InputError("the pose prior", "learns from mocap_more too, which is not here", remedy="--prior off")
        tell("learning the pose prior without the tracked people")
        poses = {f.stem: captured_poses(body, f, LearnSettings().spacing) for f in files}
        priors_without(body, poses, missing, made_folder(folder))
    return paths


def held_out(body: Body, poses: Mapping[str, Poses], settings: LearnSettings) -> dict[int, dict[str, float]]:
    """Gain of log density over the stabilisers, mean over a clip's poses [nats a pose], by number of pairs and clip."""
    gains: dict[int, dict[str, float]] = {}
    for pairs in PAIRS:
        tell(f"{pairs} pairs")
        mixtures = {
            person: without(body, poses, person, replace(settings, pairs=pairs))
            for person in dict.fromkeys(map(subject_of, poses))
        }
        gains[pairs] = {name: gain(body, mixtures[subject_of(name)], clip) for name, clip in poses.items()}
    return gains


def gain(body: Body, mixture: PoseMixture, poses: Poses) -> float:
    """Both energies have the same constant, so that their difference is that of the log densities."""
    before, after = Cost(body, [Stabilisers(body)]), Cost(body, [PosePrior(body, mixture)])
    q = np.repeat(body.neutral[None], len(poses.angles), axis=0)
    q[:, -poses.angles.shape[1] :] = poses.angles
    return float(np.mean([before.value_at(pose) - after.value_at(pose) for pose in q]))


def show_gains(gains: Mapping[int, Mapping[str, float]], poses: Mapping[str, Poses]) -> None:
    """By person: means over the clips."""
    out = report.console()
    title = "held-out log density over the stabilisers' [nats a pose]"
    made = report.table(title, "person (clips, poses)", *(f"{pairs} pairs" for pairs in gains))
    means: dict[int, list[float]] = {pairs: [] for pairs in gains}
    for person in dict.fromkeys(map(subject_of, poses)):
        names = [name for name in poses if subject_of(name) == person]
        for pairs, of in gains.items():
            means[pairs].append(float(np.mean([of[name] for name in names])))
        count = sum(len(poses[name].angles) for name in names)
        made.add_row(f"{person} ({len(names)}, {count})", *(f"{of[-1]:.1f}" for of in means.values()))
    made.add_section()
    made.add_row("mean of people", *(f"{np.mean(of):.2f}" for of in means.values()))
    made.add_row("mean of clips", *(f"{np.mean(list(of.values())):.2f}" for of in gains.values()))
    made.add_row("clips that gain", *(f"{sum(x > 0.0 for x in of.values())} of {len(of)}" for of in gains.values()))
    out.print(made)
    out.print("each person under the mixture that was learned from the others")


def show_errors(errors: Errors) -> None:
    """Means over the seeds; mean and median over clips, and of the differences from the first share."""
    out = report.console()
    for trajectory in TRAJECTORIES:
        shares = list(next(iter(errors.values())))
        made = report.table(f"hips aligned, PA [mm]: {trajectory}", "clip", *(f"share {w}" for w in shares))
        by_clip = np.array([[_errors([s[trajectory] for s in of[w]]) for w in shares] for of in errors.values()])
        for name, row in zip(errors, by_clip, strict=True):
            made.add_row(name, *map(_pair, row))
        made.add_section()
        made.add_row("mean", *map(_pair, by_clip.mean(axis=0)))
        made.add_row("median", *map(_pair, np.median(by_clip, axis=0)))
        less = by_clip - by_clip[:, :1]
        made.add_row("difference, mean", *map(_pair, less.mean(axis=0)))
        made.add_row("difference, median", *map(_pair, np.median(less, axis=0)))
        error = less.std(axis=0, ddof=1) / np.sqrt(len(less)) if len(less) > 1 else np.full_like(less[0], np.nan)
        made.add_row("its standard error", *map(_pair, error))
        out.print(made)
    out.print("keypoints of one camera; share: of the prior, learned from other people, in the rest-position priors")


def _errors(errors: Sequence[TrackErrors]) -> tuple[float, float]:
    return float(np.mean([e.aligned for e in errors])), float(np.mean([e.pa for e in errors]))


def _pair(errors: np.ndarray) -> str:
    return f"{errors[0]:.1f}, {errors[1]:.1f}"


def plain(errors: Errors) -> dict[str, object]:
    """The errors as JSON has them."""
    return {
        name: {
            w: [{t: asdict(e) for t, e in by_trajectory.items()} for by_trajectory in seeds] for w, seeds in of.items()
        }
        for name, of in errors.items()
    }
