"""Meshcat without its server: commands are kept, and become a page that stands alone.

`meshcat.Visualizer` talks to a window; its own window starts a server process. `CommandRecorder` takes the window's
place, so that nothing is started and nothing can be left behind.
"""

from __future__ import annotations

import base64
import json
from importlib import resources
from typing import Any, Protocol

import meshcat.geometry as g
import numpy as np
import umsgpack
from meshcat.geometry import Geometry, pack_numpy_array

from viz import palette

Json = dict[str, Any]


class Command(Protocol):
    """Base of meshcat's commands."""

    def lower(self) -> Json:
        """The command as plain data."""


class CommandRecorder:
    """Stands in for meshcat's ViewerWindow."""

    def __init__(self) -> None:
        self.commands: list[bytes] = []

    def send(self, command: Command) -> None:
        """Keep one command, packed as the viewer reads it; single precision is a micrometre at 10 m."""
        self.commands.append(umsgpack.packb(_plain(command.lower()), force_float_precision="single"))

    def page(self, title: str, data: Json, own: str = "") -> str:
        """An HTML page with the viewer, the recorded scene and the player's data; it loads nothing from elsewhere. own:
        a script that is run last."""
        script = (resources.files("meshcat") / "viewer" / "dist" / "main.min.js").read_text(encoding="utf-8")
        template, curves = (
            (resources.files("viz.preview") / name).read_text(encoding="utf-8") for name in ("page.html", "curves.js")
        )
        commands = [base64.b64encode(command).decode("ascii") for command in self.commands]
        parts = {
            "TITLE": _escaped(title),
            "VIEWER": script,
            "CURVES": curves,
            "COMMANDS": json.dumps(commands),
            "DATA": _script_json(data),
            "SCRIPT": own,
        }
        for name, value in parts.items():
            template = template.replace(f"__{name}__", value, 1)
        return template


class MotionTrack:
    """Values (T, D) of a property at instants 0 to T - 1: meshcat's AnimationTrack as plain arrays, a third as long."""

    def __init__(self, name: str, kind: str, values: np.ndarray) -> None:
        self.name, self.kind, self.values = name, kind, np.asarray(values, dtype=np.float32)

    def lower(self) -> Json:
        """See meshcat's AnimationTrack; three.js takes `times` and `values` as well as its `keys`."""
        times = np.arange(len(self.values), dtype=np.float32)
        packed = {"times": times, "values": self.values.reshape(-1)}
        arrays = {key: pack_numpy_array(array)["array"] for key, array in packed.items()}
        return {"name": f".{self.name}", "type": self.kind, **arrays}


class ShadedMesh(Geometry):
    """Triangles with a normal at every vertex: vertices (V, 3) [m], normals (V, 3), faces (F, 3)."""

    def __init__(self, vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray) -> None:
        super().__init__()
        self.vertices = np.asarray(vertices, dtype=np.float32)
        self.normals = np.asarray(normals, dtype=np.float32)
        self.faces = np.asarray(faces, dtype=np.uint32)

    def lower(self, object_data: Json) -> Json:
        """See meshcat's Geometry."""
        return _buffer(self.uuid, self.faces, position=self.vertices, normal=self.normals)


class TexturedPlane(Geometry):
    """A rectangle given by its corners (4, 3): top left, top right, bottom right, bottom left of the picture."""

    def __init__(self, corners: np.ndarray) -> None:
        super().__init__()
        self.corners = np.asarray(corners, dtype=np.float32)

    def lower(self, object_data: Json) -> Json:
        """See meshcat's Geometry."""
        uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=np.float32)
        faces = np.array([[0, 2, 1], [0, 3, 2]], dtype=np.uint32)
        return _buffer(self.uuid, faces, position=self.corners, uv=uv)


def _buffer(uuid: str, faces: np.ndarray, **attributes: np.ndarray) -> Json:
    """Three.js's BufferGeometry of faces (F, 3) and attributes with a row for every vertex."""
    packed = {name: pack_numpy_array(rows.T) for name, rows in attributes.items()}
    data = {"attributes": packed, "index": pack_numpy_array(faces.T)}
    return {"uuid": uuid, "type": "BufferGeometry", "data": data}


def line_segments(points: np.ndarray, colour: palette.Rgb) -> g.LineSegments:
    """Segments between consecutive pairs of points (2 S, 3) [m]."""
    geometry = g.PointsGeometry(points.T.astype(np.float32))
    return g.LineSegments(geometry, g.LineBasicMaterial(color=palette.hexadecimal(colour)))


def _plain(value: Any) -> Any:
    """NumPy numbers as Python's, the only ones the packer supports."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _script_json(data: Json) -> str:
    # "</script>" inside a string would end the script; NaN is not JSON
    return json.dumps(data, allow_nan=False).replace("</", "<\\/")


def _escaped(title: str) -> str:
    return title.replace("&", "&amp;").replace("<", "&lt;")
