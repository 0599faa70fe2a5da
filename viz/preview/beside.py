"""The source that a body follows, in the preview: a stick figure beside it, and discs under what is to stand."""

from __future__ import annotations

import meshcat
import meshcat.geometry as g
import numpy as np
import pinocchio as pin
from meshcat.animation import Animation, AnimationClip

from viz import palette
from viz.preview.recorder import MotionTrack
from viz.preview.standing import add_discs
from viz.scene import Scene
from viz.solids.solid import Side
from viz.source_figure import HEAD_RADIUS, SourceFigure

_BONE = 0.014  # radius [m]
_HIDDEN = 1e-3  # size of what is not shown: three cannot turn a matrix of none
_ALONG = np.array([0.0, 1.0, 0.0])  # the axis of three's cylinders


def add_source(root: meshcat.Visualizer, animation: Animation, scene: Scene, rows: list[int]) -> None:
    """The figure at the instants `rows`, with discs under its soles and under the body's; nothing without a source."""
    source = scene.source
    if source is None:
        return
    for k, ((i, j), side) in enumerate(zip(source.segments, source.sides, strict=True)):
        _add_bone(root["source"][f"bone_{k}"], animation, source.points[rows][:, [i, j]], side)
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


def _add_bone(node: meshcat.Visualizer, animation: Animation, ends: np.ndarray, side: Side) -> None:
    """A cylinder between points (T, 2, 3) [m]."""
    node["rod"].set_object(g.Cylinder(1.0, _BONE), _material(side))
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
