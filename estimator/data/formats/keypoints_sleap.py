"""SLEAP's analysis h5: the points of every track in every frame.

`tracks` (tracks, 2, nodes, frames), `node_names`, and optionally `track_names` and `point_scores` (tracks, nodes,
frames). Other orders of the axes are recognised by the attribute `dims` of a data set, as sleap-io writes it, or by the
sizes.
T. D. Pereira et al., SLEAP, Nature Methods 19, 2022.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.data.formats.hdf5 import array, is_hdf5, members, numeric, opened, text, texts
from estimator.data.formats.keypoints_names import named_landmarks
from estimator.data.formats.keypoints_reading import (
    MOST_FRAMES,
    KeypointFile,
    KeypointFormat,
    Person,
    Reading,
    checked_names,
    cleaned,
)
from humanoid.support.errors import InputError

if TYPE_CHECKING:
    import h5py

_AXES = ("frame", "track", "node", "xy")
_ORDERS = (("track", "xy", "node", "frame"), ("frame", "node", "xy", "track"), _AXES)  # MATLAB's, and those of scripts


def read_sleap(reading: Reading) -> None:
    """Read an analysis h5 of SLEAP's; a point without coordinates is missing, one that was set by hand is sure.

    Raises
    ------
    InputError: a data set is missing, or its sizes fit neither the names nor each other.
    """
    path = reading.source
    with opened(path) as file:
        nodes = checked_names(list(texts(array(file, "node_names", path), path, "node_names")), path, "node_names")
        names = texts(array(file, "track_names", path), path, "track_names") if _filled(file, "track_names") else ()
        points = numeric(array(file, "tracks", path), path, "tracks")
        order = _order(file["tracks"], points.shape, len(nodes), len(names), path)
        points = points.transpose([order.index(axis) for axis in _AXES])
        scores = np.ones(points.shape[:3])
        if "point_scores" in file:
            scores = numeric(array(file, "point_scores", path), path, "point_scores")
            flat = [axis for axis in _declared(file["point_scores"]) or order if axis != "xy"]
            if scores.shape != tuple(points.shape[_AXES.index(axis)] for axis in flat):
                raise InputError(
                    path, f"has the shape {scores.shape} beside tracks {points.shape}", place="point_scores"
                )
            scores = scores.transpose([flat.index(axis) for axis in _AXES[:3]])
    reading.layout = "SLEAP"
    reading.names = named_landmarks(nodes, reading)
    _add(reading, np.concatenate([points, scores[..., None]], axis=-1), names)


def _add(reading: Reading, points: np.ndarray, names: tuple[str, ...]) -> None:
    """Add points (T, N, K, 3) of N tracks."""
    frames, tracks = points.shape[:2]
    if frames > MOST_FRAMES:
        raise InputError(reading.source, f"{frames} is not a likely number of frames", place="tracks")
    missing = np.isnan(points[..., :2]).all(axis=-1)
    points[~missing & np.isnan(points[..., 2]), 2] = 1.0  # by hand: SLEAP has no score of these
    points[missing, 2] = 0.0
    ids = names if len(set(names)) == tracks else tuple(f"track_{n}" for n in range(tracks))
    there = ~missing.all(axis=2)
    for t in range(frames):
        people = [
            Person(
                cleaned(points[t, n], reading.notes, reading.source, f"frame {t}, {ids[n]}"),
                ids[n] if tracks > 1 else None,
            )
            for n in np.flatnonzero(there[t])
        ]
        reading.add(t, people)
    reading.count = frames


def _filled(file: h5py.File, name: str) -> bool:
    """Whether there are any; without tracks SLEAP writes an empty list of no texts."""
    return name in file and bool(file[name].size)


def _order(data: h5py.Dataset, shape: tuple[int, ...], nodes: int, tracks: int, path: Path) -> tuple[str, ...]:
    """The order of the axes of `tracks`: declared, else the first of the known ones whose sizes fit."""
    sizes = {"xy": 2, "node": nodes, "track": max(tracks, 1)}
    declared = _declared(data)
    for order in (declared,) if declared else _ORDERS:
        whole = sorted(order) == sorted(_AXES) and len(shape) == len(order)
        if whole and all(sizes.get(axis, size) == size for axis, size in zip(order, shape, strict=True)):
            return order
    problem = f"{nodes} node_names and {max(tracks, 1)} tracks do not fit an array of shape {shape}"
    raise InputError(path, problem, place="tracks", remedy="(tracks, 2, nodes, frames) is needed")


def _declared(data: h5py.Dataset) -> tuple[str, ...] | None:
    """The order of the axes that a data set declares."""
    dims = text(data.attrs.get("dims"))
    try:
        names = json.loads(dims) if dims is not None else None
    except ValueError:
        names = None
    return tuple(map(str, names)) if isinstance(names, list) else None


def refuse_hdf5(path: Path) -> None:
    """Raise InputError for an HDF5 file without keypoints, with its contents and what was expected."""
    with opened(path) as file:
        if {"instances", "points", "metadata"} <= set(file):
            remedy = "export it: in SLEAP, File, Export Analysis HDF5; or sleap-convert --format analysis"
            raise InputError(path, "is a project of SLEAP's, not its analysis", remedy=remedy)
        remedy = "SLEAP's analysis has tracks and node_names, DeepLabCut's a table of pandas (df_with_missing)"
        raise InputError(path, f"is an HDF5 file without keypoints: it has {members(file)}", remedy=remedy)


def _is_sleap(file: KeypointFile) -> bool:
    if not is_hdf5(file.start):
        return False
    with opened(file.path) as content:
        return "tracks" in content and "node_names" in content


SLEAP = KeypointFormat("SLEAP analysis h5", _is_sleap, lambda file, reading: read_sleap(reading), of_json=False)
