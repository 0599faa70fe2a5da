"""Evidence between the two readings of a trunk: terms of the energy at the best hypothesis of each, on captured people.

Every frame of a captured clip in which one camera has both readings is a pair, the right one known. From their
differences follow how much the priors on rest positions should count between readings (`search.readings_rest`), what
balance brings, and how reliable a difference of energy is. Shares are means over people, so that no one counts more
than another.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

import kinemode as km
from benchmarks.accuracy.trunk_view_clips import DETECTOR, EXACT, FOCAL, KINDS, ViewRun, phone, seen_by, seen_person
from benchmarks.accuracy.trunk_views import AZIMUTHS, CAPTURED, captured_windows, person_of
from benchmarks.support.common import Data, Json, Several, Work, check_known, save, work_folder
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES
from benchmarks.support.result_store import Figures, ResultStore, all_done, removed
from estimator.data.formats.keypoints import write_keypoints
from estimator.data.standing import with_standing
from estimator.energy.cost import Cost
from estimator.numerics.vectors import unit
from estimator.runs.run_reader import Run
from estimator.search.cost_model import CostModel, parts_apart
from estimator.search.hypothesis import EXCHANGED
from estimator.search.jumps.readings import AWAY, TOWARDS
from humanoid.subject.landmarks import mirror_index
from kinemode.explain import run_settings
from kinemode.terminal import report

REST = ("stabilisers", "pose prior")
SHARES = (0.0, 0.1, 0.25, 0.5, 1.0)
TEMPERATURES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
_DEEP = 0.06  # m: depth of the shoulders beyond the hips from which a reading is right or wrong
Differences = Mapping[str, float]
"""Wrong less right, by term."""


@dataclass(frozen=True)
class EvidenceRun:
    """A piece of work: a view that is tracked without smoothing."""

    view: ViewRun

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"evidence_{self.view.name}"

    @property
    def what(self) -> Mapping[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return {"evidence": self.view.what}

    def work(self, store: ResultStore) -> Figures:
        """pairs: the differences of each."""
        view = self.view
        truth = seen_person(view.source).cut(view.start, view.seconds)
        camera = phone(truth, view.azimuth)
        keypoints, out = store.scratch(self, ".json"), store.scratch(self, ".run")
        write_keypoints(keypoints, seen_by(truth, camera, view.kind, view.seed))
        run = km.track(
            "human34", keypoints=keypoints, focal=f"{FOCAL}", cues="off", seed=view.seed, out=out, overwrite=True,
            settings={"smooth": {"enabled": False}},
        )  # fmt: skip
        depth = np.sum(truth.trunk * unit(truth.of("hip") - camera.origin_world), axis=1)
        pairs = list(_pairs(run, depth[: len(run)]))
        removed(out)
        keypoints.unlink()
        return {"pairs": pairs}


def _pairs(run: Run, depth: np.ndarray) -> list[dict[str, float]]:
    """The differences in each frame that has both readings; depth (T,) [m]: of the true trunk."""
    body, cost = run.body, run_settings(run).cost
    model, mirror = CostModel(body, cost, parts_apart(body, cost)), mirror_index(body.landmark_names)
    seen = with_standing([run.observation(t) for t in range(len(run))], body.landmark_names)
    pairs = []
    for t in np.flatnonzero(np.abs(depth) > _DEEP).tolist():
        values: dict[str, dict[str, float]] = {}
        for reading in (TOWARDS, AWAY):
            own = np.flatnonzero(run.mode_reading[t] == reading)
            if len(own):
                k = own[np.argmin(run.mode_energy[t, own])]
                read = seen[t].exchanged(mirror) if run.mode_association[t, k] == EXCHANGED else seen[t]
                values[reading] = _by_term(model.cost(model.observation_term(read)), run.mode_q[t, k])
        if len(values) == 2:
            right, wrong = (values[r] for r in ((AWAY, TOWARDS) if depth[t] > 0.0 else (TOWARDS, AWAY)))
            pairs.append({name: wrong.get(name, 0.0) - right.get(name, 0.0) for name in {**wrong, **right}})
    return pairs


def _by_term(cost: Cost, q: np.ndarray) -> dict[str, float]:
    posed = cost.body.at(q)
    return {term.name: float(term.value(posed)) for term in cost.terms}


def main(
    *,
    data: Data = None,
    kinds: Annotated[tuple[str, ...], Several] = (EXACT, DETECTOR),
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Print which terms of the energy part the two readings of a trunk, on captured people who bend.

    Parameters
    ----------
    kinds
        Of keypoints, see `python -m benchmarks trunk_views --help`.
    jobs
        Views tracked at a time, each in a process of its own.
    """
    check_known("--kinds", kinds, KINDS)
    windows = captured_windows(data)
    if not windows:
        print(NO_CAPTURED_FILES)
        return
    pieces = [
        EvidenceRun(ViewRun(*window, azimuth, kind, 0))
        for window in windows for kind in kinds for azimuth in AZIMUTHS[CAPTURED]
    ]  # fmt: skip
    with work_folder(work) as folder:
        results = all_done("trunk evidence", ResultStore(folder), pieces, jobs)
    by_view: dict[tuple[str, float], list[Differences]] = {}
    for piece, result in zip(pieces, results, strict=True):
        by_view.setdefault((person_of(piece.view.source), piece.view.azimuth), []).extend(result["pairs"])
    by_view = {key: pairs for key, pairs in by_view.items() if pairs}
    rows = {
        **{f"rest positions by {share:g}": dict.fromkeys(REST, share) for share in SHARES},
        "rest positions by 0.1, no balance": {**dict.fromkeys(REST, 0.1), "balance": 0.0},
    }
    made = report.table("right reading of lower energy, mean of people", "", "front", "back", "all")
    shares = {}
    for name, weights in rows.items():
        shares[name] = [right_share(by_view, weights, azimuths) for azimuths in ((0.0,), (180.0,), (0.0, 180.0))]
        made.add_row(name, *(f"{share:.1%}" for share in shares[name]))
    report.console().print(made)
    losses = {t: log_loss(by_view, dict.fromkeys(REST, 0.1), t) for t in TEMPERATURES}
    listed = ", ".join(f"{t:g}: {loss:.3f}" for t, loss in losses.items())
    report.print_lines([f"mean log loss by what differences of energy are divided by: {listed} (chance 0.693)"])
    count = sum(len(pairs) for pairs in by_view.values())
    save(json, {"measure": "trunk evidence", "pairs": count, "right": shares, "log loss": losses})


def energies(pairs: Sequence[Differences], weights: Mapping[str, float]) -> np.ndarray:
    """The differences (N,) of the energy with some terms weighted."""
    return np.array([sum(weights.get(name, 1.0) * value for name, value in pair.items()) for pair in pairs])


def right_share(
    by_view: Mapping[tuple[str, float], Sequence[Differences]], weights: Mapping[str, float], azimuths: Sequence[float]
) -> float:
    """Share of pairs whose right reading has the lower energy, mean of people."""
    by_person: dict[str, list[np.ndarray]] = {}
    for (person, azimuth), pairs in by_view.items():
        if azimuth in azimuths:
            by_person.setdefault(person, []).append(energies(pairs, weights) > 0.0)
    return float(np.mean([np.mean(np.concatenate(right)) for right in by_person.values()]))


def log_loss(
    by_view: Mapping[tuple[str, float], Sequence[Differences]], weights: Mapping[str, float], temperature: float
) -> float:
    """Mean over views of minus the logarithm of the right reading's probability, energies divided by `temperature`."""
    return float(np.mean([np.logaddexp(0.0, -energies(p, weights) / temperature).mean() for p in by_view.values()]))
