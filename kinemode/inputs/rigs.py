"""`--cameras auto`: cameras, and clocks, that are found from the person who moves before them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import PeopleFile
from estimator.data.timing import CameraClock
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError
from kinemode.named import named_pairs
from kinemode.request import AUTO, FileOptions

if TYPE_CHECKING:
    from estimator.data.rigs.calibrate import PersonCalibration
    from estimator.data.rigs.check import RigCheck

BY_PERSON = AUTO
"""What stands for a camera file where the cameras are found from the person."""


def rig_by_person(
    body: Body,
    people: Mapping[str, PeopleFile],
    persons: Mapping[str, str],
    lenses: Mapping[str, Camera],
    clocks: Mapping[str, CameraClock],
    files: FileOptions,
) -> PersonCalibration:
    """The cameras, of pictures of the size that the detectors saw, and how much later each clock began.

    persons: who is followed in each camera. lenses: of the cameras, of that size. Clocks are found unless every
    camera but one has an offset.

    Raises InputError: as `estimator.data.rigs.calibrate.calibrate_by_person`; no keypoint files.
    """
    from estimator.data.rigs.calibrate import calibrate_by_person
    from estimator.fitting.fit import stature

    if not people:
        raise InputError("--cameras auto", "is found from keypoints", remedy="--detect, or --keypoints FILE for each")
    given = {name for name, _ in named_pairs(files.offset)}
    size = 1.0 if files.height is None else files.height / stature(body.subject)
    return calibrate_by_person(
        body,
        {name: file.one(persons[name]) for name, file in people.items()},
        lenses,
        {name: clocks[name].offset + clocks[name].keypoints for name in people},
        clocks_known=len(given & set(people)) >= len(people) - 1,
        size=size,
    )


def check_by_cameras(
    body: Body,
    people: Mapping[str, PeopleFile],
    persons: Mapping[str, str],
    cameras: Mapping[str, Camera],
    times: Mapping[str, np.ndarray],
) -> RigCheck:
    """Whether a person's motion agrees with given cameras, of pictures of the size that the detectors saw; times [s]:
    of the frames, on one clock.

    Raises InputError: as `estimator.data.rigs.check.check_by_person`.
    """
    from estimator.data.rigs.check import check_by_person
    from estimator.fitting.fit import stature

    check = check_by_person(body, {name: file.one(persons[name]) for name, file in people.items()}, cameras, times)
    tall = f"by these cameras the person is {check.size * stature(body.subject):.2f} m tall, to about 3 %"
    return replace(check, notes=(tall,))


def with_offsets(clocks: Mapping[str, CameraClock], rig: PersonCalibration) -> dict[str, CameraClock]:
    """The clocks that begin as they were found to."""
    return {
        name: replace(clock, offset=round(clock.offset + rig.offsets.get(name, 0.0), 4))
        for name, clock in clocks.items()
    }


def rig_notes(rig: PersonCalibration) -> list[str]:
    """What the user should know."""
    first, *others = rig.cameras
    places = ", ".join(
        f"{name} to {rig.turn_stds[name]:.1f} degrees and {100.0 * rig.shift_stds[name]:.0f} cm" for name in others
    )
    notes = [f"cameras are found from the person, beside {first}: {places}; they fit by {_errors(rig)}"]
    if any(rig.offset_stds[name] > 0.0 for name in others):
        late = ", ".join(f"{name}={rig.offsets[name]:.3f}" for name in others)
        notes.append(f"clocks from the person, seconds after {first}: {late}; give another with --offset")
    return [*notes, *rig.notes]


def _errors(rig: PersonCalibration) -> str:
    errors = np.array(list(rig.errors.values()))
    return f"{errors.min():.1f} to {errors.max():.1f} px"
