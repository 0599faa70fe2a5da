"""Skin by its colour: learned in one frame it is found in others, in light and shade, and nothing else is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from estimator.trackers.dual_chain.skin import Blobs, SkinModel, SkinSettings, learned_skin, skin_blobs
from humanoid.support.errors import InputError

SKIN, SHIRT, WALL, HAIR = (128, 158, 214), (150, 92, 38), (176, 188, 196), (28, 36, 52)
FACE, LEFT, RIGHT = (160.0, 60.0), (230.0, 180.0), (90.0, 180.0)
POINTS, ON_FACE = np.array([FACE, LEFT, RIGHT]), np.array([True, False, False])
SIZE, RADIUS, HAND = 90.0, 30, 14
SETTINGS = SkinSettings()
NOISE = 3.0


def picture(left=LEFT, right=RIGHT, *, shade: float = 1.0, boards=(), seed: int = 0) -> np.ndarray:
    """320 x 240: a face and two hands as discs, a shirt, hair, a wall; boards: rectangles in the colour of skin."""
    image = np.full((240, 320, 3), WALL, np.float32)
    for x0, y0, x1, y1 in boards:
        image[y0:y1, x0:x1] = SKIN
    cv2.rectangle(image, (110, 95), (210, 239), SHIRT, -1)
    cv2.ellipse(image, (160, 40), (RADIUS, 25), 0.0, 0.0, 360.0, HAIR, -1)
    for middle, radius in ((FACE, RADIUS), (left, HAND), (right, HAND)):
        if middle is not None:
            cv2.circle(image, (int(middle[0]), int(middle[1])), radius, tuple(shade * c for c in SKIN), -1)
    image += NOISE * np.random.default_rng(seed).standard_normal(image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def model() -> SkinModel:
    return learned_skin(picture(), POINTS, ON_FACE, SIZE, SETTINGS, "clip.mp4")


def nearest(blobs: Blobs, point) -> float:
    return float(np.linalg.norm(blobs.mean - point, axis=1).min())


@pytest.mark.parametrize("shade", [1.0, 0.6, 0.45])
def test_skin_is_found_in_light_and_in_shade(model: SkinModel, shade: float) -> None:
    left, right = (250.0, 120.0), (60.0, 210.0)
    blobs = skin_blobs(picture(left, right, shade=shade, seed=1), model, None, SETTINGS)
    assert len(blobs.area) == 3
    assert max(nearest(blobs, p) for p in (FACE, left, right)) < 1.5
    # the moments of a disc: pi r^2 and r^2 / 4
    np.testing.assert_allclose(blobs.area[1:], np.pi * HAND**2, rtol=0.12)
    np.testing.assert_allclose(blobs.covariance[1:], np.tile(HAND**2 / 4.0 * np.eye(2), (2, 1, 1)), atol=8.0)
    np.testing.assert_array_equal(blobs.merged, [True, False, False])


def test_areas_are_learned(model: SkinModel) -> None:
    assert model.hand == pytest.approx(np.pi * HAND**2, rel=0.12)
    assert model.face == pytest.approx(np.pi * RADIUS**2, rel=0.12)


def test_hands_that_touch_are_one_blob_which_is_marked(model: SkinModel) -> None:
    blobs = skin_blobs(picture((150.0, 200.0), (172.0, 200.0)), model, None, SETTINGS)
    assert len(blobs.area) == 2
    assert blobs.merged.all()
    assert nearest(blobs, (161.0, 200.0)) < 1.5


def test_a_board_of_the_same_colour_counts_where_it_is_not_known_to_be_background(model: SkinModel) -> None:
    boards = [(10, 20, 40, 60)]
    seen = picture(boards=boards)
    free = np.ones(seen.shape[:2], bool)
    free[:80, :60] = False
    assert len(skin_blobs(seen, model, None, SETTINGS).area) == 4
    assert len(skin_blobs(seen, model, free, SETTINGS).area) == 3
    # nor does it count as a hand in front of it, if the board is known in the learning frame
    behind = [(70, 150, 120, 210)]
    mask = np.zeros(seen.shape[:2], bool)
    mask[95:, 110:210] = True
    for middle, radius in ((FACE, RADIUS), (LEFT, HAND), (RIGHT, HAND)):
        mask |= np.hypot(*(np.indices(mask.shape)[::-1] - np.array(middle)[:, None, None])) <= radius
    with_mask = learned_skin(picture(boards=behind), POINTS, ON_FACE, SIZE, SETTINGS, "", mask)
    assert with_mask.hand == pytest.approx(np.pi * HAND**2, rel=0.15)


def test_areas_larger_than_a_persons_skin_are_not_skin(model: SkinModel) -> None:
    blobs = skin_blobs(picture(boards=[(220, 10, 319, 150)]), model, None, SETTINGS)
    assert len(blobs.area) == 3


def test_frames_without_skin_have_no_blobs(model: SkinModel) -> None:
    for empty in (np.zeros((240, 320, 3), np.uint8), np.full((240, 320, 3), WALL, np.uint8)):
        blobs = skin_blobs(empty, model, None, SETTINGS)
        assert [len(a) for a in (blobs.mean, blobs.covariance, blobs.area, blobs.merged)] == [0] * 4
        assert blobs.mean.shape == (0, 2)


def test_a_model_is_kept(model: SkinModel) -> None:
    again = SkinModel.from_arrays(model.arrays())
    np.testing.assert_array_equal(again.log_ratio, model.log_ratio)
    assert (again.brightness, again.face, again.hand, again.size) == (model.brightness, model.face, model.hand, SIZE)
    with pytest.raises(InputError, match="damaged"):
        SkinModel.from_arrays({**model.arrays(), "hand": np.array(np.nan)})


@pytest.mark.parametrize(
    ("seen", "points", "match"),
    [
        (picture(), np.array([[np.nan, 1.0], [-5.0, 8.0], [320.0, 8.0]]), "no point on skin"),
        (picture(boards=[(0, 0, 100, 239), (220, 0, 319, 239)]), POINTS, r"in \d\d% of the picture"),
        (np.zeros((240, 320, 3), np.uint8), POINTS, "is black"),
    ],
)
def test_what_cannot_be_learned_is_one_line(seen: np.ndarray, points: np.ndarray, match: str) -> None:
    with pytest.raises(InputError, match=match) as error:
        learned_skin(seen, points, ON_FACE, SIZE, SETTINGS, "clip.mp4")
    assert "clip.mp4" in str(error.value)
    assert "\n" not in str(error.value)
