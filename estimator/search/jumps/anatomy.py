"""The limbs and parts of a body whose depth one camera leaves open, found on its kinematic tree."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estimator.inference.mixture import body_size
from estimator.search.jumps.subproblems import axes_of, meeting_point
from humanoid.kinematics.body import Body
from humanoid.support.per_object import per_object

PROBES = 3  # random poses at which axes and landmarks are compared: a single pose may be a special one
SAME = 0.03  # of the body's size, as modes that are distinct: jumps that move less give nothing new
NEAR = 0.02  # of the body's size: an axis this near to a point goes through it
OFFSET = 0.08  # of the body's size: by which the axes of a robot's hip may miss each other
SHORT = 0.05  # of the body's size: shorter segments have no depth worth a jump


@dataclass(frozen=True)
class TwoSegmentLimb:
    """Two segments that turn about a root.

    landmarks (3,): root, middle and end. dofs (m,): what turns the middle and the end about the root, outwards: two or
    three axes through the root, or nearly so, then one hinge. counts (2,): how many of them the joints of the middle
    and of the end are behind.
    """

    landmarks: np.ndarray
    dofs: np.ndarray
    counts: np.ndarray


@dataclass(frozen=True)
class RigidPart:
    """A rigid part that turns about a point: trunk, head, shoulder girdle, hand, or the whole of a free body.

    dofs (n,): two or three axes through one point, outwards; none for a free root, which turns about the middle of
    the landmarks `about`. landmarks (k,): those that turn with it, the roots of its limbs among them. limbs: the limbs
    behind it. behind: the parts behind it.
    """

    dofs: np.ndarray
    landmarks: np.ndarray
    limbs: tuple[int, ...]
    behind: tuple[int, ...]
    about: tuple[int, ...] = ()

    @property
    def beyond(self) -> list[int]:
        """The landmarks that turn about those of `about`."""
        return [int(k) for k in self.landmarks if k not in self.about]

    @cached_property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """The landmarks of `about` and of `beyond`."""
        return np.array(self.about, dtype=np.int64), np.array(self.beyond, dtype=np.int64)


@dataclass(frozen=True)
class Anatomy:
    """limbs, their left and right `pairs` by index, and parts, inner ones first. same: poses nearer than this to each
    other in every landmark are the same [m]. trunk: the part that is a free body turned about the roots of a pair of
    limbs, as a person about the hips, by its place among the parts; None where there is none."""

    limbs: tuple[TwoSegmentLimb, ...]
    pairs: tuple[tuple[int, int], ...]
    parts: tuple[RigidPart, ...]
    same: float
    trunk: int | None = None


@per_object
def anatomy_of(body: Body) -> Anatomy:
    """The parts that can jump in depth, found without their names."""
    probe = _Probe(body)
    limbs = probe.limbs()
    parts = probe.parts(limbs)
    names = body.landmark_names
    ends = [tuple(names[int(k)] for k in limb.landmarks) for limb in limbs]
    mirrored = [tuple(n.replace("left_", "right_") for n in e) for e in ends]
    pairs = [(i, ends.index(m)) for i, m in enumerate(mirrored) if m != ends[i] and m in ends]
    trunk = _trunk(probe, limbs, pairs, parts)
    parts, place = (parts, None) if trunk is None else ((*parts, trunk), len(parts))
    return Anatomy(tuple(limbs), tuple(pairs), parts, SAME * probe.size, place)


def _trunk(
    probe: _Probe, limbs: list[TwoSegmentLimb], pairs: list[tuple[int, int]], parts: tuple[RigidPart, ...]
) -> RigidPart | None:
    """The whole of a free body turned about the middle between a left and a right limb on its root, which stay where
    they are while what is beyond turns over. Of several such pairs it is the one nearest to the root."""
    fixed = [not probe.moves_root(limb) for limb in limbs]
    on_root = [tuple(int(limbs[k].landmarks[0]) for k in pair) for pair in pairs if all(fixed[k] for k in pair)]
    if not parts or len(parts[0].dofs) or not on_root:
        return None
    far = [float(np.linalg.norm(probe.body.landmark_local[list(pair)].mean(axis=0))) for pair in on_root]
    about = on_root[int(np.argmin(far))]
    beyond = [k for k in parts[0].landmarks if probe.beyond(int(k), about)]
    return replace(parts[0], about=about) if beyond else None


class _Probe:
    """A body at a few random poses: which axis goes through which point."""

    def __init__(self, body: Body) -> None:
        self.body = body
        self.first = body.first_joint_dof
        rng = np.random.default_rng(0)  # of the construction alone: every body is probed at the same poses
        i = body.bounded_q
        self.posed = []
        for _ in range(PROBES):
            q = body.neutral.copy()
            q[i] = rng.uniform(body.lower[i], body.upper[i])
            self.posed.append(body.at(q))
        self.points = np.array([body.landmarks(p) for p in self.posed])
        all_dofs = np.arange(body.nv)
        axes, through = (
            np.array(x) for x in zip(*(axes_of(body.dof_jacobian(p), all_dofs) for p in self.posed), strict=True)
        )
        self.axes, self.through = axes, through
        self.size = body_size(body)
        kinds = [body.model.joints[int(j)].shortname() for j in body.tree.dof_joint]
        turning = [k.startswith("JointModelR") and not body.drives_several(d) for d, k in enumerate(kinds)]
        self.revolute = np.array(turning)  # about one axis: what others follow has no closed form
        arms = self.points[:, :, None] - through[:, None]
        self.levers = np.linalg.norm(np.cross(axes[:, None], arms), axis=-1).max(axis=0)  # (L, nv)
        self.moves = body.landmark_support & ((self.levers > NEAR * self.size) | ~self.revolute)  # (L, nv)

    def limbs(self) -> list[TwoSegmentLimb]:
        """Chains of three landmarks that share no joint: first those whose axes meet in the root, then the longest."""
        order = range(len(self.moves))
        segments = [(a, b) for a in order for b in order if self._follows(a, b)]
        chains = [(a, b, c) for a, b in segments for inner, c in segments if inner == b]
        candidates = [(limb, self._shortest(limb)) for chain in chains if (limb := self._limb(*chain)) is not None]
        candidates.sort(key=lambda x: (self._off(x[0]) > NEAR * self.size, -x[1]))
        limbs: list[TwoSegmentLimb] = []
        used = np.zeros(self.body.nv, dtype=bool)
        for limb, _ in candidates:
            if not used[limb.dofs].any():
                limbs.append(limb)
                used[limb.dofs] = True
        return sorted(limbs, key=lambda limb: int(limb.dofs[0]))

    def moves_root(self, limb: TwoSegmentLimb) -> bool:
        """Whether joints between the body's root and a limb move the limb's root."""
        before = self.moves[limb.landmarks[0]].copy()
        before[: self.first] = before[limb.dofs] = False
        return bool(before.any())

    def beyond(self, landmark: int, about: tuple[int, ...]) -> bool:
        """Whether a landmark is away from the middle of others and from the line through them."""
        offsets = self.points[:, [landmark, *about]] - self.points[:, list(about)].mean(axis=1, keepdims=True)
        along = offsets[:, 2] / np.maximum(np.linalg.norm(offsets[:, 2], axis=1), 1e-12)[:, None]
        across = np.linalg.norm(np.cross(offsets[:, 0], along), axis=1)
        return bool(across.min() > SHORT * self.size)

    def _shortest(self, limb: TwoSegmentLimb) -> float:
        lengths = np.linalg.norm(np.diff(self.points[:, limb.landmarks], axis=1), axis=2).min(axis=0)
        return float(lengths.min())

    def _follows(self, inner: int, outer: int) -> bool:
        """Whether one to three joints turn a segment of about constant length between two landmarks."""
        extra = self.moves[outer] & ~self.moves[inner]
        if (
            (self.moves[inner] & ~self.moves[outer]).any()
            or not 1 <= extra.sum() <= 3
            or not self.revolute[extra].all()
        ):
            return False
        lengths = np.linalg.norm(self.points[:, outer] - self.points[:, inner], axis=1)
        off = self.levers[inner, extra].max()
        fixed = np.ptp(lengths) < OFFSET * self.size and off < OFFSET * self.size
        return bool(fixed and lengths.min() > SHORT * self.size)

    def _limb(self, a: int, b: int, c: int) -> TwoSegmentLimb | None:
        dofs = np.flatnonzero(self.moves[c] & ~self.moves[a])
        if not 2 <= len(dofs) <= 4 or self.levers[a, dofs[-1]] < SHORT * self.size:
            return None  # the last one is not a hinge between two segments
        before = int(self.body.tree.dof_parent[dofs[0]])
        if len(dofs) < 4 and self._belongs(before, a, int(dofs[0])):
            dofs = np.append(before, dofs)
        if len(dofs) < 3:
            return None
        counts = np.array([np.count_nonzero(self.body.landmark_support[k][dofs]) for k in (b, c)])
        return TwoSegmentLimb(np.array([a, b, c]), dofs, counts)

    def _belongs(self, dof: int, root: int, first: int) -> bool:
        """Whether a joint before a limb's first turns the same limb about its root, and nothing else."""
        if dof < self.first or not self.revolute[dof]:
            return False
        others = self.body.landmark_support[:, dof] & ~self.body.landmark_support[:, first]
        others[root] = False
        return not others.any() and self.levers[root, dof] < OFFSET * self.size

    def _off(self, limb: TwoSegmentLimb) -> float:
        """Distance of the axes of the limb's ball joint from its root [m]."""
        return float(self.levers[limb.landmarks[0], limb.dofs[:-1]].max())

    def parts(self, limbs: list[TwoSegmentLimb]) -> tuple[RigidPart, ...]:
        """Runs of joints that are not of a limb, and a free root before them."""
        taken = {int(d) for limb in limbs for d in limb.dofs}
        roots = {int(limb.landmarks[0]) for limb in limbs}
        runs = self._runs(taken)
        rigid_runs: list[tuple[np.ndarray, np.ndarray]] = []  # joints, and the landmarks that turn with them
        for run in runs:
            behind = self.body.landmark_support[:, run[-1]]
            rigid = [k for k in np.flatnonzero(behind) if k in roots or self._rigid(int(k), run)]
            rigid = [k for k in rigid if not taken & set(np.flatnonzero(self.moves[k] & ~self._up_to(run)).tolist())]
            if rigid:
                rigid_runs.append((np.array(run), np.array(rigid)))
        if self.first == 6:
            loose = [k for k in range(len(self.moves)) if k in roots or not self.moves[k, 6:].any()]
            if len(loose) >= 3:
                rigid_runs.insert(0, (np.zeros(0, dtype=int), np.array(loose)))
        return tuple(self._part(i, rigid_runs, limbs) for i in range(len(rigid_runs)))

    def _up_to(self, run: list[int]) -> np.ndarray:
        return np.asarray(self.body.support(int(self.body.tree.dof_joint[run[-1]])))

    def _rigid(self, landmark: int, run: list[int]) -> bool:
        return not (self.moves[landmark] & ~self._up_to(run)).any() and self.moves[landmark][run].any()

    def _runs(self, taken: set[int]) -> list[list[int]]:
        """Two or three joints that follow each other and whose axes meet."""
        runs: list[list[int]] = []
        for d in range(self.first, self.body.nv):
            if d in taken or not self.revolute[d]:
                continue
            last = runs[-1] if runs else []
            follows = bool(last) and self.body.tree.dof_parent[d] == last[-1]
            if follows and len(last) < 3 and self._meet([*last, d]):
                last.append(d)
            else:
                runs.append([d])
        return [run for run in runs if len(run) > 1]

    def _meet(self, dofs: list[int]) -> bool:
        for k in range(PROBES):
            pivot = meeting_point(self.axes[k, dofs], self.through[k, dofs])
            off = np.linalg.norm(np.cross(self.axes[k, dofs], pivot - self.through[k, dofs]), axis=1).max()
            if off > NEAR * self.size:
                return False
        return True

    def _part(self, i: int, rigid_runs: list[tuple[np.ndarray, np.ndarray]], limbs: list[TwoSegmentLimb]) -> RigidPart:
        dofs, landmarks = rigid_runs[i]
        support = [self._up_to(d.tolist()) if len(d) else np.zeros(self.body.nv, dtype=bool) for d, _ in rigid_runs]
        last = int(dofs[-1]) if len(dofs) else 0
        mine = [k for k, limb in enumerate(limbs) if self.body.landmark_support[limb.landmarks[1], last]]
        below = [k for k in range(len(rigid_runs)) if k != i and support[k][last]]
        return RigidPart(dofs, landmarks, tuple(mine), tuple(below))
