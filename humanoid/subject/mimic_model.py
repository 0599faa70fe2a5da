"""Pinocchio models in which joints follow others.

Pinocchio's own reader of <mimic> refuses a master that comes after its follower, which by its order of names is common
(the inner knuckle of a gripper before the knuckle that drives it). So the model is built without, its joints are put
into an order in which masters come first, and then tied.
"""

from __future__ import annotations

from collections.abc import Sequence

import pinocchio as pin

from humanoid.subject.urdf_mimic import Mimic
from humanoid.support.errors import InputError


def with_mimics(model: pin.Model, mimics: Sequence[Mimic], source: str) -> pin.Model:
    """A model, its joints of one degree of freedom each, with some of them following others; the same object where none
    follows.

    The followers stay joints, with placements, but have no entries in configuration and velocity (nq, nv are smaller).
    Other joints keep their order, as far as masters come first.

    Raises
    ------
    InputError: a master hangs on its own follower, so that it is first in no order.
    """
    if not mimics:
        return model
    order = _order(model, mimics, source)
    tied = model if order == sorted(order) else _reordered(model, order)
    for mimic in mimics:
        joints = tied.getJointId(mimic.master), tied.getJointId(mimic.joint)
        tied = pin.transformJointIntoMimic(tied, *joints, mimic.multiplier, mimic.offset)
    return tied


def _order(model: pin.Model, mimics: Sequence[Mimic], source: str) -> list[int]:
    """The joints, each after its parent and its master."""
    master = {model.getJointId(m.joint): model.getJointId(m.master) for m in mimics}
    placed, waiting = [0], list(range(1, model.njoints))
    while waiting:
        ready = (j for j in waiting if model.parents[j] in placed and master.get(j, 0) in placed)
        joint = next(ready, None)
        if joint is None:
            first = next(m for m in mimics if model.getJointId(m.joint) in waiting)
            problem = f"joint {first.joint!r} carries the joint {first.master!r} that it follows"
            remedy = "let the outer joint follow the inner one, with 1/multiplier and -offset/multiplier"
            raise InputError(source, problem, place="<mimic>", remedy=remedy)
        placed.append(joint)
        waiting.remove(joint)
    return placed[1:]


def _reordered(model: pin.Model, order: Sequence[int]) -> pin.Model:
    """The same model with its joints in another order."""
    made = pin.Model()
    made.name = model.name
    place = {0: 0}
    for j in order:
        q = slice(model.idx_qs[j], model.idx_qs[j] + model.nqs[j])
        v = slice(model.idx_vs[j], model.idx_vs[j] + model.nvs[j])
        place[j] = made.addJoint(
            place[model.parents[j]], model.joints[j], model.jointPlacements[j], model.names[j],
            model.effortLimit[v], model.velocityLimit[v], model.lowerPositionLimit[q], model.upperPositionLimit[q],
        )  # fmt: skip
        made.inertias[place[j]] = model.inertias[j]
    frames = {0: 0}
    for i, frame in enumerate(list(model.frames)[1:], 1):
        joint, parent = place[frame.parentJoint], frames[frame.parentFrame]
        copy = pin.Frame(frame.name, joint, parent, frame.placement, frame.type, frame.inertia)
        frames[i] = made.addFrame(copy, False)
    return made
