"""HDF5 files of keypoints, laid out as DeepLabCut (pandas 2 and 3 with PyTables 3) and SLEAP write them."""

from __future__ import annotations

import io
import pickle
from collections.abc import Sequence
from typing import Any

import h5py
import numpy as np

ORDERS = {
    "matlab": ("track", "xy", "node", "frame"),
    "plain": ("frame", "node", "xy", "track"),
    "standard": ("frame", "track", "node", "xy"),
}
"""Orders of the axes of SLEAP's tracks: its own, its own without turning it for MATLAB, and sleap-io's."""


def deeplabcut_h5(
    columns: Sequence[tuple[str, ...]], values: np.ndarray, index: Sequence[Any], *, key: str = "df_with_missing"
) -> bytes:
    """As `to_hdf(format="table")`: columns (W) of scorer, with several animals individual, body part and coordinate;
    values (T, W), index (T) of frame numbers or of pictures' paths."""
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        group = file.create_group(key)
        group.attrs["pandas_type"] = np.bytes_(b"frame_table")
        group.attrs["info"] = _pickled({1: {"names": _levels(columns), "type": "MultiIndex"}, "index": {}})
        group.attrs["non_index_axes"] = _pickled([(1, list(columns))])
        rows = np.array(list(index))
        rows = rows.astype("S") if rows.dtype.kind == "U" else rows.astype(np.int64)
        table = np.zeros(len(rows), [("index", rows.dtype), ("values_block_0", "<f8", (len(columns),))])
        table["index"], table["values_block_0"] = rows, values
        group["table"] = table
        group["table"].attrs["values_block_0_kind"] = _pickled(list(columns))
    return content.getvalue()


def deeplabcut_fixed_h5(columns: Sequence[tuple[str, ...]], values: np.ndarray, index: Sequence[Any]) -> bytes:
    """As `to_hdf()` without a format; an index of tuples has several levels."""
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        group = file.create_group("df_with_missing")
        group.attrs["pandas_type"] = np.bytes_(b"frame")
        for axis in ("axis0", "block0_items"):
            _write_levels(group, axis, columns, _levels(columns))
        if isinstance(index[0], tuple):
            _write_levels(group, "axis1", index, ["N."] * len(index[0]))
        else:
            group["axis1"] = np.array(list(index), dtype=np.int64)
        group["block0_values"] = values
    return content.getvalue()


def sleap_h5(
    points: np.ndarray, nodes: Sequence[str], tracks: Sequence[str], order: str = "matlab", *, declared: bool = False
) -> bytes:
    """SLEAP's analysis of points (T, N, K, 3) with x, y, score; declared: with the attributes of sleap-io."""
    axes = ORDERS[order]
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        file["node_names"] = np.array(list(nodes), dtype="S")
        file["track_names"] = np.array(list(tracks), dtype="S") if tracks else np.zeros(0)
        of_points = [axis for axis in axes if axis != "xy"]
        for name, values, dims in (("tracks", points[..., :2], axes), ("point_scores", points[..., 2], of_points)):
            own = ORDERS["standard"][: values.ndim]
            file.create_dataset(name, data=values.transpose([own.index(a) for a in dims]), compression="gzip")
            if declared:
                file[name].attrs["dims"] = "[" + ", ".join(f'"{axis}"' for axis in dims) + "]"
        file["track_occupancy"] = np.isfinite(points[..., 0]).any(axis=2).astype(np.uint8)
    return content.getvalue()


def _levels(columns: Sequence[tuple[str, ...]]) -> list[str]:
    return ["scorer", *(["individuals"] if len(columns[0]) == 4 else []), "bodyparts", "coords"]


def _write_levels(group: h5py.Group, axis: str, entries: Sequence[tuple[str, ...]], names: Sequence[str]) -> None:
    """Each level's words, sorted, and of each entry the number of its word."""
    for i, words in enumerate(zip(*entries, strict=True)):
        known = sorted(set(words))
        group[f"{axis}_level{i}"] = np.array(known, dtype="S")
        group[f"{axis}_level{i}"].attrs["name"] = np.bytes_(names[i].encode())
        group[f"{axis}_label{i}"] = np.array([known.index(word) for word in words], dtype=np.int8)


def _pickled(value: Any) -> np.bytes_:
    return np.bytes_(pickle.dumps(value, protocol=0))
