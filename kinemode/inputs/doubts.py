"""Whether several cameras' keypoints agree with the sizes and clocks that were given, or assumed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from estimator.data.agreement import SUSPICIOUS, Agreement, Pair, agreement, likely_order, pairs_of
from estimator.data.cameras.camera import Camera
from estimator.data.cameras.epipolar import seen_points
from estimator.data.clock_rates import Lags
from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.observation import Observation
from estimator.vision.resolution import Size
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError
from kinemode.request import FileOptions

_BONES = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
_LOOKED_AT, _FEWEST = 60, 30  # instants; bones that were seen
_DOUBTFUL = 0.005  # of the picture's longer side, from which other orders of the cameras are tried
_LIKELY = (0.4, 1.5)  # of the subject's lengths: people of 0.7 to 2.6 m
_LONGEST = 1.0  # largest offset searched for [s]
_STEP = 1.0 / 60.0  # finer instants are thinned out to this [s]
_MOST = 1200  # instants used
_STILL = 0.7  # share of the points, the slower ones, that are left out
_FEWEST_LAGS, _SHORTEST = 2, 0.06  # instants, and seconds, that an offset has: less may be a fault of the calibration
_BETTER = 0.85  # share of the distance below which other clocks are believed


def checked_agreement(
    body: Body,
    observations: Sequence[Observation],
    tracks: Mapping[str, KeypointTrack],
    offsets: Mapping[str, float],
    files: FileOptions,
) -> list[str]:
    """Notes where the keypoints of several cameras do not fit each other, see `agreement` and `likely_offsets`.

    tracks: their `image_size` is None where it is unknown. offsets: of the clocks [s].

    Raises
    ------
    InputError: they would fit as those of pictures of another size, and no file or option has that size.
    """
    cameras = observations[0].cameras
    if len(cameras) < 2:
        return []
    pixels = np.array([o.known_pixels for o in observations])
    unknown = [track.image_size is None for track in tracks.values()]
    misfit = agreement(cameras, pixels, unknown if any(unknown) else [True] * len(cameras))
    if misfit is None:
        return []
    if misfit.factor is not None:
        return [_other_size(misfit, tracks, [camera.image_size for camera in cameras], files)]
    doubtful = misfit.distance > _DOUBTFUL * max(max(camera.image_size) for camera in cameras)
    if doubtful and (order := likely_order(cameras, pixels)) is not None:
        names = list(tracks)
        moved = ", ".join(f"{names[k]}'s are of {own}" for own, k in zip(names, order, strict=True) if names[k] != own)
        problem = "the keypoints of the cameras do not fit each other, but would if"
        return [f"{problem} {moved}: are the files' names right?"]
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
    return _unlikely_size(body, cameras, pixels)


def _unlikely_size(body: Body, cameras: Sequence[Camera], pixels: np.ndarray) -> list[str]:
    """A note where the rays meet in a person with impossible limbs, as with translations in another unit."""
    names = body.landmark_names
    if any(camera.parallel for camera in cameras) or not {"left_hip", "head_top"} <= set(names):
        return []
    pairs = [(f"{s}_{a}", f"{s}_{b}") for s in ("left", "right") for a, b in _BONES]
    bones = np.array([[names.index(a), names.index(b)] for a, b in pairs if {a, b} <= set(names)], dtype=int)
    picked = np.unique(np.linspace(0, len(pixels) - 1, min(len(pixels), _LOOKED_AT)).astype(int))
    points = np.stack([seen_points(cameras, pixels[t]) for t in picked])
    own = body.landmarks(body.at(body.neutral))
    lengths = [np.linalg.norm(p[..., bones[:, 0], :] - p[..., bones[:, 1], :], axis=-1) for p in (points, own)]
    known = np.isfinite(lengths[0])
    if known.sum() < _FEWEST:
        return []
    ratio = float(np.median((lengths[0] / lengths[1])[known]))
    if _LIKELY[0] < ratio < _LIKELY[1]:
        return []
    tall = ratio * float(np.ptp(own[:, 2]))
    return [
        f"the cameras' keypoints meet in a person {tall:.2g} m tall: are the cameras' translations metres? At"
        f" {1.0 / ratio:.2g} times these lengths the person is as tall as the subject"
    ]


def _other_size(
    misfit: Agreement, tracks: Mapping[str, KeypointTrack], pictures: Sequence[Size], files: FileOptions
) -> str:
    """The note on keypoints of another size, or the refusal where no file or option has that size."""
    factor = misfit.factor or 1.0
    sizes = {
        name: "x".join(str(round(side / factor)) for side in picture)
        for name, picture in zip(tracks, pictures, strict=True)
    }
    unknown = [name for name, track in tracks.items() if track.image_size is None]
    first = sizes[unknown[0] if unknown else next(iter(tracks))]
    problem = f"the keypoints of the cameras do not fit each other ({misfit.distance:.0f} px apart in the middle)"
    problem += f", those of pictures of {first} would"
    if not unknown or files.keypoint_size is not None:
        return f"{problem}: are the sizes that are declared, and the calibration, right?"
    alike = len(unknown) == len(tracks) and len(set(sizes.values())) == 1
    remedy = first if alike else " ".join(f"{name}={sizes[name]}" for name in unknown)
    raise InputError(tracks[unknown[0]].source or "keypoints", problem, remedy=f"--keypoint-size {remedy}")


def likely_offsets(cameras: Sequence[Camera], pixels: np.ndarray, times: np.ndarray) -> tuple[float, ...]:
    """Delays (C,) [s] of cameras that started later than most, where these make their keypoints fit much better; else
    none.

    pixels (T, C, L, 2) [px], NaN where missing, assumed at the same times (T,) [s]. The offsets are whole steps between
    instants. Points that hardly move determine no offsets, and then there are none.
    """
    if len(times) < 3:
        return ()
    middle = slice(max(0, (len(times) - _MOST) // 2), (len(times) + _MOST) // 2)
    step = float((times[-1] - times[0]) / (len(times) - 1))
    thinned = max(1, int(_STEP / step + 1e-6))
    step, part = step * thinned, pixels[middle][::thinned]
    most = min(int(_LONGEST / step), len(part) // 4)
    seen = [camera.directions(part[:, c]) for c, camera in enumerate(cameras)]
    distances = _distances(pairs_of(cameras), seen, most)
    if distances is None:
        return ()
    lags = distances.best(len(cameras))
    lags -= max(lags.tolist(), key=lags.tolist().count)  # of several that are as many, the first camera's
    small = np.abs(lags).max() < max(_FEWEST_LAGS, _SHORTEST / step)
    left = distances.of(lags)
    fitting = left <= SUSPICIOUS * max(max(camera.image_size) for camera in cameras)  # not so with another person
    if small or not fitting or left > _BETTER * distances.of(np.zeros_like(lags)):
        return ()
    return tuple(-step * lag if lag else 0.0 for lag in lags.tolist())


def _distances(pairs: Sequence[Pair], seen: Sequence[np.ndarray], most: int) -> Lags | None:
    """Distances of the pairs that see enough in common at every lag; None without any."""
    moving = [_moving(pixels) for pixels in seen]
    tables = [(pair, _lagged(pair, moving[pair.a], seen[pair.b], most)) for pair in pairs]
    usable = [(pair.a, pair.b, table) for pair, table in tables if np.isfinite(table).all()]
    if not usable:
        return None
    a, b, table = (np.array(column) for column in zip(*usable, strict=True))
    return Lags(a, b, table, most)


def _moving(seen: np.ndarray) -> np.ndarray:
    """Directions (T, L, 3) without the slower ones: what does not move contains no information on a clock."""
    speed = np.full(seen.shape[:2], np.nan)
    speed[2:-2] = np.linalg.norm(seen[4:] - seen[:-4], axis=-1)
    if not np.isfinite(speed).any():
        return np.full_like(seen, np.nan)
    return np.where((speed >= np.nanquantile(speed, _STILL))[..., None], seen, np.nan)


def _lagged(pair: Pair, first: np.ndarray, second: np.ndarray, most: int) -> list[float]:
    """Distances of a pair with the second camera's rays taken -most to most instants later."""

    def lagged(lag: int) -> float:
        i = np.arange(max(0, -lag), len(first) - max(0, lag))
        return pair.distance(first[i], second[i + lag])

    return [lagged(lag) for lag in range(-most, most + 1)]
