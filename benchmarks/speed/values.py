"""What energies without derivatives save: each term alone, and all particles of a frame, with and without pictures.

Both sides take turns in one process, so that a busy machine slows both, and must agree to the last bit.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import kinemode as km
from benchmarks.support.common import Json, save
from estimator.data.observation import Observation
from estimator.energy.term import Term
from estimator.search.hypothesis import AS_DETECTED
from estimator.synthesis.settings import DetectorSettings, ViewSettings
from estimator.trackers.base import energy_of
from estimator.trackers.particle_set import FrameEnergy
from estimator.tracking.registry import make_tracker, settings_for
from estimator.vision.cues.reader import CueReader
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.inputs.load import load_inputs
from kinemode.request import FileOptions
from kinemode.terminal import report

FPS = 10.0
FRAME = 2  # of the clip
SPREAD = 0.05  # [rad, m] standard deviation of the particles about the hypotheses
Side = Callable[[], np.ndarray]


@dataclass(frozen=True)
class Row:
    """Microseconds a pose, with derivatives and without."""

    name: str
    whole: float
    value: float


def main(
    *,
    particles: int = 200,
    repeats: int = 7,
    seed: int = 0,
    json: Json = None,
) -> None:
    """Time of energies with derivatives over that without.

    Parameters
    ----------
    particles
        How many poses.
    repeats
        How often each side is measured; the quickest counts.
    seed
        Of the poses.
    """
    with tempfile.TemporaryDirectory() as folder:
        rows = measured(Path(folder), particles, repeats, seed)
    show(rows)
    save(json, figures(rows, particles))


def measured(folder: Path, particles: int, repeats: int, seed: int) -> list[Row]:
    rng, body = np.random.default_rng(seed), Body(load_subject("human34"))
    seen = rendered(body, folder)
    tracker = make_tracker("condensation", body, settings_for("condensation"))
    search, bare = energy_of(tracker, "condensation"), replace(seen[FRAME], cues=())
    before = tracker.init(np.random.default_rng(seed), replace(seen[FRAME - 1], cues=()))[0].mixture
    owner = rng.integers(len(before.modes), size=particles)
    q = np.array([body.integrate(before.modes[k].q, SPREAD * rng.standard_normal(body.nv)) for k in owner])
    terms = search.model.cost(search.term(bare, AS_DETECTED), before.modes[0].q, 1.0 / FPS).terms
    rows = [of_term(body, term, q, repeats) for term in terms]
    for name, observation in (("keypoints", bare), ("keypoints and pictures", seen[FRAME])):
        energy = FrameEnergy(search, observation, before)
        sides = partial(one_by_one, energy, q, owner), partial(energy.values, q, owner)
        rows.append(compared(f"all of a frame, {name}", *sides, particles, repeats))
    return rows


def one_by_one(energy: FrameEnergy, q: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Energies (N,) by way of their quadratic models."""
    return np.array([energy.at(*each).value for each in zip(q, owner, strict=True)])


def rendered(body: Body, folder: Path) -> list[Observation]:
    """The first frames of a small clip, with keypoints and all cues."""
    clip = km.render(
        folder, "reach", view=ViewSettings(image_size=(320, 240)), detector=DetectorSettings(noise_px=1.5), fps=FPS,
        seconds=(FRAME + 1.5) / FPS, seed=1,
    )  # fmt: skip
    inputs = load_inputs(body, FileOptions(clip.videos, keypoints=clip.keypoints, cameras=clip.cameras))
    paths = [path for path in inputs.clips if path is not None]
    reader = CueReader(paths, inputs.observations[0].cameras, settings_for("css").cues)
    seen = [replace(o, cues=reader.at(o.index)) for o in inputs.observations[: FRAME + 1]]
    reader.close()
    return seen


def of_term(body: Body, term: Term, q: np.ndarray, repeats: int) -> Row:
    """One term at poses whose kinematics is known, without what that costs."""
    posed, placed = [body.at(each) for each in q], body.placed(q)
    gradient, hessian = np.zeros(body.nv), np.zeros((body.nv, body.nv))
    whole: Side = lambda: np.array([term.accumulate(p, gradient, hessian) for p in posed])  # noqa: E731
    values = getattr(term, "values", None)
    value: Side = lambda: np.array([term.value(p) for p in posed]) if values is None else values(placed)  # noqa: E731
    return compared(term.name, whole, value, len(q), repeats)


def compared(name: str, whole: Side, value: Side, count: int, repeats: int) -> Row:
    """Times of both sides, in turns; raises AssertionError where they differ by a bit."""
    assert np.array_equal(whole(), value()), name
    times: list[list[float]] = [[], []]
    for _ in range(repeats):
        for side, taken in zip((whole, value), times, strict=True):
            began = time.process_time()
            side()
            taken.append(time.process_time() - began)
    first, second = (1e6 * min(taken) / count for taken in times)
    return Row(name, first, second)


def show(rows: list[Row]) -> None:
    made = report.table("energies", "term", "with derivatives [us]", "value alone [us]", "times as fast")
    for row in rows:
        made.add_row(row.name, f"{row.whole:.1f}", f"{row.value:.1f}", f"{row.whole / row.value:.1f}")
    report.console().print(made)


def figures(rows: list[Row], particles: int) -> dict[str, Any]:
    return {
        "measure": "values",
        "particles": particles,
        "terms": {row.name: {"whole_us": row.whole, "value_us": row.value} for row in rows},
    }
