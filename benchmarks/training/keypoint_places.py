"""Where MediaPipe marks people, off from human34's landmarks: the numbers of humanoid/subject/layout_places.

Two phone films of people whose joint centres are known from markers (OpenCap). The camera is found from these (PnP,
shoulders to ankles); what a keypoint is off from its joint centre in the picture is explained by one offset in the
frame of a link, by least squares over the film, drawn to zero where the view leaves it open. Both films were taken from
one side, and where a hip or a knee is marked is part of the view. So only heels and toes, which are other points for a
detector than for a body, have a mean; it is shrunk to zero as far as two people and two sides are consistent with
chance. The others have the deviation about zero alone. Feet: from human34's heel and toes to where the laboratory's
model has these, and from there to the keypoints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from cyclopts import Parameter

from benchmarks.accuracy.degrees import FILMS, columns_of
from benchmarks.support.common import Data, Json, Several, data_folder, save
from estimator.data.formats.keypoints import load_keypoints
from estimator.numerics.vectors import unit
from humanoid.subject.keypoint_places import MIRROR_Y, PLACES_FOLDER
from humanoid.subject.landmarks import without_side
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

LAYOUT = "mediapipe33"
SIDES = ("left", "right")
PARTS = ("shoulder", "hip", "knee", "ankle", "heel", "big_toe")
_CORE = ("shoulder", "hip", "knee", "ankle")
_FOCAL = 0.7  # of the longer side: phones
_OFF_PX, _EVERY = 14.0, 3  # px of an inlier of PnP; frames
_KEYPOINT_STD, _OFFSET_STD = 0.02, 0.03  # m: of a keypoint about its place, of a place before anything is seen
_INDEPENDENT = 20.0  # similar frames count as so many in total
_GROSS = 0.15  # m
_LEAST_STD = 0.01  # m
_FOOT = ("heel", "big_toe")


class FilmedPerson(NamedTuple):
    """points (T, J, 3) [m] of names (J) in a world with z up; pixels (T, J, 2). R (3, 3), t (3,): world to camera."""

    names: tuple[str, ...]
    points: np.ndarray
    pixels: np.ndarray
    R: np.ndarray
    t: np.ndarray
    focal: float
    centre: np.ndarray

    def of(self, name: str) -> np.ndarray:
        """Points (T, 3) of a name."""
        return self.points[:, self.names.index(name)]


def main(
    *,
    films: Annotated[tuple[str, ...], Several] = FILMS,
    write: Annotated[bool, Parameter(negative="")] = False,
    data: Data = None,
    json: Json = None,
) -> None:
    """Print the places of keypoints on the people of phone films, and their mean.

    Parameters
    ----------
    films
        Whose people the places are learned from. To test them on a film, leave it out.
    write
        Write the file that is shipped.
    """
    folder = data_folder(data)
    if folder is None or not (folder / "opencap").is_dir():
        print("the data has no folder opencap: nothing is learned")
        return
    people = {film: places_of(filmed_person(folder / "opencap" / film)) for film in films}
    mean = {
        part: mean_place(
            [people[film][f"{side}_{part}"] for film in films for side in SIDES], centred=part not in _FOOT
        )
        for part in PARTS
    }
    made = report.table("off from human34's landmark: forward, left, up [mm]", "keypoint", *films, "place", "std")
    for part in PARTS:
        for side in SIDES:
            made.add_row(f"{side}_{part}", *(_millimetres(people[film][f"{side}_{part}"]) for film in films), "", "")
        made.add_row(part, *("" for _ in films), _millimetres(mean[part][0]), f"{1e3 * mean[part][1]:.0f}")
    report.console().print(made)
    if write:
        path = PLACES_FOLDER / f"{LAYOUT}.toml"
        head = path.read_text(encoding="utf-8").partition("[keypoints]")[0]
        path.write_text(f"{head}[keypoints]\n{entries(mean)}", encoding="utf-8")
        print(f"written: {path.name}")
    save(json, {"measure": "keypoint places", **{k: [*v[0].tolist(), v[1]] for k, v in mean.items()}})


def filmed_person(place: Path) -> FilmedPerson:
    """The frames of a film whose joint centres are known; the right side is not mirrored."""
    column = columns_of(place / "truth.csv.gz")
    track = load_keypoints(place / f"{place.name}.json")
    assert track.fps is not None
    time = np.arange(track.frame_count) / track.fps
    rows = np.flatnonzero((time >= column["time"][0]) & (time <= column["time"][-1]))
    names = tuple(f"{side}_{part}" for part in PARTS for side in SIDES)
    theirs = [name.replace("big_toe", "toe") for name in names]
    points = np.stack(
        [np.stack([np.interp(time[rows], column["time"], column[f"{n}_{a}"]) for a in "xyz"], axis=1) for n in theirs],
        axis=1,
    )
    pixels = track.pixels[np.ix_(rows, np.array([track.names.index(name) for name in names]))]
    assert track.image_size is not None
    focal, centre = _FOCAL * max(track.image_size), (np.array(track.image_size) - 1.0) / 2.0
    core = [k for k, name in enumerate(names) if without_side(name) in _CORE]
    known = points[::_EVERY][:, core].reshape(-1, 3), pixels[::_EVERY][:, core].reshape(-1, 2).copy()
    K = np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])
    _, r, t, inliers = cv2.solvePnPRansac(
        *known, K, None, reprojectionError=_OFF_PX, iterationsCount=500, flags=cv2.SOLVEPNP_SQPNP
    )
    good = inliers[:, 0]
    r, t = cv2.solvePnPRefineLM(known[0][good], known[1][good], K, None, r, t)
    return FilmedPerson(names, points, pixels, cv2.Rodrigues(r)[0], t.ravel(), focal, centre)


def places_of(person: FilmedPerson) -> dict[str, np.ndarray]:
    """By name the offset (3,) [m] of a keypoint from human34's landmark in the frame of its link, the right side's
    mirrored."""
    offsets = {name: seen_offset(person, name) for name in person.names}
    own = {m.name: np.array(m.xyz) for m in load_subject("human34").landmarks}
    for side in SIDES:
        R = link_frames(person, side, "heel")
        for part in _FOOT:
            from_ankle = person.of(f"{side}_{part}") - person.of(f"{side}_ankle")
            theirs = np.einsum("tba,tb->ta", R, from_ankle).mean(axis=0)
            offsets[f"{side}_{part}"] += theirs - own[f"{side}_{part}"]
    return {n: x * MIRROR_Y if n.startswith("right_") else x for n, x in offsets.items()}


def seen_offset(person: FilmedPerson, name: str) -> np.ndarray:
    """The offset (3,) [m] in the link's frame that explains a keypoint's distances from its joint centre."""
    k = person.names.index(name)
    side, _, part = name.partition("_")
    at = person.points[:, k] @ person.R.T + person.t
    projected = person.focal * at[:, :2] / at[:, 2:] + person.centre
    off = (person.pixels[:, k] - projected) * at[:, 2:] / person.focal
    A = (person.R @ link_frames(person, side, part))[:, :2]
    good = np.isfinite(off).all(axis=1) & (np.linalg.norm(off, axis=1) < _GROSS)
    weight = min(1.0, _INDEPENDENT / max(1, int(good.sum()))) / _KEYPOINT_STD**2
    H = weight * np.einsum("tia,tib->ab", A[good], A[good]) + np.eye(3) / _OFFSET_STD**2
    return np.asarray(np.linalg.solve(H, weight * np.einsum("tia,ti->a", A[good], off[good])))


def link_frames(person: FilmedPerson, side: str, part: str) -> np.ndarray:
    """Rotations (T, 3, 3) from a link to the world, its x forward, y to the left and z up when standing."""
    hips = person.of("left_hip") - person.of("right_hip")
    if part in ("ankle", *_FOOT):
        x = unit(person.of(f"{side}_big_toe") - person.of(f"{side}_heel"))
        y = unit(np.cross(person.of(f"{side}_knee") - person.of(f"{side}_ankle"), x))
        return np.stack([x, y, np.cross(x, y)], axis=-1)
    if part in ("hip", "knee"):
        below = "knee" if part == "hip" else "ankle"
        z, across = unit(person.of(f"{side}_{part}") - person.of(f"{side}_{below}")), hips
    else:
        shoulders = [person.of(f"{s}_shoulder") for s in SIDES]
        middle = 0.5 * (shoulders[0] + shoulders[1] - person.of("left_hip") - person.of("right_hip"))
        z, across = unit(middle), shoulders[0] - shoulders[1]
    x = unit(np.cross(across, z))
    return np.stack([x, np.cross(z, x), z], axis=-1)


def mean_place(offsets: Sequence[np.ndarray], *, centred: bool) -> tuple[np.ndarray, float]:
    """Mean (3,) of offsets (3,) [m] of people and sides, drawn to zero, or zero where they are to be centred, and the
    deviation of one of them about it, averaged over the axes.

    Each axis of the mean keeps the share of its square that is not the variance of the mean (James and Stein's, for
    positive parts); y is what mirrors, so that both sides agree.
    """
    own = np.array(offsets)
    mean, variance = own.mean(axis=0), own.var(axis=0, ddof=1)
    share = np.maximum(0.0, 1.0 - variance / len(own) / np.maximum(np.square(mean), 1e-12))
    kept = 0.0 * mean if centred else share * mean
    return kept, max(_LEAST_STD, float(np.sqrt(np.mean(np.square(own - kept)))))


def entries(mean: Mapping[str, tuple[np.ndarray, float]]) -> str:
    """Lines of the file."""
    return "".join(
        f"{part} = {{offset = [{', '.join(f'{x:.3f}' for x in offset + 0.0)}], std = {std:.3f}}}\n"
        for part, (offset, std) in mean.items()
    )


def _millimetres(offset: np.ndarray) -> str:
    return " ".join(f"{1e3 * x:+.0f}" for x in offset)
