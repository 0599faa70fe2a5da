"""Depth pictures as files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from estimator.data.media.depth_folder import DepthFolder
from humanoid.support.errors import InputError

SIZE = (8, 6)


def written(folder: Path, *pictures: np.ndarray, kind: str = ".npy") -> Path:
    """A folder with pictures 0, 1, ..., 10, ...; metres as .npy, millimetres as .png."""
    folder.mkdir()
    for i, picture in enumerate(pictures):
        if kind == ".png":
            cv2.imwrite(str(folder / f"depth_{i}.png"), picture)
        else:
            np.save(folder / f"depth_{i}.npy", picture)
    return folder


def metres(value: float) -> np.ndarray:
    return np.full(SIZE[::-1], value)


def test_both_kinds_give_the_same_metres(tmp_path: Path) -> None:
    true = np.linspace(0.8, 4.0, 48).reshape(6, 8)
    png = written(tmp_path / "png", np.round(1000.0 * true).astype(np.uint16), kind=".png")
    npy = written(tmp_path / "npy", true)
    np.testing.assert_allclose(DepthFolder(png, SIZE).at(0), true, atol=6e-4)
    np.testing.assert_allclose(DepthFolder(npy, SIZE).at(0), true, atol=1e-6)


def test_unknown_is_nan(tmp_path: Path) -> None:
    picture = metres(2.0)
    picture[0, :4] = 0.0, -1.0, np.nan, np.inf
    depth = DepthFolder(written(tmp_path / "npy", picture), SIZE).at(0)
    assert np.isnan(depth[0, :4]).all()
    assert np.isfinite(depth).sum() == 44


def test_frames_are_in_natural_order_and_none_after_the_end(tmp_path: Path) -> None:
    depth = DepthFolder(written(tmp_path / "npy", *(metres(1.0 + 0.1 * i) for i in range(12))), SIZE)
    assert len(depth) == 12
    np.testing.assert_allclose([depth.at(i)[0, 0] for i in range(12)], 1.0 + 0.1 * np.arange(12), rtol=1e-6)
    assert np.isnan(depth.at(12)).all()


def test_single_frames_may_lack_depth(tmp_path: Path) -> None:
    depth = DepthFolder(written(tmp_path / "npy", metres(0.0), metres(2.0)), SIZE)
    assert np.isnan(depth.at(0)).all()


@pytest.mark.parametrize(
    ("picture", "kind", "message"),
    [
        (metres(2000.0), ".npy", "median depth of 2000 m"),
        (np.full((6, 8), 2, np.uint16), ".png", "median depth of 0.002 m"),
        (np.ones((5, 8)), ".npy", "8 x 5, not 8 x 6"),
        (metres(0.0), ".npy", "no depth in any picture"),
        (np.full((6, 8), 200, np.uint8), ".png", "1 channels of 8 bits"),
        (np.full((6, 8, 3), 2000, np.uint16), ".png", "3 channels of 16 bits"),
        (np.ones((6, 8, 2)), ".npy", "rows and columns"),
        (np.full((6, 8), "a"), ".npy", "rows and columns"),
        (np.full((6, 8), None), ".npy", "cannot be read"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, picture: np.ndarray, kind: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        DepthFolder(written(tmp_path / "depth", picture, kind=kind), SIZE)


def test_folders_without_one_kind_of_files_are_refused(tmp_path: Path) -> None:
    folder = written(tmp_path / "npy", metres(2.0))
    cv2.imwrite(str(folder / "depth_1.png"), np.full((6, 8), 2000, np.uint16))
    with pytest.raises(InputError, match=r"has \.png and \.npy files"):
        DepthFolder(folder, SIZE)
    with pytest.raises(InputError, match="has no depth pictures"):
        DepthFolder(written(tmp_path / "none"), SIZE)
    with pytest.raises(InputError, match="cannot be read"):
        DepthFolder(tmp_path / "absent", SIZE)


@pytest.mark.parametrize("name", ["depth_0.png", "depth_0.npy"])
def test_damaged_files_are_named(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"\x93NUMPY nothing")
    with pytest.raises(InputError, match=name):
        DepthFolder(tmp_path, SIZE)
