"""The parts of a body that a motion keeps apart."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from humanoid.collision.self_collision import LinkPair, SelfCollision
from humanoid.kinematics.body import Body


def parts_of(body: Body, margin: float) -> SelfCollision:
    """The pairs of parts that are looked at; margin [m]: below which a pair counts as near.

    Left out are pairs that overlap by anything at `body.neutral`, and pairs that one joint parts: a part is all links
    that are fixed to each other, and hulls of what turns in a socket overlap where its limits let it turn.
    """
    parts = SelfCollision(body, margin=margin)
    overlapping = parts.near(body.at(body.neutral), 0.0)
    left_out = {parts.pairs[k] for k in overlapping.pair} | set(_neighbours(body.model, parts))
    return SelfCollision(body, margin=margin, exclude=sorted(left_out)) if left_out else parts


def kept_distances(body: Body, parts: SelfCollision, clearance: float) -> np.ndarray:
    """Distance [m] (pairs,) that each pair is to keep: the clearance, or what it has at rest where that is less."""
    apart = np.full(len(parts.pairs), clearance)
    near = parts.near(body.at(body.neutral), clearance)
    apart[near.pair] = near.distance
    return apart


def _neighbours(model: pin.Model, parts: SelfCollision) -> Iterator[LinkPair]:
    """Pairs of links whose joints are next to each other once joints without solids are contracted away."""
    joint = {solid.link: solid.joint for solid in parts.solids}
    above = {j: _joint_above(model, j, set(joint.values())) for j in joint.values()}
    for a, b in parts.pairs:
        if joint[a] == above[joint[b]] or joint[b] == above[joint[a]]:
            yield a, b


def _joint_above(model: pin.Model, joint: int, with_solids: set[int]) -> int | None:
    """The nearest joint that carries solids on the way to the root."""
    while joint > 0:
        joint = int(model.parents[joint])
        if joint in with_solids:
            return joint
    return None
