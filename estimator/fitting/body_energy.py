"""The energy of a few frames as a function of everything: poses, proportions and shape (CSS section 5)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation, image_extent
from estimator.fitting.shaped_body import ShapedBody, Unknowns
from estimator.search.cost_model import CostModel
from estimator.search.cost_settings import CostSettings
from estimator.vision.cues.assigned import Assignments, nothing
from estimator.vision.cues.assigned_loads import assigned_loads
from estimator.vision.likelihood.image_likelihood import CameraLikelihood, ImageLikelihood, ImageModel
from estimator.vision.likelihood.settings import CueSettings
from estimator.vision.prediction import Contours
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body, PosedBody


class Expansion(NamedTuple):
    """Value of an energy, its gradient (n,) and Gauss-Newton Hessian (n, n) by `Unknowns.flat`."""

    value: float
    gradient: np.ndarray
    hessian: np.ndarray


class Gaussian(NamedTuple):
    """A Gaussian prior: mean (n,), precision (n, n)."""

    mean: np.ndarray
    precision: np.ndarray


class BodyEnergy:
    """Energy of frames with the pictures' features as they are assigned at some unknowns, and stay.

    Keypoints, priors of poses, proportions and shape, parts kept apart, edges and outlines. A contour point moves as
    the nodes that it lies between do (CSS section 5, second and third stage).

    features: how many contour points have any.

    Parameters
    ----------
    observations (F): with cues. assigned_at: where contours are predicted and features assigned to them.
    on_scales: prior of the proportions' scales. share: what each frame counts.
    self_collision: keeps parts apart, with solids that do not follow the shape; None lets them be.
    """

    def __init__(
        self,
        shaped: ShapedBody,
        observations: Sequence[Observation],
        assigned_at: Unknowns,
        cost: CostSettings,
        cues: CueSettings,
        on_scales: Gaussian,
        share: float = 1.0,
        self_collision: SelfCollision | None = None,
    ) -> None:
        self._shaped, self._observations, self._cost = shaped, observations, cost
        self._on_scales, self._share, self._self_collision = on_scales, share, self_collision
        self._contours = [
            [_assigned(camera, posed) for camera in likelihood.cameras]
            for posed, likelihood in seen_at(shaped, observations, assigned_at, cues)
        ]
        self.features = sum(len(points.joint) for frame in self._contours for points in frame)

    def at(self, x: Unknowns) -> Expansion:
        """Value, gradient and Gauss-Newton Hessian at some unknowns."""
        shaped, nv, (_, scales, shape) = self._shaped, self._shaped.proportions.base.nv, x
        value, gradient, hessian = self._priors(x)
        of_parts = shaped.shape.of_parts(shape)
        nodes = shaped.surface.at(of_parts, scales).local
        by_shape = shaped.nodes_by_shape(shape, scales)
        body = shaped.proportions.at(scales)
        model = CostModel(body, self._cost, self._self_collision)
        for k, (observation, contours) in enumerate(zip(self._observations, self._contours, strict=True)):
            posed = body.at(x.poses[k])
            of_frame = np.r_[k * nv : (k + 1) * nv, len(x.poses) * nv : len(gradient)]
            frame = self._frame(model, posed, observation)
            by_scales = shaped.surface.proportion_derivatives(posed, of_parts, scales)
            for points in contours:
                turned = np.einsum("nij,njs->nis", posed.rotations[points.joint], points.between(by_shape))
                own = np.concatenate([points.between(by_scales), turned], axis=2)
                frame = _plus(frame, _gathered(body, posed, points.joint, points.loads(posed, nodes), own))
            value += self._share * frame.value
            gradient[of_frame] += self._share * frame.gradient
            hessian[np.ix_(of_frame, of_frame)] += self._share * frame.hessian
        return Expansion(value, gradient, hessian)

    def _priors(self, x: Unknowns) -> Expansion:
        """Of proportions and shape; those of the poses are the frames' own."""
        of_scales, of_shape = self._shaped.places(len(x.poses))
        gradient, hessian = np.zeros(of_shape.stop), np.zeros((of_shape.stop, of_shape.stop))
        value, flesh = 0.0, Gaussian(np.zeros(len(x.shape)), self._shaped.shape.precision)
        for place, at, prior in ((of_scales, x.scales, self._on_scales), (of_shape, x.shape, flesh)):
            gradient[place], hessian[place, place] = prior.precision @ (at - prior.mean), prior.precision
            value += 0.5 * float((at - prior.mean) @ gradient[place])
        return Expansion(value, gradient, hessian)

    def _frame(self, model: CostModel, posed: PosedBody, observation: Observation) -> Expansion:
        """Keypoints and priors of one frame, by its pose, the scales and the shape."""
        body, shaped = model.body, self._shaped
        term = model.observation_term(observation)
        own = model.cost(term).of(posed)
        by_scales = shaped.proportions.landmark_derivatives(posed)
        by_scales = np.concatenate([by_scales, np.zeros((*by_scales.shape[:2], len(shaped.shape.low)))], axis=2)
        loads = PointLoads(0.0, body.keypoints(posed), *term.point_loads(posed))
        frame = _gathered(body, posed, body.landmark_joint, loads, by_scales)
        nv = body.nv
        frame.gradient[:nv], frame.hessian[:nv, :nv] = own.gradient, own.hessian  # the priors' among them
        return frame._replace(value=own.value)


def seen_at(
    shaped: ShapedBody, observations: Sequence[Observation], x: Unknowns, cues: CueSettings
) -> Iterator[tuple[PosedBody, ImageLikelihood]]:
    """The body in every frame at some unknowns, and what the frame's pictures say of it."""
    body = shaped.proportions.at(x.scales)
    image = ImageModel(body, cues, shaped.surface.at(shaped.shape.of_parts(x.shape), x.scales))
    for observation, q in zip(observations, x.poses, strict=True):
        posed = body.at(q)
        landmarks = body.landmarks(posed)
        seen = [c.camera.project(landmarks) for c in observation.cues]
        extents = [image_extent(pixels, np.isfinite(pixels).all(axis=1).astype(float)) for pixels in seen]
        yield posed, ImageLikelihood.of(image, observation.cues, extents)


def _assigned(camera: CameraLikelihood, posed: PosedBody) -> ContourPoints:
    prediction = camera.predictor.predict(posed)
    groups = [match.features for match in camera.contours(prediction)] or [nothing()]
    return ContourPoints(camera.cues.camera, prediction.contours, camera.model.surface.local, groups)


def _gathered(body: Body, posed: PosedBody, joint: np.ndarray, loads: PointLoads, own: np.ndarray) -> Expansion:
    """Loads of points on joints (N,), by the pose and by what else moves them in the world, own (N, 3, K)."""
    linear, angular = posed.spatial_jacobian[:, :3], posed.spatial_jacobian[:, 3:]
    by_column = (linear + np.cross(angular, loads.points[:, None])) * body.column_support[joint][..., None]
    J = np.concatenate([body.collected(by_column.transpose(0, 2, 1)), own], axis=2).reshape(-1, body.nv + own.shape[2])
    weighted = (loads.load @ J.reshape(len(joint), 3, -1)).reshape(J.shape)
    return Expansion(loads.value, J.T @ loads.force.ravel(), J.T @ weighted)


def _plus(a: Expansion, b: Expansion) -> Expansion:
    return Expansion(a.value + b.value, a.gradient + b.gradient, a.hessian + b.hessian)


class PointLoads(NamedTuple):
    """Energy of some points, and its gradient and Gauss-Newton Hessian by each point's place.

    value. points (N, 3): in the world [m]. force (N, 3) [1/m]. load (N, 3, 3) [1/m^2].
    """

    value: float
    points: np.ndarray
    force: np.ndarray
    load: np.ndarray


class ContourPoints:
    """Points of one camera's contours, each between two nodes of the surface, and the features assigned to them.

    A point keeps its share of the way between its nodes and its rise over their chord, so that it moves as they do.

    joint (N,) int, nodes (N, 2) int, share (N,): see `estimator.vision.prediction.Contours`.

    Parameters
    ----------
    node_places (., 3): all nodes in the frames of their joints [m], as they were when the contours were predicted.
    groups: features assigned to the contours' points.
    """

    def __init__(
        self, camera: Camera, contours: Contours, node_places: np.ndarray, groups: Sequence[Assignments]
    ) -> None:
        point, *features = (np.concatenate(columns) for columns in zip(*groups, strict=True))
        used, inverse = np.unique(point, return_inverse=True)
        order = np.argsort(inverse, kind="stable")
        self._first = np.searchsorted(inverse[order], np.arange(len(used) + 1))
        self._features = tuple(np.ascontiguousarray(feature[order]) for feature in features)
        self._view = camera.arrays
        self.joint, self.nodes, self.share = contours.joint[used], contours.nodes[used], contours.share[used]
        self._rise = contours.local[used] - self.between(node_places)

    def between(self, of_nodes: np.ndarray) -> np.ndarray:
        """Something of all nodes (., ...) at the points, (N, ...)."""
        share = self.share.reshape(-1, *([1] * (of_nodes.ndim - 1)))
        return np.asarray((1.0 - share) * of_nodes[self.nodes[:, 0]] + share * of_nodes[self.nodes[:, 1]])

    def loads(self, posed: PosedBody, node_places: np.ndarray) -> PointLoads:
        """Energy of the assigned features with the nodes at `node_places` (., 3) in the frames of their joints [m]."""
        local = np.ascontiguousarray(self.between(node_places) + self._rise)
        target, precision, weight, potential, nu = self._features
        intrinsics, distortion, R, t = self._view
        points, force, load = (np.empty((len(local), *size)) for size in ((3,), (3,), (3, 3)))
        value = assigned_loads(
            posed.placements, self.joint, local, intrinsics, distortion, R, t, self._first, target,
            precision, weight, potential, nu, False, points, force, load,
        )  # fmt: skip
        return PointLoads(float(value), points, force, load)
