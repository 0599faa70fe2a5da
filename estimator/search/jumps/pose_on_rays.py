"""A pose and the lines of sight that its landmarks are on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from humanoid.kinematics.body import Body


class PoseOnRays(NamedTuple):
    """A pose and the rays its landmarks are to stay on.

    q (nq,); points (L, 3) [m]: its landmarks; spatial_jacobian (nv, 6): see `Body.dof_jacobian`; eyes (L, 3) [m]: a
    point of each ray, the optical centre unless the camera is parallel; rays (L, 3): unit vectors along them, away from
    the camera, of the first pose.
    """

    q: np.ndarray
    points: np.ndarray
    spatial_jacobian: np.ndarray
    eyes: np.ndarray
    rays: np.ndarray


def pose_on_rays(body: Body, q: np.ndarray, camera: Camera) -> PoseOnRays:
    """q (nq,) and the rays of the camera on which its landmarks are."""
    posed = body.at(q)
    points = body.landmarks(posed)
    return PoseOnRays(q, points, body.dof_jacobian(posed), *camera.sight_lines(points))


def moved_to(body: Body, on_rays: PoseOnRays, q: np.ndarray) -> PoseOnRays:
    """Another pose (nq,) that is to be on the same rays."""
    posed = body.at(q)
    return on_rays._replace(q=q, points=body.landmarks(posed), spatial_jacobian=body.dof_jacobian(posed))


def turned(body: Body, q: np.ndarray, dofs: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """q (nq,) with some degrees of freedom (m,) turned by `turns` (m,) [rad], limits kept."""
    step = np.zeros(body.nv)
    step[dofs] = turns
    return body.integrate(q, step)
