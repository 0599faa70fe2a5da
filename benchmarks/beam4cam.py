"""Errors on the real clip beam4cam: each camera alone and all four, proportions fitted from the clip itself."""

from __future__ import annotations

import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from benchmarks.common import Changes, Several, beam_folder, nested, save, start
from benchmarks.scores import COLUMNS, LEGEND, Scores, cells, mean_scores, score
from benchmarks.tracking import timed_track
from estimator.evaluation import Reference
from kinemode import report

CAMERAS = ("cam01", "cam02", "cam03", "cam04")
LEARNED = {"cam01": (102.0, 77.0), "cam02": (232.0, 126.0), "cam03": (124.0, 84.0), "cam04": (118.0, 83.0)}
LEARNED_MEAN = (144.1, 92.4)
TOGETHER = "four"
TOGETHER_TARGET = 35.0


def main(
    *,
    data: Path | None = None,
    seeds: Annotated[tuple[int, ...], Several] = (0,),
    views: Annotated[tuple[str, ...], Several] = (*CAMERAS, TOGETHER),
    tracker: str = "css",
    modes: int = 7,
    keypoints: str = "keypoints",
    changes: Changes = (),
    json: Annotated[Path | None, Parameter(name="--json")] = None,
) -> None:
    """Track beam4cam from each camera alone and from all four, against its reference.

    Parameters
    ----------
    data
        Folder with beam4cam in it; KINEMODE_DATA, or ../shared/data next to the checkout, by default.
    seeds
        Seeds of the tracker.
    views
        Cameras to track from alone, and "four" for all together.
    tracker, modes
        As in `kinemode track`.
    keypoints
        keypoints, or keypoints_multicrop for the cleaner ones.
    changes
        Changes to the settings, as cost.nu=8 css.scale=4.
    json
        Also write the figures here.
    """
    folder, settings = beam_folder(data), nested(changes)
    reference = Reference.load(folder / "reference3d.npz")
    found: dict[str, list[tuple[Scores, float]]] = {}
    with tempfile.TemporaryDirectory() as temporary:
        for view in views:
            names = CAMERAS if view == TOGETHER else (view,)
            files = {name: folder / keypoints / f"{name}.json" for name in names}
            for seed in seeds:
                run, times = timed_track(
                    files, folder / "calibration.json", Path(temporary) / "one.run", tracker=tracker, seed=seed,
                    modes=modes, settings=settings,
                )  # fmt: skip
                found.setdefault(view, []).append((score(run, reference), times.rate))
    print_table(found, seeds)
    save(json, figures(found, seeds, tracker, settings))


def print_table(found: dict[str, list[tuple[Scores, float]]], seeds: tuple[int, ...]) -> None:
    made = report.table(f"beam4cam, {len(seeds)} seed(s), means over seeds", "view", *COLUMNS, "learned", "PA   ")
    for view, results in found.items():
        learned = [f"{x:.0f}" for x in LEARNED.get(view, ())] or ["", ""]
        made.add_row(
            view, *cells(mean_scores(s for s, _ in results), float(np.median([r for _, r in results]))), *learned
        )
    alone = [result for view, results in found.items() if view != TOGETHER for result in results]
    if alone:
        rate = float(np.median([r for _, r in alone]))
        made.add_section()
        made.add_row("mean alone", *cells(mean_scores(s for s, _ in alone), rate), *(f"{x:.1f}" for x in LEARNED_MEAN))
    out = report.console()
    out.width = max(out.width, 180)
    out.print(made)
    out.print(LEGEND)
    if TOGETHER in found:
        worst = max(s.mpjpe for s, _ in found[TOGETHER])
        out.print(f"four cameras: {worst:.1f} mm in the worst seed, target at most {TOGETHER_TARGET:.0f} mm")


def figures(
    found: dict[str, list[tuple[Scores, float]]], seeds: tuple[int, ...], tracker: str, settings: dict[str, Any]
) -> dict[str, Any]:
    alone = [s for view, results in found.items() if view != TOGETHER for s, _ in results]
    return {
        "measure": "beam4cam",
        "tracker": tracker,
        "settings": settings,
        "seeds": seeds,
        "views": {
            view: [{"seed": seed, "fps": rate, **asdict(s)} for seed, (s, rate) in zip(seeds, results, strict=True)]
            for view, results in found.items()
        },
        "mean_alone": asdict(mean_scores(alone)) if alone else None,
        "learned": {**LEARNED, "mean": LEARNED_MEAN},
    }


if __name__ == "__main__":
    start(main)
