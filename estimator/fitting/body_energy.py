"""The energy of a few frames as a function of everything: poses, proportions and shape (CSS section 5); its descent
and the covariance at its minimum (section 4.1).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation, image_extent
from estimator.energy.descent.box_step import solve_box
from estimator.energy.descent.seek import trust_box
from estimator.energy.descent.solution import free_directions
from estimator.fitting.settings import DescentSettings
from estimator.fitting.shape_parameters import ShapeParameters
from estimator.numerics.newton import Damping, NewtonSettings, Problem, Step, minimise
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from estimator.vision.cues.assigned import Assignments, nothing
from estimator.vision.cues.assigned_loads import assigned_loads
from estimator.vision.cues.image_likelihood import CameraLikelihood, ImageLikelihood, ImageModel
from estimator.vision.cues.settings import CueSettings
from estimator.vision.prediction import Contours
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body, PosedBody
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.shape.surface_shape import SurfaceShape
from humanoid.subject.subject import Subject


class Unknowns(NamedTuple):
    """The unknowns of the fit: poses (F, nq), scales (P,) of the proportions, shape (S,), see `ShapeParameters`."""

    poses: np.ndarray
    scales: np.ndarray
    shape: np.ndarray


class ShapedBody:
    """A subject with its proportions, its shape parameters and its surface of about `nodes` nodes.

    subject: the given one, at scales of 1 and shape parameters of 0.
    """

    def __init__(self, subject: Subject, nodes: int) -> None:
        self.subject = subject
        self.proportions = ProportionedBody(subject)
        self.shape = ShapeParameters(subject)
        self.surface = SurfaceShape(self.proportions, nodes)

    def at(self, x: Unknowns) -> Subject:
        """The subject of some unknowns."""
        return self.shape.subject(self.subject, x.shape).scaled(self.proportions.scales(x.scales))

    def nodes_by_shape(self, shape: np.ndarray, scales: np.ndarray) -> np.ndarray:
        """Derivatives of the nodes in the frames of their joints [m] by the shape parameters, (N, 3, S)."""
        by_parts = self.surface.shape_derivatives(self.shape.of_parts(shape), scales)
        return by_parts @ self.shape.derivatives(shape)[self.surface.surface.part]

    # tangent steps: poses one after the other, then scales, then shape

    def places(self, frames: int) -> tuple[slice, slice]:
        """The positions of scales and shape in a step (F nv + P + S,); poses come first, one after the other."""
        first = frames * self.proportions.base.nv
        middle = first + len(self.proportions.names)
        return slice(first, middle), slice(middle, middle + len(self.shape.low))

    def moved(self, x: Unknowns, step: np.ndarray) -> Unknowns:
        """Unknowns after a step (F nv + P + S,), within joint limits and hard ranges."""
        body, (of_scales, of_shape) = self.proportions.base, self.places(len(x.poses))
        turns = step[: of_scales.start].reshape(len(x.poses), -1)
        poses = [body.clamp(body.integrate(q, turn)) for q, turn in zip(x.poses, turns, strict=True)]
        scales = np.clip(x.scales + step[of_scales], self.proportions.low, self.proportions.high)
        return Unknowns(np.array(poses), scales, np.clip(x.shape + step[of_shape], self.shape.low, self.shape.high))

    def bounds(self, x: Unknowns, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of a step: joint limits, hard ranges, and for poses a trust box of `radius` (nv,)."""
        body = self.proportions.base
        low, high = np.tile(-radius, (len(x.poses), 1)), np.tile(radius, (len(x.poses), 1))
        q = x.poses[:, body.bounded_q]
        low[:, body.bounded_v] = np.maximum(low[:, body.bounded_v], body.lower[body.bounded_q] - q)
        high[:, body.bounded_v] = np.minimum(high[:, body.bounded_v], body.upper[body.bounded_q] - q)
        own = ((self.proportions, x.scales), (self.shape, x.shape))
        lows = [low.ravel(), *(limits.low - values for limits, values in own)]
        highs = [high.ravel(), *(limits.high - values for limits, values in own)]
        return np.concatenate(lows), np.concatenate(highs)


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
        """Priors of proportions and shape; those of the poses belong to the frames."""
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
    """The body in every frame at some unknowns, and its evidence in the frame's pictures."""
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


_ROUNDS = 30  # of the active set iteration; bounds and frames are few
_DAMPING = Damping(least=1e-6)
_UNSEEN = 1e-9  # curvature of directions that nothing is known of, relative to none


def descend(
    shaped: ShapedBody, energy: BodyEnergy, x: Unknowns, free: slice, settings: DescentSettings
) -> tuple[Unknowns, float]:
    """Damped Gauss-Newton within joint limits and hard ranges: where it ends, and the energy there, which never rises.

    free: the part of a step (`ShapedBody.places`) that may move; the rest is held.
    """
    radius = trust_box(shaped.proportions.base, settings.max_turn, settings.max_slide)
    newton = NewtonSettings(settings.iterations, _DAMPING, enough=settings.enough)
    end = minimise(_Descent(shaped, energy, free, radius), _Point(x, energy.at(x)), newton).model
    return end.x, end.value


class _Point(NamedTuple):
    """Evaluated unknowns, and the energy's model there."""

    x: Unknowns
    model: Expansion

    @property
    def value(self) -> float:
        return self.model.value


class _Descent(Problem[_Point]):
    """An energy of which a part of the unknowns moves; radius (nv,): half-width of the poses' trust box."""

    def __init__(self, shaped: ShapedBody, energy: BodyEnergy, free: slice, radius: np.ndarray) -> None:
        self._shaped, self._energy, self._free, self._radius = shaped, energy, free, radius

    def step(self, model: _Point, damping: float) -> Step | None:
        free, expansion = self._free, model.model
        low, high = self._shaped.bounds(model.x, self._radius)
        hessian, gradient = expansion.hessian[free, free], expansion.gradient[free]
        part = bounded_step(hessian, gradient, low[free], high[free], damping, _UNSEEN)
        if part is None:
            return None
        move = np.zeros(len(expansion.gradient))
        move[free] = part
        return move, None

    def at(self, model: _Point, step: Step) -> _Point:
        x = self._shaped.moved(model.x, step[0])
        return _Point(x, self._energy.at(x))


def bounded_step(
    hessian: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray, damping: float, unseen: float = 0.0
) -> np.ndarray | None:
    """The step (n,) between bounds (n,) that minimises a damped model; None where none is certified.

    hessian (n, n), gradient (n,). unseen: curvature added to all directions.
    """
    M = hessian + np.diag(damping * np.diag(hessian) + unseen)
    step, active = np.zeros(len(gradient)), np.zeros(len(gradient), dtype=np.int8)
    return step if solve_box(M, gradient, low, high, active, _ROUNDS, step) > 0 else None


def covariance_at(shaped: ShapedBody, model: Expansion, x: Unknowns) -> np.ndarray:
    """Covariance (n, n) of all unknowns together: inverse Hessian where no joint limit holds a pose, zero elsewhere.

    A block of it is the covariance of what it belongs to with all the rest as uncertain as it is.
    """
    body = shaped.proportions.base
    starts = np.arange(len(x.poses)) * body.nv
    free = [
        start + free_directions(body, q, model.gradient[start : start + body.nv])
        for start, q in zip(starts, x.poses, strict=True)
    ]
    index = np.concatenate([*free, np.arange(len(x.poses) * body.nv, len(model.gradient))])
    covariance = np.zeros_like(model.hessian)
    covariance[np.ix_(index, index)] = np.linalg.inv(model.hessian[np.ix_(index, index)] + _UNSEEN * np.eye(len(index)))
    return 0.5 * (covariance + covariance.T)
