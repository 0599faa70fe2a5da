"""The likelihood of many poses by one picture: poses a second, and how often the true one is the likelier.

    python -m benchmarks outline_likelihood [--seeds 0 1 2 3 4] [--frames 6] [--json FILE]

upper13 moving at random before a parallel camera, rendered with clothes and noise of each seed, the empty scene known.
Every turning joint of the true pose is turned by 0.1 rad to either side, 200 times a frame. Bars: the true pose above
95 % of these, 20,000 poses a second on one core at 640 x 480, the posing included.
"""

from __future__ import annotations

import tempfile
import time
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

import kinemode as km
from benchmarks.support.common import Json, Several, save, tell
from estimator.data.formats.cameras import load_cameras
from estimator.data.image_cues import ImageCues
from estimator.trackers.dual_chain.outline_values import OutlineLikelihood, OutlineSettings
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from humanoid.kinematics.body import Body
from humanoid.limbs.graph import limb_graph
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

AWAY = 0.1  # rad
OTHERS = 200
POSES = 20_000  # timed
WAYS: dict[str, dict[str, Any]] = {
    "edges and silhouette": {},
    "edges alone": {"silhouette_evidence": 0.0, "cover_evidence": 0.0},
    "silhouette alone": {"edge_evidence": 0.0},
    "without the foreground's cover": {"cover_evidence": 0.0},
}


@dataclass(frozen=True)
class Row:
    """One way to weigh. above: share of other poses below the true one, by seed. rate: poses a second."""

    way: str
    above: list[float]
    rate: float


def main(*, seeds: Annotated[tuple[int, ...], Several] = (0, 1, 2, 3, 4), frames: int = 6, json: Json = None) -> None:
    """Render, disturb and rank.

    Parameters
    ----------
    seeds
        Of motions, clothes, noise and disturbances.
    frames
        Looked at in each clip, evenly over it.
    """
    above: dict[str, list[float]] = {way: [] for way in WAYS}
    rates: dict[str, float] = {}
    body = Body(load_subject("upper13"))
    for seed in seeds:
        tell(f"seed {seed}")
        with tempfile.TemporaryDirectory(prefix="kinemode-outline-") as folder:
            cues, q = seen_frames(Path(folder), seed, frames)
        for way, changes in WAYS.items():
            settings = replace(OutlineSettings(), **changes)
            above[way].append(
                float(np.mean([share_below(body, c, pose, settings, seed) for c, pose in zip(cues, q, strict=True)]))
            )
            rates[way] = rate(body, cues[0], q[0], settings)
    placing = rates_of_placing(body, q[0])
    table = report.table("the true pose beside others", "", "above", "worst seed", "poses/s")
    rows = [Row(way, above[way], rates[way]) for way in WAYS]
    for r in rows:
        table.add_row(r.way, f"{np.mean(r.above):.1%}", f"{min(r.above):.1%}", f"{r.rate:,.0f}")
    table.add_row("posing alone", "", "", f"{placing:,.0f}")
    report.console().print(table)
    save(json, {"measure": "outline_likelihood", "rows": [asdict(r) for r in rows], "placing": placing})


def seen_frames(folder: Path, seed: int, frames: int) -> tuple[list[ImageCues], np.ndarray]:
    """Cues of some frames of a rendered clip, and their true poses (F, nq)."""
    clip = km.render(
        folder, "random", subject="upper13", seconds=3.0, seed=seed, view=km.ViewSettings(parallel=True, azimuth=0.0)
    )
    ((name, video),) = clip.videos.items()
    camera = load_cameras(clip.cameras)[name]
    reader = CueReader([video], [camera], cue_settings(("edges", "silhouette")), plates=[clip.plates[name]])
    truth = np.load(clip.truth, allow_pickle=False)["q"]
    index = np.linspace(0, len(truth) - 1, frames).astype(int)
    with closing(reader):
        return [reader.at(int(i))[0] for i in index], truth[index]


def _likelihood(body: Body, cues: ImageCues, q: np.ndarray, settings: OutlineSettings) -> OutlineLikelihood:
    pixels = cues.camera.project(body.landmarks(body.at(q)))
    extent = float(np.sqrt(np.square(pixels - pixels.mean(axis=0)).sum(axis=1).mean()))
    return OutlineLikelihood(body, limb_graph(body), cues, extent, settings)


def share_below(body: Body, cues: ImageCues, q: np.ndarray, settings: OutlineSettings, seed: int) -> float:
    """Share of disturbed poses that are less likely than q (nq,); equal ones count half."""
    rng = np.random.default_rng(seed)
    size = np.array([0.0 if "trunk" in name else AWAY for name in body.v_names])
    steps = rng.choice([-1.0, 1.0], (OTHERS, body.nv)) * size
    poses = np.vstack([q, body.integrated(np.tile(q, (OTHERS, 1)), steps)])
    values = _likelihood(body, cues, q, settings).log_likelihood(body.placed(poses))
    return float(np.mean(values[1:] < values[0]) + 0.5 * np.mean(values[1:] == values[0]))


def rate(body: Body, cues: ImageCues, q: np.ndarray, settings: OutlineSettings) -> float:
    """Poses a second, about q (nq,), posing included."""
    likelihood = _likelihood(body, cues, q, settings)
    poses = _around(body, q)
    likelihood.log_likelihood(body.placed(poses[:10]))
    began = time.process_time()
    likelihood.log_likelihood(body.placed(poses))
    return len(poses) / (time.process_time() - began)


def rates_of_placing(body: Body, q: np.ndarray) -> float:
    """Poses per second without using a picture: the lower bound."""
    poses = _around(body, q)
    body.placed(poses[:10])
    began = time.process_time()
    body.placed(poses)
    return len(poses) / (time.process_time() - began)


def _around(body: Body, q: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(0)
    return body.integrated(np.tile(q, (POSES, 1)), 0.2 * rng.standard_normal((POSES, body.nv)))
