"""Rest positions of human34 and their widths, from the poses of many people: the numbers of its `<stabiliser>`s.

People are captured on human34 (CMU, with corrected legs: `benchmarks.training.captured_legs`) or tracked by a
laboratory's markers (OpenCap's and two others). People have equal weights, and so have the clips of a person. For each
joint the density of the stabilisers, two halves of Student's t with their own scales (`estimator.energy.priors`), is
fitted by likelihood, left and right together, and tested on people left out. Angles have the deviation of a joint's
zero (`ZERO_STD`) added, by which two skeletons or two models of one person differ.

Most people walk most of the time, with arms that hang. How far arms swing is shipped with the scales of distinct poses
(`DISTINCT`), each counted once however long or often a person takes it: the prior is of people who do something else
than walk, too.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from cyclopts import Parameter
from scipy.optimize import minimize

from benchmarks.support.common import Data, Json, data_folder, in_processes, save
from benchmarks.support.measured_people import measured_files, measured_run
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files, subject_of
from benchmarks.training.captured_legs import FITTED, Correction, Legs, corrected, correction
from benchmarks.training.pose_learning import ZERO_STD, captured_motion, joints_of
from estimator.energy.kernels.priors import STABILISER_NU as NU, stabiliser_log_integral
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import without_side
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

URDF = Path(__file__).resolve().parents[2] / "humanoid" / "urdf" / "human34.urdf"
FPS = 15.0
UNSEEN = ("lumbar_flexion", "neck_axial")
"""Joints that are not fitted: captured skeletons share a bend between back and hips in their own way, and no landmark
of theirs shows how the head is turned."""
WRITTEN = (
    "knee_flexion", "elbow_flexion", "shoulder_elevation", "shoulder_flexion", "shoulder_rotation",
    "clavicle_elevation", "clavicle_protraction", "neck_flexion", "neck_lateral",
)  # fmt: skip
"""Joints whose numbers are shipped. Those of hips, ankles and back are printed alone: most of these people walk, and
one camera before people who squat and rise had their hips off by 6 degrees more with them."""
WIDER = 2.0
"""Factor on the scales that are shipped, but of `AT_THE_END` and `DISTINCT`: skeletons and models of people differ in
where an arm's angles are zero. People left out are tracked as well with 2 as with 1.3, and people of another laboratory
better."""
LIMB = ("shoulder_elevation", "shoulder_flexion", "shoulder_rotation", "elbow_flexion")
"""Joints whose poses are distinct together."""
DISTINCT = ("shoulder_flexion",)
"""Those that are shipped with the scales of distinct poses: arms that hang hardly swing, arms that are raised swing
widely. Of rotation and elbows both ways give the same. Elevation would have a scale of 1 rad above rest, and the middle
of its density, from which searches begin, would be an arm that is raised by 37 degrees."""
APART = 0.3
"""[rad] By how much one joint at least differs in two poses of a limb that are distinct. With 0.2 and 0.4 the scales of
arms are within an eighth of these."""
SYMMETRIC = ("lumbar_lateral", "lumbar_axial", "neck_lateral", "neck_axial")
AT_THE_END = ("knee_flexion",)
"""Joints that people hold near the lower end of their range. There the errors of skeletons pile up, so that rest is the
lower decile of the people whose joints a laboratory measured, and the widths alone are fitted."""
_DRAWN, _FOLDS, _LEAST_CLIP = 2000, 5, 5
_QUICKNESS = re.compile(r' quickness="[^"]*"')


class Clip(NamedTuple):
    """Joint angles (T, D) [rad] of a person. measured: by a laboratory's markers."""

    person: str
    name: str
    angles: np.ndarray
    measured: bool


class Density(NamedTuple):
    """The density of a joint's angle [rad]: its mode, and its scales below and above."""

    rest: float
    below: float
    above: float

    def wider(self, factor: float) -> Density:
        """The same with its scales times a factor."""
        return Density(self.rest, factor * self.below, factor * self.above)

    def log(self, x: np.ndarray) -> np.ndarray:
        """Log density (N,) of angles (N,)."""
        z = (x - self.rest) / np.where(x > self.rest, self.above, self.below)
        height = math.log(0.5 * (self.below + self.above)) + stabiliser_log_integral()
        return np.asarray(-0.5 * NU * np.log1p(np.square(z) / NU) - height)


def main(
    *, data: Data = None, write: Annotated[bool, Parameter(negative="")] = False, jobs: int = 1, json: Json = None
) -> None:
    """Fit rest positions and widths, and print them with the log density of people left out.

    Parameters
    ----------
    write
        Write them into human34.urdf.
    jobs
        Clips at a time, each in a process of its own.
    """
    folder, files = data_folder(data), captured_files(data)
    if folder is None or not files:
        print(NO_CAPTURED_FILES)
        return
    body = Body(load_subject("human34"))
    joints = joints_of(body)
    every = in_processes(clip_of, [*files, *measured_files(folder)], jobs)
    legs = report.table("captured legs", "person", "fitted: factor, ankle [rad]", "used")
    for who, own in leg_corrections(every, joints).items():
        legs.add_row(who, *(f"{c.factor:.4f}, {c.ankle:.3f}" for c in (own, FITTED[who])))
    clips = straightened(every, joints)
    samples = drawn_angles(clips, np.random.default_rng(0))
    shipped = {without_side(s.joint): Density(s.rest, s.std, s.std_above) for s in body.subject.stabilisers}
    made = report.table(
        "rest, scale below, scale above [rad]",
        "joint",
        "of all frames",
        "scales of distinct poses",
        "shipped",
        "left out: fitted",
        "symmetric",
        "shipped",
    )
    distinct = distinct_angles(clips, joints, np.random.default_rng(0))
    densities, figures = dict[str, Density](), dict[str, Any]()
    for name in dict.fromkeys(without_side(joint) for joint in joints):
        if name in UNSEEN:
            continue
        people = angles_of(name, joints, samples)
        rest = lower_decile(name, joints, clips) if name in AT_THE_END else 0.0 if name in SYMMETRIC else None
        fitted, left_out = fit_density(list(people.values()), name in SYMMETRIC, rest), held_out(people, name, rest)
        mine = float(np.mean([shipped[name].log(x).mean() for x in people.values()]))
        spread = fit_density([distinct[name]], False, fitted.rest) if name in distinct else fitted
        if name in DISTINCT:
            densities[name] = spread
        elif name in WRITTEN:
            densities[name] = fitted if name in AT_THE_END else fitted.wider(WIDER)
        figures[name] = {"fit": list(fitted), "distinct": list(spread), "left out": left_out, "shipped": mine}
        cells = (" ".join(f"{x:.3f}" for x in density) for density in (fitted, spread, shipped[name]))
        made.add_row(name, *cells, *(f"{x:.2f}" for x in (*left_out, mine)))
    report.console().print(legs)
    report.console().print(made)
    report.print_lines(["left out: log density of people who were left out of the fit, nats a pose"])
    if write:
        URDF.write_text(with_densities(URDF.read_text(encoding="utf-8"), densities), encoding="utf-8")
        print(f"written: {URDF.name}")
    save(json, {"measure": "rest positions", **figures})


def clip_of(path: Path) -> Clip:
    """The angles of a captured clip, or of a laboratory's trial by its markers; without poses that the body cannot
    take."""
    body = Body(load_subject("human34"))
    first = body.nq - len(joints_of(body))
    if path.suffix != ".bvh":
        run, rows = measured_run(path, FPS)
        return Clip(path.parent.name, path.stem, run.q[rows, first:], measured=True)
    _, q = captured_motion(body, path, FPS)
    return Clip(subject_of(path.stem), path.stem, q[:, first:], measured=False)


def leg_corrections(clips: Sequence[Clip], joints: Sequence[str]) -> dict[str, Correction]:
    """By captured person who walks, fitted to the walks of people with markers."""
    legs, walks = Legs.among(joints), [clip for clip in clips if clip.measured and clip.name.startswith("walking")]
    people = [np.concatenate([c.angles for c in walks if c.person == who]) for who in {c.person for c in walks}]
    captured = {who: np.concatenate([c.angles for c in clips if c.person == who]) for who in FITTED}
    return {who: correction(angles, people, legs) for who, angles in captured.items()}


def straightened(clips: Sequence[Clip], joints: Sequence[str]) -> list[Clip]:
    """The clips with corrected legs of those who were captured."""
    legs = Legs.among(joints)
    return [
        c if c.measured else c._replace(angles=corrected(c.person, c.angles, legs))
        for c in clips
        if len(c.angles) >= _LEAST_CLIP
    ]


def drawn_angles(clips: Sequence[Clip], rng: np.random.Generator) -> dict[str, np.ndarray]:
    """By person as many poses (N, D), of every clip as many, with the deviation of a joint's zero."""
    poses = {}
    for who in dict.fromkeys(clip.person for clip in clips):
        own = [clip.angles for clip in clips if clip.person == who]
        angles = np.concatenate([a[rng.choice(len(a), -(-_DRAWN // len(own)))] for a in own])
        poses[who] = angles + ZERO_STD * rng.normal(size=angles.shape)
    return poses


def distinct_angles(clips: Sequence[Clip], joints: Sequence[str], rng: np.random.Generator) -> dict[str, np.ndarray]:
    """By joint of `LIMB`, the angles (N,) of all people's distinct poses, with the deviation of a joint's zero."""
    columns = [[k for k, joint in enumerate(joints) if without_side(joint) == name] for name in LIMB]
    kept = []
    for who in dict.fromkeys(clip.person for clip in clips):
        angles = np.concatenate([clip.angles for clip in clips if clip.person == who])
        both = np.concatenate([angles[:, list(side)] for side in zip(*columns, strict=True)])
        kept.append(distinct_poses(both, rng))
    poses = np.concatenate(kept)
    return dict(zip(LIMB, (poses + ZERO_STD * rng.normal(size=poses.shape)).T, strict=True))


def distinct_poses(poses: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Poses among (N, D), in random order, that differ by `APART` in some joint from all kept before them."""
    kept, count = np.empty_like(poses), 0
    for pose in rng.permutation(poses):
        if not np.any(np.all(np.abs(kept[:count] - pose) <= APART, axis=1)):
            kept[count] = pose
            count += 1
    return kept[:count]


def angles_of(name: str, joints: Sequence[str], people: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """By person the angles (N,) of a joint, of both sides where there are two, and of one in the middle that bends to
    both sides its mirror image too."""
    columns = [k for k, joint in enumerate(joints) if without_side(joint) == name]
    angles = {who: poses[:, columns].ravel() for who, poses in people.items()}
    return {who: np.concatenate([x, -x]) if name in SYMMETRIC else x for who, x in angles.items()}


def lower_decile(name: str, joints: Sequence[str], clips: Sequence[Clip]) -> float:
    """The lower decile, averaged over the people with markers."""
    people = {c.person for c in clips if c.measured}
    own = {who: np.concatenate([c.angles for c in clips if c.person == who]) for who in people}
    return float(np.mean([np.quantile(x, 0.1) for x in angles_of(name, joints, own).values()]))


def fit_density(people: Sequence[np.ndarray], symmetric: bool, rest: float | None = None) -> Density:
    """The most likely one, with equal weights of people (N,). symmetric: with one scale. rest: where it is known."""

    def density(x: np.ndarray) -> Density:
        return Density(
            float(x[0]) if rest is None else rest, math.exp(x[1]), math.exp(x[1] if symmetric else float(x[2]))
        )

    def unlikely(x: np.ndarray) -> float:
        return -float(np.mean([density(x).log(own).mean() for own in people]))

    every = np.concatenate(people)
    starts = [np.array([at, *(2 * [math.log(every.std())])]) for at in np.quantile(every, (0.15, 0.5, 0.85))]
    results = [minimize(unlikely, start, method="Nelder-Mead", options={"xatol": 1e-3}) for start in starts]
    return density(min(results, key=lambda result: float(result.fun)).x)


def held_out(people: Mapping[str, np.ndarray], name: str, rest: float | None) -> tuple[float, float]:
    """Mean log density of people left out, of the density as it is fitted and with one scale."""
    names, logs = list(people), list[tuple[float, float]]()
    for fold in range(_FOLDS):
        out = names[fold::_FOLDS]
        learned = [people[who] for who in names if who not in out]
        both = fit_density(learned, name in SYMMETRIC, rest), fit_density(learned, symmetric=True)
        logs += [(float(both[0].log(people[who]).mean()), float(both[1].log(people[who]).mean())) for who in out]
    of_both, symmetric = np.mean(logs, axis=0).tolist()
    return of_both, symmetric


def with_densities(urdf: str, densities: Mapping[str, Density]) -> str:
    """The text of a URDF with other numbers in its stabilisers; quickness stays."""

    def element(match: re.Match[str]) -> str:
        density = densities.get(without_side(match.group(1)))
        if density is None:
            return match.group()
        quickness = _QUICKNESS.search(match.group())
        above = "" if abs(density.above - density.below) < 5e-5 else f' std_above="{density.above:.3f}"'
        return (
            f'<stabiliser joint="{match.group(1)}" rest="{density.rest:.3f}" std="{density.below:.3f}"{above}'
            f"{quickness.group() if quickness else ''}/>"
        )

    return re.sub(r'<stabiliser joint="(\w+)"[^>]*/>', element, urdf)
