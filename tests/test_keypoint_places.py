"""Where detectors mark the body: read, stored, projected, fitted by several cameras, and the noise about it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.fitting.fit import Fit
from estimator.fitting.fitted_points import FittedKeypoints
from estimator.fitting.lengths import given_noise, measured_noise
from estimator.fitting.person import fit_person
from estimator.fitting.settings import FitSettings
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from estimator.synthesis.motion import authored_motion
from estimator.tracking.registry import settings_for
from humanoid.kinematics.body import Body
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.keypoint_places import UNKNOWN_STD, with_layout_places
from humanoid.subject.subject import load_subject, subject_from_text
from humanoid.support.errors import InputError
from tests.builders import body_of, camera_at, observe
from tests.tiny_clip import FEW_STARTS

AROUND = tuple(camera_at(a, distance=3.5, focal=660.0, height=1.2, aim=(0.0, 0.0, 0.95)) for a in (20, 110, 200, 290))
OFF = {"left_knee": (np.array([0.0, 0.02, 0.01]), 0.015), "right_big_toe": (np.array([0.01, 0.0, -0.03]), 0.02)}
TRACK = settings_for("css", modes=2, changes={"css": {"samples": 2}, "search": FEW_STARTS})


def test_places_are_read_and_written_and_grow_with_the_body() -> None:
    subject = load_subject("human34").with_keypoint_places(OFF)
    again = subject_from_text(subject.urdf, source="human34", base=subject.base)
    large = again.resized(1.1)
    for subject, factor in ((again, 1.0), (large, 1.1)):
        body = Body(subject)
        for name, (offset, std) in OFF.items():
            k = body.landmark_names.index(name)
            np.testing.assert_allclose(body.keypoint_local[k] - body.landmark_local[k], factor * offset, atol=1e-12)
            assert body.keypoint_std[k] == pytest.approx(factor * std)
        other = body.landmark_names.index("left_hip")
        assert np.array_equal(body.keypoint_local[other], body.landmark_local[other])
        assert np.isnan(body.keypoint_std[other])


def test_a_layout_gives_its_places_once_and_mirrored() -> None:
    subject = with_layout_places(load_subject("human34"), "mediapipe33")
    at = {landmark.name: landmark for landmark in subject.landmarks}
    left, right = (np.array(at[f"{side}_big_toe"].keypoint) for side in ("left", "right"))
    np.testing.assert_allclose(left * [1.0, -1.0, 1.0], right)
    assert left[2] < -0.02  # detectors mark the tip of the shoe at the floor, a body has the joint's height
    assert at["nose"].keypoint_std == pytest.approx(UNKNOWN_STD)
    assert with_layout_places(subject, "coco17") is subject
    assert not subject.notes
    unknown = with_layout_places(load_subject("human34"), "coco17")
    assert all(not any(m.keypoint) and m.keypoint_std == UNKNOWN_STD for m in unknown.landmarks)
    assert unknown.notes == (
        "where a detector of coco17 marks the body is not known: 20 mm about the landmarks is assumed",
    )
    robot = load_subject("arm8").scaled({})
    assert all(m.keypoint_std is None for m in robot.landmarks)


def test_keypoints_are_compared_with_their_places() -> None:
    subject = load_subject("human34").with_keypoint_places(OFF)
    body = Body(subject)
    q = authored_motion(body, np.array([0.4]))[0]
    posed = body.at(q)
    marked = np.array([camera.project(body.keypoints(posed)) for camera in AROUND])
    seen = observe(body, q, AROUND)
    term = CostModel(body).observation_term(replace(seen, pixels=marked))
    np.testing.assert_allclose(term.distances(posed), 0.0, atol=1e-9)
    at_landmarks = CostModel(body).observation_term(seen).distances(posed)
    moved = [body.landmark_names.index(name) for name in OFF]
    assert (np.delete(at_landmarks, moved, axis=1) < 1e-9).all()
    assert (at_landmarks[:, moved] > 0.1).all()


def test_an_unsure_place_widens_a_keypoint_and_a_measured_noise_scales_it() -> None:
    body = body_of("human34")
    seen = observe(body, authored_motion(body, np.array([0.4]))[0], AROUND)
    settings = CostSettings(keypoint_noise=0.05, keypoint_place=0.0)
    sure = CostModel(body, settings).keypoint_sigma(seen)
    np.testing.assert_allclose(
        CostModel(body, settings).keypoint_sigma(replace(seen, noise=(2.0, 1.0, 0.5, 1.0))) / sure,
        np.array([2.0, 1.0, 0.5, 1.0])[:, None] * np.ones_like(sure),
    )
    unsure = CostModel(body, replace(settings, keypoint_place=0.02)).keypoint_sigma(seen)
    added = np.sqrt(np.square(unsure) - np.square(sure))
    np.testing.assert_allclose(added / added[:, :1], np.ones_like(added))  # equal in metres everywhere


def test_several_cameras_find_where_a_person_is_marked() -> None:
    """Toes marked 3 cm below the body's: the fit finds this, within its stated deviation."""
    given = with_layout_places(load_subject("human34"), "coco17")
    truth = {name: (np.array([0.0, 0.0, -0.03]), UNKNOWN_STD) for name in ("left_big_toe", "right_big_toe")}
    body = Body(load_subject("human34").with_keypoint_places(truth))
    motion, rng = authored_motion(body, np.linspace(0.3, 2.3, 8)), np.random.default_rng(4)
    seen = []
    for i, q in enumerate(motion):
        shot = observe(body, q, AROUND, index=i, time=0.25 * i)
        marked = np.array([camera.project(body.keypoints(body.at(q))) for camera in AROUND])
        seen.append(replace(shot, pixels=marked + rng.normal(size=marked.shape)))
    fit = fit_person(given, seen, settings=FitSettings(frames=8, rounds=1), track_settings=TRACK)
    at = {landmark.name: landmark for landmark in fit.subject.landmarks}
    for name in truth:
        assert np.linalg.norm(np.array(at[name].keypoint) - [0.0, 0.0, -0.03]) < 0.02
        assert at[name].keypoint_std < UNKNOWN_STD
    assert np.abs(at["left_hip"].keypoint).max() < 0.015
    alone = [replace(o, cameras=o.cameras[:1], pixels=o.pixels[:1], confidence=o.confidence[:1]) for o in seen]
    by_one = fit_person(given, alone, settings=FitSettings(frames=8, rounds=1), track_settings=TRACK)
    assert [m.keypoint for m in by_one.subject.landmarks] == [m.keypoint for m in given.landmarks]
    assert all(0.2 < factor < 1.0 for factor in fit.noise)  # 1 px is less than detectors err
    assert not fit.moved


def test_noise_is_what_keypoints_scatter_by() -> None:
    body, rng = body_of("human34"), np.random.default_rng(5)
    settings = CostSettings(keypoint_noise=0.02, keypoint_place=0.0)
    model, q = CostModel(body, settings), authored_motion(body, np.linspace(0.3, 2.3, 20))
    factors = np.array([0.5, 1.0, 2.0, 1.0])
    seen = []
    for i, pose in enumerate(q):
        shot = observe(body, pose, AROUND, index=i, time=0.1 * i)
        sigma = model.keypoint_sigma(shot)[..., None] * factors[:, None, None]
        seen.append(replace(shot, pixels=shot.pixels + sigma * rng.normal(size=shot.pixels.shape)))
    noise = measured_noise(model, seen, list(q), 1.0, 0)
    left = 1.0 - len(q) * body.nv / np.isfinite(np.array([o.pixels for o in seen])).sum()
    # these poses were known and not fitted, so the degrees of freedom that a fit uses remain
    np.testing.assert_allclose(np.array(noise) * np.sqrt(left) / factors, 1.0, atol=0.12)


def test_a_given_noise_is_that_of_keypoints_in_pixels() -> None:
    body = body_of("human34")
    settings = CostSettings(keypoint_noise=0.05, keypoint_place=0.0)
    seen = observe(body, authored_motion(body, np.array([0.4]))[0], AROUND)
    first, others = [8.0, *[np.nan] * 3], (0.5, 0.7, 1.5, 1.0)
    given = given_noise(first, [seen], settings.keypoint_noise, others)
    assert given[1:] == others[1:]
    assert given_noise(first, [seen], settings.keypoint_noise)[1:] == (1.0, 1.0, 1.0)
    sigma = CostModel(body, settings).keypoint_sigma(replace(seen, noise=given))
    assert np.isclose(sigma[0, body.landmark_names.index("left_shoulder")], 8.0)
    assert given_noise((), [seen], settings.keypoint_noise, others) == others
    assert not given_noise((), [seen], settings.keypoint_noise)


def test_places_that_no_chance_explains_are_a_note_of_the_fit() -> None:
    proportions = ProportionedBody(with_layout_places(load_subject("human34"), "coco17"))
    points = FittedKeypoints(proportions, cameras=2)
    offsets = np.zeros((len(points.free), 3))
    offsets[3], offsets[5] = [0.0, -3.1 * UNKNOWN_STD, 0.0], 2.9 * UNKNOWN_STD
    name = proportions.base.landmark_names[3]
    assert points.moved(offsets) == {name: pytest.approx(3.1 * UNKNOWN_STD)}
    assert not FittedKeypoints(proportions, cameras=1).moved(np.zeros((0, 3)))
    nothing = np.zeros((0, 0))
    fit = Fit(load_subject("human34"), (), np.zeros(0), nothing, (), nothing, nothing, moved=points.moved(offsets))
    assert f"{name} (62 mm)" in fit.notes[0]


def test_one_cameras_places_are_not_fitted() -> None:
    proportions = ProportionedBody(with_layout_places(load_subject("human34"), "mediapipe33"))
    assert not len(FittedKeypoints(proportions, cameras=1).free)
    assert len(FittedKeypoints(proportions, cameras=2).free) == len(proportions.base.landmark_names)


@pytest.mark.parametrize("wrong", ['keypoint_std="-0.01"', 'keypoint_std="x"', 'keypoint="1 2"'])
def test_an_invalid_place_is_refused(wrong: str) -> None:
    text = load_subject("human34").urdf.replace('<landmark name="nose"', f'<landmark {wrong} name="nose"')
    with pytest.raises(InputError, match="nose"):
        subject_from_text(text, source="human34", base="free")
