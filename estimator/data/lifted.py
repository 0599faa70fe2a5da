"""How much of a pose that a network has lifted from each picture is new since the one before."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from estimator.data.observation import Observation

ALIKE = 0.3  # s, in which such a network errs alike: frames so far apart count as independent


def with_shares(observations: Iterable[Observation]) -> list[Observation]:
    """Observations in order, with the lifted pose of each counting as much as it is new: all of it in the first and
    after a gap, in between the share of `ALIKE` that has gone since the one before."""
    last, shared = -np.inf, []
    for observation in observations:
        lifted = observation.lifted
        if lifted is None:
            shared.append(observation)
            continue
        share = float(min(1.0, (observation.time - last) / ALIKE))
        shared.append(replace(observation, lifted=lifted._replace(share=share)))
        last = observation.time
    return shared
