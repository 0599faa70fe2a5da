"""What a camera sees of a surface, against rays through every triangle, masks drawn from them, and a sphere."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.ray.ray_triangle import RayMeshIntersector

from estimator.data.cameras.camera import Camera
from estimator.vision.prediction import Prediction, Predictor
from estimator.vision.view import GAP, JOINED
from estimator.vision.visibility import BACK_FACING, HIDDEN, INNER, OCCLUDED, OUTER, OUTSIDE, VISIBLE
from humanoid.kinematics.body import Body, PosedBody, points_in_world
from humanoid.shape.surface import Surface, surface_of
from humanoid.subject.subject import load_subject, subject_from_text
from tests.builders import BROWN, bent, body_of, camera_at, random_pose

NODES = 1000
FINE = 4  # pixels of a drawn mask in one of the camera's
ARMS_FORWARD = {
    **{f"{s}_shoulder_flexion": 1.0 for s in ("left", "right")},
    **{f"{s}_shoulder_rotation": 0.9 for s in ("left", "right")},
    **{f"{s}_elbow_flexion": 1.7 for s in ("left", "right")},
    "left_hip_flexion": 1.4,
    "left_knee_flexion": 1.2,
}
CASES = [
    *(("human34", f"random {k}") for k in range(4)),
    ("human34", "arms before the trunk"),
    ("arm8", "random 0"),
    ("arm8", "random 1"),
    ("upper13", "random 0"),
    ("example-robot-data:panda", "random 0"),
]


class View(NamedTuple):
    """A posed surface and its prediction; world (N, 3) [m] its nodes, owner (F,) the part of each face."""

    name: str
    posed: PosedBody
    camera: Camera
    surface: Surface
    world: np.ndarray
    normals: np.ndarray
    owner: np.ndarray
    seen: Prediction

    @property
    def triangles(self) -> np.ndarray:
        return self.world[self.surface.faces]

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Depths (N,) [m] of world points."""
        return points @ self.camera.R_camera_world[2] + self.camera.t_camera_world[2]

    def moved(self, points: np.ndarray, by: np.ndarray) -> np.ndarray:
        """World points moved at equal depth by (N, 2) pixels."""
        metres = by * self.depth(points)[:, None] / np.diag(self.camera.K)[:2]
        return points + metres @ self.camera.R_camera_world[:2]


@cache
def surface(name: str) -> tuple[Body, Surface]:
    body = Body(load_subject(name)) if ":" in name else body_of(name)
    return body, surface_of(body, NODES)


@cache
def fine_surface(name: str) -> Surface:
    return surface_of(surface(name)[0], 6 * NODES)


@cache
def view(name: str, pose: str, distortion: tuple[float, ...] = BROWN) -> View:
    """A subject in a pose, framed by a camera somewhere around it, in front for the arms before the trunk."""
    body, made = surface(name)
    if pose.startswith("random"):
        rng = np.random.default_rng(int(pose.split()[1]))
        q, azimuth = random_pose(body, rng, share=0.8, turn=0.5), rng.uniform(0.0, 360.0)
    else:
        q, azimuth = bent(body, **ARMS_FORWARD), 10.0
    posed = body.at(q)
    world = points_in_world(posed, made.joint, made.local)
    normals = np.einsum("nij,nj->ni", posed.rotations[made.joint], made.normal)
    middle, size = 0.5 * (world.min(axis=0) + world.max(axis=0)), np.ptp(world, axis=0).max()
    camera = camera_at(azimuth, distance=2.2 * size, aim=middle, distortion=distortion)
    return View(
        name, posed, camera, made, world, normals, made.part[made.faces[:, 0]], Predictor(made, camera).predict(posed)
    )


def crossings(centre: np.ndarray, ends: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Where segments from `centre` to `ends` (N, 3) and beyond meet triangles (F, 3, 3), as shares of the segments
    (N, F), infinite where they miss (Moeller and Trumbore 1997)."""
    e1, e2, s = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0], centre - triangles[:, 0]
    d = ends - centre
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = -1.0 / (d @ np.cross(e1, e2).T)
        u, v = -(d @ np.cross(s, e2).T) * scale, (d @ np.cross(s, e1).T) * scale
        t = np.einsum("fi,fi->f", e2, np.cross(s, e1)) * scale
        return np.where((u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 1e-9), t, np.inf)


def nearer_by(v: View, points: np.ndarray, part: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """How much nearer than points (N, 3) of parts (N,) another part, or their own if it is not convex, crosses the
    rays towards `ends` (N, 3) [m]; minus infinity where there is none."""
    t = crossings(v.camera.centre_world, ends, v.triangles)
    t[(v.owner == part[:, None]) & v.surface.convex[part][:, None]] = np.inf
    return np.asarray(v.depth(points) - t.min(axis=1) * v.depth(ends))


def around(v: View) -> list[np.ndarray]:
    """Directions, as far in pixels as one cell of the depth buffer."""
    return [v.seen.frame[2] * np.array([np.cos(a), np.sin(a)]) for a in np.arange(8) * np.pi / 4.0]


@pytest.mark.parametrize(("name", "pose"), CASES)
def test_states_of_nodes_are_those_of_rays(name: str, pose: str) -> None:
    v = view(name, pose)
    state = v.seen.state
    back = np.einsum("ni,ni->n", v.world - v.camera.centre_world, v.normals) >= 0.0
    np.testing.assert_array_equal(state == BACK_FACING, back)
    front = np.flatnonzero(~back)
    points, part = v.world[front], v.surface.part[front]
    nearer = nearer_by(v, points, part, points)
    differs = (state[front] == OCCLUDED) != (nearer > GAP)
    assert np.count_nonzero(nearer > GAP) > 0.02 * len(state)
    assert np.count_nonzero(differs) < 0.02 * len(state)
    # who disagrees lies within a cell of another part's outline, or of the depth that decides
    points, part, nearer = points[differs], part[differs], nearer[differs]
    hidden = np.array([nearer_by(v, points, part, v.moved(points, by[None])) > GAP for by in around(v)])
    assert ((hidden.any(axis=0) & ~hidden.all(axis=0)) | (np.abs(nearer - GAP) < 0.005)).all()
    assert v.seen.back_facing == np.count_nonzero(back)
    assert v.seen.occluded == np.count_nonzero(state == OCCLUDED)


def test_an_arm_before_the_trunk_hides_it() -> None:
    v = view("human34", "arms before the trunk")
    links = np.array(v.surface.links)[v.surface.part]
    front = v.seen.state != BACK_FACING
    hidden = {name: (v.seen.state[(links == name) & front] == OCCLUDED).mean() for name in ("torso", "left_forearm")}
    assert hidden["torso"] > 0.15
    assert hidden["left_forearm"] < 0.1


@pytest.mark.parametrize(("name", "pose"), CASES[2:6])
def test_the_depth_buffer_holds_the_nearest_triangle(name: str, pose: str) -> None:
    """Against trimesh's rays through the centres of cells; without distortion straight lines stay straight."""
    v = view(name, pose, (0.0,) * 5)
    left, top, cell = v.seen.frame
    rows, columns = np.indices(v.seen.buffer.shape)
    row, column = (a.ravel()[::23] for a in (rows, columns))
    pixels = np.stack([left + cell * column, top + cell * row, np.ones(len(row))], axis=1)
    rays = pixels @ np.linalg.inv(v.camera.K).T @ v.camera.R_camera_world
    mesh = Trimesh(v.world, v.surface.faces, process=False)
    face, ray, place = RayMeshIntersector(mesh).intersects_id(
        np.broadcast_to(v.camera.centre_world, rays.shape), rays, return_locations=True
    )
    nearest, owner = np.full(len(row), np.inf), np.full(len(row), -1)
    for f, r, depth in zip(face, ray, v.depth(place), strict=True):
        if depth < nearest[r]:
            nearest[r], owner[r] = depth, v.owner[f]
    near, held = v.seen.buffer[row, column], v.seen.owner[row, column]
    assert np.count_nonzero(owner >= 0) > 50
    same = (held >= 0) == (owner >= 0)
    assert np.count_nonzero(~same) <= 1  # a ray through an edge of the outline
    both = same & (owner >= 0)
    np.testing.assert_allclose(1.0 / near[both], nearest[both], rtol=1e-9)
    np.testing.assert_array_equal(held[both], owner[both])
    assert not near[held < 0].any()


def drawn(v: View) -> np.ndarray:
    """The smooth body, by a mesh several times as fine, filled FINE times larger than the picture, (FINE H, FINE W)."""
    made = fine_surface(v.name)
    width, height = v.camera.image_size
    mask = np.zeros((FINE * height, FINE * width), dtype=np.uint8)
    fine = (v.camera.project(points_in_world(v.posed, made.joint, made.local)) + 0.5) * FINE - 0.5
    for corners in np.round(16.0 * fine[made.faces]).astype(np.int32):
        cv2.fillConvexPoly(mask, corners, 1, shift=4)
    return mask > 0


@pytest.mark.parametrize(("name", "pose"), CASES[:-1])
def test_outer_contours_lie_on_the_outline(name: str, pose: str) -> None:
    v = view(name, pose)
    mask, cell = drawn(v), v.seen.frame[2]
    pixels, normals = (a[v.seen.contours.state == OUTER] for a in (v.seen.contours.pixels, v.seen.contours.normals))
    rim = mask & (cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
    outline = (np.argwhere(rim)[::FINE, ::-1] + 0.5) / FINE - 0.5
    gaps = np.linalg.norm(pixels[:, None] - outline, axis=2)
    off = gaps.min(axis=1)
    assert np.median(off) < 0.6
    assert np.mean(off < 1.5) > 0.86
    assert off.max() < 2.3 * cell  # where parts join, a contour slightly inside the outline still counts as part of it
    assert np.quantile(gaps.min(axis=0), 0.95) < 8.0  # about half a mesh edge: no part of the outline is left out
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)

    def covered(points: np.ndarray) -> np.ndarray:
        x, y = np.round((points + 0.5) * FINE - 0.5).astype(int).T
        return np.asarray(mask[y.clip(0, len(mask) - 1), x.clip(0, mask.shape[1] - 1)])

    assert np.mean(covered(pixels - 1.5 * cell * normals)) > 0.97
    assert np.mean(covered(pixels + 1.5 * cell * normals)) < 0.2  # a crease between two parts has both behind


def contours_by_rays(v: View, reach: float) -> np.ndarray:
    """States (M,) of the contour points by rays that pass `reach` [px] within and outside of them."""
    c, part = v.seen.contours, v.surface.part[v.seen.contours.nodes[:, 0]]
    share = c.share[:, None]
    points = (1.0 - share) * v.world[c.nodes[:, 0]] + share * v.world[c.nodes[:, 1]]
    within, outside = (v.moved(points, sign * reach * c.normals) for sign in (-1.0, 1.0))
    met = crossings(v.camera.centre_world, within, v.triangles)
    covered = v.depth(points) - met.min(axis=1) * v.depth(within) > GAP
    covered &= v.owner[met.argmin(axis=1)] != part
    behind = crossings(v.camera.centre_world, outside, v.triangles).min(axis=1) * v.depth(outside) - v.depth(points)
    width, height = v.camera.image_size
    covered |= ~((c.pixels >= -0.5) & (c.pixels <= [width - 0.5, height - 0.5])).all(axis=1)
    seen = np.where(np.isinf(behind), OUTER, np.where(behind > JOINED, INNER, HIDDEN))
    return np.where(covered, HIDDEN, seen)


@pytest.mark.parametrize(("name", "pose"), CASES[2:8])
def test_states_of_contours_are_those_of_rays(name: str, pose: str) -> None:
    """On the outline, before another part, hidden by one or within a joint's overlap, as found by rays beside them."""
    v = view(name, pose)
    state = v.seen.contours.state
    cells = [contours_by_rays(v, share * v.seen.frame[2]) for share in (0.8, 1.5)]
    assert np.mean((cells[0] != state) & (cells[1] != state)) < 0.05
    for kind in (OUTER, HIDDEN):
        own = state == kind
        assert np.mean((cells[0][own] == kind) | (cells[1][own] == kind)) > 0.95
    assert (state == INNER).any() or name == "arm8"  # an arm may stand clear of its trunk


def unprojected(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Unit rays (N, 3), camera frame, of pixels (N, 2), by iterating the projection."""
    back = np.linalg.inv(camera.K).T
    at = np.column_stack([pixels, np.ones(len(pixels))]) @ back
    for _ in range(30):
        at[:, :2] += (pixels - camera.project(camera.centre_world + at @ camera.R_camera_world)) @ back[:2, :2]
    return at / np.linalg.norm(at, axis=1, keepdims=True)


@pytest.mark.parametrize("distortion", [(0.0,) * 5, BROWN])
def test_the_contour_of_a_sphere_is_a_circle_of_rays(distortion: tuple[float, ...]) -> None:
    """All rays that touch a sphere of radius r at distance d make the angle asin(r / d) with the one to its centre."""
    radius, centre = 0.3, np.array([0.2, -0.1, 0.15])
    flesh = f'<flesh shape="superquadric" radii="{radius} {radius} {radius}" exponents="1 1"/>'
    urdf = f'<robot name="ball"><subject base="free"/><link name="ball">{flesh}</link></robot>'
    body = Body(subject_from_text(urdf, source="ball"))
    camera = camera_at(30.0, distance=1.5, focal=400.0, distortion=distortion)
    q = body.neutral.copy()
    q[:3] = centre
    to_centre = camera.R_camera_world @ centre + camera.t_camera_world
    distance = float(np.linalg.norm(to_centre))

    def angle(pixels: np.ndarray) -> np.ndarray:
        return np.arccos(unprojected(camera, pixels) @ to_centre / distance)

    worst = []
    for nodes in (300, 1000):
        seen = Predictor(surface_of(body, nodes), camera).predict(body.at(q))
        contours = seen.contours
        assert (contours.state == OUTER).all()
        worst.append(float(np.abs(angle(contours.pixels) - np.arcsin(radius / distance)).max()))
        slope = np.stack([angle(contours.pixels + d) - angle(contours.pixels - d) for d in 0.01 * np.eye(2)], axis=1)
        slope /= np.linalg.norm(slope, axis=1, keepdims=True)
        assert np.einsum("ni,ni->n", slope, contours.normals).min() > np.cos(np.radians(4.0))
        assert seen.occluded == 0
        # a camera sees a cap of the area (1 - r / d) / 2
        assert np.mean(seen.state == VISIBLE) == pytest.approx(0.5 * (1.0 - radius / distance), abs=0.01)
    assert 400.0 * worst[1] < 0.2  # px
    assert worst[1] < 0.5 * worst[0]  # of second order in the spacing of the nodes


def test_what_is_not_in_the_picture_is_not_seen() -> None:
    body, made = surface("human34")
    posed = body.at(body.neutral)
    at_feet = camera_at(0.0, distance=1.2, height=-0.4, aim=(0.0, -0.4, -0.9))
    seen = Predictor(made, at_feet).predict(posed)
    assert (seen.pixels[seen.state == VISIBLE, 0] > at_feet.image_size[1]).any()
    width, height = at_feet.image_size
    inside = ((seen.pixels >= -0.5) & (seen.pixels <= [width - 0.5, height - 0.5])).all(axis=1)
    assert 0.1 < inside.mean() < 0.9
    assert (seen.state[~inside] != VISIBLE).all()
    assert not (seen.state[inside & (seen.depth > 0.0)] == OUTSIDE).any()
    shown = seen.contours.state != HIDDEN
    assert ((seen.contours.pixels[shown] >= -0.5) & (seen.contours.pixels[shown] <= [width - 0.5, height - 0.5])).all()
    away = camera_at(0.0, aim=(9.0, 0.0, 0.3))
    nothing = Predictor(made, away).predict(posed)
    assert (nothing.state == OUTSIDE).all()
    assert (nothing.back_facing, nothing.occluded, len(nothing.contours.state)) == (0, 0, 0)
