"""The pose prior that is shipped: learned from captured motion, tried on clips it was not learned from.

Held-out likelihood decides the number of Gaussians: how much denser than the stabilisers a mixture learned from the
other clips is at the poses of a clip. `--write` writes the numbers of the mixture of all clips.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from benchmarks.common import Several, in_processes, save, start, work_folder
from benchmarks.mocap import motion_files
from benchmarks.pose_learning import LearnSettings, Poses, captured_poses, learned
from benchmarks.pose_prior_clips import Task, tracked
from benchmarks.scores import TRAJECTORIES, TrackErrors
from estimator.terms.pose_mixture import SHIPPED, PoseMixture
from estimator.terms.pose_prior import PosePrior
from estimator.terms.priors import Stabilisers
from estimator.terms.term import Cost
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

Errors = dict[str, dict[str, list[dict[str, TrackErrors]]]]
"""By clip and share of the prior: errors of every seed by trajectory."""

SUBJECT = "human34"
LEFT_OUT = ("wave_hello_fair1",)  # another skeleton: on human34 knees and back lie on their limits
PAIRS = (1, 2, 3, 4, 6, 8)
WEIGHTS = (0.0, 0.25, 0.5)
ABOUT = (
    "Mixture of Gaussians over joint angles of human34 [rad], each with its mirror image. Made by `python -m"
    " benchmarks.pose_prior --write` from motion capture: the data used in this project was obtained from"
    " mocap.cs.cmu.edu; the database was created with funding from NSF EIA-0196217. Clips {}."
)


def main(
    *,
    data: Path | None = None,
    write: Annotated[bool, Parameter(negative="")] = False,
    track: Annotated[bool, Parameter(negative="")] = False,
    weights: Annotated[tuple[float, ...], Several] = WEIGHTS,
    seconds: float = 2.0,
    seeds: Annotated[tuple[int, ...], Several] = (0,),
    jobs: int = 1,
    work: Path | None = None,
    json: Annotated[Path | None, Parameter(name="--json")] = None,
) -> None:
    """Learn the pose prior from motion capture and measure it on clips that were held out.

    Parameters
    ----------
    data
        Folder with mocap in it; KINEMODE_DATA, or ../shared/data next to the checkout, by default.
    write
        Write the numbers that are shipped.
    track
        Also track every clip from poor keypoints in one camera, with the prior learned from the others.
    weights
        Shares of the prior in the rest-position priors that are tried then.
    seconds
        So much of each clip is tracked.
    seeds
        Of the clips' noise and of the tracker.
    jobs
        Clips tracked at a time, each in a process of its own.
    work
        Folder that keeps clips and runs.
    json
        Also write the figures here.
    """
    files = [f for f in motion_files(data, (), True) if f.stem not in LEFT_OUT]
    if not files:
        print("the motion capture is not here: --data DIR or KINEMODE_DATA names the folder that has mocap in it")
        return
    body, settings = Body(load_subject(SUBJECT)), LearnSettings()
    poses = {f.stem: captured_poses(body, f, settings.spacing) for f in files}
    if write:
        mixture = shipped_mixture(body, poses, settings)
        mixture.save(SHIPPED, ABOUT.format(", ".join(poses)))
        print(f"{len(mixture.weight)} Gaussians and their mirror images: {SHIPPED.name}")
    gains = held_out(body, poses, settings)
    show_gains(gains, poses)
    errors: Errors = {}
    if track:
        with work_folder(work) as folder:
            tasks = []
            for f in files:
                prior = folder / f"without_{f.stem}.json"
                without(body, poses, f.stem, settings).save(prior, f"Without {f.stem}.")
                tasks += [Task(f, prior, tuple(weights), seconds, seed, folder / f"{f.stem}_{seed}") for seed in seeds]
            for task, by_weight in zip(tasks, in_processes(tracked, tasks, jobs), strict=True):
                for weight, by_trajectory in by_weight.items():
                    errors.setdefault(task.motion.stem, {}).setdefault(weight, []).append(by_trajectory)
        show_errors(errors)
    save(json, {"measure": "pose prior", "gain": gains, "tracked": plain(errors)})


def shipped_mixture(body: Body, poses: Mapping[str, Poses], settings: LearnSettings) -> PoseMixture:
    """Of all clips."""
    return learned(body, list(poses.values()), settings, np.random.default_rng(0))


def without(body: Body, poses: Mapping[str, Poses], name: str, settings: LearnSettings) -> PoseMixture:
    """Of all clips but one."""
    return learned(body, [p for k, p in poses.items() if k != name], settings, np.random.default_rng(0))


def held_out(body: Body, poses: Mapping[str, Poses], settings: LearnSettings) -> dict[int, dict[str, float]]:
    """Gain of log density over the stabilisers, mean over a clip's poses [nats a pose], by number of pairs and clip."""
    return {
        pairs: {
            name: gain(body, without(body, poses, name, replace(settings, pairs=pairs)), clip)
            for name, clip in poses.items()
        }
        for pairs in PAIRS
    }


def gain(body: Body, mixture: PoseMixture, poses: Poses) -> float:
    """Both energies have the same constant, so that their difference is that of the log densities."""
    before, after = Cost(body, [Stabilisers(body)]), Cost(body, [PosePrior(body, mixture)])
    q = np.repeat(body.neutral[None], len(poses.angles), axis=0)
    q[:, -poses.angles.shape[1] :] = poses.angles
    return float(np.mean([before.value_at(pose) - after.value_at(pose) for pose in q]))


def show_gains(gains: Mapping[int, Mapping[str, float]], poses: Mapping[str, Poses]) -> None:
    out = report.console()
    title = "held-out log density over the stabilisers' [nats a pose]"
    made = report.table(title, "clip (poses)", *(f"{2 * pairs} Gaussians" for pairs in gains))
    for name, clip in poses.items():
        made.add_row(f"{name} ({len(clip.angles)})", *(f"{of[name]:.1f}" for of in gains.values()))
    made.add_section()
    made.add_row("mean of clips", *(f"{np.mean(list(of.values())):.2f}" for of in gains.values()))
    out.print(made)
    out.print("each clip under the mixture that was learned from the others")


def show_errors(errors: Errors) -> None:
    """Means over the seeds, and over clips."""
    out = report.console()
    for trajectory in TRAJECTORIES:
        shares = list(next(iter(errors.values())))
        made = report.table(f"hips aligned, PA [mm]: {trajectory}", "clip", *(f"share {w}" for w in shares))
        for name, of in errors.items():
            made.add_row(name, *(_errors([s[trajectory] for s in of[w]]) for w in shares))
        made.add_section()
        every = [[s[trajectory] for of in errors.values() for s in of[w]] for w in shares]
        made.add_row("mean", *(_errors(column) for column in every))
        out.print(made)
    out.print("keypoints of one camera; share: of the prior, learned from the other clips, in the rest-position priors")


def _errors(errors: Sequence[TrackErrors]) -> str:
    return f"{np.mean([e.aligned for e in errors]):.1f}, {np.mean([e.pa for e in errors]):.1f}"


def plain(errors: Errors) -> dict[str, object]:
    """The errors as JSON has them."""
    return {
        name: {
            w: [{t: asdict(e) for t, e in by_trajectory.items()} for by_trajectory in seeds] for w, seeds in of.items()
        }
        for name, of in errors.items()
    }


if __name__ == "__main__":
    start(main)
