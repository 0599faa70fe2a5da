"""A `ModeSearch` that several processes work for: what they need to know, the search once and every frame's case. Both
hold things that cannot travel, or need not; what they are made from goes instead."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from estimator.data.image_cues import ImageCues
from estimator.data.observation import Observation
from estimator.energy.limb_targets import LimbPull
from estimator.numerics.pool import checked_count, worker_pool
from estimator.search.cost_model import CostModel, parts_apart
from estimator.search.cost_settings import CostSettings
from estimator.search.frame_search import FrameProblem, FrameSearch
from estimator.search.hypothesis import Association
from estimator.search.mode_search import ModeSearch
from estimator.search.settings import ModeSearchSettings
from estimator.vision.likelihood.image_likelihood import ImageLikelihood
from estimator.vision.likelihood.settings import CueSettings
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Base, subject_from_text


@contextmanager
def search_pool(search: ModeSearch, processes: int) -> Iterator[None]:
    """Within it so many processes do the work of a search, this one among them; what comes out is the same to the last
    bit. One process is this one alone. See `estimator.numerics.pool.worker_pool`, also for the errors.
    """
    if checked_count(processes) == 1:
        yield
        return
    before = search.workers
    with worker_pool(SearchRecipe.of(search), processes) as workers:
        search.workers = workers
        try:
            yield
        finally:
            search.workers = before


class SearchRecipe(NamedTuple):
    """Makes an equal `ModeSearch` in another process, and its frames' searches (see
    `estimator.numerics.job.WorkerJob`). urdf, source, base: of the subject."""

    urdf: str
    source: str
    base: Base
    self_collision: bool
    cost: CostSettings
    cues: CueSettings
    settings: ModeSearchSettings

    @staticmethod
    def of(search: ModeSearch) -> SearchRecipe:
        """The recipe of a search over a subject's own body; raises ValueError for another body (`unlimited`)."""
        subject, model = search.body.subject, search.model
        if search.body.model is not subject.model:
            raise ValueError("only a body with its subject's own joint limits can be made again elsewhere")
        self_collision = model.self_collision is not None
        return SearchRecipe(
            subject.urdf, subject.source, subject.base, self_collision, model.settings, model.cues, search.settings
        )

    def search(self) -> ModeSearch:
        """The search."""
        body = Body(subject_from_text(self.urdf, source=self.source, base=self.base))
        self_collision = parts_apart(body, self.cost) if self.self_collision else None
        return ModeSearch(CostModel(body, self.cost, self_collision, self.cues), self.settings)

    def message(self, context: FrameSearch) -> CaseMessage:
        """See `Job`."""
        return CaseMessage.of(context.case)

    def opener(self) -> Callable[[CaseMessage], FrameSearch]:
        """See `Job`."""
        search = self.search()

        def opened(message: CaseMessage) -> FrameSearch:
            return FrameSearch(search.model, search.seeker, search.settings, message.case(search.model))

        return opened


class CaseMessage(NamedTuple):
    """A `FrameProblem` in plain data. associations: name, keypoints and penalty of each. cues, extents: of each camera
    whose pictures are looked at; detected: see `ImageLikelihood.of`. pulls: see `FrameProblem`."""

    associations: tuple[tuple[str, Observation, float], ...]
    dt: float
    cues: tuple[ImageCues, ...]
    extents: tuple[float, ...]
    detected: float
    pulls: tuple[LimbPull, ...] = ()

    @staticmethod
    def of(case: FrameProblem) -> CaseMessage:
        """The message that tells of a case."""
        associations = tuple((a.name, a.term.observation, a.penalty) for a in case.associations)
        cameras = case.likelihood.cameras
        detected = cameras[0].detected if cameras else 0.0
        cues = tuple(c.cues if c.needs_picture else c.cues.without_picture() for c in cameras)
        return CaseMessage(associations, case.dt, cues, case.likelihood.extents, detected, tuple(case.pulls))

    def case(self, model: CostModel) -> FrameProblem:
        """The case, for the same body and cost."""
        terms = [(name, model.observation_term(o), penalty) for name, o, penalty in self.associations]
        seen = ImageLikelihood()
        if self.cues:
            seen = ImageLikelihood.of(model.image, self.cues, self.extents, self.detected)
        return FrameProblem(tuple(Association(*each) for each in terms), self.dt, seen, self.pulls)
