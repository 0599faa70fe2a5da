"""Edges as a cue: read from each picture, matched along the normals of the body's contours (CSS eq. 8)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from estimator.numerics.robust import LECLERC
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.assigned import Assignments, nothing
from estimator.vision.cues.base import CameraView, ContourMatch, Cue, ExplainedPose, Matcher
from estimator.vision.cues.cue_picture import CONTOUR_LEGEND, CuePicture, contour_dots, links
from estimator.vision.cues.edges.edge_map import EdgeMap, EdgeSettings, edge_map
from estimator.vision.cues.edges.matching import edge_assignments
from estimator.vision.prediction import Prediction
from humanoid.support.settings import setting


@dataclass(frozen=True)
class EdgeCueSettings(EdgeSettings):
    """Settings of edges: their detection, and their part in the energy.

    evidence: independent measurements that all contour points together count as, 0 for none. noise: standard deviation,
        as a fraction of the subject's extent. window: how far along the normal edges are looked for, in extents.
        candidates: how many are kept (CSS eq. 8). nu: Leclerc spread.
    motion_boundary: k of W = 1 - k S_p, 0.2 to 0.4 in CSS; where there is flow.
    """

    evidence: float = setting(40.0, at_least=0)
    noise: float = setting(0.02, above=0)
    window: float = setting(0.12, above=0)
    candidates: int = setting(4, at_least=1)
    nu: float = setting(6.0, above=0)
    motion_boundary: float = setting(0.3, at_least=0, at_most=1)


_NONE = np.zeros((0, 0), dtype=np.float32)


class Edges(Cue):
    """Edges along the body's contours."""

    name = "edges"
    summary = "image edges along the contours of the body (CSS section 3.1.2)"
    settings = EdgeCueSettings()
    on_contours = True

    def read(self, pictures: CameraPictures, instant: int, settings: EdgeSettings, prepared: Any) -> EdgeMap:
        """See `Cue.read`."""
        return edge_map(pictures.picture(instant), settings)

    def match(self, view: CameraView) -> Matcher:
        """See `Cue.match`."""
        return EdgeMatcher(view)


class EdgeMatcher(Matcher):
    """Edges of one image. Motion boundaries of the flow and the silhouette's outline, where there are any, select those
    that can be the body's."""

    def __init__(self, view: CameraView) -> None:
        super().__init__(view)
        self._settings: EdgeCueSettings = view.settings
        self._edges: EdgeMap = view.cues[Edges.name]

    def contours(self, prediction: Prediction) -> list[ContourMatch]:
        """Edges along the contours' normals (CSS eq. 8), and the energy of contour points without any."""
        s, view, edges, contours = self._settings, self.view, self._edges, prediction.contours
        if s.evidence <= 0.0:
            return []
        count = len(contours.state)
        if not count:
            return [_match()]
        sigma = view.sigma(s.noise)
        each = view.weight * s.evidence / count
        *group, share = edge_assignments(
            contours.pixels, contours.normals, contours.state, edges.strength, edges.direction, self._boundary,
            self._distance, max(2.0, s.window * view.extent), 2.0 * sigma, s.candidates, 2.0 * sigma,
            s.motion_boundary, each, 1.0 / sigma**2, LECLERC, float(s.nu),
        )  # fmt: skip
        missing, hidden = len(share) - share.sum(), count - len(share)
        return [
            _match(
                Assignments(*group),
                each * (0.5 * s.nu * missing + view.shared.occluded * view.shared.back_facing * hidden),
            )
        ]

    @cached_property
    def _boundary(self) -> np.ndarray:
        """The potential S_p (H, W) of motion boundaries, empty where no flow is known."""
        flow = self.view.cues.get("flow")
        return _NONE if flow is None else flow.whole_boundary()

    @cached_property
    def _distance(self) -> np.ndarray:
        """Distance (H, W) [px] to the silhouette's outline, empty where none is known."""
        silhouette = self.view.cues.get("silhouette")
        return _NONE if silhouette is None else np.where(silhouette.known, silhouette.distance, np.float32(0.0))

    def pictures(self, shown: ExplainedPose) -> Iterator[CuePicture]:
        """See `Matcher.pictures`."""
        groups = [match.features for match in self.contours(shown.assigned)]
        terms = [self.view.on_contours(shown.assigned, g) for g in groups if len(g.point)]
        yield CuePicture(
            "edges",
            "edges and the body's contours",
            (160.0 * self._edges.strength).astype(np.uint8),
            [*(links(term, shown.posed, "hypothesis") for term in terms), *contour_dots(shown.prediction.contours)],
            [*CONTOUR_LEGEND, ("to the edges that may be theirs", "hypothesis")],
        )


def _match(group: Any = None, unassigned: float = 0.0) -> ContourMatch:
    return ContourMatch(
        "edges", nothing() if group is None else group, unassigned, "contour without an edge, or hidden"
    )
