"""What several cameras' keypoints say of the sizes and clocks that the user gave, or did not give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from estimator.data.agreement import Agreement, agreement
from estimator.data.clock_offsets import likely_offsets
from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.observation import Observation
from estimator.vision.resolution import Size
from humanoid.support.errors import InputError
from kinemode.inputs.declared import Declared


def checked_agreement(
    observations: Sequence[Observation],
    tracks: Mapping[str, KeypointTrack],
    offsets: Mapping[str, float],
    told: Declared,
) -> list[str]:
    """Notes where the keypoints of several cameras do not fit each other, see `agreement` and `likely_offsets`.

    tracks: their `image_size` is None where it is unknown. offsets: of the clocks [s].

    Raises
    ------
    InputError: they would fit as those of pictures of another size, and no file or option says what size it was.
    """
    cameras = observations[0].cameras
    if len(cameras) < 2:
        return []
    pixels = np.array([np.where((o.confidence > 0.0)[..., None], o.pixels, np.nan) for o in observations])
    unknown = [track.image_size is None for track in tracks.values()]
    misfit = agreement(cameras, pixels, unknown if any(unknown) else [True] * len(cameras))
    if misfit is None:
        return []
    if misfit.factor is not None:
        return [_other_size(misfit, tracks, [camera.image_size for camera in cameras], told)]
    late = likely_offsets(cameras, pixels, np.array([o.time for o in observations]))
    if late:
        better = [offsets[name] + more for name, more in zip(tracks, late, strict=True)]
        remedy = " ".join(f"{name}={at:.2f}" for name, at in zip(tracks, better, strict=True) if at)
        told_of = "the keypoints of the cameras fit each other much better at other times"
        return [f"{told_of}: did they start one after the other? --offset {remedy}"]
    if misfit.far:
        return [
            f"the keypoints of the cameras do not fit each other: {misfit.distance:.0f} px apart in the middle; are the"
            " calibration, the cameras' names, the clocks (--offset) and the person right?"
        ]
    return []


def _other_size(
    misfit: Agreement, tracks: Mapping[str, KeypointTrack], pictures: Sequence[Size], told: Declared
) -> str:
    """The note on keypoints of another size, or the refusal where no file or option says what size it was."""
    factor = misfit.factor or 1.0
    sizes = {
        name: "x".join(str(round(side / factor)) for side in picture)
        for name, picture in zip(tracks, pictures, strict=True)
    }
    unknown = [name for name, track in tracks.items() if track.image_size is None]
    first = sizes[unknown[0] if unknown else next(iter(tracks))]
    problem = f"the keypoints of the cameras do not fit each other ({misfit.distance:.0f} px apart in the middle)"
    problem += f", those of pictures of {first} would"
    if not unknown or told.keypoint_size is not None:
        return f"{problem}: are the sizes that are declared, and the calibration, right?"
    alike = len(unknown) == len(tracks) and len(set(sizes.values())) == 1
    remedy = first if alike else " ".join(f"{name}={sizes[name]}" for name in unknown)
    raise InputError(tracks[unknown[0]].source or "keypoints", problem, remedy=f"--keypoint-size {remedy}")
