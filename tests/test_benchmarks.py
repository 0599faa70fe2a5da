"""The measures are right: known errors are reproduced and lost frames found."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.accuracy import beam4cam, mocap, outline
from benchmarks.papers_css import sequences
from benchmarks.support import mocap_person
from benchmarks.support.common import in_processes
from benchmarks.support.scores import TrackErrors, track_errors, trajectories
from estimator.data.cameras.camera import guessed_camera
from estimator.runs.evaluation import LIMB_JOINTS
from estimator.runs.reference_motion import Reference
from estimator.synthesis.motion_keys import MOTIONS
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode import demo
from tests.worker_jobs import numbered

CAMERA = guessed_camera("cam01", (640, 480))  # at the origin, looks along x; focal length 768 px
DEPTH = 5.0
TO_THE_SIDE, AWAY = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])


def joints(frames: int) -> np.ndarray:
    """Limb joints (T, 12, 3) in a plane at a known depth, the same in every frame."""
    places = np.random.default_rng(0).normal(0.0, 0.3, (len(LIMB_JOINTS), 3))
    places[:, 0] = DEPTH
    return np.repeat(places[None], frames, axis=0)


def errors_of(points: np.ndarray, truth: np.ndarray) -> TrackErrors:
    return track_errors(LIMB_JOINTS, points, truth, CAMERA)


def test_a_shift_is_measured_as_it_is() -> None:
    truth = joints(4)
    errors = errors_of(truth + np.array([0.02, 0.04, 0.06, 0.08])[:, None, None] * TO_THE_SIDE, truth)
    assert errors.mean == pytest.approx(50.0)
    assert errors.worst == pytest.approx(80.0)
    assert errors.pixels == pytest.approx(CAMERA.K[0, 0] * 0.08 / DEPTH)
    assert errors.lost is None
    assert errors.aligned == pytest.approx(0.0, abs=1e-9)
    assert errors.pa == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("shift", "lost"),
    [
        (0.249 * AWAY, None),
        (0.251 * AWAY, 2),  # too far in the world, hardly moved in the image
        (14.9 * DEPTH / CAMERA.K[0, 0] * TO_THE_SIDE, None),
        (15.1 * DEPTH / CAMERA.K[0, 0] * TO_THE_SIDE, 2),  # too far in the image, 98 mm in the world
        (-2.0 * DEPTH * AWAY, 2),  # behind the camera
        (np.full(3, np.nan), 2),
    ],
)  # fmt: skip
def test_the_first_lost_frame(shift: np.ndarray, lost: int | None) -> None:
    truth = joints(5)
    points = truth.copy()
    points[2] += shift
    points[4] += shift
    assert errors_of(points, truth).lost == lost


def test_size_weighs_on_the_world_alone() -> None:
    truth = joints(2)
    hips = truth[:, [LIMB_JOINTS.index(f"{side}_hip") for side in ("left", "right")]].mean(axis=1, keepdims=True)
    errors = errors_of(1.1 * truth, truth)  # the same body as seen by one camera
    assert errors.pixels == pytest.approx(0.0, abs=1e-9)
    assert errors.mean == pytest.approx(100.0 * np.linalg.norm(truth, axis=-1).mean())
    assert errors.aligned == pytest.approx(100.0 * np.linalg.norm(truth - hips, axis=-1).mean())
    assert errors.pa == pytest.approx(0.0, abs=1e-9)


def test_the_trajectories_of_a_run() -> None:
    frames, body_names = 3, ("nose", *reversed(LIMB_JOINTS))
    truth = joints(frames + 2)
    order = [LIMB_JOINTS.index(name) for name in body_names[1:]]

    def off(*metres: float) -> np.ndarray:
        """Landmarks (T, L, 3) in the body's order, so far beyond the truth of frames 2, 3 and 4."""
        shifted = truth[2:] + np.array(metres)[:, None, None] * AWAY
        return np.concatenate([np.zeros((frames, 1, 3)), shifted[:, order]], axis=1)

    truth[2:] += np.arange(frames)[:, None, None] * TO_THE_SIDE * 0.1
    modes = np.stack([off(0.1, 0.3, 0.1), off(0.05, 0.06, np.nan)], axis=1)
    run = SimpleNamespace(
        body=SimpleNamespace(landmark_names=body_names), time=np.arange(2, 2 + frames) / 30.0, mode_landmarks=modes,

        landmarks=off(0.02, 0.08, 0.04), header=SimpleNamespace(cameras=(CAMERA,)),
    )  # fmt: skip
    errors = trajectories(run, Reference(LIMB_JOINTS, truth, np.arange(frames + 2) / 30.0))  # type: ignore[arg-type]
    assert errors["smoothed"].mean == pytest.approx(140.0 / 3.0)
    assert errors["filtered"].worst == pytest.approx(300.0)
    assert errors["filtered"].lost == 1
    assert errors["best of K"].mean == pytest.approx((50.0 + 60.0 + 100.0) / 3.0)  # not the smoothed pose


def test_the_person_in_the_pictures_has_thicker_limbs_and_nothing_else() -> None:
    person, thin = mocap_person.person(), demo.demo_subject()
    widened = set()
    for ours, theirs in zip(person.flesh, thin.flesh, strict=True):
        ratio = np.array(ours.size) / theirs.size
        if not np.allclose(ratio, 1.0):
            np.testing.assert_allclose(ratio, (mocap_person.GIRTH, mocap_person.GIRTH, 1.0))
            widened.add(ours.link)
    assert widened == {f"{side}_{limb}" for side in ("left", "right") for limb in mocap_person.LIMBS}
    bodies = Body(person), Body(thin), Body(load_subject("human34"))
    placed, same, standard = (body.landmarks(body.at(body.neutral)) for body in bodies)
    np.testing.assert_allclose(placed, same, atol=1e-9)
    assert np.abs(placed - standard).max() > 0.01


def test_every_stand_in_has_a_rate_and_a_target() -> None:
    assert (
        set(sequences.FPS)
        == set(sequences.TARGET_MM)
        == {name for name, motion in MOTIONS.items() if motion.subject != "upper13"} - {"reach"}
    )


def test_motion_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mocap").mkdir()
    for name in ("run", "dance", "jump"):
        (tmp_path / "mocap" / f"{name}.bvh").touch()
    assert [path.stem for path in mocap.motion_files(tmp_path, ("run", "jump"), False)] == ["run", "jump"]
    assert [path.stem for path in mocap.motion_files(tmp_path, (), True)] == ["dance", "jump", "run"]
    with pytest.raises(InputError, match=r"no swim.*dance, jump, run"):
        mocap.motion_files(tmp_path, ("run", "swim"), False)
    monkeypatch.setenv("KINEMODE_DATA", str(tmp_path / "nowhere"))
    assert mocap.motion_files(None, mocap.DEFAULT, False) == []
    with pytest.raises(InputError, match="no such folder"):
        mocap.motion_files(tmp_path / "nowhere", mocap.DEFAULT, False)


def test_processes_keep_the_order() -> None:
    results = in_processes(numbered, [3, 1, 2], 2)
    assert [task for task, _ in results] == [3, 1, 2]
    assert os.getpid() not in {process for _, process in results}
    assert in_processes(numbered, [3, 1], 1) == [(3, os.getpid()), (1, os.getpid())]
    with pytest.raises(InputError, match="1 or more"):
        in_processes(abs, [1], 0)


def test_widths_of_an_outline_are_those_of_a_disc() -> None:
    rows, columns = np.indices((60, 80))
    disc = (columns - 40.0) ** 2 + (rows - 30.0) ** 2 <= 12.0**2
    for angle in np.linspace(0.0, 6.0, 7):
        direction = np.array([np.cos(angle), np.sin(angle)])
        assert outline._reach(disc, np.array([40.0, 30.0]), direction) == pytest.approx(12.5, abs=1.0)
    assert outline._reach(disc, np.array([5.0, 5.0]), np.array([1.0, 0.0])) == 0.0
    assert outline._reach(np.ones_like(disc), np.array([40.0, 30.0]), np.array([1.0, 0.0])) == np.inf
    ratios = outline.summed([outline.Width("thigh", body, 10.0) for body in (8.0, 9.0, 13.0)])
    assert ratios == {"thigh": (0.9, pytest.approx(0.85), pytest.approx(1.1), 3)}


def test_masks_are_a_folder_or_a_film_of_the_camera_s_name(tmp_path: Path) -> None:
    (tmp_path / "cam01").mkdir()
    (tmp_path / "cam02.mp4").touch()
    (tmp_path / "cam011.mp4").touch()
    masks = beam4cam.masks_of(tmp_path, ("cam01", "cam02"))
    assert masks == {"cam01": tmp_path / "cam01", "cam02": tmp_path / "cam02.mp4"}
    with pytest.raises(InputError, match="has no masks of cam03"):
        beam4cam.masks_of(tmp_path, ("cam03",))
