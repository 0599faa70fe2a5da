"""Rooms have no wall or furniture between any of their cameras and the person."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.synthesis.motion import authored_motion
from estimator.synthesis.motion_keys import MOTIONS
from estimator.synthesis.plate import built_scene, place_of
from estimator.synthesis.render import Renderer
from estimator.synthesis.settings import SceneSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from humanoid.kinematics.body import points_in_world
from humanoid.shape.surface import surface_of
from tests.builders import body_of
from tests.tiers import later


def crossed(start: np.ndarray, ends: np.ndarray, corners: np.ndarray) -> int:
    """How many of the lines of sight from a point (3,) to points (N, 3) meet one of the rectangles (Q, 4, 3) before."""
    corner, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    normal = np.cross(u, v)
    ways = ends - start
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.einsum("qi,qi->q", corner - start, normal) / (ways @ normal.T)  # (N, Q)
        at = start + share[..., None] * ways[:, None] - corner
        across = np.einsum("nqi,qi->nq", at, u) / np.einsum("qi,qi->q", u, u)
        up = np.einsum("nqi,qi->nq", at, v) / np.einsum("qi,qi->q", v, v)
    meets = (share > 0.0) & (share < 0.999) & (across >= 0.0) & (across <= 1.0) & (up >= 0.0) & (up <= 1.0)
    return int(meets.any(axis=1).sum())


@pytest.mark.parametrize("count", later(range(1, 9), 2, 5, 6, 7))
@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_nothing_stands_between_a_camera_and_the_person(motion, count: int) -> None:
    body = body_of(motion.subject)
    poses = [body.at(q) for q in authored_motion(body, np.array([0.0, 0.7]) * motion.seconds, motion)]
    surface = surface_of(body, nodes=300)
    points = np.array([points_in_world(posed, surface.joint, surface.local) for posed in poses])
    cameras = framing_cameras(points, ViewSettings(count=count, azimuth=motion.azimuth))
    place = place_of(points, 0.0 if body.has_free_root else None)
    ends = points[:, ::40].reshape(-1, 3)
    ends = ends[ends[:, 2] > place.floor + 0.02]  # soles sink in by millimetres
    for background in ("room", "pillar"):  # "textured" and "moving" have the room's walls
        behind, _ = built_scene(SceneSettings(background), cameras, place, np.random.default_rng(count))
        assert [crossed(camera.centre_world, ends, behind.corners) for camera in cameras] == [0] * count


def test_four_masks_hold_the_person() -> None:
    """The same by the renderer: each mask equals that of the person without a room."""
    body = body_of("human34")
    posed = body.at(body.neutral)
    surface = surface_of(body, nodes=300)
    points = points_in_world(posed, surface.joint, surface.local)[None]
    cameras = framing_cameras(points, ViewSettings(count=4, image_size=(64, 48)))
    masks = []
    for background in ("black", "room", "pillar"):
        renderer = Renderer(body, cameras, np.random.default_rng(0), SceneSettings(background), place_of(points))
        masks.append([renderer.maps(posed, c).mask for c in range(4)])
    assert np.any(masks[0], axis=(1, 2)).all()
    assert (np.array(masks[1:]) == masks[0]).all()
