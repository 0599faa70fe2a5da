"""Which axis of a file of points points up: names of head and feet come before motion, and before a screen's axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from builders import body_of

from benchmarks.robustness.c3d_files import c3d_file
from estimator.data.cameras.camera import UPS
from estimator.data.formats.opensim import upright_world, write_trc
from estimator.data.markers.load import load_points
from estimator.data.markers.merging import up_by_motion, up_by_names

COUNT, RATE = 40, 30.0
MARKERS = {  # of laboratories, by the landmark that is nearest
    "C7": "neck", "R.Acromion": "right_shoulder", "LFHD": "left_ear", "RASI": "right_hip", "r_knee_lat": "right_knee",
    "L.Ankle": "left_ankle", "RHEE": "right_heel", "LTOE": "left_big_toe", "l_calc": "left_heel",
}  # fmt: skip


def treadmill(belt: float = 1.2) -> tuple[tuple[str, ...], np.ndarray]:
    """Landmarks of a person whose head stays still while the feet slide with a belt [m/s], z up."""
    body = body_of("human34")
    points = np.tile(body.landmarks(body.at(body.neutral)), (COUNT, 1, 1))
    slide = 0.3 * np.sin(2.0 * np.pi * np.arange(COUNT) / RATE * belt / 1.2)
    low = [i for i, name in enumerate(body.landmark_names) if name.endswith(("heel", "toe", "ankle", "knee"))]
    points[:, low, 0] += slide[:, None]
    points += np.array([0.4, 0.7, 1.0])  # a point at zero would be missing
    return body.landmark_names, points


def as_markers(points: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    return points[:, [names.index(landmark) for landmark in MARKERS.values()]]


@pytest.mark.parametrize("up", UPS)
@pytest.mark.parametrize("belt", [0.8, 1.2])
def test_names_show_up_where_motion_misleads(up: str, belt: float, tmp_path: Path) -> None:
    names, upright = treadmill(belt)
    points = upright @ upright_world(up)
    assert up_by_motion(points, np.arange(COUNT) / RATE) not in (None, up)
    assert up_by_names(names, points) == up
    assert up_by_names(tuple(MARKERS), as_markers(points, names)) == up
    np.savez(tmp_path / "a.npz", points=points, names=np.array(names), fps=RATE, unit="m")
    track = load_points(tmp_path / "a.npz")
    assert track.up == up
    np.testing.assert_allclose(track.points, upright, atol=1e-9)


def test_names_without_ends_show_nothing() -> None:
    names, points = treadmill()
    assert up_by_names(tuple(f"m{i}" for i in range(len(names))), points) is None
    turning = points.copy()
    turning[COUNT // 2 :] *= -1.0
    assert up_by_names(names, turning) is None
    assert up_by_names(names, np.full_like(points, np.nan)) is None


@pytest.mark.parametrize(("screen", "up"), [("-Z", "z"), ("+Y", "z"), ("+Y", "y"), ("+Z", "-y"), ("", "y")])
def test_the_axis_of_a_screen_is_not_evidence(screen: str, up: str, tmp_path: Path) -> None:
    names, upright = treadmill()
    points = as_markers(upright, names)
    turned = 1e3 * points @ upright_world(up)
    (tmp_path / "a.c3d").write_bytes(c3d_file(tuple(MARKERS), turned, up=screen, rate=RATE, first=1, whole=False))
    track = load_points(tmp_path / "a.c3d")
    np.testing.assert_allclose(track.points, points, atol=1e-5)
    assert any("--up" in note for note in track.notes) == (up not in ("z", screen.lower().lstrip("+")))


def test_a_lying_person_is_not_put_upright_and_doubt_gives_a_note(tmp_path: Path) -> None:
    names, upright = treadmill()
    lying = upright @ upright_world("x")  # z up, the head along x
    write_trc(tmp_path / "a.trc", names, lying, np.arange(COUNT) / RATE)
    track = load_points(tmp_path / "a.trc")
    np.testing.assert_allclose(track.points, lying, atol=1e-5)
    assert "y is assumed to point up, but" in track.notes[-1]
    write_trc(tmp_path / "b.trc", names, upright, np.arange(COUNT) / RATE)
    assert not load_points(tmp_path / "b.trc").notes
