"""Points of a body whose places on it are fitted with its lengths: those that are measured in space, and those that a
detector marks in pictures. A keypoint is a marker that is seen from somewhere."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.data.observation import Observation
from estimator.energy.point_targets import marker_targets
from estimator.search.cost_model import CostModel
from humanoid.kinematics.body import Body, PosedBody, points_in_world
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.joint_names import ROOT_VELOCITY
from humanoid.subject.subject import Marker, Subject, Zero
from humanoid.subject.urdf_elements import LEAST_STD

FAR = 3.0
"""Standard deviations along an axis from which a point is not where it is expected on a body: one of 400 by chance."""


class Loads(NamedTuple):
    """A frame's evidence on points in the world: some (K,), their numbers; gradient force (K, 3) [1/m] and Gauss-Newton
    Hessian weight (K, 3, 3) [1/m^2] of its energy by their places."""

    some: np.ndarray
    force: np.ndarray
    weight: np.ndarray


class FittedPlaces(NamedTuple):
    """The result of a fit for F points. offsets (F, 3) [m]: in the frames of the joints. std (F,) [m]: how unsure their
    places are then. zeros: by degree of freedom, by how much poses are off alike in all frames [rad or m]."""

    offsets: np.ndarray
    std: np.ndarray
    zeros: Mapping[str, float]


class FittedPoints(ABC):
    """N points of a body, of F of which the places are fitted.

    names (N), joint (N,): of them, and on which they are. free (F,): numbers of those whose places are unsure. std (F,)
    [m]: how unsure. slope (P, N, 3): how points move in the frames of their joints [m] with each scale of the
    proportions.
    """

    def __init__(self, names: Sequence[str], joint: np.ndarray, std: np.ndarray, slope: np.ndarray) -> None:
        self.names, self.joint, self.slope = names, joint, slope
        self.free = np.flatnonzero(std > 0.0)
        self.std = std[self.free]

    def moved(self, offsets: np.ndarray) -> dict[str, float]:
        """Distances [m] by name of points farther than `FAR` standard deviations from where they are expected;
        offsets (F, 3) [m]."""
        far = np.flatnonzero(np.abs(offsets).max(axis=1, initial=0.0) > FAR * self.std)
        return {self.names[self.free[k]]: float(np.linalg.norm(offsets[k])) for k in far}

    @abstractmethod
    def put(self, body: Body, offsets: np.ndarray) -> None:
        """Move the points of a body whose places are fitted by offsets (F, 3) [m] in the frames of their joints, so
        that nothing is unsure."""

    @abstractmethod
    def loads(self, model: CostModel, observation: Observation, posed: PosedBody) -> Loads:
        """A frame's evidence on them."""

    @abstractmethod
    def places(self, body: Body) -> np.ndarray:
        """Their places in the frames of a body's joints, (N, 3) [m]."""

    @abstractmethod
    def fitted(self, subject: Subject, places: FittedPlaces) -> Subject:
        """A subject with these points where they were found."""

    def in_world(self, body: Body, posed: PosedBody, some: np.ndarray) -> np.ndarray:
        """The selected ones (K,), (K, 3) [m]."""
        return points_in_world(posed, self.joint[some], self.places(body)[some])


class FittedMarkers(FittedPoints):
    """The markers of a body, which are measured in space."""

    def __init__(self, proportions: ProportionedBody) -> None:
        body = proportions.base
        super().__init__(body.marker_names, body.marker_joint, body.marker_std, proportions.marker_slope)

    def put(self, body: Body, offsets: np.ndarray) -> None:
        """See `FittedPoints`."""
        body.marker_local = body.marker_local.copy()
        body.marker_local[self.free] += offsets
        body.marker_std = np.zeros(len(body.marker_names))

    def places(self, body: Body) -> np.ndarray:
        """See `FittedPoints`."""
        return body.marker_local

    def loads(self, model: CostModel, observation: Observation, posed: PosedBody) -> Loads:
        """See `FittedPoints`."""
        (term,) = marker_targets(model.body, observation, model.settings.markers)
        return Loads(observation.known_markers, *term.point_loads(posed))

    def fitted(self, subject: Subject, places: FittedPlaces) -> Subject:
        """See `FittedPoints`."""
        markers = []
        for marker, offset, own in zip(subject.markers, places.offsets, places.std, strict=True):
            x, y, z = (np.array(marker.xyz) + _in_link(subject, marker.link, offset)).tolist()
            markers.append(Marker(marker.name, marker.link, (x, y, z), float(own)))
        return subject.with_markers(markers, _zeros(subject, places))


class FittedKeypoints(FittedPoints):
    """The places where a detector marks the landmarks of a body. They are fitted where several cameras see them: in one
    camera's picture a place that is off looks like another pose, and is kept as an error that all frames share."""

    def __init__(self, proportions: ProportionedBody, *, cameras: int) -> None:
        body = proportions.base
        unsure = body.keypoint_std if cameras > 1 else np.zeros(len(body.landmark_names))
        super().__init__(body.landmark_names, body.landmark_joint, unsure, proportions.landmark_slope)

    def put(self, body: Body, offsets: np.ndarray) -> None:
        """See `FittedPoints`."""
        body.keypoint_local = body.keypoint_local.copy()
        body.keypoint_local[self.free] += offsets
        body.keypoint_std = body.keypoint_std.copy()
        body.keypoint_std[self.free] = 0.0

    def places(self, body: Body) -> np.ndarray:
        """See `FittedPoints`."""
        return body.keypoint_local

    def loads(self, model: CostModel, observation: Observation, posed: PosedBody) -> Loads:
        """See `FittedPoints`."""
        return Loads(np.arange(len(self.joint)), *model.observation_term(observation).point_loads(posed))

    def fitted(self, subject: Subject, places: FittedPlaces) -> Subject:
        """See `FittedPoints`."""
        landmarks = [subject.landmarks[int(k)] for k in self.free]
        by_name = {
            m.name: (np.array(m.keypoint) + _in_link(subject, m.link, offset), float(own))
            for m, offset, own in zip(landmarks, places.offsets, places.std, strict=True)
        }
        return subject.with_keypoint_places(by_name, _zeros(subject, places)) if by_name else subject


def _zeros(subject: Subject, places: FittedPlaces) -> list[Zero]:
    named = {*ROOT_VELOCITY, *subject.model.names}
    return [Zero(name, std) for name, std in places.zeros.items() if name in named and std > LEAST_STD]


def _in_link(subject: Subject, link: str, offset: np.ndarray) -> np.ndarray:
    """An offset (3,) in the frame of a link's joint, in the link's own."""
    frame = subject.model.frames[subject.model.getFrameId(link, pin.FrameType.BODY)]
    return np.asarray(frame.placement.rotation.T @ offset)
