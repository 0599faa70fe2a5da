"""The likelihood of limbs that is shipped: learned from rendered clips, tried on people and rooms it has not seen.

How often the true pose of a limb is likelier than one that is 0.2 to 1 m away, or turned by more than 45 degrees, with
all cues and without each; and what a likelihood and the filters of a picture cost. `--write` writes the numbers that
are shipped.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
from cyclopts import Parameter

from benchmarks.papers_loose_limbed.limb_pictures import Shown, all_limbs, moved_away, shown_clip, turned_away
from benchmarks.support.common import in_processes, save, tell
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files, subject_of
from benchmarks.training.limb_densities import Examples, examples_of, learned
from estimator.trackers.loose_limbed.limbs.features import CUES
from estimator.trackers.loose_limbed.limbs.likelihood import LimbLikelihood, LimbSettings
from estimator.trackers.loose_limbed.limbs.models import SHIPPED
from estimator.trackers.loose_limbed.limbs.ridges import ridges_of
from humanoid.subject.subject import Subject, load_subject
from kinemode.terminal.report import console, table

T = TypeVar("T")
SUBJECT, PAPER = "human34", 10  # the first of `all_limbs`
HELD_OUT = ("07", "16", "49")
"""Captured people outside the training set; the first is the one of walk_straight_07_01."""
NEVER = "07_01"  # other measures track it: it is not shown here, either
FRAMES = 4  # of a clip
FALSE = 0.2, 1.0, np.radians(45.0)  # m, m, rad: far ones that the true pose is to beat
TRIED = 200  # false poses of a limb and instant
ABOUT = (
    "Maximum entropy densities of limbs' edges, ridges and foreground. Made by `python -m benchmarks limb_likelihood"
    " --write` from {} clips ({} instants, four cameras) rendered in random rooms, light and clothes, from motion"
    " capture: the data used in this project was obtained from mocap.cs.cmu.edu; the database was created with funding"
    " from NSF EIA-0196217. Clips {}."
)


def main(
    *,
    data: Path | None = None,
    write: Annotated[bool, Parameter(negative="")] = False,
    clips: int = 28,
    tried: int = 8,
    jobs: int = 1,
    json: Annotated[Path | None, Parameter(name="--json")] = None,
) -> None:
    """Learn the limbs' likelihood from rendered pictures, or measure the one that is shipped.

    Parameters
    ----------
    data
        Folder with mocap and mocap_more in it; KINEMODE_DATA, or ../shared/data next to the checkout, by default.
    write
        Learn it, and write the numbers that are shipped, before they are measured.
    clips
        So many are learned from, of the people that are not held out.
    tried
        So many of the others are measured on.
    jobs
        Clips rendered at a time, each in a process of its own.
    json
        Also write the figures here.
    """
    files = captured_files(data)
    if not files:
        print(NO_CAPTURED_FILES)
        return
    if write:
        chosen = spread([f for f in files if subject_of(f.stem) not in HELD_OUT], clips)
        examples = in_processes(clip_examples, list(enumerate(chosen)), jobs)
        models = learned(all_limbs(person()), examples)
        models.save(SHIPPED, ABOUT.format(len(chosen), FRAMES * len(chosen), ", ".join(f.stem for f in chosen)))
        tell(f"{SHIPPED.name}: {SHIPPED.stat().st_size / 1000:.0f} kB")
    unseen = [f for f in files if subject_of(f.stem) in HELD_OUT and NEVER not in f.stem]
    chosen = spread(unseen, tried)
    shares = in_processes(clip_shares, list(enumerate(chosen, start=1000)), jobs)
    beaten = {key: float(np.mean([s[key] for s in shares])) for key in shares[0]}
    show(beaten)
    speed = speed_of(next(shown_clip(person(), chosen[0], 1, 1000)))
    for what, figure in speed.items():
        print(f"{what}: {figure:.4g}")
    save(json, {"measure": "limb likelihood", "true above false": beaten, "speed": speed})


@cache
def person() -> Subject:
    """The subject in the pictures, with lengths and girths that differ from clip to clip."""
    return load_subject(SUBJECT)


def spread(items: Sequence[T], count: int) -> list[T]:
    """So many of them, evenly."""
    return [items[int(i)] for i in np.unique(np.linspace(0, len(items) - 1, count).astype(int))]


def clip_examples(clip: tuple[int, Path]) -> Examples:
    """Examples of a clip by its number, which is the seed of its room, light and clothes."""
    seed, path = clip
    tell(path.stem)
    return examples_of(shown_clip(person(), path, FRAMES, seed), np.random.default_rng((seed, 1)))


def clip_shares(clip: tuple[int, Path]) -> dict[str, float]:
    """By limb, kind of false pose and cues: how often the true pose of the clip's instants is likelier."""
    seed, path = clip
    tell(path.stem)
    rng = np.random.default_rng((seed, 2))
    shares = [shares_of(shown, rng) for shown in shown_clip(person(), path, FRAMES, seed)]
    return {key: float(np.mean([s[key] for s in shares])) for key in shares[0]}


def settings_tried() -> dict[str, LimbSettings]:
    """All cues; without each; each alone."""
    tried = {"all": LimbSettings()}
    tried |= {f"no {cue}": LimbSettings(**{cue: False}) for cue in CUES}
    return tried | {f"{cue} alone": LimbSettings(**{c: c == cue for c in CUES}) for cue in CUES}


def shares_of(shown: Shown, rng: np.random.Generator) -> dict[str, float]:
    """See `clip_shares`; of one instant and the limbs of the paper. Poses of one likelihood count half."""
    shares, limbs = {}, shown.limbs[:PAPER]
    likelihoods = {name: LimbLikelihood(limbs, shown.views, settings=s) for name, s in settings_tried().items()}
    for i, limb in enumerate(limbs):
        t, R = shown.t[i], shown.R[i]
        near, far, least = FALSE
        false = {
            "far": (moved_away(rng, t, TRIED, near, far), np.repeat(R[None], TRIED, axis=0)),
            "turned": (np.repeat(t[None], TRIED, axis=0), turned_away(rng, R, TRIED, least)),
        }
        for kind, poses in false.items():
            for name, likelihood in likelihoods.items():
                true = likelihood.log_ratio(i, t[None], R[None])[0]
                ratios = likelihood.log_ratio(i, *poses)
                shares[f"{limb.name}/{kind}/{name}"] = float(np.mean((true > ratios) + 0.5 * (true == ratios)))
    return shares


def show(beaten: dict[str, float]) -> None:
    """Tables of shares, a row a limb, a column the cues that count."""
    keys = [key.split("/") for key in beaten]
    names = list(dict.fromkeys(limb for limb, _, _ in keys))
    for kind, text in {"far": "0.2 to 1 m away", "turned": "turned by more than 45 degrees"}.items():
        rows = table(f"share of false poses, {text}, that are less likely than the true one", "", *settings_tried())
        for name in names:
            rows.add_row(name, *(f"{beaten[f'{name}/{kind}/{cues}']:.3f}" for cues in settings_tried()))
        mean = [np.mean([beaten[f"{name}/{kind}/{cues}"] for name in names]) for cues in settings_tried()]
        rows.add_row("mean", *(f"{value:.3f}" for value in mean))
        console().print(rows)


def speed_of(shown: Shown, count: int = 20_000) -> dict[str, float]:
    """Likelihoods a second of one core over all of an instant's views, and what the filters of a picture take."""
    limbs, rng = shown.limbs[:PAPER], np.random.default_rng(0)
    likelihood = LimbLikelihood(limbs, shown.views)
    poses = [
        (moved_away(rng, t, count, 0.0, 0.5), np.repeat(R[None], count, axis=0))
        for t, R in zip(shown.t[:PAPER], shown.R[:PAPER], strict=True)
    ]
    likelihood.log_ratio(0, *poses[0])
    began = time.process_time()
    for i, (t, R) in enumerate(poses):
        likelihood.log_ratio(i, t, R)
    spent = time.process_time() - began
    picture = rng.integers(0, 256, (*shown.views[0].camera.image_size[::-1], 3)).astype(np.uint8)
    ridges_of(picture)
    began = time.process_time()
    for _ in range(10):
        ridges_of(picture)
    filters = 100.0 * (time.process_time() - began)
    return {
        f"limb likelihoods a second, {len(shown.views)} views": len(limbs) * count / spent,
        "filters [ms a picture]": filters,
    }
