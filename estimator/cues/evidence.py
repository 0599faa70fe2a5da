"""From the cues of one instant to energy terms around a pose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.cues.assigned import AssignedPoints, Assignments
from estimator.cues.matching import nearest_contour, nearest_outline, search_edges, take_candidates
from estimator.cues.settings import ImageSettings
from estimator.imaging.cues import ImageCues
from estimator.imaging.foreground import Silhouette
from estimator.imaging.point_flow import follow_points
from estimator.numerics.robust import LECLERC, LORENTZIAN
from estimator.prediction.prediction import Prediction, Predictor
from estimator.prediction.visibility import HIDDEN, OUTER
from estimator.terms.term import Term
from humanoid.kinematics.body import Body, PosedBody, points_in_world
from humanoid.shape.surface import Surface, surface_of
from humanoid.support.compiled import jit

LEAST_NOISE = 0.5  # px
FLOW_NODES = 200  # more say nothing new
OUTLINE_SAMPLES = 200
AGREES = 4.0  # standard deviations within which a contour point lies on the outline
NEAR_EDGE = 2  # px between an outline and the edge that bears it out
SURE_EDGE, LEAST_TRUST = 0.3, 0.1  # strength that proves an outline; trust where there is no edge at all
_NONE = np.zeros((0, 0), dtype=np.float32)


class Past(NamedTuple):
    """How the body lay in the frame before, and where its velocity has taken it since, if that is known."""

    parent: PosedBody
    predicted: PosedBody | None = None


class Followed(NamedTuple):
    """Nodes (N,) followed by one camera's flow: where they were, (N, 2) [px], where they are now, (N, 2) [px], and how
    sure that is, (N,), 0 to 1."""

    node: np.ndarray
    before: np.ndarray
    target: np.ndarray
    sure: np.ndarray


_LOST = Followed(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))


class ImageModel:
    """Everything about image terms that does not change from frame to frame."""

    def __init__(self, body: Body, settings: ImageSettings | None = None, surface: Surface | None = None) -> None:
        self.body = body
        self.settings = settings or ImageSettings()
        self.surface = surface or surface_of(body, nodes=self.settings.nodes)
        self._predictors: dict[tuple[object, ...], Predictor] = {}

    def predictor(self, cues: ImageCues) -> Predictor:
        """The predictor of a camera at the cues' resolution, made once."""
        c = cues.camera
        key = c.image_size, *(a.tobytes() for a in (c.K, c.distortion, c.R_camera_world, c.t_camera_world))
        if key not in self._predictors:
            self._predictors[key] = Predictor(self.surface, c, self.settings.fineness)
        return self._predictors[key]

    def evidence(self, cues: Sequence[ImageCues], extents: Sequence[float], detected: float = 0.0) -> Evidence:
        """The evidence of one instant.

        extents: the subject's extent in each camera's cues [px]. detected: how far keypoints see the person, 0 to 1.
        """
        return Evidence(tuple(CameraEvidence(self, c, e, detected) for c, e in zip(cues, extents, strict=True)))


class Evidence:
    """The evidence of one instant in every camera."""

    def __init__(self, cameras: tuple[CameraEvidence, ...]) -> None:
        self.cameras = cameras

    def assigned(self, posed: PosedBody) -> list[Term]:
        """Edges and outlines assigned to the surface as it lies at a pose, with the penalties of hidden nodes."""
        return [term for camera in self.cameras for term in camera.assigned(posed)]

    def followed(self, parent: PosedBody, predicted: PosedBody | None = None) -> list[Term]:
        """Flow of the surface since the frame before, when it lay at `parent`; it is also looked for from where it lies
        at `predicted`."""
        return self.followed_each([Past(parent, predicted)])[0]

    def followed_each(self, pasts: Sequence[Past]) -> list[list[Term]]:
        """`followed` for many pasts: the picture is searched once for the points of all of them."""
        return [self.flow_terms(found) for found in self.follow(pasts)]

    def follow(self, pasts: Sequence[Past]) -> list[list[Followed]]:
        """What the flow of each camera says of each past; `flow_terms` makes terms of it."""
        by_camera = [camera.follow(pasts) for camera in self.cameras]
        return [list(of_past) for of_past in zip(*by_camera, strict=True)]

    def flow_terms(self, followed: Sequence[Followed]) -> list[Term]:
        """The terms of one past, from what the cameras say of it."""
        return [term for camera, found in zip(self.cameras, followed, strict=True) for term in camera.flow_terms(found)]

    def agreement(self, posed: PosedBody) -> list[float]:
        """For every camera with a foreground the share of the model's outline that lies on the foreground's."""
        return [share for camera in self.cameras for share in camera.agreement(posed)]


class CameraEvidence:
    """The evidence of one instant in one camera."""

    def __init__(self, model: ImageModel, cues: ImageCues, extent: float, detected: float = 0.0) -> None:
        self.model, self.cues, self.extent, self.detected = model, cues, float(extent), detected
        self.predictor = model.predictor(cues)
        self._trust = _outline_trust(cues)
        s = model.settings
        self._weight = 1.0 - detected * (1.0 - s.beside_keypoints)
        silhouette = cues.silhouette
        self._distance = (
            _NONE if silhouette is None else np.where(silhouette.known, silhouette.distance, np.float32(0.0))
        )

    def assigned(self, posed: PosedBody) -> list[AssignedPoints]:
        """See `Evidence.assigned`."""
        prediction = self.predictor.predict(posed)
        contours = prediction.contours
        groups, constant = [], self.penalty(prediction)
        for group, unassigned in (self.edges(prediction), self.outline(prediction), self.outline_back(prediction)):
            groups.append(group)
            constant += unassigned
        return [AssignedPoints(self.model.body, self.cues.camera, contours.joint, contours.local, groups, constant)]

    def followed_each(self, pasts: Sequence[Past]) -> list[list[AssignedPoints]]:
        """See `Evidence.followed_each`."""
        return [self.flow_terms(found) for found in self.follow(pasts)]

    def follow(self, pasts: Sequence[Past]) -> list[Followed]:
        """See `Evidence.follow`; no nodes where there is no flow to follow."""
        flow = self.cues.flow
        if flow is None or not pasts or self.model.settings.flow_evidence <= 0.0:
            return [_LOST for _ in pasts]
        seen = [self._seen(past) for past in pasts]
        pixels, guess = (np.concatenate([part[k] for part in seen]) for k in (1, 2))
        target, sure = follow_points(flow, pixels, guess)
        found, first = [], 0
        for node, before, _ in seen:
            own = slice(first, first + len(node))
            found.append(Followed(node, before, target[own], sure[own]))
            first = own.stop
        return found

    def _seen(self, past: Past) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Nodes (N,) seen in the frame before, where they were, (N, 2), and where they are expected, (N, 2), or NaN."""
        surface, prediction = self.model.surface, self.predictor.predict(past.parent)
        usable = prediction.visible
        usable &= np.cumsum(usable) % max(1, np.count_nonzero(usable) // FLOW_NODES) == 0
        point = np.flatnonzero(usable)
        guess = np.full((len(point), 2), np.nan)
        if past.predicted is not None:
            world = points_in_world(past.predicted, surface.joint[point], surface.local[point])
            guess = self.cues.camera.project(world)
        return point, prediction.pixels[point], guess

    def flow_terms(self, followed: Followed) -> list[AssignedPoints]:
        """See `Evidence.flow_terms`."""
        s, surface = self.model.settings, self.model.surface
        point, before, target, sure = followed
        if not len(point):
            return []
        length = np.linalg.norm(target - before, axis=1)
        precision = 1.0 / np.square(s.flow_noise + s.flow_share * length)
        weight = self._weight * s.flow_evidence / len(point) * sure
        group = _group(point, target, _isotropic(precision), weight, LORENTZIAN, s.flow_nu)
        return [AssignedPoints(self.model.body, self.cues.camera, surface.joint, surface.local, [group], name="flow")]

    def edges(self, prediction: Prediction) -> tuple[Assignments, float]:
        """Edges along the contours' normals (CSS eq. 8), and the energy of contour points without any."""
        s, edges, contours = self.model.settings, self.cues.edges, prediction.contours
        count = len(contours.state)
        if edges is None or s.edge_evidence <= 0.0 or not count:
            return _nothing(), 0.0
        size = (count, s.edge_candidates)
        target, share, trust = np.empty((*size, 2)), np.zeros(size), np.empty(size)
        search_edges(
            contours.pixels, contours.normals, contours.state, edges.strength, edges.direction,
            _NONE if self.cues.flow is None else self.cues.flow.boundary,
            self._distance,
            max(2.0, s.edge_window * self.extent), 2.0 * self._sigma(s.edge_noise), s.edge_candidates,
            2.0 * self._sigma(s.edge_noise), s.motion_boundary, target, share, trust,
        )  # fmt: skip
        each, most = self._weight * s.edge_evidence / count, share.size
        point, place, shares = np.empty(most, dtype=np.int64), np.empty((most, 2)), np.empty(most)
        weights = np.empty((most, 3))
        taken = take_candidates(
            target, share, trust, contours.normals, each, 1.0 / self._sigma(s.edge_noise) ** 2, point, place, weights,
            shares,
        )  # fmt: skip
        group = _group(point[:taken], place[:taken], weights[:taken], shares[:taken], LECLERC, s.edge_nu)
        seen = contours.state != HIDDEN
        missing = np.count_nonzero(seen) - share[seen].sum()
        hidden = count - np.count_nonzero(seen)
        return group, each * (0.5 * s.edge_nu * missing + s.occluded * s.back_facing * hidden)

    def outline(self, prediction: Prediction) -> tuple[Assignments, float]:
        """From the model's contour to the foreground's outline."""
        silhouette, contours = self._outlined(), prediction.contours
        if silhouette is None or not len(contours.state):
            return _nothing(), 0.0
        chosen = np.empty(len(contours.state), dtype=np.int64)
        nearest_outline(contours.pixels, contours.state, silhouette.nearest, chosen)
        point = np.flatnonzero(chosen >= 0)
        place = chosen[point]
        each = self._outline_share(len(contours.state))
        return self._to_outline(point, silhouette, place, each, LECLERC), 0.0

    def outline_back(self, prediction: Prediction) -> tuple[Assignments, float]:
        """From the foreground's outline to the model's contour, and the energy of what no contour answers to."""
        s, silhouette, contours = self.model.settings, self._outlined(), prediction.contours
        if silhouette is None or not len(contours.state):
            return _nothing(), 0.0
        place = np.arange(0, len(silhouette.boundary), max(1, len(silhouette.boundary) // OUTLINE_SAMPLES))
        samples, normals = silhouette.boundary[place], silhouette.normal[place]
        chosen = np.empty(len(samples), dtype=np.int64)
        nearest_contour(samples, normals, contours.pixels, contours.normals, contours.state, 0.2 * self.extent, chosen)
        known = np.flatnonzero(chosen >= 0)
        each = self._outline_share(len(samples))
        group = self._to_outline(chosen[known], silhouette, place[known], each, LORENTZIAN)
        lost = self._trust[place][chosen < 0].sum()  # all, where no contour of the model is in the picture
        far = s.outline_nu * np.log1p((self.extent / self._sigma(s.outline_noise)) ** 2 / s.outline_nu)
        return group, each * 0.5 * far * float(lost)

    def _outlined(self) -> Silhouette | None:
        """The foreground, where it has an outline that counts."""
        silhouette = self.cues.silhouette
        counts = silhouette is not None and self.model.settings.outline_evidence > 0.0 and len(silhouette.boundary)
        return silhouette if counts else None

    def _outline_share(self, count: int) -> float:
        """Weight of one of `count` assignments of one direction."""
        return 0.5 * self._weight * self.model.settings.outline_evidence / count

    def _to_outline(
        self, point: np.ndarray, silhouette: Silhouette, place: np.ndarray, each: float, potential: int
    ) -> Assignments:
        """Assignments of boundary pixels `place` (A,) to contour points `point` (A,), measured across the outline."""
        s = self.model.settings
        precision = np.full(len(point), 1.0 / self._sigma(s.outline_noise) ** 2)
        across = _across(silhouette.normal[place], precision)
        return _group(point, silhouette.boundary[place], across, each * self._trust[place], potential, s.outline_nu)

    def agreement(self, posed: PosedBody) -> list[float]:
        """See `Evidence.agreement`; empty without a foreground."""
        silhouette, contours = self.cues.silhouette, self.predictor.predict(posed).contours
        outer = contours.state == OUTER
        if silhouette is None or not len(silhouette.boundary) or not outer.any():
            return []
        x, y = np.round(contours.pixels[outer]).astype(int).T
        distance = np.abs(
            silhouette.distance[y.clip(0, len(silhouette.mask) - 1), x.clip(0, silhouette.mask.shape[1] - 1)]
        )
        return [float(np.mean(distance < AGREES * self._sigma(self.model.settings.outline_noise)))]

    def penalty(self, prediction: Prediction) -> float:
        """Energy of back-facing and occluded nodes (CSS eq. 7)."""
        s = self.model.settings
        hidden = prediction.back_facing + s.occluded * prediction.occluded
        return self._weight * s.visibility_evidence * s.back_facing * hidden / len(prediction.state)

    def _sigma(self, noise: float) -> float:
        return max(LEAST_NOISE, noise * self.extent)


def _group(
    point: np.ndarray, target: np.ndarray, precision: np.ndarray, weight: np.ndarray, potential: int, nu: float
) -> Assignments:
    count = len(point)
    return Assignments(point, target, precision, weight, np.full(count, potential), np.full(count, float(nu)))


def _nothing() -> Assignments:
    return _group(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0), LORENTZIAN, 1.0)


@jit
def _across(normals, precision):  # type: ignore[no-untyped-def]
    """W (A, 3) that measures along unit normals (A, 2) alone, with precision (A,)."""
    W = np.empty((normals.shape[0], 3))
    for i in range(normals.shape[0]):
        x, y = normals[i, 0], normals[i, 1]
        W[i, 0], W[i, 1], W[i, 2] = x * x * precision[i], x * y * precision[i], y * y * precision[i]
    return W


def _isotropic(precision: np.ndarray) -> np.ndarray:
    return np.stack([precision, np.zeros_like(precision), precision], axis=1)


def _outline_trust(cues: ImageCues) -> np.ndarray:
    """How far each boundary pixel of the foreground is borne out by an edge of the picture along it, (M,), 0 to 1.

    Outlines that no known background proves count nothing, and where a background model takes the place that a
    person has left for foreground, its outline lies on no edge.
    """
    if cues.silhouette is None:
        return np.zeros(0)
    if cues.edges is None or not len(cues.silhouette.boundary):
        return cues.silhouette.certain.astype(float)
    height, width = cues.edges.strength.shape
    best = np.zeros(len(cues.silhouette.boundary))
    for offset in range(-NEAR_EDGE, NEAR_EDGE + 1):
        x, y = np.round(cues.silhouette.boundary + offset * cues.silhouette.normal).astype(int).T
        x, y = x.clip(0, width - 1), y.clip(0, height - 1)
        along = np.abs(np.einsum("ni,ni->n", cues.edges.direction[y, x], cues.silhouette.normal))
        best = np.maximum(best, cues.edges.strength[y, x] * along)
    trust = LEAST_TRUST + (1.0 - LEAST_TRUST) * np.minimum(1.0, best / SURE_EDGE)
    return np.where(cues.silhouette.certain, trust, 0.0)
