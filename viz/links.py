"""The joints of a body as what they move, and where they are over time."""

from __future__ import annotations

import pinocchio as pin

from humanoid.kinematics.body import Body


def link_names(body: Body) -> tuple[str, ...]:
    """A name for each joint (njoints), no two alike: of the first link that it moves, else its own; joint 0 stands for
    what is fixed to the world."""
    links: dict[int, str] = {}
    for frame in body.model.frames:
        if frame.type == pin.FrameType.BODY and frame.name != "universe":
            links.setdefault(int(frame.parentJoint), frame.name)
    taken = set(links.values())
    own = (f"joint {name}" if name in taken else str(name) for name in body.model.names)
    return tuple(links.get(j, name) for j, name in enumerate(own))
