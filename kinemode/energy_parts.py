"""The energy of a hypothesis, taken apart: its terms one by one, in each camera."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.term import Term
from estimator.search.hypothesis import EXCHANGED
from estimator.search.mode_search import ModeSearch
from estimator.vision.cues.assigned import AssignedPoints
from estimator.vision.cues.base import PastPose
from estimator.vision.cues.image_likelihood import CameraLikelihood, ImageLikelihood
from humanoid.kinematics.body import PosedBody


@dataclass(frozen=True)
class EnergyPart:
    """One part of the energy.

    name, camera: its label, the camera empty where it has none. energy: its share of the sum. count: keypoints
    or features assigned, None for what has none. distance: their mean distance in standard deviations, NaN for none.
    """

    name: str
    camera: str
    energy: float
    count: int | None = None
    distance: float = float("nan")


class Case(NamedTuple):
    """A hypothesis and all that its energy is computed from.

    past: where the body was, from where flow is followed; None where there is no past, or it is not known.
    has_transition: whether the change since then is. dt [s]: since then. assigned: where the pictures' features are
    assigned.
    """

    search: ModeSearch
    observation: Observation
    association: str
    posed: PosedBody
    past: PastPose | None
    has_transition: bool
    dt: float
    assigned: PosedBody
    likelihood: ImageLikelihood


def energy_parts(case: Case) -> Iterator[EnergyPart]:
    """The terms of the energy, each evaluated alone; keypoints and image cues camera by camera."""
    search, observation = case.search, case.observation
    for c, camera in enumerate(observation.cameras):
        yield _keypoints(case, c, camera.name)
    if case.association == EXCHANGED:
        yield EnergyPart("left and right exchanged", "", search.model.settings.exchange_penalty)
    q_previous = case.past.parent.q if case.past is not None and case.has_transition else None
    keypoints = search.term(observation, case.association)
    for term in search.model.cost(keypoints, q_previous, case.dt).terms:
        if term is not keypoints:  # listed camera by camera already
            yield EnergyPart(term.name, "", term.value(case.posed))
    for camera_likelihood in case.likelihood.cameras:
        yield from _image_parts(case, camera_likelihood)


def _keypoints(case: Case, c: int, name: str) -> EnergyPart:
    camera = slice(c, c + 1)
    seen = case.observation
    alone = replace(seen, cameras=seen.cameras[camera], pixels=seen.pixels[camera], confidence=seen.confidence[camera])
    term = case.search.term(alone, case.association)
    distance = term.distances(case.posed)
    known = distance[np.isfinite(distance)]
    return EnergyPart(
        term.name, name, term.value(case.posed), known.size, float(known.mean()) if known.size else np.nan
    )


def _image_parts(case: Case, likelihood: CameraLikelihood) -> Iterator[EnergyPart]:
    """The energy of one camera's picture as summed by `CameraLikelihood`, cue by cue; none of a picture of which no cue
    has a reading, as of a pair's right one."""
    if not likelihood.matchers:
        return
    name, prediction = likelihood.cues.camera.name, likelihood.predictor.predict(case.assigned)
    for match in likelihood.contours(prediction):
        part = EnergyPart(match.label, name, 0.0, 0)
        if len(match.features.point):
            alone = likelihood.on_contours(prediction, [match.features], name=match.label)
            part = _term_part(name, alone, case.posed)
        if match.unassigned_label:
            yield part
            yield EnergyPart(match.unassigned_label, name, match.unassigned)
        else:
            yield replace(part, energy=part.energy + match.unassigned)
    for term in likelihood.others(case.assigned, prediction):
        yield _term_part(name, term, case.posed)
    if case.past is not None:
        for followed in likelihood.follow([case.past]):
            for term in likelihood.since(followed):
                yield _term_part(name, term, case.posed)
    yield EnergyPart("nodes facing away or hidden", name, likelihood.penalty(prediction))


def _term_part(camera: str, term: Term, posed: PosedBody) -> EnergyPart:
    if not isinstance(term, AssignedPoints):
        return EnergyPart(term.name, camera, term.value(posed))
    features = term.features(posed)
    mean = float(features.weight @ features.distance / max(features.weight.sum(), 1e-300))
    return EnergyPart(term.name, camera, term.value(posed), len(features.weight), mean)
