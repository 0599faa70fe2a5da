"""Observations of every instant from keypoint tracks, and which lifted poses of a network are new measurements."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.image_cues import ImageCues
from estimator.data.observation import LiftedPose, Observation
from estimator.data.standing import with_standing
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError

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


GIVEN = "landmarks"  # layout of points that a person gave, by the subject's own names
_FEWEST_LANDMARKS = 4
_FEWEST_DIFFERENCES = 50


def assemble(
    body: Body,
    tracks: Mapping[str, KeypointTrack],
    cameras: Mapping[str, Camera],
    times: np.ndarray,
    *,
    clip_sizes: Mapping[str, tuple[int, int]] | None = None,
    detected: Mapping[str, KeypointTrack] | None = None,
) -> list[Observation]:
    """Observations (T) of all cameras with keypoints, in the order of `tracks`.

    A landmark whose keypoint a layout lacks stays missing; a track without any names is one without keypoints. A track
    shorter than `times` (T,) [s] is missing at its end, a longer one is cut; with a note by `timing.length_notes`.
    detected: the keypoints frame by frame as the detector gave them, of tracks that were brought to other instants:
    interpolation hides their jitter. A track's pose in space counts where it is the only one.

    Raises
    ------
    InputError: a track without its camera, image sizes that disagree, fewer than 4 landmarks in common.
    """
    if not tracks:
        raise InputError("keypoints", "none given")
    shape = (len(times), len(tracks), len(body.landmark_names))
    pixels, confidence = np.full((*shape, 2), np.nan), np.zeros(shape)
    used: list[Camera] = []
    jitter: list[float] = []
    for c, (name, track) in enumerate(tracks.items()):
        used.append(_camera(name, track, cameras, (clip_sizes or {}).get(name)))
        here, there = common_landmarks(body.landmark_names, track) if track.names else ([], [])
        count = min(len(times), track.frame_count)
        pixels[:count, c, here] = track.pixels[:count, there]
        confidence[:count, c, here] = track.confidence[:count, there]
        whole = (detected or {}).get(name)
        jitter.append(keypoint_jitter(pixels[:, c] if whole is None else whole.pixels[:, there]))
    given = all(track.layout == GIVEN for track in tracks.values())
    lifted = _lifted_poses(body, list(tracks.values()), len(times))
    observations = (
        Observation(i, float(t), tuple(used), pixels[i], confidence[i], tuple(jitter), given, lifted=lifted[i])
        for i, t in enumerate(np.asarray(times).tolist())
    )
    return with_shares(with_standing(observations, body.landmark_names))


def _lifted_poses(body: Body, tracks: Sequence[KeypointTrack], count: int) -> list[LiftedPose | None]:
    """Lifted pose of each of `count` instants; none where there are several tracks."""
    world = tracks[0].world
    if len(tracks) > 1 or world is None:
        return [None] * count
    here, there = common_landmarks(body.landmark_names, tracks[0])
    points = np.full((count, len(body.landmark_names), 3), np.nan)
    points[: len(world), here] = world[:count, there]
    return [None if np.isnan(p).all() else LiftedPose(p) for p in points]


def keypoint_jitter(pixels: np.ndarray) -> float:
    """Standard deviation [px] of the jitter in a track of keypoints, pixels (T, L, 2) with NaN where missing.

    From the median size of the second differences in time: bodies move smoothly, errors of detectors do not, and
    outliers do not reach a median. Errors that last for several frames are seen in part. Zero for a track too short.
    """
    second = np.abs(np.diff(pixels, n=2, axis=0)) if len(pixels) > 2 else np.zeros(0)
    second = second[np.isfinite(second)]
    if second.size < _FEWEST_DIFFERENCES:
        return 0.0
    return float(np.median(second) / (0.6745 * np.sqrt(6.0)))  # of a normal distribution; 1, -2, 1 squared add to 6


def common_landmarks(landmarks: Sequence[str], track: KeypointTrack) -> tuple[list[int], list[int]]:
    """Places of the landmarks a track has: in the body and in the track."""
    place: dict[str, int] = {}
    for j, name in enumerate(track.names):
        if name is not None:
            place.setdefault(name, j)
    here = [i for i, name in enumerate(landmarks) if name in place]
    if len(here) < _FEWEST_LANDMARKS:
        problem = f"has {len(here)} of the subject's landmarks, at least {_FEWEST_LANDMARKS} are needed"
        remedy = f"subject: {', '.join(landmarks) or 'none'}; {track.layout}: {', '.join(place) or 'none'}"
        raise InputError(track.source or "keypoints", problem, remedy=remedy)
    return here, [place[landmarks[i]] for i in here]


def _camera(
    name: str, track: KeypointTrack, cameras: Mapping[str, Camera], clip_size: tuple[int, int] | None
) -> Camera:
    if name not in cameras:
        known = ", ".join(cameras) or "none"
        raise InputError(track.source or "keypoints", f"there is no camera {name!r}", remedy=f"cameras: {known}")
    sizes = {"camera": cameras[name].image_size, "keypoints": track.image_size, "clip": clip_size}
    stated = {what: tuple(size) for what, size in sizes.items() if size is not None}
    if len(set(stated.values())) > 1:
        each = ", ".join(f"{what} {w} x {h}" for what, (w, h) in stated.items())
        raise InputError(track.source or name, f"image sizes of {name!r} disagree: {each}")
    return cameras[name]


Progress = Callable[[int, int], None]
"""Called with how many instants of how many are done."""


class Cues(Protocol):
    """Source of image cues (see `estimator.vision.cues.reader.CueReader`)."""

    def at(self, index: int) -> tuple[ImageCues, ...]:
        """The cues of every camera at a frame."""
        ...
