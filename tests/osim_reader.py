"""A second reader of OpenSim's model files, for the tests: it shares no code with the writer."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin


def numbers(element: ET.Element, tag: str) -> np.ndarray:
    """The numbers in a child's text."""
    return np.array((element.findtext(tag) or "").split(), dtype=float)


def turn(axis: np.ndarray, angle: float) -> pin.SE3:
    """A turn about an axis (3,) [rad]."""
    return pin.SE3(pin.exp3(angle * axis / np.linalg.norm(axis)), np.zeros(3))


def offset(frame: ET.Element) -> pin.SE3:
    """A PhysicalOffsetFrame in its parent: the translation, then turns about x, y and z fixed to the frame."""
    placed = pin.SE3(np.eye(3), numbers(frame, "translation"))
    for axis, angle in zip(np.eye(3), numbers(frame, "orientation"), strict=True):
        placed = placed * turn(axis, angle)
    return placed


class OsimModel:
    """A model file, queried by name."""

    def __init__(self, path: Path) -> None:
        model = ET.parse(path).getroot().find("Model")
        assert model is not None
        self.model = model
        self.segments = {body.get("name", ""): body for body in model.iterfind("BodySet/objects/Body")}
        self.joints = list(model.find("JointSet/objects") or [])
        self.markers = {marker.get("name", ""): marker for marker in model.iterfind("MarkerSet/objects/Marker")}
        self.coordinates = {c.get("name", ""): c for joint in self.joints for c in joint.iter("Coordinate")}
        self.couplings = list(model.iterfind("ConstraintSet/objects/CoordinateCouplerConstraint"))

    def coupled(self, values: Mapping[str, float]) -> dict[str, float]:
        """All coordinates [rad, m] from the unconstrained ones; other values are ignored."""
        out = dict(values)
        for coupling in self.couplings:
            assert coupling.findtext("isEnforced") == "true"
            slope, start = numbers(coupling, "coupled_coordinates_function/LinearFunction/coefficients")
            leader = values[coupling.findtext("independent_coordinate_names", "")]
            out[coupling.findtext("dependent_coordinate_name", "")] = slope * leader + start
        return out

    def at(self, values: Mapping[str, float]) -> dict[str, pin.SE3]:
        """The segments in the ground at coordinates [rad, m]."""
        placed = {"/ground": pin.SE3.Identity()}
        for joint in self.joints:
            ends = []
            for end in ("parent", "child"):
                name = joint.findtext(f"socket_{end}_frame")
                (frame,) = (f for f in joint.iterfind("frames/PhysicalOffsetFrame") if f.get("name") == name)
                ends.append((frame.findtext("socket_parent", ""), offset(frame)))
            (parent, before), (child, after) = ends
            placed[child] = placed[parent] * before * self._motion(joint, values) * after.inverse()
        return {name.removeprefix("/bodyset/"): place for name, place in placed.items()}

    def _motion(self, joint: ET.Element, values: Mapping[str, float]) -> pin.SE3:
        moved, turned = np.zeros(3), pin.SE3.Identity()
        axes = list(joint.iterfind("SpatialTransform/TransformAxis"))
        names = [f"{kind}{i}" for kind in ("rotation", "translation") for i in "123"]
        assert [axis.get("name") for axis in axes] in ([], names)
        for axis in axes:
            coordinate, along = axis.findtext("coordinates"), numbers(axis, "axis")
            if not coordinate:
                continue
            slope, start = numbers(axis, "LinearFunction/coefficients")
            value = slope * values[coordinate] + start
            if (axis.get("name") or "").startswith("rotation"):
                turned = turned * turn(along, value)
            else:
                moved = moved + value * along
        return pin.SE3(turned.rotation, moved)

    def marker_places(self, values: Mapping[str, float]) -> dict[str, np.ndarray]:
        """The markers in the ground [m]."""
        placed = self.at(values)
        frames = {name: (marker.findtext("socket_parent_frame") or "") for name, marker in self.markers.items()}
        return {
            name: placed[frames[name].removeprefix("/bodyset/")] * numbers(marker, "location")
            for name, marker in self.markers.items()
        }
