"""Patches of one part of the body: which pixels are theirs, and where they are found in the next picture."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.data.formats.cameras import load_cameras
from estimator.vision.cues.part_patches import (
    LEAST_TEXTURE,
    REACH,
    RETURNED,
    SIDE,
    follow_patches,
    part_masks,
    texture_of,
)
from estimator.vision.prediction import Predictor
from humanoid.kinematics.body import Body
from humanoid.shape.surface import surface_of
from humanoid.subject.subject import load_subject
from kinemode.shot import RenderedClip
from tests.shifted_textures import shifted_textures

SHIFT = (3.3, -2.1)  # px
LEFT, RIGHT = 70, 79  # columns of a limb, narrower than a window


def limb_before_a_room() -> tuple[np.ndarray, np.ndarray]:
    """Two pictures (120, 160) uint8: a strip of texture moves by SHIFT before texture that stays."""
    before, moved = shifted_textures(SHIFT)
    room = before[::-1, ::-1]
    columns = np.arange(before.shape[1])
    here = (columns >= LEFT) & (columns < RIGHT)
    there = (columns >= LEFT + SHIFT[0]) & (columns < RIGHT + SHIFT[0])
    return np.where(here, before, room), np.where(there, moved, room)


def limb_points() -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 2) in the limb's middle, and the masks of its pixels."""
    points = np.column_stack([np.full(9, (LEFT + RIGHT - 1) / 2.0), np.linspace(20.0, 100.0, 9)])
    across = np.arange(SIDE) - REACH + points[0, 0]
    mask = np.broadcast_to((across > LEFT) & (across < RIGHT - 1), (SIDE, SIDE))
    return points, np.repeat(mask[None], len(points), axis=0)


def test_a_limb_is_found_by_its_own_pixels_and_missed_by_all() -> None:
    before, now = limb_before_a_room()
    points, masks = limb_points()
    own, missed = follow_patches(before, now, points, points + np.round(SHIFT), masks)
    assert (missed < RETURNED).all()
    np.testing.assert_allclose(own, points + SHIFT, atol=0.2)
    mixed, _ = follow_patches(before, now, points, points + np.round(SHIFT), np.ones_like(masks))
    wrong = [np.linalg.norm(places - points - SHIFT, axis=1).mean() for places in (own, mixed)]
    assert wrong[1] > 4.0 * wrong[0]


@pytest.mark.parametrize("shift", [(0.4, 0.0), (-2.6, 3.1)])
def test_whole_windows_follow_a_shifted_picture(shift: tuple[float, float]) -> None:
    before, now = shifted_textures(shift)
    points = np.random.default_rng(4).uniform([20.0, 20.0], [140.0, 100.0], (60, 2))
    places, missed = follow_patches(before, now, points, points, np.ones((60, SIDE, SIDE), bool))
    hit = missed < RETURNED
    assert hit.mean() > 0.9
    np.testing.assert_allclose(places[hit], points[hit] + shift, atol=0.1)


def test_what_cannot_be_followed_is_lost() -> None:
    before, now = limb_before_a_room()
    points, masks = limb_points()
    even = np.full_like(before, 120)
    for first, second, chosen in ((before, now, np.zeros_like(masks)), (even, now, masks), (before, even, masks)):
        assert np.isinf(follow_patches(first, second, points, points, chosen)[1]).all()
    assert (texture_of(even, points, masks) == 0.0).all()
    assert (texture_of(before, points, masks) > LEAST_TEXTURE).all()
    stripes = np.where(np.arange(160) // 3 % 2, 60, 200).astype(np.uint8)[None].repeat(120, axis=0)
    assert texture_of(stripes, points, masks) == pytest.approx(0.0, abs=1e-6)


def test_masks_have_pixels_of_a_nodes_own_part_alone(clip: RenderedClip) -> None:
    ((_, camera),) = load_cameras(clip.cameras).items()
    body = Body(load_subject(clip.subject))
    surface = surface_of(body)
    prediction = Predictor(surface, camera).predict(body.at(np.load(clip.truth)["q"][0]))
    nodes = np.flatnonzero(prediction.visible)
    masks = part_masks(prediction, surface, nodes)
    offsets = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), axis=-1) - REACH
    for node, mask in zip(nodes, masks, strict=True):
        cells, inside = prediction.cells((prediction.pixels[node] + offsets)[mask])
        assert inside.all()
        assert (prediction.owner[cells[:, 1], cells[:, 0]] == surface.part[node]).all()
    assert masks.any(axis=(1, 2)).mean() > 0.5
    hidden = prediction.owner.copy()
    hidden[:] = -1
    assert not part_masks(prediction._replace(owner=hidden), surface, nodes).any()
