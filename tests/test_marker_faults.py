"""Swapped labels and mirrored axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimator.data.cameras.camera import UPS
from estimator.data.formats.opensim import upright_world, write_trc
from estimator.data.markers.load import load_points
from estimator.data.markers.merging import up_by_motion
from estimator.data.markers.swaps import mirrored_swaps
from estimator.data.markers.track import MarkerTrack
from humanoid.subject.marker_start import matching_set
from humanoid.support.errors import InputError
from kinemode.inputs.points import mirrored

TRIALS = ("static1", "walking1", "walkingTS1", "STS1", "squats1")


def trial(shared_data: Path, name: str) -> MarkerTrack:
    file = shared_data / "opencap" / "subject4" / f"{name}.trc"
    if not file.is_file():
        pytest.skip("needs opencap/subject4")
    return load_points(file)


def legs(rng: np.random.Generator, noise: float = 0.003) -> MarkerTrack:
    """Two ankles that walk past each other, 100 frames a second."""
    time = np.arange(300) / 100.0
    points = np.zeros((300, 2, 3))
    for k, phase in enumerate((0.0, np.pi)):
        points[:, k, 0] = 1.2 * time + 0.3 * np.sin(6.0 * time + phase)
        points[:, k, 1] = 0.1 - 0.2 * k
        points[:, k, 2] = 0.1 + 0.05 * np.maximum(np.cos(6.0 * time + phase), 0.0)
    return MarkerTrack(("L", "R"), points + noise * rng.normal(size=points.shape), time, "a")


def exchanged(track: MarkerTrack, pair: tuple[str, str], frames: slice) -> MarkerTrack:
    points, (i, k) = track.points.copy(), (track.names.index(name) for name in pair)
    points[frames, i], points[frames, k] = track.points[frames, k], track.points[frames, i]
    return track._replace(points=points)


@pytest.mark.parametrize("frames", [slice(0, 10), slice(40, 41), slice(97, 160), slice(250, 300)])
def test_swapped_labels_are_corrected_with_a_note(frames: slice) -> None:
    whole = legs(np.random.default_rng(1))
    mended, notes = mirrored_swaps(exchanged(whole, ("L", "R"), frames), [("L", "R"), ("absent", "R")])
    np.testing.assert_array_equal(mended.points, whole.points)
    assert f"L and R in {frames.stop - frames.start} frames" in notes[0]
    assert mirrored_swaps(whole, [("L", "R")])[1] == ()


def test_gaps_hide_no_swap() -> None:
    whole = legs(np.random.default_rng(2))
    whole.points[60:66] = whole.points[120:128, 0] = whole.points[200:280] = np.nan
    for frames in (slice(66, 110), slice(128, 150)):
        np.testing.assert_array_equal(
            mirrored_swaps(exchanged(whole, ("L", "R"), frames), [("L", "R")])[0].points, whole.points
        )
    assert mirrored_swaps(whole, [("L", "R")])[1] == ()


def test_points_that_were_measured_elsewhere_change_no_labels() -> None:
    """With a jumping head, noise, gaps and outliers as in a laboratory, all labels stay."""
    time = np.arange(180) / 60.0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        away = 0.065 * np.stack([-np.sin(time), np.cos(time), 0.0 * time], axis=1)
        leap = np.stack([0.4 * time, 0.0 * time, 0.5 * np.abs(np.sin(2.5 * time))], axis=1)
        points = np.stack([leap + away, leap - away], axis=1) + 0.005 * rng.normal(size=(180, 2, 3))
        wrong = rng.random((180, 2)) < 0.05
        points[wrong] += 0.1 * rng.normal(size=(int(wrong.sum()), 3))
        for column in range(2):
            for begin in rng.integers(5, 170, size=3):
                points[begin : begin + 6, column] = np.nan
        track = MarkerTrack(("L", "R"), points, time, "a")
        mended, _ = mirrored_swaps(track, [("L", "R")])
        changed = ~np.isclose(mended.points, points, equal_nan=True).all(axis=(1, 2))
        assert not changed.any(), seed


def test_paths_that_cross_are_not_a_swap() -> None:
    whole = legs(np.random.default_rng(3))
    whole.points[:, :, 1] *= 0.05  # a centimetre apart as they pass
    assert mirrored_swaps(whole, [("L", "R")])[1] == ()


def test_a_real_walk_is_left_alone_and_its_swaps_are_put_right(shared_data: Path) -> None:
    for name in TRIALS:
        track = trial(shared_data, name)
        pairs = matching_set(track.names).pairs
        assert mirrored_swaps(track, pairs)[1] == (), name
    track, rng = trial(shared_data, "walking1"), np.random.default_rng(4)
    pairs = matching_set(track.names).pairs
    swapped = track
    for pair in pairs:
        first = int(rng.integers(1, 80))
        swapped = exchanged(swapped, pair, slice(first, first + int(rng.integers(1, 45))))
    np.testing.assert_array_equal(mirrored_swaps(swapped, pairs)[0].points, track.points)


def test_mirrored_axes_are_reported(shared_data: Path) -> None:
    for name in TRIALS:
        track = trial(shared_data, name)
        markers = [m for m in matching_set(track.names).markers if m.link in ("pelvis", "torso")]
        model = np.array([np.add(m.xyz, (-0.01, 0.0, 0.12) if m.link == "torso" else 0.0) for m in markers])
        points = track.points[:, [track.names.index(m.name) for m in markers]]
        assert not mirrored(model, points), name
        assert mirrored(model, points * [1.0, -1.0, 1.0]), name


def test_what_is_flat_is_not_mirrored() -> None:
    rng = np.random.default_rng(5)
    flat = rng.normal(size=(6, 3)) * [1.0, 1.0, 0.0]
    assert not mirrored(flat, flat[None] * [1.0, -1.0, 1.0] + 0.001 * rng.normal(size=(20, 6, 3)))
    assert not mirrored(flat[:3], flat[None, :3])


def test_walking_shows_the_up_axis(shared_data: Path, tmp_path: Path) -> None:
    for name in TRIALS[1:]:
        track = trial(shared_data, name)
        for up in UPS:
            assert up_by_motion(track.points @ upright_world(up), track.time) == up, name
    walk = trial(shared_data, "walking1")
    arrays = {
        "points": walk.points @ upright_world("-y"),
        "names": np.array(walk.names),
        "time": walk.time,
        "unit": "m",
    }
    np.savez(tmp_path / "a.npz", **arrays)
    read = load_points(tmp_path / "a.npz")
    np.testing.assert_allclose(read.points, walk.points, atol=1e-9)
    assert "does not declare which axis points up: -y, from the feet to the head" in read.notes[0]
    write_trc(tmp_path / "a.trc", walk.names, walk.points @ upright_world("y").T, walk.time)
    (note,) = load_points(tmp_path / "a.trc").notes
    assert "y is assumed to point up, but from feet to head the body extends along z" in note
    unnamed = {**arrays, "names": np.array([f"m{i}" for i in range(len(walk.names))])}
    np.savez(tmp_path / "b.npz", **unnamed)
    assert "does not declare which axis points up: -y, by its motion" in load_points(tmp_path / "b.npz").notes[0]


def test_a_motion_that_leaves_it_open(tmp_path: Path) -> None:
    still = np.random.default_rng(6).normal(size=(1, 8, 3)) * [0.2, 0.2, 1.0] + 0.001 * np.zeros((30, 1, 1))
    assert up_by_motion(still, np.arange(30) / 30.0) is None
    assert up_by_motion(np.full((30, 8, 3), np.nan), np.arange(30) / 30.0) is None
    np.savez(tmp_path / "a.npz", points=still, names=np.array(list("abcdefgh")), fps=30.0, unit="m")
    with pytest.raises(InputError, match=r"does not declare which axis points up, .*--up: x, y, z"):
        load_points(tmp_path / "a.npz")
