"""How often the dual-chain tracker loses an arm that it had: the rate that `dual_chain.pose.lost` is set to.

    python -m benchmarks limb_losses [--seeds 20 21 ... 27] [--jobs 2] [--work FOLDER] [--json FILE]

On the clips of `dual_chain_events`, with 1,000 samples and without any search for limbs elsewhere. An arm is lost where
its error comes from below 50 mm to above 150 mm, which is about what an arm at another depth costs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import numpy as np

from benchmarks.papers_dual_chain.dual_chain_event_clips import EVENTS, EventClip
from benchmarks.papers_dual_chain.dual_chain_runs import FPS, Film, tracked
from benchmarks.support.common import Json, Several, Work, check_known, save, work_folder
from benchmarks.support.result_store import Figures, ResultStore, all_done
from kinemode.terminal import report

HAD, LOST = 50.0, 150.0  # mm
_SETTINGS: dict[str, Any] = {"pose": {"particles": 1000, "lost": 0.0}}


@dataclass(frozen=True)
class LossRun:
    """The tracker through one clip."""

    clip: EventClip

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"losses_{self.clip.event.replace(' ', '_')}_{self.clip.seed}"

    @property
    def what(self) -> Mapping[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return {"measure": "limb_losses", "settings": _SETTINGS, **asdict(self)}

    def work(self, store: ResultStore) -> Figures:
        """errors (T, 2) [mm]: of each arm's joints, expected over the poses."""
        film = Film(self.clip.files(store.folder))
        true, errors = film.arms(film.q), []
        for state, result, _ in tracked(film, _SETTINGS, len(film.q), self.clip.seed):
            off = np.linalg.norm(film.arms(state.q) - true[result.index], axis=2).mean(axis=0)
            errors.append([float(arm.mean()) for arm in np.split(off, 2)])
        return {"errors": errors}


def losses(error: np.ndarray) -> tuple[int, int]:
    """How often an arm was lost, of its errors (T,) [mm], and the number of frames in which it was not: from an error
    below `HAD` until one of `LOST`."""
    count = frames = 0
    had = False
    for value in error:
        count += int(had and value >= LOST)
        had = value < (LOST if had else HAD)
        frames += int(had)
    return count, frames


def main(
    *,
    seeds: Annotated[tuple[int, ...], Several] = tuple(range(20, 28)),
    events: Annotated[tuple[str, ...], Several] = EVENTS,
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Render, track, count.

    Parameters
    ----------
    seeds
        Of the clips and of the tracker.
    events
        What happens.
    jobs
        So many runs at a time.
    """
    check_known("--events", events, EVENTS)
    with work_folder(work) as folder:
        runs = [LossRun(EventClip(event, seed)) for seed in seeds for event in events]
        results = all_done("losses", ResultStore(folder), runs, jobs)
    each = [losses(error) for result in results for error in np.array(result["errors"]).T]
    count, seconds = sum(n for n, _ in each), sum(frames for _, frames in each) / FPS
    row = {"lost": count, "seconds": seconds, "rate": count / seconds, "error": np.sqrt(max(count, 1)) / seconds}
    table = report.table("arms that were lost", "lost", "seconds of arms that were had", "rate [1/s]")
    table.add_row(str(count), f"{seconds:.0f}", f"{row['rate']:.3f} ± {row['error']:.3f}")
    report.console().print(table)
    save(json, {"measure": "limb_losses", "seeds": seeds, "rows": [row]})
