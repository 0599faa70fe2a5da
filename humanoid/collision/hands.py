"""Hands that a body holds stiffly on its forearms, as it has no wrists."""

from __future__ import annotations

import pinocchio as pin

from humanoid.kinematics.body import Body


def stiff_hands(body: Body) -> tuple[str, ...]:
    """Links that carry a wrist and do not move about it."""
    frames = body.model.frames
    wrists = {landmark.link for landmark in body.subject.landmarks if landmark.name.endswith("_wrist")}
    own = {link: frames[body.model.getFrameId(link, pin.FrameType.BODY)].parentFrame for link in wrists}
    return tuple(sorted(link for link, joint in own.items() if frames[joint].type == pin.FrameType.FIXED_JOINT))
