"""Where a picture shows the background at another brightness."""

from __future__ import annotations

import numpy as np

from estimator.vision.cues.subtraction import Background, SilhouetteSettings, departure


def scene() -> np.ndarray:
    """A wall (60, 80, 3) with a texture of coarse squares."""
    coarse = np.random.default_rng(0).integers(60, 180, (12, 16, 1)) + np.array([0, 10, 20])
    return np.kron(coarse, np.ones((5, 5, 1))).astype(np.float32)


def test_a_shadow_keeps_the_texture_and_paint_does_not() -> None:
    wall = scene()
    background = Background(wall, np.full_like(wall, 2.0), np.ones(wall.shape[:2], bool))
    picture = wall.copy()
    shadow, paint = np.s_[10:40, 5:35], np.s_[10:40, 45:75]
    picture[shadow] *= 0.75
    picture[paint] = 90.0
    departs = departure(picture.astype(np.uint8), background, SilhouetteSettings())
    assert (departs.squared[shadow] < 1.0).all()
    assert departs.shaded[20:30, 15:25].mean() > 0.9
    assert (departs.squared[paint] > 1.0).mean() > 0.8
    assert not departs.shaded[20:30, 55:65].any()
    assert (departs.squared[45:] < 1.0).all()
    assert not departs.shaded[50:].any()


def test_a_pixel_is_classified_alike_in_any_crop() -> None:
    wall = scene()
    picture = np.clip(wall * 0.7, 0.0, 255.0).astype(np.uint8)
    whole, part = (
        departure(picture[:, k:], Background(wall[:, k:], np.full_like(wall[:, k:], 2.0), np.ones((60, 80 - k), bool)),
                  SilhouetteSettings()) for k in (0, 7)
    )  # fmt: skip
    inner = np.s_[:, 20:]  # beyond what the new border is seen from
    np.testing.assert_array_equal(whole.squared[:, 7:][inner], part.squared[inner])
    np.testing.assert_array_equal(whole.shaded[:, 7:][inner], part.shaded[inner])
