"""The energy of a hypothesis, taken apart: its terms one by one, in each camera."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from estimator.cues.assigned import AssignedPoints, Assignments
from estimator.cues.evidence import CameraEvidence, Evidence, Past
from estimator.imaging.observation import Observation
from estimator.prediction.prediction import Prediction
from estimator.search.association import EXCHANGED
from estimator.search.mode_search import ModeSearch
from humanoid.kinematics.body import PosedBody


@dataclass(frozen=True)
class Part:
    """One part of the energy.

    name, camera: what it is of, the camera empty where it is of none. energy: its share of the sum. count: keypoints
    or features assigned, None for what has none. distance: their mean distance in standard deviations, NaN for none.
    """

    name: str
    camera: str
    energy: float
    count: int | None = None
    distance: float = float("nan")


class Case(NamedTuple):
    """A hypothesis and all that its energy is computed from.

    before: where the body was, from where flow is followed; None where there is no past, or it is not known. paid:
    whether the change since then is. dt [s]: since then. predicted: where its velocity would carry the parent, which
    the flow is looked for from. assigned: where the pictures' features are assigned.
    """

    search: ModeSearch
    observation: Observation
    association: str
    posed: PosedBody
    before: PosedBody | None
    paid: bool
    dt: float
    predicted: PosedBody | None
    assigned: PosedBody
    evidence: Evidence | None


def energy_parts(case: Case) -> Iterator[Part]:
    """The terms of the energy, each evaluated alone; keypoints and image cues camera by camera."""
    search, observation = case.search, case.observation
    for c, camera in enumerate(observation.cameras):
        yield _keypoints(case, c, camera.name)
    if case.association == EXCHANGED:
        yield Part("left and right exchanged", "", search.model.settings.exchange_penalty)
    q_previous = case.before.q if case.before is not None and case.paid else None
    keypoints = search.term(observation, case.association)
    for term in search.model.cost(keypoints, q_previous, case.dt).terms:
        if term is not keypoints:  # told camera by camera already
            yield Part(term.name, "", term.value(case.posed))
    for camera_evidence in () if case.evidence is None else case.evidence.cameras:
        yield from _image_parts(case, camera_evidence)


def _keypoints(case: Case, c: int, name: str) -> Part:
    one = slice(c, c + 1)
    seen = case.observation
    alone = replace(seen, cameras=seen.cameras[one], pixels=seen.pixels[one], confidence=seen.confidence[one])
    term = case.search.term(alone, case.association)
    distance = term.distances(case.posed)
    known = distance[np.isfinite(distance)]
    return Part(term.name, name, term.value(case.posed), known.size, float(known.mean()) if known.size else np.nan)


def _image_parts(case: Case, evidence: CameraEvidence) -> Iterator[Part]:
    """What one camera's picture costs, as `CameraEvidence.assigned` and `followed` add it up."""
    name, prediction = evidence.cues.camera.name, evidence.predictor.predict(case.assigned)
    settings = evidence.model.settings
    if evidence.cues.edges is not None and settings.edge_evidence > 0.0:
        group, unassigned = evidence.edges(prediction)
        yield _assigned_part("edges", case, evidence, term_of(evidence, prediction, group))
        yield Part("contour without an edge, or hidden", name, unassigned)
    if evidence.cues.silhouette is not None and settings.outline_evidence > 0.0:
        for label, found in (("body to silhouette", evidence.outline), ("silhouette to body", evidence.outline_back)):
            group, unassigned = found(prediction)
            part = _assigned_part(label, case, evidence, term_of(evidence, prediction, group))
            yield replace(part, energy=part.energy + unassigned)
    if case.before is not None:
        for term in evidence.followed_each([Past(case.before, case.predicted)])[0]:
            yield _assigned_part("flow", case, evidence, term)
    yield Part("nodes facing away or hidden", name, evidence.penalty(prediction))


def term_of(evidence: CameraEvidence, prediction: Prediction, group: Assignments) -> AssignedPoints | None:
    """The term of one kind of feature alone; None where there are none."""
    if not len(group.point):
        return None
    contours = prediction.contours
    return AssignedPoints(evidence.model.body, evidence.cues.camera, contours.joint, contours.local, [group])


def _assigned_part(label: str, case: Case, evidence: CameraEvidence, term: AssignedPoints | None) -> Part:
    name = evidence.cues.camera.name
    if term is None:
        return Part(label, name, 0.0, 0)
    found = term.features(case.posed)
    mean = float(found.weight @ found.distance / max(found.weight.sum(), 1e-300))
    return Part(label, name, term.value(case.posed), len(found.weight), mean)
