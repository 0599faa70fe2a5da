"""A body whose joints turn as far as one likes."""

from __future__ import annotations

import numpy as np

from humanoid.kinematics.body import Body


def unlimited(body: Body) -> Body:
    """The same body without joint limits: for trackers that are to show what the limits are worth (CSS section 6).

    Kinematics, landmarks, stabilisers and rest pose are the same; `lower` and `upper` are infinite, `bounded_v` and
    `bounded_q` empty, so that `clamp` and `integrate` hold nothing back.
    """
    model = body.model.copy()
    model.lowerPositionLimit = np.full(body.nq, -np.inf)
    model.upperPositionLimit = np.full(body.nq, np.inf)
    return Body(body.subject, model)
