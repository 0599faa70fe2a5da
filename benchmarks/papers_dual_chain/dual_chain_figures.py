"""Figures 2 and 3 of Taycher et al. (2004) on rendered clips of an upper body: 40 samples of the posterior, from the
front and from the side.

python -m benchmarks dual_chain_figures [--figures tracking comparison] [--seed 0] [--out FOLDER] [--work FOLDER]
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from benchmarks.papers_dual_chain.dual_chain import CONDENSATION, DUAL, SAMPLING, WAYS
from benchmarks.papers_dual_chain.dual_chain_runs import DRAWN, Film, UpperClip, tracked
from benchmarks.support.common import Several, Work, check_known, work_folder
from estimator.data.formats.cameras import load_cameras
from estimator.data.media.clip import Clip
from estimator.data.media.picture import write_picture
from estimator.inference.annealing import systematic
from viz.pictures.overlay import side_by_side
from viz.pictures.painter import BodyPainter
from viz.pictures.pose_samples import captioned, samples_tile

FIGURES: dict[str, tuple[str, tuple[str, ...], tuple[int, ...]]] = {
    "tracking": ("reach_out", (DUAL,), (10, 30, 50, 70, 90, 110)),
    "comparison": (
        "cross_arms", (DUAL, SAMPLING, CONDENSATION.format(5000), CONDENSATION.format(15000)), (10, 30, 50, 70, 90),
    ),
}  # fmt: skip


def main(
    *,
    figures: Annotated[tuple[str, ...], Several] = tuple(FIGURES),
    seed: int = 0,
    out: Path = Path("docs/reproductions"),
    work: Work = None,
) -> None:
    """Track and draw.

    Parameters
    ----------
    figures
        tracking (Figure 2), comparison (Figure 3).
    seed
        Of the clip and of the tracker.
    out
        Folder of the pictures: dual_chain_NAME.jpg.
    """
    check_known("--figures", figures, FIGURES)
    out.mkdir(parents=True, exist_ok=True)
    with work_folder(work) as folder:
        for name in figures:
            motion, ways, frames = FIGURES[name]
            film = Film(UpperClip(motion, seed).files(folder))
            rows = [_row(film, way, frames, seed) for way in ways]
            write_picture(out / f"dual_chain_{name}.jpg", np.concatenate(rows))


def _row(film: Film, way: str, frames: tuple[int, ...], seed: int) -> np.ndarray:
    """The chosen frames of one way, beside each other."""
    ((name, video),) = film.files.videos.items()
    camera, painter = load_cameras(film.files.cameras)[name], BodyPainter(film.body)
    settings: dict[str, Any] = WAYS[way]
    tiles: list[np.ndarray] = []
    with closing(Clip.open(video)) as reader:
        for state, result, _ in tracked(film, settings, max(frames) + 1, seed):
            if result.index not in frames:
                continue
            rng = np.random.default_rng([seed, result.index, 1])
            q = state.q[systematic(rng, np.full(len(state.q), 1.0 / len(state.q)), DRAWN)]
            lacks = float(result.extra.get("samples", 1.0)) == 0.0
            tile = samples_tile(reader.frame(result.index), camera, painter, q[:0] if lacks else q)
            caption = f"{way}: frame {result.index}" if not tiles else f"frame {result.index}"
            tiles.append(captioned(tile, caption + (", no samples" if lacks else "")))
    return side_by_side(tiles)
