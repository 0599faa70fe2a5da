"""Whether the keypoints fit much better as those of another layout of as many points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimator.data.observation import Observation
from estimator.search.cost_model import CostModel
from estimator.search.hypothesis import EXCHANGED
from estimator.tracking.registry import Settings, make_tracker
from estimator.tracking.runner import run
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import mirror_index
from humanoid.subject.subject import Subject
from kinemode.inputs.load import Inputs

_TRIED, _ENOUGH = 4, 8  # frames in which layouts are tried; keypoints that they have at least
_CAPPED, _MUCH_BETTER = 10.0, 0.5  # standard deviations that count at most; share of them that is left


def likely_layout(subject: Subject, inputs: Inputs) -> str:
    """The layout by which the keypoints fit much better than as they were read, as a sentence; empty where none does.

    Poses of a few frames are searched anew for each layout of as many points, without the frames between them.
    """
    if not inputs.other_layouts:
        return ""
    body, settings = Body(subject), Settings()
    own = _misfit(body, inputs.observations, settings)
    misfits = {name: _misfit(body, seen(), settings) for name, seen in inputs.other_layouts.items()}
    best = min(misfits, key=lambda name: misfits[name], default="")
    if not best or not misfits[best] < _MUCH_BETTER * own:
        return ""
    return (
        f"the keypoints fit much better as {best}: at {misfits[best]:.1f} standard deviations in the mean, as they were"
        f" read at {own:.1f}. Track with --layout {best}"
    )


def _misfit(body: Body, observations: Sequence[Observation], settings: Settings) -> float:
    """Mean distance of the keypoints from poses that are searched for them, in standard deviations, none above 10."""
    usable = [o for o in observations if o.count >= _ENOUGH]
    picked = [usable[i] for i in np.unique(np.linspace(0, len(usable) - 1, _TRIED).astype(int))] if usable else []
    tracker, model = make_tracker("css", body), CostModel(body, settings.cost)
    mirror = mirror_index(body.landmark_names)
    far = []
    for observation in picked:
        ((result, _),) = run(tracker, [replace(observation, index=0, cues=())], 0)
        if len(result.q):
            seen = observation.exchanged(mirror) if result.association[0] == EXCHANGED else observation
            distances = model.observation_term(seen).distances(body.at(result.q[0]))
            far.append(np.nanmean(np.minimum(distances, _CAPPED)))
    return float(np.mean(far)) if far else np.inf
