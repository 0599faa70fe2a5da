"""The effect of a chain of keypoints beside css where keypoints are missing, on the real clip beam4cam.

    python -m benchmarks css_dual [--data DIR] [--views cam01 ...] [--seeds 0 1 2 3 4] [--jobs 2] [--work FOLDER]

Every elbow, wrist, knee and ankle is gone twice for 15 frames, at times that a seed draws. All ways have the same gaps,
the same seed, the same body, fitted once to the whole keypoints of the camera, and see nothing else.
"""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from benchmarks.accuracy.beam4cam import CAMERAS
from benchmarks.support.common import (
    Changes,
    Data,
    Json,
    Several,
    Work,
    beam_folder,
    check_known,
    nested,
    save,
    work_folder,
)
from benchmarks.support.result_store import Figures, ResultStore, all_done, removed
from benchmarks.support.tracking import timed_track
from estimator.runs.evaluation import procrustes
from estimator.runs.pairs import paired
from estimator.runs.posterior import Posterior, PosteriorCalibration
from estimator.runs.reference_motion import Reference
from estimator.runs.run_reader import Run
from humanoid.support.files import replacing
from kinemode.terminal import report
from kinemode.testing.calibration import calibration_error, coverage

GONE = tuple(f"{side}_{joint}" for joint in ("elbow", "wrist", "knee", "ankle") for side in ("left", "right"))
GAP, TIMES = 15, 2  # frames, for every keypoint
WHOLE, MISSING, KEPT = "css, nothing missing", "css", "css-dual"
WAYS: dict[str, tuple[str, dict[str, Any]]] = {
    WHOLE: ("css", {}),
    MISSING: ("css", {}),
    KEPT: ("css-dual", {}),
    "css-dual, which": ("css-dual", {"exchange": "which"}),
    "css-dual, one-way": ("css-dual", {"exchange": "one-way"}),
    "css-dual, printed": ("css-dual", {"exchange": "printed"}),
}


@dataclass(frozen=True)
class Fitted:
    """The body fitted to a camera's keypoints, folder of the data."""

    camera: str
    folder: str

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"fitted_{self.camera}"

    @property
    def what(self) -> Mapping[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return {"fitted": self.camera}

    def work(self, store: ResultStore) -> Figures:
        """Its URDF."""
        out = store.scratch(self, ".run")
        folder = Path(self.folder)
        files = {self.camera: folder / "keypoints" / f"{self.camera}.json"}
        run, _ = timed_track(files, folder / "calibration.json", out, frames=2)
        text = run.header.subject_urdf
        removed(out)
        return {"urdf": text}


@dataclass(frozen=True)
class GapRun:
    """One way through the clip from one camera. changes: to `css_dual.beside`, as JSON."""

    camera: str
    seed: int
    way: str
    tracker: str
    changes: str
    folder: str

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"{self.camera}_{self.way.replace(' ', '_').replace(',', '')}_{self.seed}"

    @property
    def what(self) -> Mapping[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return {name: value for name, value in asdict(self).items() if name != "folder"}

    def work(self, store: ResultStore) -> Figures:
        """See `run_figures`, and `seconds` of processor time a frame."""
        folder, out = Path(self.folder), store.scratch(self, ".run")
        subject, keypoints = store.scratch(self, ".urdf"), store.scratch(self, ".json")
        subject.write_text(store.of(Fitted(self.camera, self.folder))["urdf"], encoding="utf-8")
        gone = with_gaps(folder / "keypoints" / f"{self.camera}.json", keypoints, self.seed)
        if self.way == WHOLE:
            keypoints.write_bytes((folder / "keypoints" / f"{self.camera}.json").read_bytes())
        beside = json_module.loads(self.changes)
        settings = {"smooth": {"enabled": False}, **({"css_dual": {"beside": beside}} if beside else {})}
        run, times = timed_track(
            {self.camera: keypoints}, folder / "calibration.json", out,
            subject=subject, fit="off", tracker=self.tracker, seed=self.seed, settings=settings,
        )  # fmt: skip
        figures = run_figures(run, Reference.load(folder / "reference3d.npz"), gone)
        for path in (out, subject, keypoints):
            removed(path)
        return {**figures, "seconds": times.cpu_tracking}


def with_gaps(source: Path, to: Path, seed: int) -> dict[str, np.ndarray]:
    """Write a copy of a keypoint file in which each of `GONE` is missing `TIMES` times for `GAP` frames, apart and not
    in the first three frames; returns by name in which frames (T,) bool."""
    content, rng = json_module.loads(source.read_text(encoding="utf-8")), np.random.default_rng(seed)
    frames, names = content["frames"], content["names"]
    gone = {}
    for name in GONE:
        begins = rng.integers(3, len(frames) - TIMES * GAP - TIMES, size=TIMES)
        begins = np.sort(begins) + np.arange(TIMES) * (GAP + 1)
        missing = np.zeros(len(frames), dtype=bool)
        for begin in begins:
            missing[begin : begin + GAP] = True
        gone[name] = missing
        for t in np.flatnonzero(missing):
            if frames[t]["keypoints"]:
                frames[t]["keypoints"][names.index(name)][2] = 0.0
    with replacing(to) as temporary:
        temporary.write_text(json_module.dumps(content), encoding="utf-8")
    return gone


def run_figures(run: Run, reference: Reference, gone: Mapping[str, np.ndarray]) -> Figures:
    """Mean distances [mm] after the best similarity of each frame, of its best hypothesis as tracked: `pa` of all limb
    joints, `there` and `gone` of those whose keypoint is seen and is missing; and credible levels of the joints' true
    places, as they are, `levels_there`, `levels_gone`."""
    pairs = paired(run.body.landmark_names, run.time, reference)
    names, ours, true = pairs.shared.names, pairs.shared.ours, pairs.truth_of_frames(len(run.time))
    points = run.mode_landmarks[:, 0][:, ours]
    missing = np.array([gone.get(name, np.zeros(len(points), dtype=bool)) for name in names]).T
    off = np.full(missing.shape, np.nan)
    for t in np.flatnonzero(np.isfinite(points).all(axis=(1, 2)) & np.isfinite(true).all(axis=(1, 2))):
        off[t] = 1e3 * np.linalg.norm(procrustes(points[t], true[t]) - true[t], axis=1)
    levels = _levels(run, ours, true)
    return {
        "pa": float(np.nanmean(off)),
        "there": float(np.nanmean(off[~missing])),
        "gone": float(np.nanmean(off[missing])),
        "levels_there": levels[~missing & np.isfinite(levels)].tolist(),
        "levels_gone": levels[missing & np.isfinite(levels)].tolist(),
    }


def _levels(run: Run, ours: Sequence[int], true: np.ndarray) -> np.ndarray:
    """Credible levels (T, J) of true joints (T, J, 3), NaN where there are none."""
    rng, camera = np.random.default_rng(0), run.header.cameras[0]
    levels = np.full(true.shape[:2], np.nan)
    for t in range(len(run)):
        result = run.result(t)
        if not len(result.weight) or not np.isfinite(true[t]).all():
            continue
        posterior = Posterior.of(run.body, result, PosteriorCalibration(), [camera])
        places = np.full((len(run.body.landmark_names), 3), np.nan)
        places[ours] = true[t]
        levels[t] = posterior.landmark_credible_levels(rng, places[None])[0][ours]
    return levels


def main(
    *,
    data: Data = None,
    views: Annotated[tuple[str, ...], Several] = CAMERAS,
    seeds: Annotated[tuple[int, ...], Several] = (0, 1, 2, 3, 4),
    ways: Annotated[tuple[str, ...], Several] = tuple(WAYS),
    changes: Changes = (),
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Take keypoints away, track, compare.

    Parameters
    ----------
    views
        Cameras, each tracked alone.
    seeds
        Of the gaps and of the tracker.
    ways
        What is compared.
    changes
        Changes to the chain beside css in all ways that have it, as farthest=0.5 points.noise=3.
    jobs
        So many runs at a time.
    """
    check_known("--views", views, CAMERAS)
    check_known("--ways", ways, WAYS)
    folder = str(beam_folder(data))
    with work_folder(work) as place:
        store = ResultStore(place)
        all_done("bodies", store, [Fitted(view, folder) for view in views], jobs)
        pieces = [
            GapRun(view, seed, way, tracker, _text(nested(changes), own) if tracker != "css" else "{}", folder)
            for seed in seeds
            for view in views
            for way, (tracker, own) in ((way, WAYS[way]) for way in ways)
        ]
        results = all_done("runs", store, pieces, jobs)
    save(json, {"measure": "css_dual", "seeds": seeds, "rows": show(pieces, results, ways, views)})


def _text(changes: dict[str, Any], own: dict[str, Any]) -> str:
    return json_module.dumps({**changes, **own}, sort_keys=True)


def show(
    pieces: Sequence[GapRun], results: Sequence[Figures], ways: Sequence[str], views: Sequence[str]
) -> list[dict[str, Any]]:
    """A row a way and camera, and one of all; deviations are over seeds."""
    table = report.table(
        f"beam4cam, {len(GONE)} keypoints each gone {TIMES} times for {GAP} frames: PA [mm], filtered", "way", "camera",
        "all joints", "whose keypoint is there", "is missing", "90 % regions: there", "missing", "calibration error",
        "s a frame",
    )  # fmt: skip
    rows = []
    for way in ways:
        for view in (*views, "all"):
            mine = [(p, r) for p, r in zip(pieces, results, strict=True) if p.way == way and view in (p.camera, "all")]
            row: dict[str, Any] = {"way": way, "camera": view, **_mean(mine)}
            rows.append(row)
            table.add_row(
                way if view == views[0] else "", view,
                *(f"{row[name]:.1f} ± {row[name + '_std']:.1f}" for name in ("pa", "there", "gone")),
                *(f"{100.0 * row[name]:.0f} %" for name in ("covers_there", "covers_gone")),
                f"{row['calibration_error']:.3f}", f"{row['seconds']:.2f}",
            )  # fmt: skip
    report.console().print(table)
    return rows


def _mean(mine: Sequence[tuple[GapRun, Figures]]) -> dict[str, float]:
    out: dict[str, float] = {}
    seeds = sorted({piece.seed for piece, _ in mine})
    for name in ("pa", "there", "gone", "seconds"):
        of_seed = [np.mean([r[name] for piece, r in mine if piece.seed == seed]) for seed in seeds]
        out |= {name: float(np.mean(of_seed)), f"{name}_std": float(np.std(of_seed))}
    there, gone = (np.concatenate([np.array(r[f"levels_{k}"]) for _, r in mine]) for k in ("there", "gone"))
    return {
        **out,
        "covers_there": float(coverage(there, 0.9)[0]),
        "covers_gone": float(coverage(gone, 0.9)[0]),
        "calibration_error": calibration_error(np.concatenate([there, gone])),
    }
