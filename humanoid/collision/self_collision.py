"""Distances between the parts of a body: signed distance, witness points and gradient of every near pair."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from itertools import pairwise
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin

from humanoid.collision import broad_phase, curvature, witness
from humanoid.collision.compiled_contacts import find_contacts, find_distances
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody
from humanoid.shape.solids import ConvexSolid, Geometry, solids_of
from humanoid.support.errors import InputError

LinkPair = tuple[str, str]
_Query = tuple[int, int, Any, Any]
"""The two solids, coal's query of their distance and how it is to be answered."""

REST_OVERLAP = 0.003  # [m] pairs that overlap by more at the neutral configuration are drawn so, and left out
MOST_PAIRS = 100_000  # every pair is checked in every pose
_ITERATIONS = 500
_HULL_TOLERANCES = 1e-8, 1e-6  # of GJK and EPA
# On ellipsoids EPA takes long, and at 1e-8 fails, or answers wrongly, in some of a thousand deep overlaps; from here
# `witness.sharpen` reaches the last digits.
_ELLIPSOID_TOLERANCES = 1e-6, 1e-4


class Contacts(NamedTuple):
    """Pairs nearer than a margin, in the order of `SelfCollision.pairs`.

    pair (M,): index into `SelfCollision.pairs`.
    distance (M,): signed distance [m], negative in overlap.
    point_a, point_b (M, 3): witness points in the world [m]; in overlap the deepest ones.
    normal (M, 3): unit vector in the world from solid a to b; distance = normal . (point_b - point_a).
    gradient (M, nv): derivative of the distance in the tangent space [m per unit of v].
    """

    pair: np.ndarray
    distance: np.ndarray
    point_a: np.ndarray
    point_b: np.ndarray
    normal: np.ndarray
    gradient: np.ndarray


class SolidArrays(NamedTuple):
    """The solids and pairs of a `SelfCollision`, as `compiled_contacts.find_contacts` takes them; not to be changed.

    joint (S,): index of the joint that moves each of S solids.
    local (S, 12): T_joint_solid, rotation column by column, and translation [m].
    core (S, 6): centre and half-axis of a capsule around each solid, in its frame [m]. radius (S,): of it [m].
    radii (S, 3): half-axes of ellipsoids [m], zero for other shapes.
    kind (S,): see `curvature`.
    pairs (P, 2): solids of each pair. pair_column (P, 2): last column of the spatial Jacobian that moves either.
    """

    joint: np.ndarray
    local: np.ndarray
    core: np.ndarray
    radius: np.ndarray
    radii: np.ndarray
    kind: np.ndarray
    pairs: np.ndarray
    pair_column: np.ndarray


class _Buffers(NamedTuple):
    """Room for contacts, reused from pose to pose; see `Contacts`. near: index of a pair."""

    near: np.ndarray
    distance: np.ndarray
    point_a: np.ndarray
    point_b: np.ndarray
    normal: np.ndarray

    @staticmethod
    def of(count: int) -> _Buffers:
        return _Buffers(np.zeros(count, dtype=np.int64), np.zeros(count), *np.zeros((3, count, 3)))


class SelfCollision:
    """Signed distances between the parts of a body, by a compiled kernel, and by coal where that is not certain.

    Coal measures pairs with a hull, ellipsoids deep in another part, capsules whose axes are parallel or cross, and
    searches that fail, see `compiled_contacts`.

    A pair is two solids that a joint parts. Links that are adjacent in the tree, once links without solids are
    contracted away, are not a pair, nor are links that overlap by over 3 mm at `body.neutral`.

    One object serves one thread: it reuses buffers and coal's queries. Results own their arrays and do not depend on
    earlier calls, except for distances of hulls, by less than 1e-8 m.

    Parameters
    ----------
    margin: distance [m] below which a pair counts as near.
    exclude, include: pairs of links to remove from, and to add to, those of these rules; `exclude` takes precedence.
    geometry: which solids, see `humanoid.shape.solids.solids_of`.

    Attributes
    ----------
    solids: see `humanoid.shape.solids`.
    pairs: links (a, b) of every checked pair of solids; a link with several solids occurs several times.
    arrays: solids and pairs for compiled code that calls `compiled_contacts.find_contacts` itself.
    overlapping_at_rest: pairs of links left out because they overlap at `body.neutral`, with their depth [m].

    Raises
    ------
    InputError: a name in `exclude` or `include` has no solid, a pair cannot move, a mesh cannot be read, or there are
        more than `MOST_PAIRS` pairs.
    """

    def __init__(
        self,
        body: Body,
        *,
        margin: float = 0.02,
        exclude: Iterable[LinkPair] = (),
        include: Iterable[LinkPair] = (),
        geometry: Geometry = "auto",
    ) -> None:
        self.margin = margin
        self.solids = solids_of(body, geometry)
        self._body = body
        _check_count(body.subject.source, self.solids)
        self._set_solids(body)
        included, excluded = self._checked(include, "include"), self._checked(exclude, "exclude")
        pairs = _tree_pairs(body.model, self.solids)
        self._set_pairs(pairs)
        self.overlapping_at_rest = self._rest_overlaps(body)
        self._set_pairs(self._adjusted(pairs, included, excluded))

    def near(self, posed: PosedBody, margin: float | None = None) -> Contacts:
        """Every pair whose signed distance is below the margin [m] (by default the constructor's)."""
        count = self._measure(posed, self.margin if margin is None else margin)
        if count == 0:
            return self._nothing
        buffers = self._contacts  # copied by name: a loop over them costs as much again
        pair, distance, normal = (
            buffers.near[:count].copy(),
            buffers.distance[:count].copy(),
            buffers.normal[:count].copy(),
        )
        point_a, point_b = buffers.point_a[:count].copy(), buffers.point_b[:count].copy()
        tree = self._body.tree
        gradient = witness.gradients(
            posed.spatial_jacobian, tree.column_parent, self._pair_column[pair], point_a, point_b, normal
        )
        return Contacts(pair, distance, point_a, point_b, normal, self._body.collected(gradient))

    def add_curvature(self, posed: PosedBody, contacts: Contacts, factor: np.ndarray, hessian: np.ndarray) -> None:
        """Add the second derivatives of the contacts' distances, times factor (M,), to hessian (nv, nv), in the tangent
        space at the pose that the contacts are of. Those of hulls are left out, see `curvature.add_curvature`."""
        broad_phase.place(posed.placements, self._joint, self._local, self._core, self._world, self._segment)
        tree, follows = self._body.tree, self._body.follows
        by_column = np.zeros((len(tree.column_dof),) * 2) if follows else hessian
        curvature.add_curvature(
            posed.spatial_jacobian, tree.column_joint, tree.column_parent, self._pair_column[contacts.pair],
            self._solid_pairs[contacts.pair], self._kind, self._world, self._segment, self._radius, self._radii,
            contacts.point_a, contacts.point_b, contacts.normal, contacts.distance, factor, by_column,
        )  # fmt: skip
        if follows:
            hessian += self._body.collected_hessian(by_column)

    def distances(self, placed: PlacedBodies) -> tuple[np.ndarray, np.ndarray]:
        """The signed distances of `near` alone, of N poses: where those of each pose begin, (N + 1,), and they, (M,).

        Each is that of `near` to the last bit. Makes no gradients.
        """
        count, size = len(placed.q), len(self.solids)
        world, segment = np.empty((count, size, 12)), np.empty((count, size, 6))
        first, first_left = np.empty((2, count + 1), dtype=np.int64)
        pair, distance, left = find_distances(
            placed.placements, *self._kernel_arrays, self.margin, world, segment, first, first_left
        )
        if not len(left):
            return first, distance
        starts, measured = self._measured_by_coal(left, first_left, world, segment)
        pose = np.concatenate([np.repeat(np.arange(count), np.diff(begins)) for begins in (first, starts)])
        order = np.lexsort((np.concatenate((pair, measured.near)), pose))
        return first + starts, np.concatenate((distance, measured.distance))[order]

    def penetration(self, posed: PosedBody) -> float:
        """Deepest overlap of two parts [m], 0 if none."""
        count = self._measure(posed, 0.0)
        return max(0.0, -float(self._contacts.distance[:count].min())) if count else 0.0

    def _measure(self, posed: PosedBody, margin: float) -> int:
        """Write the pairs below the margin into the buffers; returns how many."""
        contacts = self._contacts
        count, remaining = find_contacts(
            posed.placements, *self._kernel_arrays, margin, self._world, self._segment, self._candidates, *contacts,
            self._left,
        )  # fmt: skip
        if remaining == 0:
            return int(count)
        total = self._ask(self._left[:remaining].tolist(), margin, contacts, count, every_point=True)
        if total > count:
            solids = (self._world, self._segment, self._radius, self._radii)
            _sharpen(solids, self._solid_pairs, contacts, count, total)
        if 0 < count < total:
            order = np.argsort(contacts.near[:total])
            for array in contacts:
                array[:total] = array[order]
        return total

    def _measured_by_coal(
        self, left: np.ndarray, first: np.ndarray, world: np.ndarray, segment: np.ndarray
    ) -> tuple[np.ndarray, _Buffers]:
        """The contacts of N poses among the pairs left, see `find_distances`: where those of each pose begin, (N + 1,),
        and they, without witness points."""
        contacts, total, starts = _Buffers.of(len(left)), 0, np.zeros_like(first)
        remaining = left.tolist()
        for n, (begin, end) in enumerate(pairwise(first.tolist())):
            if begin < end:
                self._world[:] = world[n]
                total = self._ask(remaining[begin:end], self.margin, contacts, total, every_point=False)
            starts[n + 1] = total
        contacts = _Buffers(*(array[:total] for array in contacts))
        if total:  # every solid of every pose is one of many, so that one call sharpens the contacts of all poses
            count, size = world.shape[:2]
            pose = np.repeat(np.arange(count), np.diff(starts))
            pairs = self._solid_pairs[contacts.near] + size * pose[:, None]
            solids = world.reshape(-1, 12), segment.reshape(-1, 6), np.tile(self._radius, count)
            each = contacts._replace(near=np.arange(total))
            _sharpen((*solids, np.tile(self._radii, (count, 1))), pairs, each, 0, total)
        return starts, contacts

    def _ask(self, pairs: list[int], margin: float, contacts: _Buffers, count: int, every_point: bool) -> int:
        """Ask coal for some pairs of the solids in `_world`, and write those below the margin into buffers that hold
        `count` contacts already; returns their new number of entries. Witness points that `_sharpen` does not use are
        left out, unless `every_point`."""
        near, distances, points_a, points_b, normals = contacts
        transforms, result, pointless = self._transforms, self._result, self._requests[0]
        for k in pairs:
            i, j, query, request = self._queries[k] or self._made_query(k)
            for s in (i, j):
                transforms[s].setRotation(self._rotations[s])
                transforms[s].setTranslation(self._translations[s])
            result.clear()
            distance = query(transforms[i], transforms[j], request, result)
            if not distance >= margin:  # NaN is a failed query
                near[count], distances[count], normals[count] = k, distance, result.normal
                if every_point or request is not pointless:
                    points_a[count], points_b[count] = result.getNearestPoint1(), result.getNearestPoint2()
                count += 1
        return count

    def _set_solids(self, body: Body) -> None:
        """Solids as arrays for the kernels, and coal's transforms with views of where the kernels write."""
        solids, n = self.solids, len(self.solids)
        self._joint = np.array([s.joint for s in solids], dtype=np.int64)
        self._local = np.array([[*s.rotation.T.ravel(), *s.translation] for s in solids]).reshape(n, 12)
        self._core = np.array([[*s.core_centre, *s.core_half] for s in solids]).reshape(n, 6)
        self._radius = np.array([s.core_radius for s in solids])
        self._radii = np.array([s.radii for s in solids]).reshape(n, 3)
        self._kind = np.array([_kind(s) for s in solids], dtype=np.int64)
        self._world, self._segment = np.zeros((n, 12)), np.zeros((n, 6))
        self._transforms = [coal.Transform3s() for _ in solids]
        self._rotations = [row[:9].reshape(3, 3).T for row in self._world]
        self._translations = [row[9:] for row in self._world]
        self._result = coal.DistanceResult()

    def _set_pairs(self, pairs: list[tuple[int, int]]) -> None:
        solids, count = self.solids, len(pairs)
        self.pairs: tuple[LinkPair, ...] = tuple((solids[i].link, solids[j].link) for i, j in pairs)
        self._solid_pairs = np.array(pairs, dtype=np.int64).reshape(count, 2)
        self._pair_column = self._body.last_columns(self._joint)[self._solid_pairs]
        self._requests = _request(*_HULL_TOLERANCES), _request(*_ELLIPSOID_TOLERANCES)
        self._queries: list[_Query | None] = [None] * count  # each takes 4 kB: made when the pair first comes near
        self._candidates, self._left = np.zeros((2, count), dtype=np.int64)
        self._contacts = _Buffers.of(count)
        self.arrays = SolidArrays(
            self._joint, self._local, self._core, self._radius, self._radii, self._kind, self._solid_pairs,
            self._pair_column,
        )  # fmt: skip
        self._kernel_arrays = self.arrays[:-1]
        empty = np.zeros((0, 3))
        self._nothing = Contacts(
            np.zeros(0, dtype=np.int64), np.zeros(0), empty, empty, empty, np.zeros((0, self._body.nv))
        )

    def _made_query(self, k: int) -> _Query:
        i, j = self._solid_pairs[k].tolist()
        a, b = self.solids[i], self.solids[j]
        query = coal.ComputeDistance(a.geometry, b.geometry)
        made = i, j, query, self._requests[bool(a.radii.any() or b.radii.any())]
        self._queries[k] = made
        return made

    def _checked(self, pairs: Iterable[LinkPair], place: str) -> set[frozenset[str]]:
        """Pairs of links as sets, every name known."""
        links = sorted({s.link for s in self.solids})
        source, checked = self._body.subject.source, set()
        for pair in pairs:
            names = (pair,) if isinstance(pair, str) else tuple(pair)
            if len(names) != 2 or names[0] == names[1]:
                raise InputError(source, f"{names!r} is not a pair of two links", place=place, remedy="('a', 'b')")
            for name in names:
                if name not in links:
                    remedy = "links with a solid: " + (", ".join(links) or "none")
                    raise InputError(source, f"no solid on a link {name!r}", place=place, remedy=remedy)
            checked.add(frozenset(names))
        return checked

    def _rest_overlaps(self, body: Body) -> dict[LinkPair, float]:
        """Pairs of links that overlap by more than `REST_OVERLAP` at rest, with the deepest overlap of their solids."""
        count = self._measure(body.at(body.neutral), -REST_OVERLAP)
        overlaps: dict[LinkPair, float] = {}
        for k, distance in zip(*(buffer[:count].tolist() for buffer in self._contacts[:2]), strict=True):
            pair = self.pairs[k]
            overlaps[pair] = max(overlaps.get(pair, 0.0), -distance)
        return overlaps

    def _adjusted(
        self, pairs: list[tuple[int, int]], included: set[frozenset[str]], excluded: set[frozenset[str]]
    ) -> list[tuple[int, int]]:
        """The pairs of the tree, less those that overlap at rest, with the user's changes."""
        for a, b in list(self.overlapping_at_rest):
            if frozenset((a, b)) in included:
                del self.overlapping_at_rest[a, b]
        at_rest = {frozenset(pair) for pair in self.overlapping_at_rest}
        chosen = {(i, j) for i, j in pairs if self._links(i, j) not in at_rest | excluded}
        for names in included - excluded:
            added = {(i, j) for i, j in _movable_pairs(self.solids) if self._links(i, j) == names}
            if not added:
                a, b = sorted(names)
                problem = f"{a!r} and {b!r} are fixed to each other"
                raise InputError(self._body.subject.source, problem, place="include", remedy="leave the pair out")
            chosen |= added
        return sorted(chosen)

    def _links(self, i: int, j: int) -> frozenset[str]:
        return frozenset((self.solids[i].link, self.solids[j].link))


def _sharpen(solids: tuple[np.ndarray, ...], pairs: np.ndarray, contacts: _Buffers, first: int, count: int) -> None:
    """Coal's contacts, from `first` to `count`, to the last digits, in place; pairs (., 2): of solids, see
    `broad_phase.candidates`."""
    points = contacts[2:]
    listed: list[Any] = [*solids, pairs, contacts.near, count, contacts.distance, *points]
    failed = witness.sharpen(*[*listed, first, False])
    while failed >= 0:
        i, j = pairs[contacts.near[failed]]
        guess: list[Any] = [*solids, i, j, *(array[failed] for array in points)]
        contacts.distance[failed] = broad_phase.guess_contact(*guess)
        failed = witness.sharpen(*[*listed, failed, True])


def _kind(solid: ConvexSolid) -> int:
    """The kind of solid whose curvature is known, see `curvature`."""
    if isinstance(solid.geometry, coal.Ellipsoid):
        return curvature.ELLIPSOID
    return curvature.CAPSULE if isinstance(solid.geometry, (coal.Capsule, coal.Sphere)) else curvature.UNKNOWN


def _request(gjk_tolerance: float, epa_tolerance: float) -> coal.DistanceRequest:
    """Signed distances; every query starts from the same guess, so that it never depends on the one before."""
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    request.gjk_initial_guess = coal.GJKInitialGuess.DefaultGuess
    request.gjk_tolerance, request.epa_tolerance = gjk_tolerance, epa_tolerance
    request.gjk_max_iterations = request.epa_max_iterations = _ITERATIONS
    return request


def _check_count(source: str, solids: tuple[ConvexSolid, ...]) -> None:
    in_joint = Counter(solid.joint for solid in solids).values()
    pairs = math.comb(len(solids), 2) - sum(math.comb(count, 2) for count in in_joint)
    if pairs > MOST_PAIRS:
        problem = f"{len(solids)} shapes make {pairs} pairs to keep apart, more than {MOST_PAIRS}"
        remedy = "leave shapes out of the URDF, or set cost.interpenetration_weight to 0"
        raise InputError(source, problem, place="collision geometry", remedy=remedy)


def _movable_pairs(solids: tuple[ConvexSolid, ...]) -> list[tuple[int, int]]:
    """Every two solids that a joint parts."""
    n = len(solids)
    return [(i, j) for i in range(n) for j in range(i + 1, n) if solids[i].joint != solids[j].joint]


def _tree_pairs(model: pin.Model, solids: tuple[ConvexSolid, ...]) -> list[tuple[int, int]]:
    """Movable pairs of links that are not adjacent once links without solids are contracted away."""
    solid_links = {s.link for s in solids}
    above = {link: _link_above(model, link, solid_links) for link in solid_links}
    return [
        (i, j)
        for i, j in _movable_pairs(solids)
        if solids[i].link not in (above[solids[j].link], solids[j].link) and above[solids[i].link] != solids[j].link
    ]


def _link_above(model: pin.Model, link: str, solid_links: set[str]) -> str | None:
    """The nearest link with a solid on the way to the root."""
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    while frame.parentFrame != 0:
        frame = model.frames[frame.parentFrame]
        if frame.type == pin.FrameType.BODY and frame.name in solid_links:
            return str(frame.name)
    return None
