"""Pictures of one view at several sizes: cameras and keypoints brought to one of them, and doubts about the size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack
from humanoid.support.errors import InputError

Size = tuple[int, int]
"""Width, height [px]."""

SURE = 0.5  # confidence from which a keypoint's place is used to check the picture's size
_FEWEST = 20
_MANY_OUTSIDE, _MOST_OUTSIDE = 0.1, 0.5
_CORNER = 0.51  # share of both sides that keypoints of half the size stay within
_REMEDY = "give what the detector saw with --keypoint-size WxH"


def shown(size: Size) -> str:
    """A size as text."""
    return "{} x {}".format(*size)


def same_aspect(a: Size, b: Size) -> bool:
    """Whether one picture can be the other resized, with sides of whole pixels."""
    small, large = sorted((a, b))
    sx, sy = small[0] / large[0], small[1] / large[1]
    return abs(large[1] * sx - small[1]) <= 1.0 or abs(large[0] * sy - small[0]) <= 1.0


def resized_camera(camera: Camera, size: Size) -> Camera:
    """The camera of the same pictures resized: with pixel centres at integers, x becomes (x + 0.5) s - 0.5."""
    sx, sy = (new / old for new, old in zip(size, camera.image_size, strict=True))
    T_new_old = np.array([[sx, 0.0, 0.5 * sx - 0.5], [0.0, sy, 0.5 * sy - 0.5], [0.0, 0.0, 1.0]])
    return replace(camera, image_size=size, K=T_new_old @ camera.K)


def scaled_camera(camera: Camera, factor: float) -> Camera:
    """The camera of an image resized by `factor`.

    Image sides are rounded to whole pixels, and K follows the ratio of the rounded sides, as resizing does.
    """
    size = (max(1, round(camera.image_size[0] * factor)), max(1, round(camera.image_size[1] * factor)))
    return resized_camera(camera, size)


def resized_pixels(pixels: np.ndarray, old: Size, new: Size) -> np.ndarray:
    """Places (..., 2) [px] in pictures of size `old`, in pictures resized to `new`: pixel centres are at integers."""
    return np.asarray((pixels + 0.5) * (np.array(new) / np.array(old)) - 0.5)


def resized_track(track: KeypointTrack, old: Size, new: Size) -> KeypointTrack:
    """Keypoints found in pictures of size `old`, in pictures resized to `new`."""
    return replace(track, pixels=resized_pixels(track.pixels, old, new), image_size=new)


def declared_size(track: KeypointTrack, given: Size | None) -> Size | None:
    """Size of the pictures that the detector saw, None where neither the file nor the user gives it.

    Raises InputError where they contradict each other.
    """
    if given is not None and track.image_size is not None and given != track.image_size:
        problem = f"declares pictures of {shown(track.image_size)}, --keypoint-size has {shown(given)}"
        raise InputError(track.source, problem, remedy="leave the option out, or correct image_size in the file")
    return given or track.image_size


def fitted_track(
    name: str, track: KeypointTrack, size: Size | None, picture: Size
) -> tuple[KeypointTrack, tuple[str, ...]]:
    """Keypoints of pictures of `size`, None where it is unknown, as they are in pictures of size `picture`; and notes.

    Raises
    ------
    InputError: another aspect; most keypoints outside the picture.
    """
    if size is None:
        return track, doubts(name, track, picture, declared=False)
    if size == picture:
        return replace(track, image_size=size), doubts(name, track, picture, declared=True)
    if not same_aspect(size, picture):
        problem = f"image sizes of {name!r} disagree: keypoints {shown(size)}, pictures {shown(picture)}"
        raise InputError(
            track.source or name, problem, remedy="keypoints of the same pictures, of any size, are needed"
        )
    scaled = resized_track(track, size, picture)
    note = f"{name}: keypoints of pictures of {shown(size)} are scaled to {shown(picture)}"
    return scaled, (note, *doubts(name, scaled, picture, declared=True))


def fitted_camera(camera: Camera, picture: Size, source: str) -> tuple[Camera, tuple[str, ...]]:
    """The camera of pictures of size `picture`, and notes; raises InputError, naming `source`, for another aspect."""
    if tuple(camera.image_size) == tuple(picture):
        return camera, ()
    before, after = shown(camera.image_size), shown(picture)
    if not same_aspect(camera.image_size, picture):
        problem = f"image sizes of {camera.name!r} disagree: camera {before}, pictures {after}"
        raise InputError(source, problem, remedy="a calibration of pictures of the same aspect is needed")
    note = f"{camera.name}: calibrated at {before}, scaled to {after}"
    return resized_camera(camera, picture), (note,)


def doubts(name: str, track: KeypointTrack, picture: Size, *, declared: bool) -> tuple[str, ...]:
    """Notes where keypoints look like those of pictures of another size.

    declared: whether the user has confirmed the size. Raises InputError where not, and most are outside.
    """
    points = track.pixels[(track.confidence >= SURE) & np.isfinite(track.pixels).all(axis=-1)]
    if len(points) < _FEWEST:
        return ()
    place = (points + 0.5) / np.array(picture)
    outside = float(np.mean(((place < 0.0) | (place > 1.0)).any(axis=1)))
    problem = f"{outside:.0%} of the keypoints lie outside the picture of {shown(picture)}"
    if outside > _MOST_OUTSIDE and not declared:
        raise InputError(track.source or name, problem, remedy=f"is it of other pictures? {_REMEDY}")
    if outside > _MANY_OUTSIDE:
        return (f"{name}: {problem}",)
    if not declared and (np.quantile(place, 0.98, axis=0) <= _CORNER).all():
        half = f"{picture[0] // 2}x{picture[1] // 2}"
        where = f"all keypoints lie in the top left quarter of the picture of {shown(picture)}"
        return (f"{name}: {where}, as those of a smaller picture would; if so, --keypoint-size {half}, or what it was",)
    return ()
