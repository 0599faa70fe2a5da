"""Colours of limbs at true poses of rendered captured people: how far halves of one limb differ, and how exactly
colours show where limbs end. Constants of the cue `colour` are from here.

Halves of one limb have equal colours, however light and shade and the pattern of the cloth vary over it: what separates
them is what `estimator.vision.cues.colour_model.differing` takes off. Beside it stand the distances of limbs from what
lies beside them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np

import kinemode as km
from benchmarks.support.common import NO_CAPTURE_HERE, Data, Json, Several, Work, in_processes, save, tell, work_folder
from benchmarks.support.mocap_person import DETECTOR, FPS, person
from benchmarks.support.pose_prior_clips import captured_files, trial_of
from estimator.data.formats.cameras import load_cameras
from estimator.data.image_cues import ImageCues
from estimator.data.observation import image_extent
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.colour import Colour, ColourMatcher
from estimator.vision.cues.colour_matching import MATCHED
from estimator.vision.cues.colour_model import BEHIND, LIMBS, ColourReading, differing, distances, seen_colours
from estimator.vision.cues.image_likelihood import CameraLikelihood, ImageModel
from estimator.vision.prediction import Prediction
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

DEFAULT = ("05_05", "08_04", "10_04", "12_02", "49_03")
"""Trials of people in none of the clips that figures of tracks are quoted of."""
QUANTILES = (0.02, 0.1, 0.5, 0.9, 0.98)
SPARSE = (0.0, 0.005, 0.01, 0.02, 0.04, 0.1)
"""Bounds of 1/n + 1/m of groups of pairs of n and m pixels."""
_SIZE = 640  # px
_EVERY = 10  # frames between those whose limbs are halved
_FEWEST = 20  # px of a half, and of what lies beside a limb


@dataclass(frozen=True)
class Task:
    """A clip to render. seconds: of it. folder: of the clip."""

    motion: Path
    seed: int
    seconds: float
    folder: Path


@dataclass(frozen=True)
class LimbFigures:
    """Figures of one clip.

    halves, beside: pairs of halves of limbs, and of limbs and what lies beside them: 1/n + 1/m of their pixels,
    distance, and how surely they differ. error, expected [px]: root mean square error of where colours have limbs
    end, and the one that their variance promises. extent [px].
    """

    halves: list[tuple[float, float, float]]
    beside: list[tuple[float, float, float]]
    error: float
    expected: float
    extent: float


def main(
    *,
    data: Data = None,
    trials: Annotated[tuple[str, ...], Several] = DEFAULT,
    seconds: float = 2.0,
    seed: int = 11,
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Compare colours of halves of limbs, and where limbs end by colour with where they do, at true poses.

    Parameters
    ----------
    trials
        Subject and trial of captured clips.
    seconds
        So much of each.
    seed
        Of the first clip's room, clothes and noise; the next has the next one.
    jobs
        Clips at a time, each in a process of its own.
    """
    files = {trial_of(path.stem): path for path in captured_files(data)}
    if not files:
        print(NO_CAPTURE_HERE)
        return
    with work_folder(work) as folder:
        tasks = [Task(files[name], seed + i, seconds, folder / name) for i, name in enumerate(trials)]
        results = dict(zip(trials, in_processes(measured, tasks, jobs), strict=True))
    halves, beside = (
        np.array([pair for r in results.values() for pair in getattr(r, kind)]) for kind in ("halves", "beside")
    )
    show(halves, beside)
    out = report.console()
    for name, r in results.items():
        out.print(f"{name}: limbs end within {r.error:.2f} px rms, expected {r.expected:.2f}, extent {r.extent:.0f} px")
    save(json, {"measure": "limb colours", "clips": {name: vars(r) for name, r in results.items()}})


def show(halves: np.ndarray, beside: np.ndarray) -> None:
    """Quantiles of distances of pairs (N, 3), see `LimbFigures`, and how many of them differ."""
    titles = (*(f"{q:g}" for q in QUANTILES), "differ")
    made = report.table("squared Hellinger distances: quantiles", "pairs", "number", *titles)
    groups = {f"halves, 1/n + 1/m {a:g} to {b:g}": (halves, a, b) for a, b in pairwise(SPARSE)}
    groups |= {"all halves": (halves, 0.0, np.inf), "limbs and beside them": (beside, 0.0, np.inf)}
    for name, (pairs, low, high) in groups.items():
        some = pairs[(pairs[:, 0] >= low) & (pairs[:, 0] < high)]
        if len(some):
            values = (*np.quantile(some[:, 1], QUANTILES), np.mean(some[:, 2] > 0.0))
            made.add_row(name, str(len(some)), *(f"{value:.3f}" for value in values))
    report.console().print(made)


def measured(task: Task) -> LimbFigures:
    clip = km.render(
        task.folder, task.motion, subject=person(), detector=DETECTOR, fps=FPS, seconds=task.seconds, seed=task.seed
    )
    tell(f"{task.motion.stem}: rendered")
    ((name, video),) = clip.videos.items()
    pictures = CameraPictures(video, load_cameras(clip.cameras)[name], _SIZE)
    model, cue = ImageModel(Body(load_subject(clip.subject))), Colour()
    learned: np.ndarray | None = None
    halves, beside, errors, variances, extents = [], [], [], [], []
    for t, q in enumerate(np.load(clip.truth)["q"]):
        reading = cue.read(pictures, t, cue.settings, None)
        posed = model.body.at(q)
        points = pictures.camera.project(model.body.landmarks(posed))
        extent = image_extent(points, np.ones(len(points)))
        cues = ImageCues(pictures.camera, {cue.name: reading if learned is None else reading.with_learned(learned)})
        likelihood = CameraLikelihood(model, cues, extent)
        prediction, matcher = likelihood.predictor.predict(posed), likelihood.matchers[cue.name]
        assert isinstance(matcher, ColourMatcher)
        if learned is not None:
            offset, variance, _, status = matcher.borders(prediction)
            errors.append(offset[status == MATCHED])
            variances.append(variance[status == MATCHED])
            extents.append(extent)
        learned = matcher.learn(prediction, 1.0 / FPS, 1.0)
        if t % _EVERY == 0:
            halves += [compared(*both) for both in halved(reading, prediction, len(model.surface.links))]
            seen = seen_colours(reading.bins, prediction, len(model.surface.links), cue.settings.window * extent)
            enough = np.flatnonzero(seen.sum(axis=2).min(axis=0) >= _FEWEST)
            beside += [compared(seen[LIMBS, p : p + 1], seen[BEHIND, p : p + 1]) for p in enough]
    error, expected = (
        float(np.sqrt(np.mean(np.concatenate(squares)))) for squares in ([e * e for e in errors], variances)
    )
    return LimbFigures(halves, beside, error, expected, float(np.mean(extents)))


def compared(first: np.ndarray, second: np.ndarray) -> tuple[float, float, float]:
    """Of two histograms (1, BINS), see `LimbFigures`."""
    sparse = float(1.0 / first.sum() + 1.0 / second.sum())
    return sparse, float(distances(first, second)[0, 0]), float(differing(first, second)[0, 0])


def halved(reading: ColourReading, prediction: Prediction, parts: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Histograms (1, BINS) of both halves of each part that is seen, cut across and along the picture."""
    for part in range(parts):
        cells = np.argwhere(prediction.owner == part)
        for axis in (0, 1) if len(cells) else ():
            place, middle = np.indices(prediction.owner.shape)[axis], np.median(cells[:, axis])
            both = [seen_half(reading, prediction, part, parts, side) for side in (place < middle, place > middle)]
            if min(half.sum() for half in both) >= _FEWEST:
                yield both[0], both[1]


def seen_half(reading: ColourReading, prediction: Prediction, part: int, parts: int, side: np.ndarray) -> np.ndarray:
    """Histogram (1, BINS) of what is seen of a part in the cells `side` (rows, columns)."""
    owner = np.where((prediction.owner == part) & ~side, parts, prediction.owner)
    seen = seen_colours(reading.bins, prediction._replace(owner=owner), parts + 1, 1.0)
    return np.asarray(seen[LIMBS, part : part + 1])
