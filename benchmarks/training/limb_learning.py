"""The potentials between limbs that are shipped: learned from captured motion, tried on clips that were held out.

Held-out log density rates the number of kernels. `--write` writes the potentials of all clips but those in
the folder mocap, which the measures of trackers use, and their copies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter

from benchmarks.support.common import Several, check_known, data_folder, save, tell, work_folder
from benchmarks.support.pose_prior_clips import LEFT_OUT, NO_CAPTURED_FILES, captured_files, subject_of, trial_of
from benchmarks.training.limb_learning_plot import draw_potentials
from benchmarks.training.pose_learning import POOR_FIT, VAGUE_STD
from estimator.inference.beliefs.learning import LearnSettings
from estimator.search.cost_model import per_dof
from estimator.search.cost_terms import CostSettings
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.retarget import retarget
from estimator.trackers.loose_limbed.limbs.potential_learning import (
    LimbPoses,
    captured_poses,
    joined,
    learned_potentials,
    log_densities,
    random_poses,
)
from estimator.trackers.loose_limbed.limbs.potentials import SHIPPED, LimbPotentials, load_potentials
from humanoid.kinematics.body import Body
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from kinemode.terminal import report

SUBJECT = "human34"
DT = 1.0 / 30.0  # [s] between the poses of a clip
STEPS = (1.0 / 60.0, DT, 2.0 * DT, 3.0 * DT)
"""[s] that temporal potentials are learned of."""
EVERY = 5  # of so many poses one is learned from: neighbours are redundant
KERNELS = (1, 3, 5, 8)
TRIED = ("07_01", "02_05", "16_01")
"""Trials that are held out in turn: walk_straight, punch, jump."""
DRAWN = 3000  # poses, for subjects without captured motion
ABOUT = (
    "Mixtures of relative placements of {}'s limbs in space and time. Made by `python -m benchmarks limb_learning"
    " --write`{}."
)
CREDIT = (
    " from motion capture: the data used in this project was obtained from mocap.cs.cmu.edu; the database was created"
    " with funding from NSF EIA-0196217. Clips {}. Not seen: {}"
)
NOBODY = " --drawn from poses drawn from the subject's stabilisers within its limits, without captured motion"


def main(
    *,
    data: Path | None = None,
    subject: str = SUBJECT,
    kernels: Annotated[tuple[int, ...], Several] = KERNELS,
    full: Annotated[bool, Parameter(negative="")] = False,
    clips: Annotated[tuple[str, ...], Several] = TRIED,
    held_out: Literal["clip", "person"] = "clip",
    drawn: Annotated[bool, Parameter(negative="")] = False,
    write: Annotated[bool, Parameter(negative="")] = False,
    output: Path = SHIPPED,
    figure: Path | None = None,
    seed: int = 0,
    work: Path | None = None,
    json: Annotated[Path | None, Parameter(name="--json")] = None,
) -> None:
    """Learn the potentials between limbs from motion capture and measure them on clips that were held out.

    Parameters
    ----------
    data
        Folder with mocap and mocap_more in it; KINEMODE_DATA, or ../shared/data next to the checkout, by default.
    subject
        Whose limbs. Captured motions need a whole person; others --drawn.
    kernels
        So many of every mixture are tried; the first is written.
    full
        Whole covariances, not diagonal ones.
    clips
        Trials that are held out in turn, as in 07_01.
    held_out
        Only the clip, or all of the person.
    drawn
        Poses drawn from the subject's stabilisers within its limits instead; held out are others drawn alike.
    write
        Learn of all clips but those in mocap, and write the file, with 3 kernels by default.
    output
        The file that is written; the one that is shipped by default.
    figure
        Draw samples of the file's potentials, as the paper's Figure 3, into this picture.
    seed
        Of K-means, and of drawn poses.
    work
        Folder that keeps the retargeted motions.
    json
        Also write the figures here.
    """
    if write and output == SHIPPED and (drawn or subject != SUBJECT):
        raise InputError("--write", f"the file that is shipped is of {SUBJECT}, captured", remedy="--output FILE")
    body = Body(load_subject(subject))
    graph, settings = limb_graph(body), LearnSettings(full=full)
    if figure is not None and not write:
        draw_potentials(figure, graph, body, load_potentials(output).of_graph(graph, body, output), seed)
        return
    files = [] if drawn else captured_files(data)
    if not files and not drawn:
        print(NO_CAPTURED_FILES)
        return
    if drawn:
        rng, speed = np.random.default_rng(seed), CostSettings()
        of_dof = per_dof(body, speed.turn_speed, speed.root_turn_speed, speed.root_slide_speed)
        poses = {name: random_poses(body, graph, DRAWN, STEPS, of_dof, rng) for name in ("drawn", "drawn_too")}
    else:
        with work_folder(work) as folder:
            poses = {f.stem: poses_of(graph, body, motion(body, subject, f, folder)) for f in files}
    if write:
        settings = settings if kernels == KERNELS else replace(settings, kernels=kernels[0])
        seen = ["drawn"] if drawn else unseen_by(data, list(poses))
        potentials = learned_from(graph, body, poses, seen, settings, seed)
        hidden = sorted(set(poses) - set(seen))
        credit = NOBODY if drawn else CREDIT.format(", ".join(seen), ", ".join(hidden))
        potentials.save(output, ABOUT.format(subject, credit))
        print(f"{len(potentials.spatial)} edges, {len(potentials.temporal)} time steps: {output.name}")
        if figure is not None:
            draw_potentials(figure, graph, body, potentials, seed)
        return
    tried = ["drawn_too"] if drawn else named(list(poses), clips)
    gains = {m: measured(graph, body, poses, tried, held_out, replace(settings, kernels=m), seed) for m in kernels}
    show(gains, settings, held_out)
    save(json, {"measure": "limb potentials", "full": full, "nats": gains})


Nats = dict[str, dict[str, float]]
"""By clip, nats a pose in space, and in time by time step."""


def motion(body: Body, subject: str, path: Path, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """A captured motion on the body: q (T, nq) `DT` apart, and which poses (T,) it can take; kept in the folder."""
    kept = folder / f"{subject}_{path.stem}.npz"
    if not kept.is_file():
        tell(path.stem)
        mocap = load_mocap(path)
        followed = retarget(body, mocap, np.arange(0.0, mocap.seconds, DT))
        firm = [i for i, name in enumerate(followed.names) if name.split("_")[-1] not in VAGUE_STD]
        with replacing(kept) as temporary, temporary.open("wb") as file:
            np.savez(file, q=followed.q, good=followed.residual[:, firm].max(axis=1) < POOR_FIT)
    with np.load(kept) as arrays:
        return arrays["q"], arrays["good"]


def poses_of(graph: LimbGraph, body: Body, moving: tuple[np.ndarray, np.ndarray]) -> LimbPoses:
    """Limb poses of one captured motion."""
    return captured_poses(graph, body, [moving], DT, STEPS)


def named(names: Sequence[str], trials: Sequence[str]) -> list[str]:
    """The clips of these trials. Raises InputError for one that is not there."""
    of = {trial_of(name): name for name in names}
    check_known("--clips", trials, of)
    return [of[trial] for trial in trials]


def unseen_by(data: Path | None, names: Sequence[str]) -> list[str]:
    """The clips that no tracker is measured on: of no trial in the folder mocap."""
    folder = data_folder(data)
    if folder is None:
        raise InputError("limb potentials", "the motion capture is not here", remedy="--data DIR")
    tests = {trial_of(f.stem) for f in (folder / "mocap").glob("*.bvh") if f.stem not in LEFT_OUT}
    return [name for name in names if trial_of(name) not in tests]


def learned_from(
    graph: LimbGraph, body: Body, poses: Mapping[str, LimbPoses], seen: Sequence[str], settings: LearnSettings,
    seed: int,
) -> LimbPotentials:  # fmt: skip
    """The potentials of some clips."""
    return learned_potentials(graph, body, joined([poses[name].thinned(EVERY) for name in seen]), settings, seed)


def measured(
    graph: LimbGraph, body: Body, poses: Mapping[str, LimbPoses], tried: Sequence[str], held_out: str,
    settings: LearnSettings, seed: int,
) -> Nats:  # fmt: skip
    """Nats a pose of every clip that is tried, under the potentials of the others, of time steps of `DT`."""
    short = {name: LimbPoses(p.spatial, {DT: p.forward[DT]}) for name, p in poses.items()}
    nats: Nats = {}
    for clip in tried:
        others = [n for n in poses if n != clip and not (held_out == "person" and subject_of(n) == subject_of(clip))]
        potentials = learned_from(graph, body, short, others, settings, seed)
        space, time = log_densities(potentials, short[clip])
        nats[clip] = {"space": space, "time": time[DT]}
        tell(f"{settings.kernels} kernels, {clip}: {space:.2f} in space, {time[DT]:.2f} in time")
    return nats


def show(gains: Mapping[int, Nats], settings: LearnSettings, held_out: str) -> None:
    """By clip and number of kernels."""
    covariance = "whole covariances" if settings.full else "diagonal covariances"
    title = f"held-out log density [nats a pose], {covariance}"
    made = report.table(title, "clip", *(f"M = {m}: space, time" for m in gains))
    for clip in next(iter(gains.values())):
        made.add_row(clip, *(f"{of[clip]['space']:.2f}, {of[clip]['time']:.2f}" for of in gains.values()))
    out = report.console()
    out.print(made)
    floors = f"deviations of {1e3 * settings.floor:g} mm and {1e3 * settings.floor_turn:g} mrad or more"
    out.print(f"space: mean of the directed edges; time: of limbs, {1e3 * DT:.1f} ms forward and backward; {floors}")
    out.print(f"held out: the {held_out}")
