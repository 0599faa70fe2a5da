"""The time of recovery from a pose that was set wrong."""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.papers_dual_chain.dual_chain_runs import Film, UpperClip, tracker_of
from benchmarks.support import standard_errors
from benchmarks.support.common import save
from benchmarks.support.result_store import Figures, ResultStore
from estimator.trackers.dual_chain.tracker import DualChain, DualState
from kinemode.terminal import report

BEGIN = (20, 45, 70)  # frames at which poses are put wrong
WRONG = 1.0  # rad
AFTER = 15  # frames
WITHIN = 10  # frames
NEAR, BESIDE = 1.2, 20.0  # times the error without, and mm more: found again


@dataclass(frozen=True)
class Recovery:
    """A tracker whose poses are put wrong at some frames of a clip, and the same tracker undisturbed."""

    clip: UpperClip
    seed: int
    label: str
    settings: str

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"recovery_{self.clip.motion}_{self.clip.seed}_{self.label.replace(' ', '_')}"

    @property
    def what(self) -> Mapping[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return asdict(self)

    def work(self, store: ResultStore) -> Figures:
        """Expected errors [mm] of the frames after each disturbance, `wrong` and `right` (B, AFTER)."""
        film = Film(self.clip.files(store.folder))
        tracker, true = tracker_of(film, json_module.loads(self.settings)), film.arms(film.q)
        seen = [o for o, _ in film.observations(max(BEGIN) + AFTER)]
        states: list[DualState] = []
        for o in seen:
            rng = np.random.default_rng([self.seed, o.index])
            states.append((tracker.step(rng, states[-1], o) if states else tracker.init(rng, o))[0])
        errors = [_error(film, s, true[o.index]) for s, o in zip(states, seen, strict=True)]
        wrong = []
        for begin in BEGIN:
            state, each = disturbed(tracker, states[begin - 1], np.random.default_rng([self.seed, begin, 2])), []
            for o in seen[begin : begin + AFTER]:
                state, _ = tracker.step(np.random.default_rng([self.seed, o.index, 3]), state, o)
                each.append(_error(film, state, true[o.index]))
            wrong.append(each)
        return {"wrong": wrong, "right": [errors[b : b + AFTER] for b in BEGIN]}


def disturbed(tracker: DualChain, state: DualState, rng: np.random.Generator) -> DualState:
    """All poses, and the hypotheses, with 1 rad more or less in every joint of the arms, inside the limits."""
    body, v = tracker.body, np.zeros(tracker.body.nv)
    arms = np.concatenate(tracker.parts.dofs[1:])
    v[arms] = WRONG * rng.choice([-1.0, 1.0], size=len(arms))
    modes = tuple(replace(m, q=body.integrate(m.q, v)) for m in state.mixture.modes)
    other = state.alternative
    return replace(
        state,
        q=body.integrated(state.q, np.tile(v, (len(state.q), 1))),
        alternative=other and replace(other, q=body.integrated(other.q, np.tile(v, (len(other.q), 1)))),
        mixture=replace(state.mixture, modes=modes),
    )


def _error(film: Film, state: DualState, true: np.ndarray) -> float:
    return float(np.linalg.norm(film.arms(state.q) - true, axis=2).mean())


def back_after(wrong: Sequence[float], right: Sequence[float]) -> int:
    """The number of frames after which the error is about that without, from 1; one more than the total if never."""
    near = np.asarray(wrong) <= NEAR * np.asarray(right) + BESIDE
    return int(np.argmax(near)) + 1 if near.any() else len(near) + 1


def show_recovery(
    pieces: Sequence[Recovery], results: Sequence[Figures], ways: Sequence[str], json: Path | None
) -> None:
    """A row a way; the standard error of the share is binomial."""
    table = report.table(
        "put wrong by 1 rad in every joint of the arms", "way", "times", "found within 10 frames", "median frames",
        "before [mm]", "after 1", "after 10", "undisturbed after 10",
    )  # fmt: skip
    rows = []
    for way in ways:
        pairs = [
            (wrong, right)
            for piece, result in zip(pieces, results, strict=True)
            if piece.label == way
            for wrong, right in zip(result["wrong"], result["right"], strict=True)
        ]
        frames = np.array([back_after(wrong, right) for wrong, right in pairs])
        wrong, right = (np.array([pair[k] for pair in pairs]) for k in (0, 1))
        row = {
            "way": way, "times": len(pairs), "found": float((frames <= WITHIN).mean()),
            "found_error": standard_errors.of_share(int((frames <= WITHIN).sum()), len(pairs)),
            "frames": float(np.median(frames)),
            "before": float(right[:, 0].mean()), "after_1": float(wrong[:, 0].mean()),
            "after_10": float(wrong[:, WITHIN - 1].mean()), "undisturbed_10": float(right[:, WITHIN - 1].mean()),
        }  # fmt: skip
        rows.append(row)
        table.add_row(
            way, str(row["times"]), f"{row['found']:.0%} ± {row['found_error']:.0%}", f"{row['frames']:.0f}",
            f"{row['before']:.0f}", f"{row['after_1']:.0f}", f"{row['after_10']:.0f}", f"{row['undisturbed_10']:.0f}",
        )  # fmt: skip
    report.console().print(table)
    save(json, {"measure": "dual_chain_recovery", "rows": rows})
