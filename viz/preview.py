"""The browser preview: a run as a page to turn, play and scrub, drawn by meshcat's viewer.

What a page leaves out, to stay below about 30 MB: instants beyond KEY_FRAMES (evenly spaced ones are kept), and video
pictures beyond PICTURES over all cameras; each instant then shows the last picture at or before it. Pictures are
reduced to PICTURE_LONGEST px, freed of lens distortion and JPEG-compressed.
"""

from __future__ import annotations

import base64
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import meshcat
import meshcat.geometry as g
import numpy as np
import pinocchio as pin
from meshcat.animation import Animation, AnimationClip

from estimator.formats.run_file import Run
from estimator.imaging.camera import Camera
from humanoid.atomic import replacing
from humanoid.body import Body
from viz import palette
from viz.painter import BodyPainter
from viz.recorder import CommandRecorder, MotionTrack, ShadedMesh, TexturedPlane
from viz.scene import Scene, as_scene, evenly
from viz.solid import Solid, merged, sides_among
from viz.solids import body_solids

KEY_FRAMES = 600
PICTURES = 240
PICTURES_PER_CAMERA = 120
PICTURE_LONGEST = 640
_QUALITY = 72
_MARK_DEPTH = 0.25  # size of the little pyramid that stands for a camera [m]
_NOTHING = 0.005  # a weight below would be written as 0 %
_HOME_FOV = np.radians(38.0)


def write_html(run: Run | Scene, path: str | Path) -> Path:
    """Write a page that needs nothing else: no server, no network. Raises InputError where it cannot be written."""
    with replacing(path) as temporary:
        temporary.write_text(page(run), encoding="utf-8")
    return Path(path)


def page(run: Run | Scene) -> str:
    """The preview as the text of one HTML page; starts no process."""
    scene = as_scene(run)
    rows = evenly(len(scene), KEY_FRAMES)
    recorder = CommandRecorder()
    root = meshcat.Visualizer(window=recorder)
    painter = BodyPainter(scene.body)
    stage = _Stage(scene, painter, rows)
    _set_lights(root, stage)
    _set_ground(root, stage)
    animation = Animation(default_framerate=_key_rate(scene, rows))
    parts = merged(body_solids(scene.body))
    _add_bodies(root, animation, scene, rows, parts)
    cameras = [_add_camera(root, scene, c, rows, stage) for c in range(len(scene.cameras))]
    root.set_animation(animation, play=True)
    return recorder.page(f"{scene.body.subject.name} - kinemode", _player_data(scene, rows, stage, cameras, parts))


class _Stage:
    """Where the body moves: used to place the ground, the lights, the pictures and the first view."""

    def __init__(self, scene: Scene, painter: BodyPainter, rows: list[int]) -> None:
        bodies = [t for t in rows if scene.has_body(t)]
        chosen = [bodies[i] for i in evenly(len(bodies), 60)]
        vertices = [painter.vertices(scene.body.at(scene.q[t])) for t in chosen]
        self.points = np.concatenate([v[:: max(1, len(v) // 200)] for v in vertices])
        self.floor = min(float(v[:, 2].min()) for v in vertices)
        low, high = np.quantile(self.points, 0.02, axis=0), np.quantile(self.points, 0.98, axis=0)
        self.centre = (low + high) / 2.0
        self.radius = max(0.3, 0.5 * float(np.linalg.norm(high - low)))
        towards = scene.cameras[0].centre_world - self.centre if scene.cameras else np.array([1.0, 0.0, 0.0])
        heading = np.arctan2(towards[1], towards[0]) + np.radians(35.0)
        self.towards_home = np.array([np.cos(heading), np.sin(heading), 0.28])
        self.towards_home /= np.linalg.norm(self.towards_home)

    def eye(self) -> np.ndarray:
        """Where the first view looks from [m], (3,)."""
        return self.centre + self.towards_home * 1.05 * self.radius / np.sin(_HOME_FOV / 2.0)


def _key_rate(scene: Scene, rows: list[int]) -> float:
    """Keys are evenly spaced in the animation; the player's own table says when each of them was."""
    return max(1.0, scene.rate * (len(rows) - 1) / max(1, len(scene) - 1))


def _set_lights(root: meshcat.Visualizer, stage: _Stage) -> None:
    for name, colour in (("top_color", palette.BACKGROUND), ("bottom_color", palette.PANEL)):
        root["/Background"].set_property(name, [channel / 255.0 for channel in colour])
    for name in ("/Grid", "/Axes", "/Lights/PointLightPositiveX"):
        root[name].set_property("visible", False)
    key = stage.centre + 4.0 * stage.towards_home + np.array([0.0, 0.0, 3.0])
    lamp = root["/Lights/PointLightNegativeX/<object>"]
    for name, value in (("position", key.tolist()), ("distance", 0.0), ("intensity", 0.45)):
        lamp.set_property(name, value)
    back = -stage.towards_home + np.array([0.0, 0.0, 0.8])
    root["/Lights/FillLight/<object>"].set_property("position", (10.0 * back).tolist())
    root["/Lights/FillLight/<object>"].set_property("intensity", 0.3)
    root["/Lights/AmbientLight/<object>"].set_property("intensity", 0.52)


def _set_ground(root: meshcat.Visualizer, stage: _Stage) -> None:
    """Lines every half metre, level with the lowest foot."""
    middle = np.round(stage.centre[:2] * 2.0) / 2.0
    reach = np.arange(-3.0, 3.01, 0.5)
    ends = [((x, -3.0), (x, 3.0)) for x in reach] + [((-3.0, y), (3.0, y)) for y in reach]
    points = np.array([[middle[0] + x, middle[1] + y, stage.floor] for pair in ends for x, y in pair])
    root["ground"].set_object(_lines(points, palette.GRID))


def _lines(points: np.ndarray, colour: palette.Rgb) -> g.LineSegments:
    """Segments between consecutive pairs of points (2 S, 3) [m]."""
    geometry = g.PointsGeometry(points.T.astype(np.float32))
    return g.LineSegments(geometry, g.LineBasicMaterial(color=palette.hexadecimal(colour)))


def _add_bodies(
    root: meshcat.Visualizer, animation: Animation, scene: Scene, rows: list[int], parts: tuple[Solid, ...]
) -> None:
    _add_body(root["body"], animation, scene.body, parts, scene.q[rows], 1.0)
    coarse = merged(replace(part, colour=palette.HYPOTHESIS) for part in body_solids(scene.body, coarse=True))
    for k in range(scene.mode_q.shape[1]):
        _add_body(root[f"hypothesis_{k}"], animation, scene.body, coarse, scene.mode_q[rows, k], 0.3)


def _add_body(
    node: meshcat.Visualizer,
    animation: Animation,
    body: Body,
    parts: tuple[Solid, ...],
    q: np.ndarray,
    opacity: float,
) -> None:
    """A node per joint below `node`, with its meshes, and a position and a quaternion per instant (a missing one holds
    still)."""
    names = {part.joint: part.name for part in reversed(parts)}
    moved = sorted(names)
    positions, quaternions = _motion(body, q, moved)
    for j, joint in enumerate(moved):
        child = node[f"{joint}_{names[joint]}"]
        for i, part in enumerate(part for part in parts if part.joint == joint):
            child[str(i)].set_object(_mesh(part), _material(part, opacity))
        child.set_transform(_matrix(positions[0, j], quaternions[0, j]))
        tracks = {
            "position": MotionTrack("position", "vector3", positions[:, j]),
            "quaternion": MotionTrack("quaternion", "quaternion", quaternions[:, j]),
        }
        animation.clips[child.path] = AnimationClip(tracks, fps=animation.default_framerate)


def _mesh(part: Solid) -> g.Geometry:
    if part.normals is None:  # the viewer takes the means of the faces itself
        return g.TriangularMeshGeometry(part.vertices, part.faces)
    return ShadedMesh(part.vertices, part.normals, part.faces)


def _material(part: Solid, opacity: float) -> g.Material:
    """Front faces alone where the solid is closed: the far side of a translucent limb would show as dark bands."""
    paint, side = palette.hexadecimal(part.paint), 0 if part.closed else 2
    return g.MeshPhongMaterial(color=paint, opacity=opacity, shininess=18, side=side)


def _motion(body: Body, q: np.ndarray, moved: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, J, 3) [m] and quaternions xyzw (T, J, 4) of some joints; instants without q repeat the last."""
    positions, quaternions = np.zeros((len(q), len(moved), 3)), np.zeros((len(q), len(moved), 4))
    quaternions[..., 3] = 1.0
    for t, configuration in enumerate(q):
        if not np.isfinite(configuration).all():
            if t > 0:
                positions[t], quaternions[t] = positions[t - 1], quaternions[t - 1]
            continue
        posed = body.at(configuration)
        positions[t] = posed.translations[moved]
        quaternions[t] = [pin.Quaternion(np.ascontiguousarray(R)).coeffs() for R in posed.rotations[moved]]
    return positions, quaternions


def _matrix(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = pin.Quaternion(*quaternion[[3, 0, 1, 2]]).toRotationMatrix()
    matrix[:3, 3] = position
    return matrix


def _add_camera(root: meshcat.Visualizer, scene: Scene, c: int, rows: list[int], stage: _Stage) -> dict[str, Any]:
    """One camera's mark, picture and frustum; returns what the player has to know of it."""
    camera = scene.cameras[c]
    node = root["cameras"][f"camera_{c}"]
    node["mark"].set_object(_lines(_pyramid(camera, _MARK_DEPTH), palette.TEXT))
    depths = stage.points @ camera.R_camera_world[2] + camera.t_camera_world[2]
    far = max(1.0, float(depths.max()) + 0.6)
    pictures, picture_of = _pictures(scene, c, rows)
    if pictures:
        material = g.MeshBasicMaterial(color=0xFFFFFF, side=0)
        node["picture"].set_object(TexturedPlane(_corners(camera, far)), material)
        node["frustum"].set_object(_lines(_pyramid(camera, far), palette.GRID))
    axes, centre = camera.R_camera_world, camera.centre_world
    distance = max(0.5, float(axes[2] @ (stage.centre - centre)))
    sight = (_corners(camera, 1.0) - centre) @ axes.T
    return {
        "name": camera.name,
        "node": f"camera_{c}",
        "eye": centre.tolist(),
        "target": (centre + distance * axes[2]).tolist(),
        "up": (-axes[1]).tolist(),
        # the view's middle is the principal point, so what is farther from it decides
        "half_width": float(np.abs(sight[:, 0]).max()),
        "half_height": float(np.abs(sight[:, 1]).max()),
        "pictures": pictures,
        "picture_of": picture_of,
    }


def _corners(camera: Camera, depth: float) -> np.ndarray:
    """Corners of the picture at a depth, clockwise from the top left, in the world [m], (4, 3)."""
    width, height = camera.image_size
    corners = np.array([[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]])
    rays = np.concatenate([corners, np.ones((4, 1))], axis=1) @ np.linalg.inv(camera.K).T
    return (rays * depth - camera.t_camera_world) @ camera.R_camera_world


def _pyramid(camera: Camera, depth: float) -> np.ndarray:
    corners = _corners(camera, depth)
    eye = camera.centre_world
    pairs = [p for i in range(4) for p in (eye, corners[i], corners[i], corners[(i + 1) % 4])]
    return np.array(pairs)


def _pictures(scene: Scene, c: int, rows: list[int]) -> tuple[list[str], list[int]]:
    """JPEG data addresses of one camera's pictures, and which of them each instant shows."""
    if scene.frames[c] is None:
        return [], []
    wanted = min(PICTURES_PER_CAMERA, max(1, PICTURES // len(scene.cameras)))
    chosen = evenly(len(rows), wanted)
    pictures: list[str] = []
    shown: list[int] = []
    for i, image in zip(chosen, scene.images(c, [rows[i] for i in chosen]), strict=True):
        if image is None:
            break
        pictures.append(_data_address(image, scene.cameras[c]))
        shown.append(i)
    if not pictures:
        return [], []
    last = np.searchsorted(shown, np.arange(len(rows)), side="right") - 1
    return pictures, np.maximum(last, 0).tolist()


def _data_address(image: np.ndarray, camera: Camera) -> str:
    """The picture reduced, undistorted (so that it fits the flat plane) and compressed."""
    scale = min(1.0, PICTURE_LONGEST / max(camera.image_size))
    size = tuple(max(1, round(side * scale)) for side in camera.image_size)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    if np.any(camera.distortion):
        K = camera.K.copy()
        K[:2, 2] = (K[:2, 2] + 0.5) * scale - 0.5
        K[0, :2] *= scale
        K[1, 1] *= scale
        small = cv2.undistort(small, K, np.asarray(camera.distortion, dtype=np.float64))
    _, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode("ascii")


def _player_data(
    scene: Scene, rows: list[int], stage: _Stage, cameras: list[dict[str, Any]], parts: tuple[Solid, ...]
) -> dict[str, Any]:
    rate = _key_rate(scene, rows)
    tangent = float(np.tan(_HOME_FOV / 2.0))
    return {
        "subject": scene.body.subject.name,
        "time": [float(t) for t in np.round(scene.time[rows], 4)],
        "key_time": [i / rate for i in range(len(rows))],
        "index": [int(i) for i in scene.index[rows]],
        "status": [scene.status[t] for t in rows],
        "best": [int(k) for k in scene.path[rows]],
        "weight": [[float(f"{w:.3g}") if np.isfinite(w) else None for w in row] for row in scene.mode_weight[rows]],
        "cameras": cameras,
        "home": {
            "eye": stage.eye().tolist(),
            "target": stage.centre.tolist(),
            "up": [0.0, 0.0, 1.0],
            "half_height": tangent,
            "half_width": tangent,
        },
        "legend": _legend(scene, parts),
        "nothing": _NOTHING,
        "best_colour": _css(palette.GOOD),
        "other_colour": _css(palette.HYPOTHESIS),
        "status_colour": {name: _css(colour) for name, colour in palette.STATUS.items()},
    }


def _legend(scene: Scene, parts: tuple[Solid, ...]) -> list[tuple[str, str | None]]:
    """Names and colours: of the sides that are told apart by colour, else one name for the body."""
    sides = sides_among(part.side for part in parts if part.colour is None)
    legend: list[tuple[str, str | None]] = [(side, _css(palette.SIDES[side])) for side in sides]
    if not legend:
        colours = {part.paint for part in parts}
        legend = [("body", _css(colours.pop()))] if len(colours) == 1 else [("body in its own colours", None)]
    if ((scene.mode_weight >= _NOTHING).sum(axis=1) > 1).any():
        legend.append(("other hypotheses", _css(palette.HYPOTHESIS)))
    return legend


def _css(colour: palette.Rgb) -> str:
    return f"#{palette.hexadecimal(colour):06x}"
