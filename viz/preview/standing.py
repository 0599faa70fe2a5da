"""The floor and the feet that stand on it, in the preview."""

from __future__ import annotations

import meshcat
import meshcat.geometry as g
import numpy as np
from meshcat.animation import Animation, AnimationClip

from estimator.inference.ground import Ground
from estimator.runs.contact import Contact
from viz import palette
from viz.preview.recorder import MotionTrack, line_segments

_REACH, _STEP = 3.0, 0.5  # m: of the grid, and between its lines
_RADIUS, _THICKNESS = 0.055, 0.006  # m
_HIDDEN = 1e-3  # size of a disc that is not shown: three cannot turn a matrix of none


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
        scale = np.maximum(np.where(shown & (size > 0.5), size, 0.0), _HIDDEN)
        tracks = {
            "position": MotionTrack("position", "vector3", own),
            "scale": MotionTrack("scale", "vector3", np.tile(scale[:, None], 3)),
        }
        animation.clips[node.path] = AnimationClip(tracks, fps=animation.default_framerate)
