"""Multi-view eigen-templates as detectors of limbs: recall and precision on clips of people, rooms, clothes and motions
that they were not trained on, each with templates for its own cameras."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from benchmarks.papers_loose_limbed.limb_pictures import Shown, shown_clip
from benchmarks.support.common import save, tell
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files
from benchmarks.training.limb_likelihood import person
from estimator.data.cameras.camera import Camera
from estimator.inference.beliefs.space import placements_of
from estimator.synthesis.limb_templates import train_templates
from estimator.trackers.loose_limbed.limbs.features import PERSON
from estimator.trackers.loose_limbed.part_detectors.contract import AllPartProposals
from estimator.trackers.loose_limbed.part_detectors.templates import LimbTemplates, TemplateSettings, template_proposals
from estimator.vision.patches import PatchView, patch_view
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph
from humanoid.subject.subject import Subject
from kinemode.terminal.report import console, table

NEAR, TURNED = 0.1, 30.0  # m of the proximal joint, degrees between the axes: what counts as found
TRIED = ("02_03", "02_05", "02_06", "05_10", "05_12", "16_01", "26_01")
"""Motions that the measures use; poses of the training are drawn, no captured one among them."""
SEED = 7000  # of the clips' people, rooms and clothes


def main(
    *,
    data: Path | None = None,
    clips: int = len(TRIED),
    first: int = 0,
    frames: int = 10,
    poses: int = 1500,
    score: str = "ratio",
    cameras: int = 4,
    json: Annotated[Path | None, Parameter(name="--json")] = None,
) -> None:
    """Train templates for the cameras of some rendered clips, and search for the limbs of the people in them.

    Parameters
    ----------
    data
        Folder with mocap and mocap_more in it; KINEMODE_DATA, or ../shared/data next to the checkout, by default.
    clips, first
        So many clips, from this one on.
    frames
        Of each clip.
    poses
        That templates are trained by.
    score
        See `TemplateSettings`.
    cameras
        Of each clip.
    json
        Also write the figures here.
    """
    named = {path.stem[-5:]: path for path in captured_files(data)}
    files = [named[name] for name in TRIED if name in named]
    if not files:
        print(NO_CAPTURED_FILES)
        return
    subject, settings = person(), TemplateSettings(score=score)
    graph, rows = limb_graph(subject), []
    for k, path in list(enumerate(files))[first : first + clips]:
        shown = list(shown_clip(subject, path, frames, SEED + k, cameras))
        before = time.process_time()
        detect, _ = template_detector(subject, [v.camera for v in shown[0].views], settings, poses)
        trained = time.process_time() - before
        detect(shown[0])
        before = time.process_time()
        part_proposals = [detect(of) for of in shown]
        each = (time.process_time() - before) / frames
        rows.append(
            np.array([found(graph, said, of) for said, of in zip(part_proposals, shown, strict=True)]).mean(axis=0)
        )
        tell(f"{path.stem}: trained {trained:.0f} s, {each:.2f} s a frame, {sum_up(graph, rows[-1])}")
    total = np.mean(rows, axis=0)
    shown_as = table("limbs found", "", "either side", "its own", "its own, roll too", "precision, either side")
    for name, values in zip(graph.names, total, strict=True):
        shown_as.add_row(name, *(f"{value:.2f}" for value in values))
    console().print(shown_as)
    save(json, {"measure": "limb templates", "found": dict(zip(graph.names, total.tolist(), strict=True))})


def template_detector(
    subject: Subject, cameras: Sequence[Camera], settings: TemplateSettings, poses: int = 1500
) -> tuple[Callable[[Shown], AllPartProposals], LimbTemplates]:
    """The search for the limbs of a subject's graph in instants that these cameras show, and its templates."""
    graph, templates = limb_graph(subject), train_templates(subject, cameras, poses=poses)
    return lambda shown: template_proposals(templates, graph, views_of(shown), settings), templates


def views_of(shown: Shown) -> list[PatchView]:
    """An instant as templates take it."""
    pairs = zip(shown.views, shown.pictures, strict=True)
    return [patch_view(view.camera, picture, view.foreground == PERSON) for view, picture in pairs]


def found(graph: LimbGraph, part_proposals: AllPartProposals, shown: Shown) -> np.ndarray:
    """For each limb (L, 4): whether a proposal of its own is at it or the other side's; at it; at it and not turned
    about its axis either; and the share of its proposals that are at it or the other side's."""
    values = np.zeros((len(graph.limbs), 4))
    for k, proposals in enumerate(part_proposals):
        at = [_at(proposals.points, shown.t[i], shown.R[i]) for i in (k, graph.mirror[k])]
        either = at[0][0] | at[1][0]
        values[k] = either.any(), at[0][0].any(), at[0][1].any(), either.mean() if len(either) else 0.0
    return values


def _at(points: np.ndarray, t: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which points (N, 7) are near a limb at t (3,), R (3, 3) and along it, and which are turned as it is, too."""
    places, turned = placements_of(points)
    near = np.linalg.norm(places - t, axis=1) <= NEAR
    along = turned[:, :, 2] @ R[:, 2] >= np.cos(np.radians(TURNED))
    cosine = 0.5 * (np.einsum("nij,ij->n", turned, R) - 1.0)
    return near & along, near & (cosine >= np.cos(np.radians(TURNED)))


def sum_up(graph: LimbGraph, values: np.ndarray) -> str:
    """Recalls (L, 4) in a line."""
    return ", ".join(f"{name} {value[0]:.2f}/{value[1]:.2f}" for name, value in zip(graph.names, values, strict=True))
