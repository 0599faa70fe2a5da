"""Input that contradicts the clip: frames are not marked tracked, and the likely cause is named."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import kinemode as km
from estimator.data.agreement import likely_order
from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras import write_cameras
from estimator.synthesis.motion import authored_motion
from humanoid.subject.landmarks import FORMATS
from humanoid.support.errors import InputError
from tests.builders import body_of, camera_at
from tests.tiny_clip import QUICK_BY_KEYPOINTS

BODY = body_of("human34")
POSES = authored_motion(BODY, np.linspace(0.3, 1.0, 6))
POINTS = np.array([BODY.landmarks(BODY.at(q)) for q in POSES])
CAMERAS = tuple(
    replace(camera_at(at, height=1.2, distance=4.0, aim=(0.0, 0.0, 0.9)), name=f"c{k}")
    for k, at in enumerate((20.0, 100.0, 230.0))
)


def keypoints(layout: str, camera: Camera) -> np.ndarray:
    """Keypoints (T, K, 3) as a detector with that layout writes them, without naming it."""
    seen = np.array([camera.project(points) for points in POINTS])
    place = {name: k for k, name in enumerate(BODY.landmark_names)}
    middle = seen[:, [place[n] for n in ("left_hip", "right_hip", "left_shoulder", "right_shoulder")]].mean(axis=1)
    columns = [middle if n is None else seen[:, place[n]] for n in FORMATS[layout]]
    pixels = np.stack(columns, axis=1) + np.random.default_rng(0).normal(size=(len(seen), len(columns), 2))
    return np.concatenate([pixels, np.ones((*pixels.shape[:2], 1))], axis=2)


def track(folder: Path, layout: str, declared: str, *, cameras: int = 1) -> tuple[km.Run, str]:
    """A run and its messages."""
    paths = []
    for camera in CAMERAS[:cameras]:
        paths.append(folder / f"{camera.name}.npy")
        np.save(paths[-1], keypoints(layout, camera))
    write_cameras(folder / "cameras.json", CAMERAS)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        run = km.track(
            "human34", (), keypoints=paths, cameras=folder / "cameras.json", layout=declared, fps=10.0, fit="off",
            settings=QUICK_BY_KEYPOINTS, out=folder / f"{declared}.run",
        )  # fmt: skip
    assert {w.filename for w in warned if issubclass(w.category, km.InputWarning)} <= {__file__}
    return run, " ".join(str(w.message) for w in warned)


@pytest.mark.parametrize(("layout", "cameras"), [pytest.param("h36m17", 2, marks=pytest.mark.thorough), ("body25b", 1)])
def test_another_layout_of_as_many_points_is_named_and_no_frame_tracked(
    layout: str, cameras: int, tmp_path: Path
) -> None:
    wrong, warned = track(tmp_path, layout, "auto", cameras=cameras)
    assert f"--layout {layout}" in warned
    assert set(wrong.status) == {"hard"}
    assert set(km.open_run(tmp_path / "auto.run").status) == {"hard"}  # stored
    right, warned = track(tmp_path, layout, layout, cameras=cameras)
    assert "--layout" not in warned
    assert set(right.status) == {"tracked"}


@pytest.mark.parametrize("factor", [1.0, 0.3048])
def test_translations_not_in_metres_are_reported(factor: float, tmp_path: Path) -> None:
    points = np.stack([keypoints("coco17", camera) for camera in CAMERAS])
    given = {c.name: replace(c, t_camera_world=factor * c.t_camera_world) for c in CAMERAS}
    tall = f"{factor * np.ptp(BODY.landmarks(BODY.at(BODY.neutral))[:, 2]):.2g} m tall"
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        km.track(
            "human34", (), keypoints=dict(zip(given, points, strict=True)), cameras=given, fps=10.0, fit="off",
            settings=QUICK_BY_KEYPOINTS, keypoint_size=(640, 480),
        )  # fmt: skip
    assert any(tall in str(w.message) for w in warned) is (factor != 1.0)


@pytest.mark.parametrize("order", [(1, 0, 2), (2, 0, 1), (0, 2, 1)])
def test_exchanged_files_are_named(order: tuple[int, ...]) -> None:
    own = np.stack([[camera.project(p) for p in POINTS] for camera in CAMERAS], axis=1)
    pixels = own + np.random.default_rng(1).normal(size=own.shape)
    assert likely_order(CAMERAS, pixels) is None
    mended = likely_order(CAMERAS, pixels[:, order])
    assert mended is not None
    np.testing.assert_array_equal(pixels[:, order][:, mended], pixels)


def test_a_layout_belongs_to_files_by_its_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no layout 'h36m'"):
        track(tmp_path, "h36m17", "h36m")
