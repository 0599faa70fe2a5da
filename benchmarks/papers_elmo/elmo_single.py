"""ELMO in single frames: random poses, each by itself, searched from the neighbours of an index, and from as many
random examples of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from benchmarks.papers_elmo.elmo_clips import JOINTS, filmed_poses
from benchmarks.support.common import Changes, Json, Several, Work, nested, save, tell, work_folder
from benchmarks.support.mocap_person import person
from estimator.data.formats.cameras import load_cameras
from estimator.data.observation import Observation
from estimator.search.examples.hashing import Neighbours
from estimator.search.examples.index import ExampleIndex
from estimator.search.mode_search import Examples
from estimator.synthesis.poses import sampler_of
from estimator.trackers.elmo.tracker import Elmo
from estimator.tracking.registry import make_tracker, settings_for
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from humanoid.kinematics.body import Body
from kinemode.pictures import CueChoice, cue_choice
from kinemode.shot import RenderedClip
from kinemode.terminal import report

_SEED = 4321


class AtRandom(ExampleIndex):
    """The same examples, drawn instead of looked up."""

    def nearest(self, description: np.ndarray, count: int) -> Neighbours:
        """Any of them; the same for the same picture."""
        rng = np.random.default_rng(int(description.astype(np.int64).sum()))
        numbers = rng.choice(len(self.q), count, replace=False)
        return Neighbours(numbers, np.zeros(count, np.int64), count, False)


@dataclass(frozen=True)
class Row:
    """error (T): of the likeliest mode, mean over `JOINTS` in the world [mm]; best (T): of the mode nearest to the
    truth; starts (T): of the start nearest to it."""

    starts_from: str
    count: int
    error: list[float]
    best: list[float]
    starts: list[float]


def main(
    *,
    index: Path,
    poses: int = 200,
    counts: Annotated[tuple[int, ...], Several] = (50, 10),
    baseline: float = 0.12,
    cues: str = "depth",
    changes: Changes = (),
    work: Work = None,
    json: Json = None,
) -> None:
    """Find random poses, one frame each, nothing given.

    Parameters
    ----------
    index
        Index of examples of human34 (`kinemode train-index`).
    poses
        How many.
    counts
        Starts of each search.
    baseline
        Metres between the cameras.
    cues
        Image cues to use, as depth,silhouette.
    changes
        Changes to the settings, as elmo.rounds=4.
    """
    body = Body(person())
    settings = settings_for("elmo", changes=nested(changes))
    tracker = make_tracker("elmo", body, replace(settings, search=replace(settings.search, index=str(index))))
    assert isinstance(tracker, Elmo)
    known, rows = tracker.search.examples.index, []
    sampler = sampler_of(body, known.recipe)
    rng = np.random.default_rng(_SEED)
    q = np.array([sampler.draw(rng) for _ in range(poses)])
    with work_folder(work) as folder:
        clip = filmed_poses(folder / f"random_{poses}_{baseline:g}", body, q, baseline)
        frames = list(observations(clip, body, cue_choice(cues)))
        true = np.load(clip.truth)["landmarks"]
    for count in counts:
        for name, chosen in (("neighbours", known), ("random examples", AtRandom(**vars(known)))):
            tracker.settings = replace(tracker.settings, neighbours=count)
            tracker.search.__dict__["examples"] = Examples(chosen, body, tracker.search.evidence)
            rows.append(searched(tracker, name, count, frames, true))
            tell(f"{name}, {count}: median {np.median(rows[-1].error):.0f} mm")
    show(rows)
    figures = {"poses": poses, "baseline": baseline, "cues": cues, "rows": [asdict(row) for row in rows]}
    save(json, {"measure": "elmo, single frames", **figures})


def observations(clip: RenderedClip, body: Body, used: CueChoice) -> Iterator[Observation]:
    """The frames of a pair with the cues used, and no keypoints."""
    cameras = tuple(load_cameras(clip.cameras).values())
    nothing = np.full((len(cameras), len(body.landmark_names), 2), np.nan)
    with np.load(clip.truth) as truth:
        times = truth["time"]
    with closing(CueReader(list(clip.videos.values()), cameras, cue_settings(used), rights=[1, None])) as reader:
        for i, time in enumerate(times.tolist()):
            yield Observation(i, time, cameras, nothing, np.zeros(nothing.shape[:2]), cues=reader.at(i))


def searched(tracker: Elmo, name: str, count: int, frames: list[Observation], true: np.ndarray) -> Row:
    """Every frame by itself."""
    joints = [tracker.body.landmark_names.index(joint) for joint in JOINTS]
    errors: list[tuple[float, float, float]] = []

    def off(q: np.ndarray, t: int) -> float:
        points = tracker.body.landmarks(tracker.body.at(q))
        return 1e3 * float(np.linalg.norm(points[joints] - true[t][joints], axis=1).mean())

    for t, observation in enumerate(frames):
        if not tracker.can_start(observation):
            errors.append((np.nan, np.nan, np.nan))
            continue
        _, result = tracker.init(np.random.default_rng(0), observation)
        of_modes = [off(q, t) for q in result.q]
        starts = min(off(q, t) for lookup in tracker.lookups(observation) for q in lookup.q)
        errors.append((of_modes[0], min(of_modes), starts))
    error, best, nearest = np.array(errors).T.tolist()
    return Row(name, count, error, best, nearest)


def show(rows: list[Row]) -> None:
    table = report.table(
        "errors [mm] over shoulders, elbows, wrists, neck and head, in the world, single frames",
        "starts", "median", "mean", "under 50 mm", "best mode, median", "nearest start, mean",
    )  # fmt: skip
    for r in rows:
        error = np.array(r.error)
        table.add_row(
            f"{r.count} {r.starts_from}", f"{np.nanmedian(error):.0f}", f"{np.nanmean(error):.0f}",
            f"{np.mean(error < 50.0):.0%}", f"{np.nanmedian(r.best):.0f}", f"{np.nanmean(r.starts):.0f}",
        )  # fmt: skip
    report.console().print(table)
