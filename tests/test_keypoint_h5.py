"""Keypoints from the HDF5 files of DeepLabCut and SLEAP; their layouts were compared with what these programs' writers,
pandas with PyTables and sleap-io, wrote."""

from __future__ import annotations

import io
import os
import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from benchmarks.robustness.hdf5_files import deeplabcut_fixed_h5, deeplabcut_h5, sleap_h5
from estimator.data.formats.hdf5 import plain_pickle
from estimator.data.formats.keypoints import KeypointTrack, load_keypoints, load_people
from humanoid.subject.landmarks import COCO17
from humanoid.support.errors import InputError
from tests.test_keypoint_files import FRAMES, points, same

PICTURES = [("labeled-data", "walk", f"img{t:03d}.png") for t in range(FRAMES)]


def table(*who: str, kinds: Sequence[str] = ("x", "y", "likelihood")) -> tuple[list[tuple[str, ...]], np.ndarray]:
    """Columns and values of DeepLabCut's tables, with a person for every name or one without a name."""
    columns = [
        ("DLC", *([name] if who else []), part, kind) for name in who or ("",) for part in COCO17 for kind in kinds
    ]
    values = [points(n)[..., : len(kinds)].reshape(FRAMES, -1) for n in range(max(len(who), 1))]
    return columns, np.concatenate(values, axis=1)


def saved(folder: Path, content: bytes, name: str = "walk.h5") -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


def read(folder: Path, content: bytes) -> KeypointTrack:
    return load_keypoints(saved(folder, content))


def test_deeplabcuts_tables(tmp_path: Path) -> None:
    columns, values = table()
    same(read(tmp_path, deeplabcut_h5(columns, values, range(FRAMES))), points())
    shuffled = np.random.default_rng(3).permutation(len(columns))
    path = saved(tmp_path, deeplabcut_h5([columns[i] for i in shuffled], values[:, shuffled], range(FRAMES)))
    track = load_keypoints(path)
    order = [track.names.index(name) for name in COCO17]
    np.testing.assert_array_equal(track.pixels[:, order], points()[..., :2])
    columns, values = table(kinds=("x", "y"))
    same(read(tmp_path, deeplabcut_h5(columns, values, ["/".join(p) for p in PICTURES])), points(), sure=True)
    same(read(tmp_path, deeplabcut_fixed_h5(columns, values, PICTURES)), points(), sure=True)


@pytest.mark.parametrize("write", [deeplabcut_h5, deeplabcut_fixed_h5])
def test_deeplabcuts_individuals_are_people(tmp_path: Path, write: Any) -> None:
    columns, values = table("ann", "bob", "single")
    people = load_people(saved(tmp_path, write(columns, values, range(FRAMES))))
    for who, name in enumerate(("ann", "bob")):
        track = people.one(name)
        order = [track.names.index(part) for part in COCO17]
        np.testing.assert_array_equal(track.pixels[:, order], points(who)[..., :2])
        np.testing.assert_array_equal(track.confidence[:, order], points(who)[..., 2])
    assert "'single'" in track.notes[-1]
    assert [len(frame) for frame in people.frames.values()] == [2, 2, 0, 2, 2]


@pytest.mark.parametrize(("order", "declared"), [("matlab", False), ("plain", False), ("standard", True)])
def test_sleaps_tracks_in_every_order_of_their_axes(tmp_path: Path, order: str, declared: bool) -> None:
    alone = points()[:, None]
    alone[LATE := (4, 0, 2)][2] = np.nan  # by hand: no score
    track = read(tmp_path, sleap_h5(alone, COCO17, (), order, declared=declared))
    np.testing.assert_array_equal(track.pixels, alone[:, 0, :, :2])
    assert track.confidence[LATE[0], LATE[2]] == 1.0
    np.testing.assert_array_equal(track.confidence[:4], points()[:4, :, 2])
    assert track.fps is None
    both = np.stack([points(), points(1)], axis=1)
    both[3, 1] = np.nan
    people = load_people(saved(tmp_path, sleap_h5(both, COCO17, ("ann", "bob"), order, declared=declared)))
    same(people.one("ann"), points())
    assert [len(frame) for frame in people.frames.values()] == [2, 2, 0, 1, 2]


class Runs:
    """Code that plain pickle would run."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.putenv, ("KINEMODE_RAN", "yes")


@pytest.mark.parametrize(
    "content",
    [
        pickle.dumps(Runs(), 0),
        pickle.dumps(Runs(), 4),
        b"cos\nsystem\n.",
        b"(lp999999999999\n.",  # a memo index that would take much memory
        b"\x80\x04\x96\xff\xff\xff\xff\xff\x00\x00\x00.",  # a byte array of a petabyte
        b"(lp0\n",
        b"",
        None,
        "list",
    ],
)
def test_a_pickle_is_read_as_plain_lists_alone(content: Any) -> None:
    with pytest.raises(InputError, match=r"walk\.h5: info: is not a plain list of names"):
        plain_pickle(content, Path("walk.h5"), "info")
    assert plain_pickle(pickle.dumps([("DLC", "näse", 1)] * 2, 0), Path("a"), "") == [("DLC", "näse", 1)] * 2


def hdf5(**content: Any) -> bytes:
    out = io.BytesIO()
    with h5py.File(out, "w", userblock_size=content.pop("userblock", 0)) as file:
        for name, value in content.items():
            file[name] = value
    return out.getvalue()


def matlab() -> bytes:
    whole = hdf5(userblock=512, joints=np.zeros(3))
    return b"MATLAB 7.3 MAT-file".ljust(512) + whole[512:]


def changed(**attributes: Any) -> bytes:
    """DeepLabCut's file with other attributes."""
    out = io.BytesIO(deeplabcut_h5(*table(), range(FRAMES)))
    with h5py.File(out, "r+") as file:
        for name, value in attributes.items():
            at = file["df_with_missing/table" if name.startswith("values") else "df_with_missing"]
            at.attrs[name] = np.bytes_(pickle.dumps(value, 0))
    return out.getvalue()


LOOKED_FOR = "tracks and node_names, DeepLabCut's a table of pandas"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (matlab(), f"without keypoints: it has 'joints' .*{LOOKED_FOR}"),
        (hdf5(model_weights=np.zeros(3), tracks=np.zeros(2)), f"it has 'model_weights', 'tracks' .*{LOOKED_FOR}"),
        (hdf5(instances=0, points=0, metadata=0), "is a project of SLEAP's.*Export Analysis HDF5"),
        (deeplabcut_h5(*table(), range(FRAMES))[:3000], "is a damaged HDF5 file"),
        (b"scorer", "does not begin as HDF5 files do"),
        (changed(info={1: {"names": ["a", "b"]}}), r"columns have the levels \['a', 'b'\] \(DeepLabCut's are scorer"),
        (changed(info=[]), r"columns have the levels \[\]"),
        (changed(values_block_0_kind=[("DLC", "nose", "x")]), r"1 columns do not fit an array of shape \(5, 51\)"),
        (changed(values_block_0_kind=["x"]), r"has a column 'x' \(its scorer, bodyparts, coords are needed"),
        (deeplabcut_h5([("DLC", "nose", "z")], np.zeros((1, 1)), [0]), "coords: has 'z' in column 0"),
        (deeplabcut_h5([("DLC", "nose", "x")], np.zeros((1, 1)), [0]), "coords: 'nose' needs both x and y"),
        (deeplabcut_h5(*table(), [0, 1, 2, 2, 4]), "row 3: frame 2 is in row 2 too"),
        (deeplabcut_h5(*table(), [-1, 0, 1, 2, 3]), "index: a list of texts is needed"),
        (sleap_h5(points()[:, None], COCO17[:5], ()), r"tracks: 5 node_names and 1 tracks do not fit .*\(1, 2, 17, 5"),
        (sleap_h5(points()[:, None], COCO17, ("a", "b")), "17 node_names and 2 tracks do not fit"),
        (hdf5(tracks=np.zeros((1, 2, 1, 4)), node_names=np.array([b"nose", b"nose"])), "'nose' appears twice"),
        (hdf5(tracks=np.zeros((1, 2, 1, 4)), node_names=np.zeros(1)), "node_names: a list of texts is needed"),
        (hdf5(tracks=np.array([b"a"]), node_names=np.array([b"nose"])), "tracks: is of type"),
    ],
)
def test_faults_are_one_line(tmp_path: Path, content: bytes, message: str) -> None:
    path = saved(tmp_path, content)
    with pytest.raises(InputError, match=message) as caught:
        load_keypoints(path)
    assert caught.value.source == str(path)
    assert "\n" not in str(caught.value)


def test_an_array_that_would_fill_the_memory_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "walk.h5"
    with h5py.File(path, "w") as file:
        file["node_names"] = np.array(COCO17, dtype="S")
        file.create_dataset("tracks", shape=(1, 2, 17, 10**7), dtype="f8", chunks=(1, 2, 17, 100))
    with pytest.raises(InputError, match="tracks: unpacks to more than 400 MB"):
        load_keypoints(path)
