"""A background learned with the body's place from keypoints: a person who stands still is not scenery."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from estimator.data.image_cues import ImageCues
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.background import KnownBody
from estimator.vision.cues.foreground import (
    SilhouetteSettings,
    foreground_mask,
    learn_background,
    silhouette_of,
)
from estimator.vision.cues.reader import persons_before
from estimator.vision.cues.settings import cue_settings
from estimator.vision.cues.silhouette import Outline
from estimator.vision.person_region import KnownPerson, Limbs, limbs_of
from humanoid.kinematics.body import Body, points_in_world
from humanoid.shape.surface import surface_of
from humanoid.subject.subject import load_subject
from tests.builders import camera_at
from tests.test_cues import HEIGHT, WIDTH, X, Y, overlap, scene, texture
from tests.tiers import later

SETTINGS = SilhouetteSettings(rounds=1)


def upright(x: float, grown: float = 0.0) -> np.ndarray:
    """An upright bar 24 px wide, and the area up to `grown` around it."""
    return (np.abs(X - x) < 12.0 + grown) & (np.abs(Y - 60.0) < 40.0 + grown)


def clip_of(places: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    rng, room, thing = np.random.default_rng(20), texture(21, contrast=25.0), texture(22) * (0.4, 0.5, 1.5)
    return [scene(rng, room, upright(x), thing, int(x)) for x in places], room


def known(x: float) -> KnownBody:
    return KnownBody(upright(x, -8.0), upright(x, -2.0), upright(x, 10.0))


@pytest.mark.parametrize("stands_first", later([True, False], True))
def test_standing_then_walking_is_recognised_from_the_first_frame(stands_first: bool) -> None:
    walks, stands = np.linspace(40, 120, 9).round(), np.full(16, 40.0 if stands_first else 120.0)
    places = np.concatenate([stands, walks] if stands_first else [walks, stands])
    frames, room = clip_of(places)
    there = upright(stands[0], -3.0)
    without = learn_background(frames, SETTINGS)
    background = learn_background(frames, SETTINGS, [known(places[0])] + [None] * (len(frames) - 1))
    assert without is not None
    assert background is not None
    assert np.median(np.abs(without.mean - room)[there & without.known]) > 20.0  # the person counts as scenery
    assert background.known[there].mean() > 0.9
    assert np.median(np.abs(background.mean - room)[there]) < 2.0
    for i in (0, 12, 18, 24):
        assert overlap(foreground_mask(frames[i], background, SETTINGS), upright(places[i])) > 0.9


@pytest.mark.parametrize("back_at", [40.0, 46.0])
def test_who_comes_back_to_stand_there_is_still_no_scenery(back_at: float) -> None:
    away = np.concatenate([np.linspace(40, 100, 4), np.linspace(100, back_at, 4)]).round()
    places = np.concatenate([np.full(10, 40.0), away, np.full(18, back_at)])
    frames, room = clip_of(places)
    at_first = known(places[0])._replace(body=upright(places[0], 2.0))  # flesh is drawn rather wide than narrow
    background = learn_background(frames, SETTINGS, [at_first] + [None] * (len(frames) - 1))
    assert background is not None
    wrong = background.known & (np.abs(background.mean - room).max(axis=2) > 20.0)
    assert wrong.sum() < 0.15 * upright(40.0).sum()
    assert background.known[~upright(40.0, 6.0) & ~upright(back_at, 6.0)].all()


def test_the_background_behind_a_still_person_is_unknown() -> None:
    places = np.full(20, 80.0)
    frames, room = clip_of(places)
    background = learn_background(frames, SETTINGS, [known(x) for x in places])
    assert background is not None
    assert not background.known[upright(80.0)].any()
    assert background.known[~upright(80.0, 6.0)].all()
    assert np.median(np.abs(background.mean - room)[background.known]) < 2.0
    silhouette = silhouette_of(foreground_mask(frames[7], background, SETTINGS), background.known)
    assert len(silhouette.boundary)
    assert not silhouette.certain.any()  # and has no effect
    cues = ImageCues(replace(camera_at(0.0), image_size=(WIDTH, HEIGHT)), {"silhouette": silhouette})
    assert "behind 100% of the keypoints of frame 7 is never seen" in Outline().doubt(cues, np.full((5, 2), 80.0), 7)
    assert "has 0% of the keypoints on it" in Outline().doubt(cues, np.full((5, 2), 10.0), 7)


@pytest.fixture(scope="module")
def body() -> Body:
    return Body(load_subject("human34"))


@pytest.fixture(scope="module")
def limbs(body: Body) -> Limbs:
    return limbs_of(body)


@pytest.mark.parametrize("seed", range(4))
def test_limbs_lie_where_the_body_does(seed: int, body: Body, limbs: Limbs) -> None:
    rng = np.random.default_rng(seed)
    pose = body.integrate(body.neutral, np.concatenate([np.zeros(6), 0.5 * rng.standard_normal(body.nv - 6)]))
    posed, camera = body.at(body.clamp(pose)), camera_at(90.0 * seed)
    surface = surface_of(body, 2000)
    truth = np.zeros(camera.image_size[::-1], np.uint8)
    for corners in np.round(camera.project(points_in_world(posed, surface.joint, surface.local)))[surface.faces]:
        cv2.fillConvexPoly(truth, corners.astype(np.int32), 1)
    pixels, seen = camera.project(body.landmarks(posed)), np.ones(len(body.landmark_names), bool)
    core, about, reach = (limbs.mask(pixels, seen, camera.image_size, w) for w in (0.3, 1.0, 1.8))
    assert truth[core].mean() > 0.93
    assert about[truth > 0].mean() > 0.9
    assert reach[truth > 0].mean() > 0.995
    assert reach.sum() < 4.0 * truth.sum()
    seen[[body.landmark_names.index(name) for name in ("left_knee", "neck", "right_elbow")]] = False
    assert limbs.mask(np.where(seen[:, None], pixels, np.nan), seen, camera.image_size, 1.8)[truth > 0].mean() > 0.95


def test_a_fitted_body_is_found_as_the_one_it_was_fitted_from(limbs: Limbs) -> None:
    fitted = load_subject("human34")
    fitted = fitted.scaled({p.joint: 1.1 for p in fitted.proportions})
    pixels, confidence = np.full((1, 1, len(limbs.ends), 2), np.nan), np.zeros((1, 1, len(limbs.ends)))
    persons = persons_before(fitted, [camera_at(0.0)], pixels, confidence, cue_settings(["silhouette"]))
    assert persons is not None
    assert persons[0].limbs.parts == limbs.parts
    assert persons[0].limbs.ends.tobytes() == limbs.ends.tobytes()
    assert not len(persons[0].instants)
    assert persons_before(fitted, [camera_at(0.0)], pixels, confidence, cue_settings(["edges"])) is None


def test_keypoints_are_of_the_instants_frames(tmp_path: Path, body: Body, limbs: Limbs) -> None:
    for i, frame in enumerate(clip_of(np.linspace(40, 120, 9))[0]):
        cv2.imwrite(str(tmp_path / f"{i}.png"), frame)
    camera = camera_at(0.0)
    pixels = np.repeat(camera.project(body.landmarks(body.at(body.neutral)))[None], 3, axis=0)
    seen = np.array([[True], [False], [True]]) & np.ones(pixels.shape[:2], bool)
    pixels = pixels * (WIDTH, HEIGHT) / camera.image_size
    small = replace(camera, image_size=(WIDTH, HEIGHT))
    person = KnownPerson(limbs, pixels, seen, (WIDTH, HEIGHT))
    pictures = CameraPictures(tmp_path, small, WIDTH, frames=np.array([3, 4, 5]), person=person)
    assert pictures.spread(9)[1] == [None, None, None, 0, None, 2, None, None, None]
    assert pictures.spread(2)[1] == [None, 0, None]  # the first, the last, and the known one
    assert pictures.body(2, 1.0).shape == (HEIGHT, WIDTH)
    pictures.close()
