"""Keypoints at instants between the frames they were detected in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator.data.formats.keypoints import KeypointTrack

LONGEST_BRIDGE = 0.1  # frames further apart are not interpolated: what lies between is unknown [s]


def at_places(track: KeypointTrack, places: np.ndarray, times: np.ndarray) -> KeypointTrack:
    """The keypoints at `places` (T,) among the track's frames, see `Timeline`.

    times (N,): of the track's first N frames [s]; others do not count.
    Between two frames a point lies on the line from the one to the other and is as sure as the less sure of the two; it
    is missing where it is missing in either, or where the frames are more than `LONGEST_BRIDGE` apart. A track whose
    first frames are the instants comes back as it is.
    """
    count = len(times)
    if _follows(places, count):
        return track
    known = np.isfinite(places)
    place = np.where(known, places, 0.0)
    lower = np.floor(place).astype(np.int64)
    share = place - lower
    upper = np.minimum(lower + 1, count - 1)
    between = known & (share > 0.0)
    known &= ~between | (times[upper] - times[lower] <= LONGEST_BRIDGE + 1e-6)
    pixels, confidence = track.pixels[lower], track.confidence[lower]
    b, part = between, share[between, None, None]
    pixels[b] = (1.0 - part) * pixels[b] + part * track.pixels[upper[b]]
    confidence[b] = np.minimum(confidence[b], track.confidence[upper[b]])
    pixels[~known], confidence[~known] = np.nan, 0.0
    return replace(track, pixels=pixels, confidence=confidence)


def _follows(places: np.ndarray, count: int) -> bool:
    """Whether the instants are the track's frames from the first on, and none after its end."""
    first = places[:count]
    return bool((first == np.arange(len(first))).all() and np.isnan(places[count:]).all())
