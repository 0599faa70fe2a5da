"""Rigs from a person of a few seconds: adjusted to few instants, and once for each question that is asked."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import pytest

from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.rigs import calibrate, check, first, search, steadiness
from humanoid.kinematics.body import Body


@pytest.fixture(scope="module", autouse=True)
def quick_rigs() -> Iterator[None]:
    """Few instants, as a motion of six seconds has no more to show; the function, the command and the cameras of a
    track get the same rig where they ask the same."""
    with pytest.MonkeyPatch.context() as patch:
        for module, name, most in (
            (first, "_ITERATIONS", 500), (search, "_MANY", 30), (check, "_INSTANTS", 30),
            (steadiness, "_INSTANTS", 20), (steadiness, "_SPLITS", 4),
        ):  # fmt: skip
            patch.setattr(module, name, most)
        patch.setattr(calibrate, "calibrate_by_person", answered_once(calibrate.calibrate_by_person))
        patch.setattr(check, "check_by_person", answered_once(check.check_by_person))
        yield


def answered_once(work: Callable[..., Any]) -> Callable[..., Any]:
    """The function, which does not work twice where all that it is given is equal."""
    answers: dict[Any, Any] = {}

    @functools.wraps(work)
    def answer(*args: Any, **changes: Any) -> Any:
        asked = question((args, changes))
        if asked not in answers:
            answers[asked] = work(*args, **changes)
        return answers[asked]

    return answer


def question(given: Any) -> Any:
    """What is given, as something that can be a key: by value; of a track without where it was read."""
    if isinstance(given, Body):
        return given.subject.urdf
    if isinstance(given, KeypointTrack):
        return question((given.names, given.pixels, given.confidence))
    if isinstance(given, np.ndarray):
        return given.shape, given.tobytes()
    if isinstance(given, Mapping):
        return tuple((name, question(value)) for name, value in given.items())
    if isinstance(given, (tuple, list)):
        return tuple(map(question, given))
    if hasattr(given, "__dataclass_fields__"):
        return type(given), question({name: getattr(given, name) for name in given.__dataclass_fields__})
    return given
