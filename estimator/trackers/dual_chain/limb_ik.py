"""Limbs drawn from where an image shows their ends: inverse kinematics in closed form, with its exact density.

A place in the image, a depth and a swivel (the turn of the elbow about the line from shoulder to hand) give the four
angles of an arm: a proposal of poses from the observation, which importance sampling then weights (Taycher et al. 2004,
section 4; Taycher and Darrell 2003). Given head, neck and trunk, arms are independent.

Its density in the angles is that of place, depth and swivel times |d(place, depth, swivel) / d(angles)|, for an arm
whose axes meet in the shoulder |p| L1 L2 |sin elbow| |cos middle shoulder angle| times the image's scale, p being the
way from shoulder to hand. Where that is zero, with the elbow straight or the outer shoulder axes in line, equal changes
of the image are ever larger ones of the angles: what is within about a degree of there is not drawn (`SINGULAR`; of
upper13's arm five percent of all angles), so that weights, proportional to one over the density, are bounded.

Axes that miss each other, as robots' do, are met by Newton's method from the closed form. Angles that it does not lead
to are never drawn and have density zero (of g1's limbs a tenth): less is proposed, and what is has its exact density.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.inference.chains.feature_density import FeatureDensity
from estimator.numerics.vectors import rotated
from estimator.search.jumps.anatomy import TwoSegmentLimb
from estimator.search.jumps.subproblems import axes_of, meeting_point, turn_between
from estimator.trackers.dual_chain.limb_ik_kernels import forward_each, solve_each
from estimator.trackers.dual_chain.limb_ik_lines import aim_back, aimed, in_world, lines_in, log_line_volumes
from humanoid.kinematics.body import Body, PlacedBodies
from humanoid.support.errors import InputError

_MEET = 1e-9  # m: axes that miss a point by less go through it
_LOOSE = 0.5  # rad: by which Newton's steps may bring angles back inside of the limits
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
    limb with all its joints at `rest` (m,): root, where the ball's axes meet or are nearest to each other, middle and
    end. low, high (m,): limits as turns from rest. near, far [m]: how near to the root the end can be, and how far.
    least: logarithm of the volume below which it is singular. loose [rad]: how far outside of its limits the closed
    form may be, 0 where axes meet.
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
    loose: float

    @staticmethod
    def of(body: Body, limb: TwoSegmentLimb, joint: int, local: np.ndarray) -> LimbIK:
        """The inverse kinematics of a limb whose end is the point `local` (3,) [m] in the frame of its outermost joint,
        or of one behind it.

        Raises
        ------
        InputError: a limb of joints that have no limits.
        """
        dofs = limb.dofs
        joints = [int(body.tree.dof_joint[d]) for d in dofs]
        entries = np.array([body.model.idx_qs[j] for j in joints])
        if not np.isin(entries, body.bounded_q).all():
            raise InputError(f"subject {body.subject.name}", "has a limb without joint limits", remedy="limits for it")
        lower, upper = body.lower[entries], body.upper[entries]
        q = body.neutral.copy()
        q[entries] = rest = 0.5 * (lower + upper)
        posed = body.at(q)
        parent = int(body.tree.joint_parent[joints[0]])
        R, t = posed.rotations[parent], posed.translations[parent]
        axes, through = axes_of(body.dof_jacobian(posed), dofs)
        axes, through = axes @ R, (through - t) @ R
        end = posed.rotations[joint] @ local + posed.translations[joint]
        points = (np.array([*body.landmarks(posed)[limb.landmarks[:2]], end]) - t) @ R
        points[0], missed = _root(axes[:-1], through[:-1], points[0])
        near, far = _reach(axes[-1], through[-1], points, lower[-1] - rest[-1], upper[-1] - rest[-1])
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        least = float(np.log(SINGULAR * lengths.prod() * far))
        # a turn about an axis changes the distance from the root by twice as much as it misses the root at most
        return LimbIK(
            entries, parent, rest, axes, through, points, lower - rest, upper - rest, max(near - 2.0 * missed, 0.0),
            far + 2.0 * missed, least, _LOOSE if missed > 0.0 else 0.0,
        )  # fmt: skip

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
        solve_each(*self._limb, np.ascontiguousarray(ends), swivels, picks, turns, ways, volumes)
        return self._arms(turns, ways, volumes)

    def forward(self, angles: np.ndarray) -> tuple[np.ndarray, Arms]:
        """Place of the end in the parent's frame [m], (N, 3), and the result of `solved` for angles (N, m)."""
        count = len(angles)
        ends, volumes = np.zeros((count, 3)), np.full(count, -np.inf)
        ways = np.zeros(count, dtype=np.int64)
        turns = np.ascontiguousarray(angles - self.rest)
        forward_each(*self._limb, turns, ends, ways, volumes)
        return ends, self._arms(turns, ways, volumes)

    @property
    def _limb(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
        return self.axes, self.through, self.points, self.low, self.high, self.loose

    def _arms(self, turns: np.ndarray, ways: np.ndarray, volumes: np.ndarray) -> Arms:
        ok = (ways > 0) & (volumes > self.least)
        log_density = np.full(len(ok), -np.inf)
        log_density[ok] = volumes[ok] - np.log(ways[ok])
        return Arms(np.clip(turns + self.rest, self.low + self.rest, self.high + self.rest), ok, log_density)


@dataclass(frozen=True, eq=False)
class ImageProposal:
    """Arms whose ends are where one camera may see them.

    seen: density of the end's place in the image [px], its only feature. Depth is drawn evenly over what the limb can
    reach on the line of sight, in front of the camera, the swivel evenly all around.

    Raises
    ------
    InputError: a density without the feature, or of several.
    """

    ik: LimbIK
    camera: Camera
    seen: FeatureDensity

    def __post_init__(self) -> None:
        if len(self.seen.names) != 1 or not self.seen.known.all():
            remedy = "one feature, and kernels that all contain it"
            raise InputError("proposal of limbs", "has an image that does not locate the end of a limb", remedy=remedy)

    def sample(self, rng: np.random.Generator, placed: PlacedBodies) -> Arms:
        """One arm for each of N configurations, whose trunk it is put on.

        Where `ok` is false, the place was out of reach, outside of the limits with its swivel, or singular, and angles
        are in the middle of the limits: a draw that failed. To draw again instead would change the density.
        """
        ik, count = self.ik, len(placed.q)
        pixels = self.seen.sample(rng, count)[0][:, 0]
        level, swivel, picks = rng.random(count), _ROUND * rng.random(count), rng.random(count)
        lines = lines_in(self.camera, *aimed(self.camera, pixels), ik.parent, placed)
        spans = lines.spans(ik.points[0], ik.near, ik.far)
        rows = np.flatnonzero(spans.whole > 0.0)
        ends = lines.origins[rows] + spans.at(level)[rows, None] * lines.ways[rows]
        arms = ik.solved(ends, swivel[rows], picks[rows])
        ends, rows = ends[arms.ok], rows[arms.ok]
        angles, ok, log_density = np.tile(ik.rest, (count, 1)), np.zeros(count, dtype=bool), np.full(count, -np.inf)
        angles[rows], ok[rows] = arms.angles[arms.ok], True
        of_place = self._log_density(in_world(ends, ik.parent, placed.of(rows)), pixels[rows], spans.whole[rows])
        log_density[rows] = arms.log_density[arms.ok] + of_place
        return Arms(angles, ok, log_density)

    def log_density(self, angles: np.ndarray, placed: PlacedBodies) -> np.ndarray:
        """Logarithms (N,) of the density with which `sample` has these angles (N, m), on the trunks of N
        configurations; -inf where it never has. Its integral over the angles is the share of draws that are ok."""
        ik = self.ik
        ends, arms = ik.forward(angles)
        rows = np.flatnonzero(arms.ok)
        some = placed.of(rows)
        ends = in_world(ends[rows], ik.parent, some)
        pixels, (origins, ways) = self.camera.project(ends), self.camera.sight_lines(ends)
        spans = lines_in(self.camera, origins, ways, ik.parent, some).spans(ik.points[0], ik.near, ik.far)
        depth = np.einsum("ni,ni->n", ends - origins, ways)
        seen = spans.have(depth) & (spans.whole > 0.0) & aim_back(self.camera, pixels, ways)
        log_density, rows = np.full(len(angles), -np.inf), rows[seen]
        of_place = self._log_density(ends[seen], pixels[seen], spans.whole[seen])
        log_density[rows] = arms.log_density[rows] + of_place
        return log_density

    def _log_density(self, ends: np.ndarray, pixels: np.ndarray, length: np.ndarray) -> np.ndarray:
        """Log-density (N,) of place and swivel: ends (N, 3) [m] in the world, seen at pixels (N, 2), on lines of which
        the limb reaches `length` (N,) [m]."""
        if not len(ends):
            return np.zeros(0)
        image = self.seen.log_density(pixels[:, None]) - np.logaddexp.reduce(self.seen.log_weight)
        volumes = log_line_volumes(self.camera, ends, self.camera.sight_lines(ends)[1])
        return np.asarray(image + volumes - np.log(length) - (np.log(_ROUND) if self.ik.swivels else 0.0))


def _root(axes: np.ndarray, through: np.ndarray, landmark: np.ndarray) -> tuple[np.ndarray, float]:
    """The landmark (3,) where a ball's axes, through (m - 1, 3) [m] each, go through it, else the point that is nearest
    to them all; and by how much they miss it in sum [m], 0 where they meet."""
    for point in (landmark, meeting_point(axes, through)):
        missed = float(np.linalg.norm(np.cross(axes, point - through), axis=1).sum())
        if missed < _MEET:
            return point, 0.0
    return (point, missed) if np.isfinite(missed) else (landmark, _MEET)


def _reach(hinge: np.ndarray, seat: np.ndarray, points: np.ndarray, low: float, high: float) -> tuple[float, float]:
    """The least and the largest distance [m] of the end from the root, over the turns of the hinge: at its limits, or
    where the end is in the plane of hinge and root."""
    arm, other = points[2] - seat, points[0] - seat
    facing = turn_between(hinge, arm, other)
    turns = [low, high, *(t for t in facing + np.pi * np.arange(-4, 5) if low < t < high)]
    distances = [float(np.linalg.norm(rotated(hinge, t, arm) - other)) for t in turns]
    return min(distances), max(distances)
