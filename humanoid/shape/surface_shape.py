"""Nodes as functions of the parts' parameters x_d and the proportions x_i, with derivatives (CSS section 2, eq. 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import PosedBody
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.shape.flesh import flesh_derivatives
from humanoid.shape.surface import Surface, flesh_surface, spread_nodes
from humanoid.subject.subject import Flesh
from humanoid.subject.urdf_document import read_document
from humanoid.subject.urdf_elements import segments
from humanoid.subject.urdf_flesh import mirror_parts, stretch_matrix
from humanoid.support.errors import InputError


class SurfaceShape:
    """The surface of a subject whose parts and proportions vary, on nodes u that stay where they are in their domain.

    Everything takes the parts' parameters (B, 9), those of `Flesh.parameters`, and the proportions' scales (P,); where
    they are left out, they are the subject's own, and 1. The subject that they describe is
    `subject.reshaped(dict(enumerate(parameters))).scaled(body.scales(scales))`.

    parameters (B, 9): the subject's own. mirror (B,) int: see `mirror_parts`. surface: the subject's own.

    Raises
    ------
    InputError: the subject has no flesh.
    """

    def __init__(self, body: ProportionedBody, nodes: int = 1000) -> None:
        subject = body.base.subject
        if not subject.flesh:
            raise InputError(subject.source, "has no flesh to shape", remedy="add <flesh> to its links")
        self._body = body
        self._nodes = spread_nodes(subject.flesh, nodes)
        self.parameters = np.array([f.parameters for f in subject.flesh])
        self.mirror = mirror_parts([f.link for f in subject.flesh])
        self.surface = flesh_surface(body.base, self._nodes)
        document = read_document(subject.urdf, subject.source)
        self._segments = [segments(document, p) for p in subject.proportions]
        model = body.base.model
        frames = [model.frames[model.getFrameId(f.link, pin.FrameType.BODY)] for f in subject.flesh]
        self._R_joint_link = [np.array(frame.placement.rotation) for frame in frames]

    def at(self, parameters: np.ndarray | None = None, scales: np.ndarray | None = None) -> Surface:
        """The surface of given parameters and scales; which parts are convex is determined again."""
        scales = self._scales(scales)
        grown = []
        for flesh in self._flesh(parameters):
            state = flesh.state
            for k, A in self._stretches(flesh):
                state = state + (scales[k] - 1.0) * (A @ state)
            grown.append(flesh.with_state(state))
        surface = flesh_surface(self._body.base, self._nodes, grown)
        moved = np.einsum("p,pbk->bk", scales - 1.0, self._body.part_slope)
        return replace(surface, local=surface.local + moved[surface.part])

    def shape_derivatives(self, parameters: np.ndarray | None = None, scales: np.ndarray | None = None) -> np.ndarray:
        """Derivatives of `Surface.local` by the nine parameters of each node's own part, (N, 3, 9)."""
        scales = self._scales(scales)
        by_part = []
        for flesh, nodes, R_joint_link in zip(self._flesh(parameters), self._nodes, self._R_joint_link, strict=True):
            state, by_own = flesh.state, np.eye(12)
            for k, A in self._stretches(flesh):
                step = np.eye(12) + (scales[k] - 1.0) * A
                state, by_own = step @ state, step @ by_own
            D = flesh_derivatives(flesh.with_parameters(state[3:]), nodes.u)
            by_part.append(np.einsum("ij,njk,kl->nil", R_joint_link, D, by_own[3:, 3:]))
        return np.concatenate(by_part)

    def proportion_derivatives(
        self, posed: PosedBody, parameters: np.ndarray | None = None, scales: np.ndarray | None = None
    ) -> np.ndarray:
        """Derivatives of the nodes in the world [m] by the scales, (N, 3, P), of `ProportionedBody.at(scales)`."""
        scales = self._scales(scales)
        slope = self._body.part_slope[:, self.surface.part].copy()
        first = 0
        for flesh, nodes, R_joint_link in zip(self._flesh(parameters), self._nodes, self._R_joint_link, strict=True):
            own = slice(first, first + len(nodes.u))
            first = own.stop
            state, by_scale = flesh.state, np.zeros((12, len(scales)))
            for k, A in self._stretches(flesh):
                step = np.eye(12) + (scales[k] - 1.0) * A
                by_scale = step @ by_scale
                by_scale[:, k] += A @ state
                state = step @ state
            D = flesh_derivatives(flesh.with_parameters(state[3:]), nodes.u)
            moved = by_scale[:3] + np.einsum("njk,kp->njp", D, by_scale[3:])
            slope[:, own] += np.einsum("ij,njp->pni", R_joint_link, moved)
        return self._body.point_derivatives(posed, self.surface.joint, slope)

    def _scales(self, scales: np.ndarray | None) -> np.ndarray:
        return np.ones(len(self._body.names)) if scales is None else np.asarray(scales, dtype=float)

    def _flesh(self, parameters: np.ndarray | None) -> Sequence[Flesh]:
        flesh = self._body.base.subject.flesh
        if parameters is None:
            return flesh
        return [f.with_parameters(p) for f, p in zip(flesh, parameters, strict=True)]

    def _stretches(self, flesh: Flesh) -> list[tuple[int, np.ndarray]]:
        """The proportions that stretch a part, each with how."""
        return [(k, stretch_matrix(flesh, s[flesh.link])) for k, s in enumerate(self._segments) if flesh.link in s]
