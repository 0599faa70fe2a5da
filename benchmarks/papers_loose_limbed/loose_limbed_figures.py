"""Figures 4, 6, 7 and 8 (left) of Sigal et al. (CVPR 2004) on captured walking before four cameras, not tuned on.

    python -m benchmarks loose_limbed_figures [--figures messages start tracking iterations] [--seeds 0 1 2]

Figure 4: messages to the trunk, and what their product with the likelihood becomes. Figure 6: from what is proposed for
limbs to what is believed. Figure 7: tracking after that. Figure 8, left: error of the first frame by iteration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from benchmarks.papers_loose_limbed.loose_limbed_clips import LimbClip, Markers
from benchmarks.papers_loose_limbed.loose_limbed_runs import LOOSE
from benchmarks.support.common import Data, Several, captured_folder, check_known, tell
from benchmarks.support.figure_file import new_figure, write_figure
from estimator.data.observation import Observation
from estimator.inference.beliefs.graph import Belief
from estimator.inference.beliefs.propagation import Propagated
from estimator.inference.beliefs.space import PLACEMENTS, placements_of
from estimator.trackers.loose_limbed.limbs.window import window
from estimator.trackers.loose_limbed.tracker import LooseLimbed
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.runner import FrameByFrame
from humanoid.limbs.limb import LimbGraph
from viz.pictures.limb_layer import draw_beliefs, draw_limbs
from viz.pictures.overlay import reduced
from viz.pictures.painter import CameraProjection, camera_view

Tile = tuple[str, np.ndarray]
"""A caption and an RGB picture (H, W, 3)."""

WALK, CLIP_SEED = "walk_straight_07_01", 4
FIRST, LAST, STEP = 11, 41, 10  # the frame that is searched from nothing, the last tracked one, those shown
FIGURES = ("messages", "start", "tracking", "iterations")
_SAMPLES = 60  # drawn of a density
_OF_EACH = 8  # of them where those of all limbs lie over each other
_LONGEST = 640  # px
_MARGIN = 0.25  # of the person's height, about what is shown


def main(
    *,
    figures: Annotated[tuple[str, ...], Several] = FIGURES,
    seeds: Annotated[tuple[int, ...], Several] = (0, 1, 2),
    data: Data = None,
    out: Path = Path("docs/reproductions"),
) -> None:
    """Draw some of the figures.

    Parameters
    ----------
    figures
        messages (Figure 4), start (6), tracking (7), iterations (8, left).
    seeds
        Of the tracker; all of them for `iterations`, the first for the others.
    out
        Folder of the pictures: loose_limbed_NAME.png.
    """
    check_known("--figures", figures, FIGURES)
    folder = captured_folder(data)
    if folder is None:
        return
    stage = Stage(LimbClip(folder / "mocap" / f"{WALK}.bvh", CLIP_SEED, 0, LAST + 2))
    paths = {name: out / f"loose_limbed_{name}.png" for name in FIGURES}
    needed = seeds if "iterations" in figures else seeds[:1] if {"messages", "start"} & set(figures) else ()
    beginnings = [stage.beginning(seed) for seed in needed]
    if "messages" in figures:
        write_messages(paths["messages"], stage, beginnings[0])
    if "start" in figures:
        write_start(paths["start"], stage, beginnings[0])
    if "iterations" in figures:
        write_iterations(paths["iterations"], [beginning.errors for beginning in beginnings])
    if "tracking" in figures:
        write_tracking(paths["tracking"], stage, seeds[0])


@dataclass(frozen=True)
class Beginning:
    """The first frame of two, searched from nothing.

    proposals: samples of Q, points (L, N, 7).
    result: of all iterations. errors (iterations,): mean of the markers after each, expected over the samples [mm].
    """

    proposals: np.ndarray
    result: Propagated
    errors: np.ndarray


@dataclass(frozen=True)
class Stage:
    """A clip and the tracker on it."""

    clip: LimbClip

    @cached_property
    def tracker(self) -> LooseLimbed:
        """The tracker with default settings, by pictures alone."""
        made: Any = make_tracker(LOOSE, self.clip.body, settings_for(LOOSE))
        return made

    def seen(self, frame: int) -> Observation:
        """A frame."""
        return self.clip.observation(frame)

    def beginning(self, seed: int) -> Beginning:
        """Internals of the tracker in the first two frames."""
        tracker, rng = self.tracker, np.random.default_rng(seed)
        instants = [tracker.instants.instant(rng, self.seen(FIRST + k), anew=True) for k in range(2)]
        graph = window(tracker.potentials, tracker.settings.outlier, instants)
        errors: list[float] = []

        def watch(iteration: int, beliefs: tuple[Belief, ...]) -> None:
            errors.append(self.error(FIRST, beliefs[: len(self.clip.graph.limbs)]))
            tell(f"seed {seed}, iteration {len(errors)}: {errors[-1]:.0f} mm")

        result, _ = tracker.inferred(rng, graph, None, self.seen(FIRST), anew=True, watch=watch)
        densities = [density for density in instants[0].proposals if density is not None]
        samples = np.array([density.sample(rng, _SAMPLES) for density in densities])
        return Beginning(samples, result, np.array(errors))

    def error(self, frame: int, beliefs: Sequence[Belief]) -> float:
        """Mean of the markers [mm]."""
        markers, clip = Markers.of(self.clip.graph), self.clip
        placed = [placements_of(belief.points) for belief in beliefs]
        t, R = (np.stack([p[k] for p in placed], axis=1) for k in (0, 1))
        true = markers.of_poses(clip.graph, clip.body, clip.q[frame])
        return markers.expected_error(true, t, R, np.stack([belief.weights for belief in beliefs], axis=1))

    def picture(self, frame: int, camera: int) -> tuple[np.ndarray, CameraProjection]:
        """A camera's picture (H, W, 3) uint8 BGR to draw on, grey and darker than it is, and its view."""
        cues = self.seen(frame).cues[camera]
        view = camera_view(cues.camera, _LONGEST)
        image = reduced(cues.picture, view)
        grey = 0.55 * image.mean(axis=2, keepdims=True)
        return np.repeat(grey.astype(np.uint8), 3, axis=2), view

    def around(self, frame: int, view: CameraProjection) -> tuple[slice, slice]:
        """Rows and columns about where the person truly is."""
        clip = self.clip
        places = Markers.of(clip.graph).of_poses(clip.graph, clip.body, clip.q[frame])
        pixels = view.project(places)[0]
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        margin = _MARGIN * (high - low)[1]
        x0, y0 = np.maximum(low - margin, 0).astype(int)
        x1, y1 = np.minimum(high + margin, view.size).astype(int)
        return slice(y0, y1), slice(x0, x1)

    def tile(
        self, frame: int, camera: int, points: np.ndarray | None, weights: np.ndarray | None = None, best: bool = False
    ) -> np.ndarray:
        """A camera's picture about the person, RGB, with samples of all limbs: points (L, N, 7), alike unless weights
        (L, N) are given; best: instead of them the likeliest sample of each limb, as cones."""
        image, view = self.picture(frame, camera)
        graph = self.clip.graph
        if points is not None and best and weights is not None:
            chosen = np.take_along_axis(points, weights.argmax(axis=1)[:, None, None], axis=1)[:, 0]
            draw_limbs(image, view, graph, *placements_of(chosen))
        elif points is not None and weights is not None:
            draw_beliefs(image, view, graph, points, weights)
        elif points is not None:
            draw_samples(image, view, graph, points)
        rows, columns = self.around(frame, view)
        return np.ascontiguousarray(image[rows, columns, ::-1])


def draw_samples(image: np.ndarray, view: CameraProjection, graph: LimbGraph, points: np.ndarray) -> None:
    """Outlines of samples (L, N, 7), all alike, in place; NaN are left out."""
    t, R = placements_of(np.nan_to_num(points.reshape(-1, PLACEMENTS.size), nan=0.5))
    t = np.where(np.isfinite(points.reshape(-1, PLACEMENTS.size)[:, :1]), t, np.nan)
    shape = points.shape[:2]
    samples = t.reshape(*shape, 3).swapaxes(0, 1), R.reshape(*shape, 3, 3).swapaxes(0, 1)
    draw_limbs(image, view, graph, *samples)


def write_messages(path: Path, stage: Stage, beginning: Beginning) -> None:
    """Figure 4: the messages to the limb with most neighbours, and its belief."""
    graph, result = stage.clip.graph, beginning.result
    limb = max(range(len(graph.limbs)), key=lambda k: sum(k in edge for edge in graph.edges))
    rng = np.random.default_rng(0)
    others = sorted(i for i, j in result.messages if j == limb and i < len(graph.limbs))
    empty = np.full((len(graph.limbs), _SAMPLES, PLACEMENTS.size), np.nan)
    tiles = []
    for other in others:
        message = empty.copy()
        message[limb] = result.messages[other, limb].of_kernels_alone().sample(rng, _SAMPLES)
        tiles.append((f"from {spoken(graph.names[other])}", stage.tile(FIRST, 0, message)))
    belief, product = result.beliefs[limb], empty.copy()
    rows = rng.choice(len(belief.points), _SAMPLES, p=belief.weights)
    product[limb] = belief.points[rows]
    tiles.append((f"belief: {spoken(graph.names[limb])}", stage.tile(FIRST, 0, product)))
    write_tiles(path, [tiles[: (len(tiles) + 1) // 2], tiles[(len(tiles) + 1) // 2 :]])


def write_start(path: Path, stage: Stage, beginning: Beginning) -> None:
    """Figure 6: proposals, Q with limbs without proposals, beliefs, likeliest limbs, in two views."""
    beliefs = beginning.result.beliefs[: len(stage.clip.graph.limbs)]
    points, weights = np.array([b.points for b in beliefs]), np.array([b.weights for b in beliefs])
    rows = []
    for camera in (0, 1):
        rows.append(
            [
                ("picture", stage.tile(FIRST, camera, None)),
                ("samples of Q", stage.tile(FIRST, camera, beginning.proposals[:, :_OF_EACH])),
                (f"beliefs, {len(beginning.errors)} iterations", stage.tile(FIRST, camera, points, weights)),
                ("likeliest samples", stage.tile(FIRST, camera, points, weights, best=True)),
            ]
        )
    write_tiles(path, rows)


def write_tracking(path: Path, stage: Stage, seed: int) -> None:
    """Figure 7: some of the frames after the start from nothing, in two views."""
    frames = FrameByFrame(stage.tracker, seed)
    rows: list[list[Tile]] = [[], []]
    for frame in range(FIRST, LAST + 2):  # the last is only used as a frame ahead
        result = frames.push(stage.seen(frame))
        if result is None or (result.index - FIRST) % STEP or "limb_points" not in result.extra:
            continue
        for camera, row in enumerate(rows):
            belief = result.extra["limb_points"], result.extra["limb_weights"]
            row.append((f"frame {result.index - FIRST}", stage.tile(result.index, camera, *belief)))
        tell(f"frame {result.index}")
    write_tiles(path, rows)


def write_iterations(path: Path, errors: Sequence[np.ndarray]) -> None:
    """Figure 8, left: mean and deviation over seeds of errors (iterations,) [mm]."""
    figure = new_figure(6.0, 3.2)
    axes, iterations = figure.subplots(), np.arange(1, len(errors[0]) + 1)
    mean, deviation = np.mean(errors, axis=0), np.std(errors, axis=0)
    axes.fill_between(iterations, mean - deviation, mean + deviation, color="#1f4e79", alpha=0.25, linewidth=0)
    axes.plot(iterations, mean, color="#1f4e79")
    axes.set_xlabel("iteration")
    axes.set_ylabel("error of a marker [mm]")
    axes.set_ylim(bottom=0.0)
    axes.set_xlim(1, len(iterations))
    write_figure(path, figure)
    print(
        f"first frame, {len(errors)} seeds: {mean[0]:.0f} mm after 1 iteration, {mean[-1]:.1f} +- {deviation[-1]:.1f}"
    )


def write_tiles(path: Path, rows: Sequence[Sequence[Tile]]) -> None:
    """Pictures with their captions, in rows, as a PNG."""
    count = max(len(row) for row in rows)
    height, width = rows[0][0][1].shape[:2]
    figure = new_figure(1.8 * count, len(rows) * (1.8 * height / width + 0.25))
    grid = figure.subplots(len(rows), count, squeeze=False)
    for axes in grid.ravel():
        axes.axis("off")
    for row, line in zip(rows, grid, strict=True):
        for (caption, picture), axes in zip(row, line, strict=False):
            axes.imshow(picture)
            axes.set_title(caption, fontsize=8)
    write_figure(path, figure)


def spoken(name: str) -> str:
    """The name of a limb as it is read."""
    return name.replace("_", " ")
