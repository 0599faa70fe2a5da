"""Where a guessed camera stands to a subject that is fixed in the world and cannot be moved before it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from estimator.data.cameras.camera import Camera, camera_before
from estimator.data.formats.keypoints import KeypointTrack
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.point_features import landmark_features
from humanoid.kinematics.body import Body

_FEWEST = 3


def before_subject(
    body: Body, tracks: Mapping[str, KeypointTrack], cameras: Mapping[str, Camera]
) -> tuple[dict[str, Camera], list[str]]:
    """The one camera of a clip, moved to where the subject at rest looks as large as its keypoints in the first frame
    that has enough of them, preferably those of head and trunk, which arms do not move; and a note that says so. As it
    is where no frame has enough."""
    ((name, track),) = tracks.items()
    order = np.array(
        [track.names.index(mark) if mark in track.names else -1 for mark in body.landmark_names], dtype=int
    )
    rest = body.landmarks(body.at(body.neutral))
    still = landmark_features(body, anatomy_of(body)).of_trunk
    for pixels, confidence in zip(track.pixels, track.confidence, strict=True):
        seen = np.flatnonzero((order >= 0) & (np.append(confidence, 0.0)[order] > 0.0))
        chosen = np.intersect1d(seen, still)
        chosen = chosen if len(chosen) >= _FEWEST else seen
        if len(chosen) >= _FEWEST and np.ptp(pixels[order[chosen]], axis=0).max() > 0.0:
            camera = camera_before(cameras[name], rest[chosen], pixels[order[chosen]])
            away = camera.depths(rest[chosen]).mean()
            place = f"level before {body.subject.name}, {away:.2f} m away"
            return {name: camera}, [f"{name} is taken to stand {place}: no camera file says where"]
    return dict(cameras), []
