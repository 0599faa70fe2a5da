"""What a helping process needs to know: the search, once, and every frame's case. Both hold things that cannot travel,
or need not; what they are made from goes instead."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from estimator.cost.model import CostModel, CostSettings
from estimator.imaging.cues import ImageCues
from estimator.imaging.observation import Observation
from estimator.search.frame_search import FrameCase, Reading
from estimator.search.mode_search import ModeSearch
from estimator.search.settings import ModeSearchSettings
from humanoid.collision.clearance import Clearance
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Base, subject_from_text


class SearchRecipe(NamedTuple):
    """Makes an equal `ModeSearch` in another process. urdf, source, base: of the subject."""

    urdf: str
    source: str
    base: Base
    clearance: bool
    cost: CostSettings
    settings: ModeSearchSettings

    @staticmethod
    def of(search: ModeSearch) -> SearchRecipe:
        """The recipe of a search over a subject's own body; raises ValueError for another body (`unlimited`)."""
        subject, model = search.body.subject, search.model
        if search.body.model is not subject.model:
            raise ValueError("only a body with its subject's own joint limits can be made again elsewhere")
        clearance = model.clearance is not None
        return SearchRecipe(subject.urdf, subject.source, subject.base, clearance, model.settings, search.settings)

    def search(self) -> ModeSearch:
        """The search."""
        body = Body(subject_from_text(self.urdf, source=self.source, base=self.base))
        clearance = Clearance(body) if self.clearance else None
        return ModeSearch(CostModel(body, self.cost, clearance), self.settings)


class CaseMessage(NamedTuple):
    """A `FrameCase` in plain data. readings: name, keypoints and price of each. cues, extents: of each camera whose
    pictures are looked at; detected: see `ImageModel.evidence`."""

    readings: tuple[tuple[str, Observation, float], ...]
    dt: float
    cues: tuple[ImageCues, ...]
    extents: tuple[float, ...]
    detected: float

    @staticmethod
    def of(case: FrameCase) -> CaseMessage:
        """The message that tells of a case."""
        readings = tuple((r.name, replace(r.term.observation, cues=()), r.penalty) for r in case.readings)
        cameras = () if case.evidence is None else case.evidence.cameras
        detected = cameras[0].detected if cameras else 0.0
        return CaseMessage(
            readings, case.dt, tuple(c.cues for c in cameras), tuple(c.extent for c in cameras), detected
        )

    def case(self, model: CostModel) -> FrameCase:
        """The case, for the same body and cost."""
        readings = tuple(Reading(name, model.observation_term(o), penalty) for name, o, penalty in self.readings)
        evidence = model.image.evidence(self.cues, self.extents, self.detected) if self.cues else None
        return FrameCase(readings, self.dt, evidence)
