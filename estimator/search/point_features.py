"""Points of a body that trackers of image features predict: its head, its hands, or its landmarks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.cameras.projection import project_with_jacobian
from estimator.search.jumps.anatomy import Anatomy
from humanoid.kinematics.body import Body, PlacedBodies, points_of_each, points_on_links
from humanoid.support.compiled import jit
from humanoid.support.errors import InputError

FACE = ("nose", "left_eye", "right_eye", "left_ear", "right_ear")
HAND = "wrist"  # how the end of a limb with a hand is called, in COCO's names
HEAD = "head"
TRUNK = -1


@dataclass(frozen=True, eq=False)
class PointFeatures:
    """Points fixed to links.

    names (F,). joint (F,), local (F, 3) [m]: where they are fixed, in the joints' frames. limb (F,): the number of the
    limb (`Anatomy.limbs`) whose joints move them beside the trunk's, -1 for none.
    """

    names: tuple[str, ...]
    joint: np.ndarray
    local: np.ndarray
    limb: np.ndarray

    @property
    def count(self) -> int:
        """Number of features."""
        return len(self.names)

    def points(self, placed: PlacedBodies) -> np.ndarray:
        """In the world [m], (N, F, 3), of N configurations."""
        return points_of_each(placed, self.joint, self.local)

    def in_image(self, body: Body, q: np.ndarray, camera: Camera, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Some of them, chosen (K,), at q (N, nq): pixels (N, K, 2) [px] and their derivatives (N, K, 2, nv) [px per
        unit of v]; NaN where they have no image."""
        points = points_of_each(body.placed(q), self.joint[chosen], self.local[chosen])
        support = body.column_support[self.joint[chosen]]
        pixels = np.empty((len(q), len(chosen), 2))
        columns = np.empty((len(q), len(chosen), 2, support.shape[1]))
        pixel_jacobians(points, body.spatial_jacobians(q), support, *camera.arrays, pixels, columns)
        return pixels, body.collected(columns)

    def ends(self, limb: int) -> np.ndarray:
        """The features (K,) that a limb moves, the outermost last."""
        return np.flatnonzero(self.limb == limb)

    @property
    def of_trunk(self) -> np.ndarray:
        """The features (K,) that no limb moves."""
        return np.flatnonzero(self.limb == TRUNK)


def skin_features(body: Body, anatomy: Anatomy) -> PointFeatures:
    """The middle of the face, and the middle of the hand at the end of each limb whose end is a wrist (Taycher et al.
    2004, section 4).

    The middle of a hand is that of the flesh on its link, where it has flesh.

    Raises
    ------
    InputError: a body without a face, or without such a limb.
    """
    marks = {mark.name: mark for mark in body.subject.landmarks}
    face = [marks[name] for name in FACE if name in marks]
    arms = [k for k, limb in enumerate(anatomy.limbs) if HAND in body.landmark_names[int(limb.landmarks[2])]]
    if not face or not arms or len({mark.link for mark in face}) > 1:
        lacks = "no arms of two segments that end in a wrist" if face else "no landmarks on one face"
        remedy = 'features = "keypoints", or a subject with nose, eyes or ears and wrists'
        raise InputError(f"subject {body.subject.name}", f"has {lacks}", remedy=remedy)
    flesh = {part.link: part.xyz for part in body.subject.flesh}
    names, places = [HEAD], [(face[0].link, tuple(np.mean([mark.xyz for mark in face], axis=0)))]
    for k in arms:
        wrist = marks[body.landmark_names[int(anatomy.limbs[k].landmarks[2])]]
        names.append(wrist.name.replace(HAND, "hand"))
        places.append((wrist.link, flesh.get(wrist.link, wrist.xyz)))
    joint, local = points_on_links(body.model, places)
    return PointFeatures(tuple(names), joint, local, np.array([TRUNK, *arms]))


def landmark_features(body: Body, anatomy: Anatomy, names: Sequence[str] | None = None) -> PointFeatures:
    """All landmarks, or those of some names; a limb moves its middle and its end."""
    chosen = [k for k, name in enumerate(body.landmark_names) if names is None or name in names]
    limb = np.full(len(body.landmark_names), TRUNK)
    for k, one_limb in enumerate(anatomy.limbs):
        moved = body.landmark_support[:, one_limb.dofs].any(axis=1)
        moved[int(one_limb.landmarks[0])] = False  # its root, whose axes meet there
        limb[moved] = k
    return PointFeatures(
        tuple(body.landmark_names[k] for k in chosen), body.landmark_joint[chosen], body.landmark_local[chosen],
        limb[chosen],
    )  # fmt: skip


@jit
def pixel_jacobians(points, columns, support, intrinsics, lens, R, t, pixels, jacobian):  # type: ignore[no-untyped-def]
    """Fill pixels (N, F, 2) [px] and jacobian (N, F, 2, C) [px per unit of a column], NaN where there is no image.

    points (N, F, 3) [m]: in the world, fixed to bodies. columns (N, C, 6): of the spatial Jacobians, linear at the
    world's origin and angular. support (F, C) bool: which columns move which point. The camera: intrinsics (5,), lens,
    R (3, 3), t (3,), T_camera_world.
    """
    slope = np.empty((2, 3))
    for n in range(points.shape[0]):
        for f in range(points.shape[1]):
            x, y, z = points[n, f, 0], points[n, f, 1], points[n, f, 2]
            u, v, seen = project_with_jacobian(points[n, f], intrinsics, lens, R, t, slope)
            if not seen:
                pixels[n, f], jacobian[n, f] = np.nan, np.nan
                continue
            pixels[n, f, 0], pixels[n, f, 1] = u, v
            for c in range(columns.shape[1]):
                jacobian[n, f, 0, c], jacobian[n, f, 1, c] = 0.0, 0.0
                if not support[f, c]:
                    continue
                a = columns[n, c]
                vx = a[0] + a[4] * z - a[5] * y
                vy = a[1] + a[5] * x - a[3] * z
                vz = a[2] + a[3] * y - a[4] * x
                jacobian[n, f, 0, c] = slope[0, 0] * vx + slope[0, 1] * vy + slope[0, 2] * vz
                jacobian[n, f, 1, c] = slope[1, 0] * vx + slope[1, 1] * vy + slope[1, 2] * vz
