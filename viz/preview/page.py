"""The browser preview: a run as a page to rotate, play and scrub, drawn by meshcat's viewer.

What a page leaves out, to stay below about 30 MB: instants beyond KEY_FRAMES (evenly spaced ones are kept), and
pictures as in `viz.preview.cameras`.

Content of the page's panel of curves: every joint angle over time, its interval, and the hypotheses' angles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import meshcat
import meshcat.geometry as g
import numpy as np
import pinocchio as pin
from meshcat.animation import Animation, AnimationClip

from estimator.runs.coordinates import JointEntry, joint_entries
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import Body
from humanoid.support.files import replacing
from viz import palette
from viz.pictures.painter import BodyPainter
from viz.preview.beside import add_floor, add_forces, add_source, add_stances
from viz.preview.cameras import add_camera
from viz.preview.recorder import CommandRecorder, MotionTrack, ShadedMesh
from viz.scene import Scene, as_scene, evenly
from viz.solids.body_solids import body_solids
from viz.solids.solid import DrawnMesh, merged, side_of, sides_among
from viz.source_figure import LEGEND, heading

_UNITS = {"turn": ("°", float(np.degrees(1.0))), "slide": ("mm", 1e3)}


def joint_curves(scene: Scene, rows: Sequence[int]) -> list[dict[str, Any]]:
    """For each joint that one number places, in the body's order: name, side, unit (degrees or millimetres), value (T),
    low and high (T), the ends of the 90 % interval, None without them; modes (T, K); limits (2).

    Numbers are rounded to tenths, and None where there is none.
    """
    return [
        _curve(scene, list(rows), entry)
        for entry in joint_entries(scene.body)
        if entry.kind in _UNITS and not entry.follows
    ]


def _curve(scene: Scene, rows: list[int], entry: JointEntry) -> dict[str, Any]:
    unit, factor = _UNITS[entry.kind]
    model, at = scene.body.model, entry.start
    limits = np.array([model.lowerPositionLimit[at], model.upperPositionLimit[at]])
    curve = {
        "name": entry.name,
        "side": side_of(entry.name),
        "unit": unit,
        "value": _numbers(factor * scene.q[rows, at]),
        "modes": [_numbers(factor * row) for row in scene.mode_q[rows, :, at]],
        "limits": _numbers(factor * limits),
    }
    if scene.interval is None:
        return curve | {"low": None, "high": None}
    low, high = factor * scene.interval[rows, :, at].T
    return curve | {"low": _numbers(low), "high": _numbers(high)}


def _numbers(values: np.ndarray) -> list[float | None]:
    return [round(float(x), 1) if np.isfinite(x) else None for x in values]


KEY_FRAMES = 600
_NOTHING = 0.005  # a weight below would be written as 0 %
_HOME_FOV = np.radians(38.0)
_ABOUT_FORCES = 0.5  # opacity of a body with arrows of forces, which lie inside its legs


def write_html(run: Run | Scene, path: str | Path) -> Path:
    """Write a page that needs nothing else: no server, no network. Raises InputError where it cannot be written."""
    with replacing(path) as temporary:
        temporary.write_text(page(run), encoding="utf-8")
    return Path(path)


def page(run: Run | Scene, script: str = "") -> str:
    """The preview as the text of one HTML page; starts no process. script: run after the page's own."""
    scene = as_scene(run)
    rows = evenly(len(scene), KEY_FRAMES)
    recorder = CommandRecorder()
    root = meshcat.Visualizer(window=recorder)
    painter = BodyPainter(scene.body)
    stage = _Stage(scene, painter, rows)
    _set_lights(root, stage)
    contact = scene.contact()
    add_floor(root, stage.centre, stage.lowest, None if contact is None else contact.floor)
    animation = Animation(default_framerate=_key_rate(scene, rows))
    parts = merged(body_solids(scene.body))
    _add_bodies(root, animation, scene, rows, parts)
    if scene.source is not None:
        add_source(root, animation, scene, rows)
    elif scene.forces is not None:
        add_forces(root["forces"], animation, scene.forces, rows)
    elif contact is not None:
        add_stances(root, animation, contact, rows)
    cameras = [add_camera(root, scene, c, rows, stage.points) for c in range(len(scene.cameras))]
    root.set_animation(animation, play=True)
    return recorder.page(
        f"{scene.body.subject.name} - kinemode", _player_data(scene, rows, stage, cameras, parts), script
    )


class _Stage:
    """Region in which the body moves: used to place the floor, the lights, the pictures and the first view."""

    def __init__(self, scene: Scene, painter: BodyPainter, rows: list[int]) -> None:
        bodies = [t for t in rows if scene.has_body(t)]
        chosen = [bodies[i] for i in evenly(len(bodies), 60)]
        vertices = [painter.vertices(scene.body.at(scene.q[t])) for t in chosen]
        points = [v[:: max(1, len(v) // 200)] for v in vertices]
        if scene.source is not None:
            beside = scene.source.points[chosen].reshape(-1, 3)
            points.append(np.tile(beside[np.isfinite(beside).all(axis=1)], (6, 1)))  # so as to count as much
        self.points = np.concatenate(points)
        self.lowest = min(float(v[:, 2].min()) for v in vertices)
        low, high = np.quantile(self.points, 0.02, axis=0), np.quantile(self.points, 0.98, axis=0)
        self.centre = (low + high) / 2.0
        self.radius = max(0.3, 0.5 * float(np.linalg.norm(high - low)))
        towards = scene.cameras[0].origin_world - self.centre if scene.cameras else _front(scene)
        towards = -scene.cameras[0].R_camera_world[2] if scene.cameras and scene.cameras[0].parallel else towards
        heading = np.arctan2(towards[1], towards[0]) + np.radians(35.0)
        self.towards_home = np.array([np.cos(heading), np.sin(heading), 0.28])
        self.towards_home /= np.linalg.norm(self.towards_home)

    def eye(self) -> np.ndarray:
        """Viewpoint of the first view [m], (3,)."""
        return self.centre + self.towards_home * 1.05 * self.radius / np.sin(_HOME_FOV / 2.0)


def _front(scene: Scene) -> np.ndarray:
    """Viewpoint of a body that no camera saw, (3,): in front of it where it stands beside another."""
    turn = 0.0 if scene.source is None else np.radians(heading(scene.body, scene.q))
    return np.array([np.cos(turn), np.sin(turn), 0.0])


def _key_rate(scene: Scene, rows: list[int]) -> float:
    """Keys are evenly spaced in the animation; the player's own table has their times."""
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


def _add_bodies(
    root: meshcat.Visualizer, animation: Animation, scene: Scene, rows: list[int], parts: tuple[DrawnMesh, ...]
) -> None:
    _add_body(root["body"], animation, scene.body, parts, scene.q[rows], 1.0)
    coarse = merged(replace(part, colour=palette.HYPOTHESIS) for part in body_solids(scene.body, coarse=True))
    for k in range(scene.mode_q.shape[1]):
        _add_body(root[f"hypothesis_{k}"], animation, scene.body, coarse, scene.mode_q[rows, k], 0.3)


def _add_body(
    node: meshcat.Visualizer,
    animation: Animation,
    body: Body,
    parts: tuple[DrawnMesh, ...],
    q: np.ndarray,
    opacity: float,
) -> None:
    """A node per joint below `node`, with its meshes, and a position and a quaternion per instant (a missing one holds
    still)."""
    names = node_names(parts)
    moved = list(names)
    positions, quaternions = motion(body, q, moved)
    for j, joint in enumerate(moved):
        child = node[names[joint]]
        for i, part in enumerate(part for part in parts if part.joint == joint):
            child[str(i)].set_object(_mesh(part), _material(part, opacity))
        child.set_transform(_matrix(positions[0, j], quaternions[0, j]))
        tracks = {
            "position": MotionTrack("position", "vector3", positions[:, j]),
            "quaternion": MotionTrack("quaternion", "quaternion", quaternions[:, j]),
        }
        animation.clips[child.path] = AnimationClip(tracks, fps=animation.default_framerate)


def node_names(parts: tuple[DrawnMesh, ...]) -> dict[int, str]:
    """Name of the node of each joint that moves something, in the order of the joints."""
    names = {part.joint: part.name for part in reversed(parts)}
    return {joint: f"{joint}_{names[joint]}" for joint in sorted(names)}


def _mesh(part: DrawnMesh) -> g.Geometry:
    if part.normals is None:  # the viewer takes the means of the faces itself
        return g.TriangularMeshGeometry(part.vertices, part.faces)
    return ShadedMesh(part.vertices, part.normals, part.faces)


def _material(part: DrawnMesh, opacity: float) -> g.Material:
    """Front faces alone where the solid is closed: the far side of a translucent limb would show as dark bands."""
    paint, side = palette.hexadecimal(part.paint), 0 if part.closed else 2
    return g.MeshPhongMaterial(color=paint, opacity=opacity, shininess=18, side=side)


def motion(body: Body, q: np.ndarray, moved: list[int]) -> tuple[np.ndarray, np.ndarray]:
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


def _player_data(
    scene: Scene, rows: list[int], stage: _Stage, cameras: list[dict[str, Any]], parts: tuple[DrawnMesh, ...]
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
        "joints": joint_curves(scene, rows),
        "side_colour": {side: _css(colour) for side, colour in palette.SIDES.items()},
        "home": {
            "eye": stage.eye().tolist(),
            "target": stage.centre.tolist(),
            "up": [0.0, 0.0, 1.0],
            "half_height": tangent,
            "half_width": tangent,
            "parallel": False,
        },
        "legend": _legend(scene, parts),
        "nothing": _NOTHING,
        "body_opacity": 1.0 if scene.forces is None else _ABOUT_FORCES,
        "best_colour": _css(palette.GOOD),
        "other_colour": _css(palette.HYPOTHESIS),
        "status_colour": {name: _css(colour) for name, colour in palette.STATUS.items()},
    }


def _legend(scene: Scene, parts: tuple[DrawnMesh, ...]) -> list[tuple[str, str | None]]:
    """Names and colours: of the sides that are distinguished by colour, else one name for the body."""
    sides = sides_among(part.side for part in parts if part.colour is None)
    legend: list[tuple[str, str | None]] = [(side, _css(palette.SIDES[side])) for side in sides]
    if not legend:
        colours = {part.paint for part in parts}
        legend = [("body", _css(colours.pop()))] if len(colours) == 1 else [("body in its own colours", None)]
    if ((scene.mode_weight >= _NOTHING).sum(axis=1) > 1).any():
        legend.append(("other hypotheses", _css(palette.HYPOTHESIS)))
    if scene.source is not None:
        legend += [(side, _css(palette.SIDES[side])) for side in sides_among(scene.source.sides) if side not in sides]
        legend += [(said, None) for said in LEGEND]
    return legend


def _css(colour: palette.Rgb) -> str:
    return f"#{palette.hexadecimal(colour):06x}"
