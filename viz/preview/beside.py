"""Beside the body in the preview: the source that it follows, the floor, discs under what is to stand, and forces."""

from __future__ import annotations

import meshcat
import meshcat.geometry as g
import numpy as np
import pinocchio as pin
from meshcat.animation import Animation, AnimationClip

from estimator.inference.ground import Ground
from estimator.runs.contact import Contact
from estimator.runs.forces import Forces
from viz import palette
from viz.preview.recorder import MotionTrack, line_segments
from viz.scene import Scene
from viz.solids.solid import Side
from viz.source_figure import HEAD_RADIUS, SourceFigure

_REACH, _STEP = 3.0, 0.5  # m: of the grid, and between its lines
_RADIUS, _THICKNESS = 0.055, 0.006  # m
_OUT_OF_SIGHT = 1e-3  # size of a disc that is not shown: three cannot turn a matrix of none


def add_floor(root: meshcat.Visualizer, centre: np.ndarray, lowest: float, floor: Ground | None) -> None:
    """Lines every half metre about a centre (3,): in the floor's plane, else level with the lowest point [m]."""
    middle = np.round(centre[:2] / _STEP) * _STEP
    at = np.arange(-_REACH, _REACH + 0.01, _STEP)
    ends = [((x, -_REACH), (x, _REACH)) for x in at] + [((-_REACH, y), (_REACH, y)) for y in at]
    flat = np.array([middle + np.array(place) for pair in ends for place in pair])
    normal, height = (np.array([0.0, 0.0, 1.0]), lowest) if floor is None else (floor.normal, floor.height)
    z = (height - flat @ normal[:2]) / normal[2]
    root["ground"].set_object(line_segments(np.column_stack([flat, z]), palette.GRID))


def add_stances(root: meshcat.Visualizer, animation: Animation, contact: Contact, rows: list[int]) -> None:
    """A disc under each point of the feet, as large as it probably stands, at the instants `rows`."""
    places = contact.points[rows].copy()
    if contact.floor is not None:
        places -= contact.heights[rows][..., None] * contact.floor.normal
    add_discs(root["standing"], animation, contact.names, places, contact.standing[rows])


def add_discs(
    root: meshcat.Visualizer, animation: Animation, names: tuple[str, ...], places: np.ndarray, sizes: np.ndarray
) -> None:
    """Discs of these names (P) with their middles at places (T, P, 3) [m], NaN for none, as large as sizes (T, P) have
    it, 1 for all of it; nothing below a half."""
    upright = np.eye(4)
    upright[1:3, 1:3] = [[0.0, -1.0], [1.0, 0.0]]  # three's cylinders lie along y
    for k, name in enumerate(names):
        colour = palette.hexadecimal(palette.ON_PAPER["left" if "left" in name else "right"])
        node = root[name]
        node["disc"].set_object(g.Cylinder(_THICKNESS, _RADIUS), g.MeshBasicMaterial(color=colour, opacity=0.7))
        node["disc"].set_transform(upright)
        own, size = places[:, k].copy(), sizes[:, k]
        shown = np.isfinite(own).all(axis=1)
        if not shown.any():
            continue
        own[~shown] = own[shown][0]
        scale = np.maximum(np.where(shown & (size > 0.5), size, 0.0), _OUT_OF_SIGHT)
        tracks = {
            "position": MotionTrack("position", "vector3", own),
            "scale": MotionTrack("scale", "vector3", np.tile(scale[:, None], 3)),
        }
        animation.clips[node.path] = AnimationClip(tracks, fps=animation.default_framerate)


_ARROW, _HEAD = 0.012, 0.03  # m: radii of an arrow's shaft and of its point
_POINT = 0.08  # m: length of its point
_FAINT = 0.03  # weights: forces below are not drawn


def add_forces(root: meshcat.Visualizer, animation: Animation, forces: Forces, rows: list[int]) -> None:
    """An arrow from the centre of pressure of each foot, a metre long for the body's weight, with a disc under it."""
    shares = np.linalg.norm(forces.force, axis=2) / forces.weight
    start = np.where(shares[..., None] > _FAINT, forces.pressure, np.nan)
    end = start + forces.force / forces.weight
    paint = g.MeshBasicMaterial(color=palette.hexadecimal(palette.WARN))
    for k, foot in enumerate(forces.feet):
        node, along = root[foot], end[rows, k] - start[rows, k]
        length = np.linalg.norm(along, axis=1, keepdims=True)
        tip = end[rows, k] - along / length * np.minimum(_POINT, length)
        _add_bone(node["shaft"], animation, np.stack([start[rows, k], tip], axis=1), paint, _ARROW)
        _add_bone(node["point"], animation, np.stack([tip, end[rows, k]], axis=1), paint, _HEAD, 0.0)
    sizes = np.where(np.isfinite(start[rows]).all(axis=2), 1.0, 0.0)
    add_discs(root["pressure"], animation, forces.feet, start[rows], sizes)


_BONE = 0.014  # radius [m]
_HIDDEN = 1e-3  # size of what is not shown: three cannot turn a matrix of none
_ALONG = np.array([0.0, 1.0, 0.0])  # the axis of three's cylinders


def add_source(root: meshcat.Visualizer, animation: Animation, scene: Scene, rows: list[int]) -> None:
    """The figure at the instants `rows`, with discs under its soles and under the body's; nothing without a source."""
    source = scene.source
    if source is None:
        return
    for k, ((i, j), side) in enumerate(zip(source.segments, source.sides, strict=True)):
        _add_bone(root["source"][f"bone_{k}"], animation, source.points[rows][:, [i, j]], _material(side))
    if source.head is not None:
        head = root["source"]["head"]
        head["ball"].set_object(g.Sphere(HEAD_RADIUS), _material("trunk"))
        _move(head, animation, source.points[rows, source.head], None, np.ones((len(rows), 3)))
    _add_standing(root["standing"], animation, source, source.names, source.points[rows], rows, "source")
    body = scene.body
    landmarks = np.full((len(rows), len(body.landmark_names), 3), np.nan)
    there = np.array([scene.has_body(t) for t in rows])
    landmarks[there] = body.landmarks_of(body.placed(scene.q[rows][there]))
    _add_standing(root["standing"], animation, source, body.landmark_names, landmarks, rows, "subject")


def _add_standing(
    root: meshcat.Visualizer,
    animation: Animation,
    source: SourceFigure,
    names: tuple[str, ...],
    points: np.ndarray,
    rows: list[int],
    whose: str,
) -> None:
    """Discs on the floor under landmarks (T, L, 3) [m] at instants `rows` (T)."""
    pairs = source.feet_among(names)
    columns, own = [k for k, _ in pairs], [i for _, i in pairs]
    places = points[:, own].copy()
    places[..., 2] = np.where(np.isfinite(places[..., 2]), source.level, np.nan)
    add_discs(
        root, animation, tuple(f"{whose}_{source.standing_names[k]}" for k in columns), places,
        source.standing[rows][:, columns].astype(np.float64),
    )  # fmt: skip


def _add_bone(
    node: meshcat.Visualizer,
    animation: Animation,
    ends: np.ndarray,
    material: g.Material,
    radius: float = _BONE,
    far: float | None = None,
) -> None:
    """A cylinder between points (T, 2, 3) [m], or a cone that has another radius [m] at the second."""
    wide = radius if far is None else far
    node["rod"].set_object(g.Cylinder(1.0, radius, radiusTop=wide, radiusBottom=radius), material)
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (len(ends), 1))
    for t in np.flatnonzero(length > 1e-6):  # NaN compares false
        turns[t] = pin.Quaternion.FromTwoVectors(_ALONG, along[t] / length[t]).coeffs()
    size = np.ones((len(ends), 3))
    size[:, 1] = length
    _move(node, animation, ends.mean(axis=1), turns, size)


def _move(
    node: meshcat.Visualizer, animation: Animation, places: np.ndarray, turns: np.ndarray | None, size: np.ndarray
) -> None:
    """Tracks of places (T, 3) [m], turns xyzw (T, 4) and sizes (T, 3); not shown where a place is NaN."""
    shown = np.isfinite(places).all(axis=1)
    places = np.zeros_like(places) if not shown.any() else np.where(shown[:, None], places, places[shown][0])
    size = np.maximum(np.where(shown[:, None], size, 0.0), _HIDDEN)
    tracks = {
        "position": MotionTrack("position", "vector3", places), "scale": MotionTrack("scale", "vector3", size),
    }  # fmt: skip
    if turns is not None:
        tracks["quaternion"] = MotionTrack("quaternion", "quaternion", turns)
    animation.clips[node.path] = AnimationClip(tracks, fps=animation.default_framerate)


def _material(side: Side) -> g.Material:
    return g.MeshPhongMaterial(color=palette.hexadecimal(palette.SIDES[side]), shininess=18)
