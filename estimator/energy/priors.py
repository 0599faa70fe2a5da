"""Priors on the configuration: stabilisers, the transition from the previous frame, and which way is up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from functools import cached_property

import numpy as np
import pinocchio as pin

from estimator.data.cameras.camera import Camera
from estimator.energy.kernels.priors import (
    STABILISER_NU,
    diffuse,
    record_since,
    stabiliser_record,
    stabiliser_values,
    tilt_record,
    tilt_values,
    transition_joints,
    transition_record,
    transition_values,
)
from estimator.energy.kernels.records import STABILISERS, TILT, TRANSITION, Record
from estimator.energy.recorded import RecordedTerm
from estimator.numerics.robust import POTENTIALS, robust_sum
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody
from humanoid.support.errors import InputError
from humanoid.support.per_object import per_object

COUNTED_BEFORE = "rest positions, counted before"


class Stabilisers(RecordedTerm):
    """Long-tailed pull of every joint towards its rest position (CSS section 3.2.2), with a scale on either side of it,
    times `weight`, and for some joints times a further factor, `relative` by their names."""

    name, kind, lasting = "stabilisers", STABILISERS, True

    def __init__(
        self,
        body: Body,
        weight: float = 1.0,
        potential: str = "lorentzian",
        nu: float = STABILISER_NU,
        *,
        relative: Mapping[str, float] | None = None,
    ) -> None:
        self._body = body
        model = body.model
        joints = []
        for stabiliser in body.subject.stabilisers:
            if not model.existJointName(stabiliser.joint):
                raise InputError(body.subject.source, f"no movable joint {stabiliser.joint!r}", place="<stabiliser>")
            joints.append(model.getJointId(stabiliser.joint))
        self._q_index = np.array([model.idx_qs[j] for j in joints], dtype=np.int64)
        self._v_index = np.array([model.idx_vs[j] for j in joints], dtype=np.int64)
        self._rest = np.array([s.rest for s in body.subject.stabilisers])
        self._precision = np.array([(s.std**-2, s.std_above**-2) for s in body.subject.stabilisers]).reshape(-1, 2)
        factors = {} if relative is None else relative
        self._weight = weight * np.array([factors.get(s.joint, 1.0) for s in body.subject.stabilisers])
        self._kind, self._nu = POTENTIALS[potential], float(nu)

    def counted_before(self, std: np.ndarray, returned: float) -> Stabilisers:
        """The part, as an energy below zero, that the past of a pose counts already: all but what draws a joint back by
        a share `returned` of its distance from rest, where the change since the past, of standard deviation std (nv,),
        is all that holds it.

        A joint of variance S at rest that is drawn back with a weight w, beside a step of variance s, moves by w s / S
        of its distance: w = returned S / s, no more than 1.
        """
        variance = np.square([s.moments[1] for s in self._body.subject.stabilisers])
        new = np.minimum(1.0, returned * variance / np.square(std[self._v_index]))
        made = copy(self)
        made.__dict__.pop("record", None)  # that of these weights, if it was asked for already
        made.name, made._weight = COUNTED_BEFORE, self._weight * (new - 1.0)
        return made

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        pulled = self._weight != 0.0
        q_index, v_index, rest = self._q_index[pulled], self._v_index[pulled], self._rest[pulled]
        precision, weight = self._precision[pulled], self._weight[pulled]
        return stabiliser_record(q_index, v_index, rest, precision, weight, self._kind, self._nu)

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        stabiliser_values(
            placed.q, self._q_index, self._rest, self._precision, self._weight, self._kind, self._nu, values
        )
        return values


@per_object
def _joints(body: Body) -> np.ndarray:
    assert body.compiled is not None
    return transition_joints(body.compiled.indices)


class Transition(RecordedTerm):
    """Diffusion from a previous configuration, 1/2 sum rho((q (-) q_previous)_i^2 / std_i^2) in its tangent space.

    q_previous (nq,): centre. std (nv,): scale of the change [m, rad]. The Gaussian potential is a random walk; a
    long-tailed one lets a mode jump with a penalty that grows with the logarithm of the distance, which is what lets a
    search recover from a wrong interpretation (CSS section 1.1). The exact Hessian leaves out the curvature of (-) in
    joints of several degrees of freedom: with it searches take as many steps.
    """

    name, kind = "transition", TRANSITION

    def __init__(
        self, body: Body, q_previous: np.ndarray, std: np.ndarray, potential: str = "gaussian", nu: float = 8.0
    ) -> None:
        self._body, self._q_previous = body, q_previous
        self._precision = 1.0 / np.square(std)
        self._kind, self._nu = POTENTIALS[potential], float(nu)
        self.recorded = body.compiled is not None

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        return transition_record(_joints(self._body), self._q_previous, self._precision, self._kind, self._nu)

    def since(self, q_previous: np.ndarray) -> Transition:
        """The same from another configuration (nq,)."""
        moved = copy(self)
        moved._q_previous = q_previous
        if self.recorded:
            moved.record = record_since(self.record, q_previous)
        return moved

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        if self.recorded:
            return super().accumulate(posed, gradient, hessian, exact)
        model, (pull, bend) = self._body.model, np.empty((2, self._body.nv))
        # only joints of several degrees of freedom have a difference whose derivative is not the identity
        several = [j for j in range(1, model.njoints) if model.nvs[j] > 1]
        blocks = [(model.idx_vs[j], model.idx_vs[j] + model.nvs[j]) for j in several]
        slope = pin.dDifference(model, self._q_previous, posed.q, pin.ARG1) if blocks else np.zeros((0, 0))
        ranges = np.array(blocks, dtype=np.int64).reshape(-1, 2)
        change = self._body.difference(self._q_previous, posed.q)
        value: float = diffuse(
            change, self._precision, self._kind, self._nu, exact, ranges, slope, pull, bend, gradient, hessian
        )  # fmt: skip
        return value

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        if self.recorded:
            transition_values(*self.record[1:], placed.q, values)
            return values
        for n, q in enumerate(placed.q):
            change = self._body.difference(self._q_previous, q)
            values[n] = robust_sum(change, self._precision, self._kind, self._nu)
        return values


_LEVEL = 1e-12  # of a cosine


class GravityPrior(RecordedTerm):
    """1/2 rho(|u - up|^2 / std^2), u being the root's own up axis in the world.

    A stabiliser (CSS 3.2.2) of the root's tilt; its heading stays free. |u - up| is the tilt [rad] to second order.

    Parameters
    ----------
    body: with a free root and an up axis (`Subject.upright`).
    up (3,): unit vector in the world.
    weight, potential, nu: see `estimator.numerics.robust`.
    """

    name, kind, lasting = "upright", TILT, True

    def __init__(
        self, body: Body, up: np.ndarray, weight: float = 1.0, potential: str = "lorentzian", nu: float = STABILISER_NU
    ) -> None:
        assert body.subject.upright is not None
        self._body = body
        self._axis = np.array(body.subject.upright.axis)
        self._precision = 1.0 / body.subject.upright.std**2
        self._up, self._weight, self._kind, self._nu = (
            np.asarray(up, dtype=float),
            float(weight),
            POTENTIALS[potential],
            float(nu),
        )

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        return tilt_record(self._axis, self._up, self._precision, self._weight, self._kind, self._nu)

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        tilt_values(
            placed.placements, self._axis, self._up, self._precision, self._weight, self._kind, self._nu, values
        )
        return values


def world_up(cameras: Sequence[Camera]) -> np.ndarray:
    """The axis of the world, one of +-x, +-y, +-z, nearest to the cameras' mean upward direction, (3,).

    Worlds have z up, or y up, or are a camera's own with y down; cameras are held more or less level. Without cameras
    it is z: points in space are read so.
    """
    if not cameras:
        return np.array([0.0, 0.0, 1.0])
    upward = -np.sum([c.R_camera_world[1] for c in cameras], axis=0)
    axis = np.zeros(3)
    k = int(np.argmax(np.abs(upward)))
    axis[k] = 1.0 if upward[k] >= 0.0 else -1.0
    return axis


def up_is_assumed(cameras: Sequence[Camera]) -> bool:
    """Whether the world's up is no more than the picture's of its only camera: a guessed camera, or a file whose world
    is the camera itself. A calibrated one is never level to the last bit."""
    return len(cameras) == 1 and float(-cameras[0].R_camera_world[1] @ world_up(cameras)) > 1.0 - _LEVEL
