"""By how much points of the surface are followed wrongly: the setting `cues.flow.mixed`.

    python -m benchmarks followed_points --all

Rendered clips of captured people have true poses: each node that is seen in a frame is followed to the next, and
compared with where the true pose has it then.
"""

from __future__ import annotations

from contextlib import closing
from itertools import pairwise

import numpy as np

from benchmarks.accuracy.mocap import DEFAULT, rendered_motions
from benchmarks.support.common import Clips, Data, Every, Json, Work, save, tell
from estimator.data.formats.cameras import load_cameras
from estimator.vision.cues.base import PastPose
from estimator.vision.cues.flow import follow_points
from estimator.vision.cues.image_likelihood import ImageLikelihood, ImageModel
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.shot import RenderedClip
from kinemode.terminal import report

LENGTHS = (0.0, 1.0, 2.0, 4.0, 8.0, np.inf)  # px a frame
SHARES = (0.5, 0.68, 0.9)
_EXTENT = 100.0  # px; flow does not depend on it


def main(
    *,
    data: Data = None,
    clips: Clips = DEFAULT,
    every: Every = False,
    seconds: float = 2.0,
    clip_seed: int = 2,
    work: Work = None,
    json: Json = None,
) -> None:
    """Measure by how much flow leads points of rendered people wrongly, by their own part's pixels and by all.

    Parameters
    ----------
    seconds
        Only so much of each.
    clip_seed
        Seed of the clips: room, clothes and noise.
    """
    measured: dict[str, np.ndarray] = {}
    for name, clip in rendered_motions(data, clips, every, seconds, clip_seed, work):
        measured[name] = errors(clip)
        tell(f"{name}: {len(measured[name])} points")
    if not measured:
        return
    points = np.concatenate(list(measured.values()))
    show(points)
    rows = {f"{low:g} to {high:g}": scales(points, low, high) for low, high in pairwise(LENGTHS)}
    save(json, {"measure": "followed_points", "clips": list(measured), "errors": rows})


def errors(clip: RenderedClip) -> np.ndarray:
    """Points (N, 6) of a clip: whether it was followed by its own part's pixels, its motion [px], the error x, y of
    flow [px], and what it would be by all pixels of its window."""
    body, truth = Body(load_subject(clip.subject)), np.load(clip.truth)["q"]
    model = ImageModel(body, cue_settings(["flow"]))
    (camera,) = load_cameras(clip.cameras).values()
    rows = []
    with closing(CueReader([clip.videos[camera.name]], [camera], model.cues)) as reader:
        for k in range(1, len(truth)):
            likelihood = ImageLikelihood.of(model, reader.at(k), [_EXTENT])
            (matcher,) = likelihood.cameras[0].matchers.values()
            (now,) = matcher.follow([PastPose(body.at(truth[k - 1]))])
            there = matcher.view.predictor.predict(body.at(truth[k])).pixels[now.node]
            mixed, _ = follow_points(matcher.view.cues["flow"], now.before)
            motion = np.linalg.norm(there - now.before, axis=1)
            row = np.column_stack([now.own, motion, now.target - there, mixed - there])
            rows.append(row[now.sure > 0.5])
    return np.concatenate(rows)


def scales(points: np.ndarray, shortest: float, longest: float) -> dict[str, list[float]]:
    """Errors [px] of a coordinate not exceeded by each of `SHARES`, of points (N, 6) that move so far: those that are
    followed by their own part, the same by all pixels, and the others."""
    chosen = points[(points[:, 1] >= shortest) & (points[:, 1] < longest)]
    own = chosen[:, 0] > 0.0
    classes = {"own part": chosen[own, 2:4], "the same, all pixels": chosen[own, 4:6], "others": chosen[~own, 2:4]}
    return {name: np.quantile(np.abs(e), SHARES).tolist() if len(e) else [] for name, e in classes.items()}


def show(points: np.ndarray) -> None:
    """Print the errors by how far points move."""
    columns = ("own part", "the same points by all pixels", "others", "others / own at 68 %")
    table = report.table("error of a coordinate [px]: 50, 68 and 90 % are below", "motion [px]", *columns)
    ratios = []
    for low, high in pairwise(LENGTHS):
        by_class = scales(points, low, high)
        if not all(by_class.values()):
            continue
        ratios.append(by_class["others"][1] / by_class["own part"][1])
        cells = (" ".join(f"{e:.2f}" for e in own) for own in by_class.values())
        table.add_row(f"{low:g} to {high:g}", *cells, f"{ratios[-1]:.1f}")
    report.console().print(table)
    print(f"followed by their own part: {points[:, 0].mean():.0%}; median of the ratios {np.median(ratios):.1f}")
