"""Fit of keypoints to a limb at a placement: the landmarks fixed in its frame, projected, with left and right possibly
exchanged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.data.cameras.projection import in_camera, pack_cameras, project_point
from estimator.data.observation import Observation
from estimator.energy.kernels.keypoints import BEHIND
from estimator.numerics.robust import POTENTIALS, rho
from estimator.trackers.loose_limbed.limbs.potential_learning import random_configurations
from humanoid.kinematics.body import Body
from humanoid.limbs.limb import LimbGraph, limb_placements
from humanoid.subject.landmarks import mirror_index
from humanoid.support.compiled import jit
from humanoid.support.errors import InputError
from humanoid.support.settings import CheckedSettings, setting

_POSES = 400
_SEED = 0  # the poses only sample the body, and are not part of any trial
_FIXED = 0.01  # of the longest limb: what moves less than this is fixed
_LOOSE = 0.11  # of the limb's length: what moves less than this still locates the limb
_OFF_AXIS = 0.1  # of the limb's length: how far off the axis a landmark must be to show the limb's rotation about it
_TURNED = 0.7  # rad: how little a landmark's direction from the axis may be known
_MOST_TURNING = 6


@dataclass(frozen=True, eq=False)
class LimbLandmarks:
    """The landmarks (M,) of one limb, by their index among the body's.

    place (M, 3) [m]: where they are in the limb's frame on average. spread (M,) [m]: root mean square distance from
    there over poses. fixed (M,) bool: whether that is as good as nothing, as of what is on the limb's link or its
    joints.
    turning (P,): landmarks, mostly of neighbours, that show the limb's rotation about its z axis, the most certain
    first. angle (P,) [rad]: their mean direction from the axis, from x to y. uncertain (P,) [rad]: its circular
    standard deviation over poses.
    """

    landmark: np.ndarray
    place: np.ndarray
    spread: np.ndarray
    fixed: np.ndarray
    turning: np.ndarray
    angle: np.ndarray
    uncertain: np.ndarray


def landmarks_of_limbs(body: Body, graph: LimbGraph) -> tuple[LimbLandmarks, ...]:
    """Landmarks of every limb of a graph, in poses drawn from the body's stabilisers within its limits. Found by their
    places alone; what moves by less than 11 % of the limb's length counts. Depends on the body's lengths: once a body
    is enough. Raises InputError for a body that lacks a link of the graph."""
    q = random_configurations(body, _POSES, np.random.default_rng(_SEED))
    points = body.landmarks_of(body.placed(np.ascontiguousarray(q)))
    t, R = limb_placements(graph, body, q)
    size = longest_of(graph)
    return tuple(_of_limb((points - t[:, None, k]) @ R[:, k], limb.length, size) for k, limb in enumerate(graph.limbs))


def longest_of(graph: LimbGraph) -> float:
    """Length of the longest limb [m], with which errors of detectors are scaled: they grow with the person."""
    return max(limb.length for limb in graph.limbs)


def _of_limb(local: np.ndarray, length: float, size: float) -> LimbLandmarks:
    """local (N, L, 3): the landmarks of all poses in the limb's frame [m]."""
    place = local.mean(axis=0)
    spread = np.sqrt(np.square(local - place).sum(axis=2).mean(axis=0))
    own = np.flatnonzero(spread < max(_LOOSE * length, _FIXED * size))
    across = np.linalg.norm(local[:, :, :2], axis=2)
    direction = (local[:, :, 0] + 1j * local[:, :, 1]) / np.maximum(across, 1e-12)
    mean = direction.mean(axis=0)
    uncertain = np.sqrt(-2.0 * np.log(np.clip(np.abs(mean), 1e-12, 1.0)))
    telling = (np.median(across, axis=0) > _OFF_AXIS * length) & (uncertain < _TURNED)
    turning = np.flatnonzero(telling)
    turning = turning[np.argsort(uncertain[turning], kind="stable")][:_MOST_TURNING]
    return LimbLandmarks(
        own, place[own], spread[own], spread[own] < _FIXED * size, turning, np.angle(mean)[turning], uncertain[turning]
    )


@dataclass(frozen=True)
class KeypointEvidenceSettings(CheckedSettings):
    """potential, nu: robust potential of a keypoint (`estimator.numerics.robust`). exchange [nats]: how much less
    likely a view's left and right of a limb are exchanged than as detected.
    Raises InputError where a value is outside its range."""

    potential: str = setting("lorentzian", one_of=tuple(POTENTIALS))
    nu: float = setting(8.0, above=0)
    exchange: float = setting(3.0, at_least=0)


class KeypointEvidence:
    """The evidence of an instant's keypoints for placements of limbs.

    A view's energy of a limb is the sum of 1/2 rho of its landmarks' distances from their keypoints over their standard
    deviations, by confidence; a landmark that moves in the limb's frame from pose to pose is as much less certain. A
    view's evidence is the logarithm of a mixture of two: keypoints as detected, and left and right exchanged. Views are
    added. A landmark shared by several limbs, such as that of a joint, counts for its share in each, so that it is once
    in the product over limbs.

    sigma (C, L): standard deviation of each keypoint [px] (`estimator.search.cost_model.CostModel.keypoint_sigma`).
    landmarks: `landmarks_of_limbs(body, graph)`, for callers with many instants.

    Raises
    ------
    InputError: sigma is not of the observation's shape, or not above 0; a parallel camera, which measures no depth.
    """

    def __init__(
        self,
        body: Body,
        graph: LimbGraph,
        observation: Observation,
        sigma: np.ndarray,
        settings: KeypointEvidenceSettings | None = None,
        landmarks: Sequence[LimbLandmarks] | None = None,
    ) -> None:
        self.settings = settings or KeypointEvidenceSettings()
        for camera in observation.cameras:
            camera.needs_centre()
        sigma = np.asarray(sigma, dtype=float)
        if sigma.shape != observation.confidence.shape or not (np.isfinite(sigma) & (sigma > 0.0)).all():
            remedy = "one finite number above 0 for each camera and landmark"
            raise InputError("sigma", "does not suit the keypoints", place="keypoint evidence", remedy=remedy)
        landmarks = landmarks or landmarks_of_limbs(body, graph)
        mirror = mirror_index(body.landmark_names)
        seen = (observation.confidence > 0.0) & np.isfinite(observation.pixels).all(axis=2)
        # a person seen on one side alone has nothing to exchange
        other = np.where(seen & seen[:, mirror], mirror, np.arange(len(mirror)))
        pixels = np.where(seen[..., None], observation.pixels, 0.0)
        weight = np.where(seen, np.minimum(observation.confidence, 1.0), 0.0)
        values = np.concatenate([pixels, weight[..., None], np.square(sigma)[..., None]], axis=2)
        readings = np.stack([values, np.take_along_axis(values, other[..., None], axis=1)], axis=1)
        self._cameras = pack_cameras(observation.cameras)
        owners = np.bincount(np.concatenate([of.landmark for of in landmarks]), minlength=len(mirror))
        self._limbs = []
        for of in landmarks:
            keypoints = np.ascontiguousarray(readings[:, :, of.landmark])
            keypoints[..., 2] /= owners[of.landmark]
            views = np.maximum(seen[:, of.landmark].sum(axis=0), 1)  # it is off its place by the same in all of them
            self._limbs.append((np.ascontiguousarray(of.place), views * np.square(of.spread), keypoints))

    def log_likelihood(self, limb: int, t: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Log-likelihood of placements of a limb, by its index in the graph, t (N, 3) [m] and R (N, 3, 3) in the world:
        (N,) [nats], at most 0, which it is where no keypoint is informative."""
        total = np.zeros(len(t))
        t, R = np.ascontiguousarray(t, dtype=float), np.ascontiguousarray(R, dtype=float)
        s = self.settings
        _add_evidence(t, R, *self._limbs[limb], self._cameras, POTENTIALS[s.potential], s.nu, s.exchange, total)
        return total


@jit
def _add_evidence(t, R, place, spread, keypoints, cameras, kind, nu, exchange, total):  # type: ignore[no-untyped-def]
    """Add to total (N,) [nats] of placements t (N, 3), R (N, 3, 3) of a limb with landmarks at place (M, 3) in its
    frame, whose variance there is spread (M,) [m^2].

    keypoints (C, 2, M, 4): u, v [px], weight, variance [px^2], as detected and exchanged. cameras (4,):
    see `estimator.data.cameras.projection.pack_cameras`.
    """
    detected = -math.log(1.0 + math.exp(-exchange))
    energy = np.empty(2)
    for c in range(keypoints.shape[0]):
        if not (keypoints[c, 0, :, 2] > 0.0).any():
            continue
        camera = cameras[0][c], cameras[1][c], cameras[2][c], cameras[3][c]
        for n in range(t.shape[0]):
            _fill_energies(t[n], R[n], place, spread, keypoints[c], camera, kind, nu, energy)
            own, other = energy[0], energy[1] + exchange
            low = min(own, other)
            total[n] += detected - low + math.log(math.exp(low - own) + math.exp(low - other))


@jit
def _fill_energies(t, R, place, spread, keypoints, camera, kind, nu, energy):  # type: ignore[no-untyped-def]
    """Fill energy (2,) [nats] of a view's keypoints (2, M, 4) as detected and exchanged; the rest: see
    `_add_evidence`."""
    intrinsics, lens, R_camera, t_camera = camera
    energy[:] = 0.0
    p = np.empty(3)
    for m in range(place.shape[0]):
        if keypoints[0, m, 2] == 0.0:
            continue
        for i in range(3):
            p[i] = t[i] + R[i, 0] * place[m, 0] + R[i, 1] * place[m, 1] + R[i, 2] * place[m, 2]
        u, v, ahead = project_point(p, intrinsics, lens, R_camera, t_camera)
        depth = in_camera(p, R_camera, t_camera)[2]
        for k in range(2):
            s = BEHIND
            if ahead:
                du, dv = u - keypoints[k, m, 0], v - keypoints[k, m, 1]
                blur = spread[m] * intrinsics[0] * intrinsics[1] / (depth * depth)
                s = (du * du + dv * dv) / (keypoints[k, m, 3] + blur)
                if not s < BEHIND:  # nothing is farther off than what is behind the camera
                    s = BEHIND
            energy[k] += 0.5 * keypoints[k, m, 2] * rho(kind, s, nu)[0]
