"""Limbs drawn from where an image shows their ends: inverse kinematics in closed form, with its exact density.

A place in the image, a depth and a swivel (the turn of the elbow about the line from shoulder to hand) give the four
angles of an arm: a proposal of poses by what is seen, which importance sampling then weighs (Taycher et al. 2004,
section 4; Taycher and Darrell 2003). Given head, neck and trunk, arms are independent.

Its density in the angles is that of place, depth and swivel times |d(place, depth, swivel) / d(angles)|, for an arm
whose axes meet in the shoulder |p| L1 L2 |sin elbow| |cos middle shoulder angle| times the image's scale, p being the
way from shoulder to hand. Where that is zero, with the elbow straight or the outer shoulder axes in line, equal changes
of the image are ever larger ones of the angles: what is within about a degree of there is not drawn (`SINGULAR`), so
that weights, which go by one over the density, are bounded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.cameras.camera import Camera
from estimator.cameras.projection import project_with_jacobian
from estimator.inference.chains.feature_density import FeatureDensity
from estimator.search.jumps.anatomy import Limb
from estimator.search.jumps.lines import axes_of
from estimator.search.proposals.limb_ik_kernels import look_at_each, solve_each
from humanoid.kinematics.body import Body, PlacedBodies
from humanoid.support.compiled import jit
from humanoid.support.errors import InputError

_BENDS = 2001  # hinge angles at which the reach is looked at
_ROUND = 2.0 * np.pi
SINGULAR = 0.02  # of the largest volume: sin(elbow) cos(middle shoulder angle) of what is not drawn


class Arms(NamedTuple):
    """N configurations of a limb.

    angles (N, m) [rad]: entries of q. ok (N,) bool: whether there is one, inside of the limits and not singular.
    log_density (N,): of the angles [1/rad^m], -inf where not ok.
    """

    angles: np.ndarray
    ok: np.ndarray
    log_density: np.ndarray


@dataclass(frozen=True, eq=False)
class LimbIK:
    """The inverse kinematics of one limb, its end a point fixed to its outer segment.

    entries (m,): of q. parent: the joint whose frame all else is in. axes, through (m, 3), points (3, 3) [m]: of the
    limb with all its joints at `rest` (m,): root, middle and end. low, high (m,): limits as turns from rest. near, far
    [m]: how near to the root the end can be, and how far. least: logarithm of the volume below which it is singular.
    """

    entries: np.ndarray
    parent: int
    rest: np.ndarray
    axes: np.ndarray
    through: np.ndarray
    points: np.ndarray
    low: np.ndarray
    high: np.ndarray
    near: float
    far: float
    least: float

    @staticmethod
    def of(body: Body, limb: Limb, joint: int, local: np.ndarray) -> LimbIK:
        """Of a limb whose end is the point `local` (3,) [m] in the frame of its outermost joint, or of one behind it.

        Raises
        ------
        InputError: a limb of joints that have no limits.
        """
        dofs = limb.dofs
        joints = [int(body.tree.dof_joint[d]) for d in dofs]
        entries = np.array([body.model.idx_qs[j] for j in joints])
        lower, upper = body.lower[entries], body.upper[entries]
        if not (np.isfinite(lower) & np.isfinite(upper)).all():
            raise InputError(f"subject {body.subject.name}", "has a limb without joint limits", remedy="limits for it")
        q = body.neutral.copy()
        q[entries] = rest = 0.5 * (lower + upper)
        posed = body.at(q)
        parent = int(body.tree.joint_parent[joints[0]])
        R, t = posed.rotations[parent], posed.translations[parent]
        axes, through = axes_of(body.dof_jacobian(posed), dofs)
        root, middle = body.landmarks(posed)[limb.landmarks[:2]]
        end = posed.rotations[joint] @ local + posed.translations[joint]
        points = (np.array([root, middle, end]) - t) @ R
        own = axes @ R, (through - t) @ R
        near, far = _reach(own[0][-1], own[1][-1], points, lower[-1] - rest[-1], upper[-1] - rest[-1])
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        least = float(np.log(SINGULAR * lengths.prod() * far))
        return LimbIK(entries, parent, rest, *own, points, lower - rest, upper - rest, near, far, least)

    @property
    def swivels(self) -> bool:
        """Whether it has a swivel: three axes at its root and a hinge. With two, a place is all there is to choose."""
        return len(self.entries) > 3

    def solved(self, ends: np.ndarray, swivels: np.ndarray, picks: np.ndarray) -> Arms:
        """Angles that bring the end to places (N, 3) [m] in the parent's frame with swivels (N,) [rad].

        There are up to four ways; picks (N,), from 0 to 1, take one of those inside of the limits. log_density is that
        of the angles where places and swivels have density 1.
        """
        count = len(ends)
        turns, volumes = np.zeros((count, len(self.entries))), np.full(count, -np.inf)
        ways = np.zeros(count, dtype=np.int64)
        solve_each(
            self.axes, self.through, self.points, self.low, self.high, np.ascontiguousarray(ends),
            np.ascontiguousarray(swivels, dtype=float), picks, turns, ways, volumes,
        )  # fmt: skip
        return self._arms(turns, ways, volumes)

    def looked_at(self, angles: np.ndarray) -> tuple[np.ndarray, Arms]:
        """Where the end is in the parent's frame [m], (N, 3), and what `solved` would say of angles (N, m)."""
        count = len(angles)
        ends, volumes = np.zeros((count, 3)), np.full(count, -np.inf)
        ways = np.zeros(count, dtype=np.int64)
        turns = np.ascontiguousarray(angles - self.rest)
        look_at_each(self.axes, self.through, self.points, self.low, self.high, turns, ends, ways, volumes)
        return ends, self._arms(turns, ways, volumes)

    def _arms(self, turns: np.ndarray, ways: np.ndarray, volumes: np.ndarray) -> Arms:
        ok = (ways > 0) & (volumes > self.least)
        log_density = np.full(len(ok), -np.inf)
        log_density[ok] = volumes[ok] - np.log(ways[ok])
        return Arms(np.clip(turns + self.rest, self.low + self.rest, self.high + self.rest), ok, log_density)


@dataclass(frozen=True, eq=False)
class ImageProposal:
    """Arms whose ends are where one camera may see them.

    seen: densities of the end's place in the image [px], its only feature. Depth is drawn evenly over what the limb can
    reach on the line of sight, the swivel evenly all around.
    """

    ik: LimbIK
    camera: Camera
    seen: FeatureDensity

    def drawn(self, rng: np.random.Generator, placed: PlacedBodies) -> Arms:
        """One arm for each of N configurations, whose trunk it is put on."""
        count = len(placed.q)
        pixels = self.seen.sample(rng, count)[0][:, 0]
        level, swivel, picks = rng.random(count), _ROUND * rng.random(count), rng.random(count)
        origins, ways = self._lines(pixels, placed)
        depth, length = _depths(origins, ways, self.ik, level)
        reached = length > 0.0
        ends = np.where(reached[:, None], origins + depth[:, None] * ways, np.inf)
        arms = self.ik.solved(np.where(reached[:, None], ends, 1e6), swivel, picks)
        ok = arms.ok & reached
        log_density = np.full(count, -np.inf)
        log_density[ok] = arms.log_density[ok] + self._log_density(ends[ok], pixels[ok], length[ok], placed.of(ok))
        return Arms(arms.angles, ok, log_density)

    def log_density(self, angles: np.ndarray, placed: PlacedBodies) -> np.ndarray:
        """Logarithms (N,) of the density with which `drawn` has these angles (N, m), on the trunks of N configurations;
        -inf where it never has."""
        ends, arms = self.ik.looked_at(angles)
        pixels = self.camera.project(_in_world(ends, self.ik.parent, placed))
        ok = arms.ok & np.isfinite(pixels).all(axis=1)
        origins, ways = self._lines(np.where(ok[:, None], pixels, 0.0), placed)
        _, length = _depths(origins, ways, self.ik, np.zeros(len(ends)))
        ok &= length > 0.0
        log_density = np.full(len(ends), -np.inf)
        log_density[ok] = arms.log_density[ok] + self._log_density(ends[ok], pixels[ok], length[ok], placed.of(ok))
        return log_density

    def _lines(self, pixels: np.ndarray, placed: PlacedBodies) -> tuple[np.ndarray, np.ndarray]:
        """Lines of sight in the parent's frame: points of them (N, 3) [m] and unit directions (N, 3)."""
        origins, ways = self.camera.rays(pixels)
        M = placed.placements[:, self.ik.parent]
        R = M[:, :9].reshape(-1, 3, 3)  # row k is column k of the rotation
        return np.einsum("nki,ni->nk", R, origins - M[:, 9:]), np.einsum("nki,ni->nk", R, ways)

    def _log_density(
        self, ends: np.ndarray, pixels: np.ndarray, length: np.ndarray, placed: PlacedBodies
    ) -> np.ndarray:
        """Of place and swivel, (N,): ends (N, 3) in the parent's frame, seen at pixels (N, 2), of `length` (N,) [m]."""
        if not len(ends):
            return np.zeros(0)
        volumes = np.empty(len(ends))
        _line_volumes(
            _in_world(ends, self.ik.parent, placed), *self.camera.arrays, self.camera.rays(pixels)[1], volumes
        )
        image = self.seen.log_density(pixels[:, None]) - np.logaddexp.reduce(self.seen.log_weight)
        swivel = np.log(_ROUND) if self.ik.swivels else 0.0
        return np.asarray(image + np.log(volumes) - np.log(length) - swivel)


def _in_world(points: np.ndarray, joint: int, placed: PlacedBodies) -> np.ndarray:
    """Points (N, 3) [m], each in the frame of the joint in its configuration, in the world."""
    M = placed.placements[:, joint]
    return np.asarray(np.einsum("nki,nk->ni", M[:, :9].reshape(-1, 3, 3), points) + M[:, 9:])


def _depths(origins: np.ndarray, ways: np.ndarray, ik: LimbIK, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth (N,) [m] on lines (N, 3) at a share `level` (N,) of what the limb can reach there, and how much that is,
    (N,) [m], 0 where the line is out of reach: what is in the sphere of `far` about the root, not in that of `near`."""
    off = ik.points[0] - origins
    along = np.einsum("ni,ni->n", off, ways)
    square = np.einsum("ni,ni->n", off, off) - along**2
    outer = np.sqrt(np.maximum(ik.far**2 - square, 0.0))
    inner = np.sqrt(np.maximum(ik.near**2 - square, 0.0))
    length = 2.0 * (outer - inner)
    at = level * length
    return along - outer + at + np.where(at > 0.5 * length, 2.0 * inner, 0.0), length


def _reach(hinge: np.ndarray, seat: np.ndarray, points: np.ndarray, low: float, high: float) -> tuple[float, float]:
    """The least and the largest distance [m] of the end from the root, over the turns of the hinge."""
    turns = np.linspace(low, high, _BENDS)[:, None]
    arm = points[2] - seat
    along = hinge * (arm @ hinge)
    moved = along + np.cos(turns) * (arm - along) + np.sin(turns) * np.cross(hinge, arm)
    distance = np.linalg.norm(seat + moved - points[0], axis=1)
    return float(distance.min()), float(distance.max())


@jit
def _line_volumes(points, intrinsics, lens, R, t, ways, volumes):  # type: ignore[no-untyped-def]
    """Fill volumes (N,) [px^2 / m^2] with |d(pixel, depth) / d(point)| at points (N, 3), their lines' directions ways
    (N, 3). The camera: intrinsics (5,), lens (5,), (1, 22) or (1, 1, 22), R (3, 3), t (3,)."""
    J = np.empty((3, 3))
    for n in range(points.shape[0]):
        project_with_jacobian(points[n], intrinsics, lens, R, t, J[:2])
        J[2] = ways[n]
        volumes[n] = abs(np.linalg.det(J))
