"""Keypoints as detectors of limbs on the real clip beam4cam: recall and precision of pairs of views, and of
single views, against the reference's joints; with the body that the clip was fitted with."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.accuracy.beam4cam import CAMERAS, TOGETHER, checked
from benchmarks.papers_loose_limbed.limb_templates import NEAR, TURNED
from benchmarks.support.common import Data, Json, Work, beam_folder, save, tell, work_folder
from benchmarks.support.tracking import timed_track
from estimator.data.observation import Observation
from estimator.inference.beliefs.space import placements_of
from estimator.runs.reference_motion import Reference
from estimator.runs.run_reader import Run
from estimator.trackers.loose_limbed.limbs.keypoint_evidence import LimbLandmarks, landmarks_of_limbs
from estimator.trackers.loose_limbed.part_detectors.contract import PartProposals
from estimator.trackers.loose_limbed.part_detectors.keypoints import keypoint_proposals
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph
from humanoid.subject.landmarks import mirror_index
from kinemode.terminal.report import console, table

RECALL, PRECISION = 0.95, 0.8
_BESIDE = 0.02  # m from a limb's axis: landmarks nearer are its joints
_COLUMNS = ("either side", "its own", "precision, either side", "its own", "by weight, either side", "its own")


def main(
    *,
    data: Data = None,
    views: Sequence[str] = (TOGETHER, *CAMERAS),
    keypoints: str = "keypoints",
    work: Work = None,
    json: Json = None,
) -> None:
    """Look for the limbs of the person of beam4cam by keypoints.

    A limb is measured by the two joints of its axis that the reference has; a candidate is right within 100 mm of the
    proximal joint and 30 degrees of the axis. The head has no such joints.

    Parameters
    ----------
    views
        "four" for pairs of all views, cameras for each alone.
    keypoints
        keypoints, or keypoints_multicrop for the cleaner ones.
    """
    folder, shown = beam_folder(data), checked(tuple(views), (TOGETHER, *CAMERAS))
    with work_folder(work) as kept:
        files = {name: folder / keypoints / f"{name}.json" for name in CAMERAS}
        run, _ = timed_track(files, folder / "calibration.json", kept / "limbs.run", frames=2)
        figures = measured(run, Reference.load(folder / "reference3d.npz"), shown)
    save(json, {"measure": "limbs by keypoints", "keypoints": keypoints, "views": figures})


def measured(run: Run, reference: Reference, views: Sequence[str]) -> dict[str, dict[str, list[float]]]:
    """The figures for `show` in each of the views."""
    body, graph = run.body, limb_graph(run.body)
    landmarks, truth, figures = landmarks_of_limbs(body, graph), joints(run, reference), {}
    for view in views:
        before, counts, values = time.process_time(), [], []
        for i, points in enumerate(truth):
            seen = of_cameras(run.observation(i), CAMERAS if view == TOGETHER else [view])
            part_proposals = keypoint_proposals(body, graph, seen, None, landmarks)
            counts.append(np.mean([len(proposals.weights) for proposals in part_proposals]))
            names = body.landmark_names
            values.append(
                [shares(graph, landmarks, k, proposals, points, names) for k, proposals in enumerate(part_proposals)]
            )
        each = 1e3 * (time.process_time() - before) / len(truth)
        tell(f"{view}: {each:.0f} ms a frame, measures included, {np.mean(counts):.0f} candidates of a limb")
        figures[view] = show(graph, view, np.array(values))
    return figures


def joints(run: Run, reference: Reference) -> np.ndarray:
    """The body's landmarks in the reference (T, L, 3) [m], NaN where it has none, at the times of the run's frames."""
    names, count = run.body.landmark_names, len(reference.points)
    points = np.full((count, len(names), 3), np.nan)
    for k, name in enumerate(names):
        if name in reference.names:
            points[:, k] = reference.points[:, reference.names.index(name)]
    return points


def of_cameras(observation: Observation, names: Sequence[str]) -> Observation:
    """The observation of some of its cameras."""
    rows = [k for k, camera in enumerate(observation.cameras) if camera.name in names]
    cameras = tuple(observation.cameras[k] for k in rows)
    return replace(
        observation, cameras=cameras, pixels=observation.pixels[rows], confidence=observation.confidence[rows]
    )


def ends(
    graph: LimbGraph, landmarks: Sequence[LimbLandmarks], k: int, points: np.ndarray, mirror: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """A limb's proximal joint (3,) [m] and the unit vector of its axis (3,), by the points (L, 3) of the reference;
    None where it has none on the axis, or pairs whose middle is on it, near both ends."""
    of, limb = landmarks[k], graph.limbs[k]
    have = np.isfinite(points[:, 0])
    on_axis = []
    for i, place in zip(of.landmark, of.place, strict=True):
        j = mirror[i]
        if have[i] and np.hypot(*place[:2]) < _BESIDE:
            on_axis.append((place[2], points[i]))
        elif j in of.landmark and have[i] and have[j]:
            middle = 0.5 * (place + of.place[list(of.landmark).index(j)])
            if np.hypot(*middle[:2]) < _BESIDE:
                on_axis.append((middle[2], 0.5 * (points[i] + points[j])))
    if len(on_axis) < 2:
        return None
    (low, a), (high, b) = min(on_axis, key=lambda x: x[0]), max(on_axis, key=lambda x: x[0])
    if high - low < 0.5 * limb.length:
        return None
    axis = (b - a) / np.linalg.norm(b - a)
    return a - low * axis, axis


def shares(
    graph: LimbGraph,
    landmarks: Sequence[LimbLandmarks],
    k: int,
    proposals: PartProposals,
    points: np.ndarray,
    names: tuple[str, ...],
) -> np.ndarray:
    """Shares of a limb's candidates (6,), as `_COLUMNS` has them: whether one is right, the share of the right ones,
    and that of their weight; NaN where the reference does not have the limb or there is no candidate to be right."""
    mirror = mirror_index(names)
    truth = [ends(graph, landmarks, i, points, mirror) for i in (k, graph.mirror[k])]
    if truth[0] is None or truth[1] is None:
        return np.full(6, np.nan)
    if not len(proposals.weights):
        return np.array([0.0, 0.0, *[np.nan] * 4])
    t, R = placements_of(proposals.points)
    right = [
        (np.linalg.norm(t - start, axis=1) <= NEAR) & (R[:, :, 2] @ axis >= np.cos(np.radians(TURNED)))
        for start, axis in (each for each in truth if each is not None)
    ]
    sides = right[0] | right[1], right[0]
    weights = proposals.weights / proposals.weights.sum()
    return np.array([*(s.any() for s in sides), *(s.mean() for s in sides), *(weights[s].sum() for s in sides)])


def show(graph: LimbGraph, view: str, values: np.ndarray) -> dict[str, list[float]]:
    """A table of values (T, L, 6); their means by limb, and over the limbs."""
    known = np.isfinite(values[..., 0]).any(axis=0)
    made = table(f"limbs by keypoints, {view}", "", *_COLUMNS)
    rows = {graph.names[k]: np.nanmean(values[:, k], axis=0) for k in np.flatnonzero(known)}
    rows["mean"] = np.mean(list(rows.values()), axis=0)
    for name, row in rows.items():
        made.add_row(name, *(f"{value:.3f}" for value in row))
    console().print(made)
    if view == TOGETHER:
        for side, (recall, precision) in (("either side", rows["mean"][[0, 2]]), ("its own", rows["mean"][[1, 3]])):
            bars = f"recall {recall:.3f}, bar {RECALL}; precision {precision:.3f}, bar {PRECISION}"
            console().print(f"{side}: {bars}, by pairs of views")
    return {name: row.tolist() for name, row in rows.items()}
