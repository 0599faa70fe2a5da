"""Which poses lifted from pictures by a network are new measurements."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from estimator.data.observation import Observation

ALIKE = 0.3  # s, correlation time of such a network's errors: frames this far apart count as independent
_TINY = 1e-6  # s


def with_shares(observations: Iterable[Observation]) -> list[Observation]:
    """Observations in order, of which the lifted poses of the first, and of each `ALIKE` seconds after the last that
    counts, count in full and the others not at all."""
    last, shared = -np.inf, []
    for observation in observations:
        lifted = observation.lifted
        if lifted is None:
            shared.append(observation)
            continue
        counts = observation.time - last >= ALIKE - _TINY
        last = observation.time if counts else last
        shared.append(replace(observation, lifted=lifted._replace(share=float(counts))))
    return shared
