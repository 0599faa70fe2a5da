"""Time of a self-collision query of human34, against its kinematics; which parts of the query take it.

The unit is one `body.at(q)`, so that figures of different machines compare.
"""

from __future__ import annotations

from collections.abc import Callable
from timeit import repeat

import numpy as np
import pinocchio as pin

from estimator.energy.interpenetration import Interpenetration
from humanoid import load_subject
from humanoid.collision.compiled_contacts import find_contacts
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body, PosedBody

CALLS, ROUNDS = 400, 7


def seconds(call: Callable[[], object]) -> float:
    call()
    return min(repeat(call, number=CALLS, repeat=ROUNDS)) / CALLS


def poses_by_contacts(body: Body, self_collision: SelfCollision, rng: np.random.Generator) -> dict[int, PosedBody]:
    """A pose for every number of near pairs that random poses reach."""
    by_count: dict[int, PosedBody] = {}
    i = body.bounded_q
    for _ in range(3000):
        q = pin.neutral(body.model)
        q[i] = rng.uniform(body.lower[i], body.upper[i])
        posed = body.at(q)
        by_count.setdefault(len(self_collision.near(posed).pair), posed)
    return by_count


def kernel_alone(self_collision: SelfCollision, posed: PosedBody) -> Callable[[], tuple[int, int]]:
    """The contacts that need no coal; returns how many, and how many pairs are left to it."""
    arrays, pairs = self_collision.arrays, len(self_collision.pairs)
    room = (np.zeros((len(arrays.joint), 12)), np.zeros((len(arrays.joint), 6)), *np.zeros((2, pairs), dtype=np.int64))
    points, left = np.zeros((3, pairs, 3)), np.zeros(pairs, dtype=np.int64)
    arguments = (posed.placements, *arrays[:-1], self_collision.margin, *room, np.zeros(pairs), *points, left)
    return lambda: find_contacts(*arguments)


def coal_alone(self_collision: SelfCollision, posed: PosedBody) -> Callable[[], None]:
    """The queries of one pose that the kernel leaves, transforms already set."""
    remaining = kernel_alone(self_collision, posed)()[1]
    self_collision.near(posed)
    transforms, result = self_collision._transforms, self_collision._result
    queries = [self_collision._queries[k] for k in self_collision._left[:remaining]]

    def run() -> None:
        for i, j, query, request in queries:
            result.clear()
            query(transforms[i], transforms[j], request, result)

    return run


def main() -> None:
    body = Body(load_subject("human34"))
    self_collision = SelfCollision(body)
    term = Interpenetration(self_collision)
    unit = seconds(lambda: body.at(body.neutral))
    print(
        f"human34: {len(self_collision.solids)} solids, {len(self_collision.pairs)} pairs;"
        f" body.at(q) {unit * 1e6:.1f} us = 1"
    )
    print(f"{'near pairs':>10} {'near':>8} {'[us]':>8} {'kernel':>8} {'coal':>8} {'rest':>8} {'term':>8}")
    gradient, hessian = np.zeros(body.nv), np.zeros((body.nv, body.nv))
    poses = poses_by_contacts(body, self_collision, np.random.default_rng(0))
    for count in sorted({0, 1, 3, 6, 10} & poses.keys()):
        posed = poses[count]
        whole = seconds(lambda p=posed: self_collision.near(p))  # type: ignore[misc]
        kernel, coal = seconds(kernel_alone(self_collision, posed)), seconds(coal_alone(self_collision, posed))
        energy = seconds(lambda p=posed: term.accumulate(p, gradient, hessian))  # type: ignore[misc]
        shares = [whole, kernel, coal, whole - kernel - coal, energy]
        near, *rest = (f"{share / unit:8.2f}" for share in shares)
        print(f"{count:>10} {near} {whole * 1e6:8.1f} {' '.join(rest)}")
