"""A subject whose proportions and flesh vary together, and the numbers that vary."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.fitting.shape_parameters import ShapeParameters
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.shape.surface_shape import SurfaceShape
from humanoid.subject.subject import Subject


class Unknowns(NamedTuple):
    """What is fitted: poses (F, nq), scales (P,) of the proportions, shape (S,), see `ShapeParameters`."""

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
        """Where scales and shape stand in a step (F nv + P + S,); poses come first, one after the other."""
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
