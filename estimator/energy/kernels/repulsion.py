"""Compiled kernels of the terms against overlap: of body parts, and of parts below a floor."""

from __future__ import annotations

import numpy as np

from estimator.energy.kernels.records import FLOOR, REPULSION, Record, record_of
from estimator.numerics.robust import rho
from estimator.numerics.vectors import cross, dot
from humanoid.collision.compiled_contacts import find_contacts
from humanoid.collision.curvature import add_curvature
from humanoid.collision.floor import RoundPieces, lowest_point
from humanoid.collision.self_collision import SolidArrays
from humanoid.collision.witness import gradients
from humanoid.support.compiled import jit

_DEEPEST = 3.0  # exponent beyond which the potential continues as a parabola: for power 1, from three scales inside


@jit
def potential(distance: float, scale: float, power: float) -> tuple[float, float, float]:
    """exp(-z |z|^(power - 1)), capped, with its first and second derivative by the distance."""
    z = distance / scale
    deepest = -(_DEEPEST ** (1.0 / power))
    at = max(z, deepest)
    size = abs(at)
    f = np.exp(-at * size ** (power - 1.0))
    slope = power * size ** (power - 1.0)
    # the curvature of the exponent is infinite at contact for powers between 1 and 2
    bend = power * (power - 1.0) * max(size, 0.1) ** (power - 2.0) if power > 1.0 else 0.0
    first, second = -f * slope, f * (slope * slope + (bend if at < 0.0 else -bend))
    beyond = z - at
    value = f + beyond * (first + 0.5 * beyond * second)
    return value, (first + beyond * second) / scale, second / (scale * scale)


@jit
def slopes_of(distance: np.ndarray, settings: np.ndarray) -> np.ndarray:
    """Derivatives (M,) of the energy by the distance (M,) of each contact; settings (6,)."""
    scale, weight, power, _, slope, _ = settings
    slopes = np.empty(distance.size)
    for m in range(distance.size):
        slopes[m] = weight * (potential(distance[m], scale, power)[1] - slope)
    return slopes


@jit
def add_repulsion(
    distance: np.ndarray,
    rows: np.ndarray,
    settings: np.ndarray,
    gradient: np.ndarray,
    hessian: np.ndarray,
    exact: bool,
) -> float:
    """Sum over contacts: distance (M,), rows (M, nv) its gradients; adds to gradient (nv,) and hessian (nv, nv)."""
    scale, weight, power, value, slope, margin = settings
    moving = np.empty(rows.shape[1], dtype=np.int64)
    total = 0.0
    for m in range(distance.size):
        d = distance[m]
        f, first, second = potential(d, scale, power)
        total += weight * (f - value - slope * (d - margin))
        first, second = weight * (first - slope), weight * (second if exact else max(second, 0.0))
        count = 0
        for k in range(rows.shape[1]):
            if rows[m, k] != 0.0:
                moving[count] = k
                count += 1
        for i in moving[:count]:
            gradient[i] += first * rows[m, i]
            for j in moving[:count]:
                hessian[i, j] += second * (rows[m, i] * rows[m, j])  # symmetric to the last bit
    return total


@jit
def repulsion_values(first: np.ndarray, distance: np.ndarray, settings: np.ndarray, values: np.ndarray) -> None:
    """Fill values (N,) with those of `add_repulsion`; first (N + 1,): contacts first[n] to first[n + 1] - 1, of
    distance (C,) [m], are those of pose n."""
    scale, weight, power, value, slope, margin = settings
    for n in range(values.size):
        total = 0.0
        for m in range(first[n], first[n + 1]):
            f = potential(distance[m], scale, power)[0]
            total += weight * (f - value - slope * (distance[m] - margin))
        values[n] = total


def repulsion_record(solids: SolidArrays, settings: np.ndarray) -> Record:
    """The term of S solids in P pairs; settings (6,): see `add_repulsion`."""
    joint, local, core, radius, radii, kind, pairs, pair_column = solids
    numbers = [settings, local, core, radius, radii]
    return record_of(REPULSION, [len(joint), len(pairs), joint, kind, pairs, pair_column], numbers)


@jit
def recorded_repulsion(  # type: ignore[no-untyped-def]
    integers, numbers, placements, J, dof_joint, dof_parent, exact, gradient, hessian
):
    """Value of the term and whether it is done, of a record's integers (I,) and numbers (F,); where it is not, as a
    pair is left to coal, it adds nothing.

    placements (njoints, 12), J (nc, 6), dof_joint, dof_parent (nc,), gradient (nc,), hessian (nc, nc): see `evaluate`.
    """
    S, P, settings = integers[0], integers[1], numbers[:6]
    joint, kind, o = integers[2 : 2 + S], integers[2 + S : 2 + 2 * S], 2 + 2 * S
    pairs, pair_column = integers[o : o + 2 * P].reshape(P, 2), integers[o + 2 * P : o + 4 * P].reshape(P, 2)
    local, core = numbers[6 : 6 + 12 * S].reshape(S, 12), numbers[6 + 12 * S : 6 + 18 * S].reshape(S, 6)
    radius, radii = numbers[6 + 18 * S : 6 + 19 * S], numbers[6 + 19 * S : 6 + 22 * S].reshape(S, 3)
    world, segment, distance = np.empty((S, 12)), np.empty((S, 6)), np.empty(P)
    candidates, near, left = np.empty(P, np.int64), np.empty(P, np.int64), np.empty(P, np.int64)
    point_a, point_b, normal = np.empty((P, 3)), np.empty((P, 3)), np.empty((P, 3))
    count, remaining = find_contacts(
        placements, joint, local, core, radius, radii, kind, pairs, settings[5], world, segment, candidates, near,
        distance, point_a, point_b, normal, left,
    )  # fmt: skip
    if remaining > 0 or count == 0:
        return 0.0, remaining == 0
    near, distance, last = near[:count], distance[:count], pair_column[near[:count]]
    point_a, point_b, normal = point_a[:count], point_b[:count], normal[:count]
    if exact:
        add_curvature(
            J, dof_joint, dof_parent, last, pairs[near], kind, world, segment, radius, radii, point_a, point_b, normal,
            distance, slopes_of(distance, settings), hessian,
        )  # fmt: skip
    rows = gradients(J, dof_parent, last, point_a, point_b, normal)
    return add_repulsion(distance, rows, settings, gradient, hessian, exact), True


@jit
def raise_pieces(  # type: ignore[no-untyped-def]
    placements, J, column_parent, joint, column, centre, half_axes, normal, height, precision, kind, nu, exact,
    gradient, hessian,
):  # fmt: skip
    """Value of P pieces; adds the derivatives of those below the floor to gradient (nc,) and hessian (nc, nc).

    placements (njoints, 12). J (nc, 6), column_parent (nc,): see `estimator.energy.points`. joint, column (P,), centre
    (P, 3), half_axes (P, 3, 3): see `RoundPieces`. normal (3,), height: of the floor.
    """
    value = 0.0
    point = np.empty(3)
    for n in range(joint.shape[0]):
        d = lowest_point(placements[joint[n]], centre[n], half_axes[n], normal, point) - height
        if d >= 0.0:
            continue
        cost, slope, bend = rho(kind, d * d * precision, nu)
        value += 0.5 * cost
        pull = slope * precision * d
        stiff = precision * (slope + 2.0 * bend * d * d * precision if exact else slope)
        moment = cross(point, normal)  # normal . (v + w x point)
        i = column[n]
        while i >= 0:
            along = dot(normal, J[i]) + dot(moment, J[i, 3:])
            gradient[i] += pull * along
            k = i
            while k >= 0:
                s = stiff * along * (dot(normal, J[k]) + dot(moment, J[k, 3:]))
                hessian[i, k] += s
                if k != i:
                    hessian[k, i] += s
                k = column_parent[k]
            i = column_parent[i]
    return value


@jit
def floor_values(  # type: ignore[no-untyped-def]
    placements, joint, centre, half_axes, normal, height, precision, kind, nu, values
):
    """Fill values (N,) with those of `raise_pieces` for placements (N, njoints, 12)."""
    point = np.empty(3)
    for s in range(placements.shape[0]):
        value = 0.0
        for n in range(joint.shape[0]):
            d = lowest_point(placements[s, joint[n]], centre[n], half_axes[n], normal, point) - height
            if d < 0.0:
                value += 0.5 * rho(kind, d * d * precision, nu)[0]
        values[s] = value


def floor_record(
    pieces: RoundPieces, normal: np.ndarray, height: float, precision: float, kind: int, nu: float
) -> Record:
    """The term, see `raise_pieces`."""
    joint, column, centre, half_axes = pieces
    return record_of(FLOOR, [len(joint), kind, joint, column], [height, precision, nu, normal, centre, half_axes])


@jit
def recorded_floor(integers, numbers, placements, J, column_parent, exact, gradient, hessian):  # type: ignore[no-untyped-def]
    """`raise_pieces` of a record's integers (I,) and numbers (F,)."""
    P, kind, joint, column = integers[0], integers[1], integers[2:], integers[2 + integers[0] :]
    height, precision, nu, normal = numbers[0], numbers[1], numbers[2], numbers[3:6]
    centre, half_axes = numbers[6 : 6 + 3 * P].reshape(P, 3), numbers[6 + 3 * P : 6 + 12 * P].reshape(P, 3, 3)
    return raise_pieces(
        placements, J, column_parent, joint[:P], column[:P], centre, half_axes, normal, height, precision, kind, nu,
        exact, gradient, hessian,
    )  # fmt: skip
