"""The features of a body that are seen in a frame: its bare skin in a picture, or its keypoints."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np

from estimator.data.image_cues import ImageCues
from estimator.data.observation import Observation, image_extent
from estimator.inference.chains.evidence import Detections
from estimator.search.cost_model import CostModel
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.point_features import HEAD, PointFeatures, landmark_features, skin_features
from estimator.trackers.dual_chain.faces import FaceDetector, Faces, face_of_keypoints, skin_points
from estimator.trackers.dual_chain.feature_detections import all_of, at_size, of_blobs, of_faces, of_keypoints
from estimator.trackers.dual_chain.skin import SkinModel, SkinSettings, learned_skin, skin_blobs
from estimator.vision.resolution import resized_pixels
from humanoid.support.errors import InputError

SKIN, KEYPOINTS = "skin", "keypoints"
KINDS = (SKIN, KEYPOINTS)


class SeenFeatures(Protocol):
    """One kind of features, and how they are detected in the frames of one camera's clip, in its pixels."""

    @property
    def features(self) -> PointFeatures:
        """Names of the detected features. Raises InputError for a body without features of that kind."""
        ...

    @property
    def needed_cues(self) -> tuple[str, ...]:
        """See `estimator.trackers.capabilities.RequiresCues`."""
        ...

    def check(self, observation: Observation) -> None:
        """Raise InputError where a clip with such frames lacks something that is needed."""
        ...

    def learned(self, observation: Observation, pixels: np.ndarray) -> SkinModel | None:
        """Learn the model of the first frame; pixels (F, 2) [px]: features in its pose. Raises InputError where the
        frame does not allow it."""
        ...

    def detected(self, observation: Observation, skin: SkinModel | None) -> Detections:
        """In a frame, with what was learned."""
        ...


class SkinFeatures:
    """Face and hands as blobs of skin; the face also by its keypoints where there are any, and by a detector whose
    model file is given (empty: none). Raises InputError where that file is not such a model."""

    def __init__(self, model: CostModel, settings: SkinSettings, face_model: str = "") -> None:
        self._model, self._settings = model, settings
        self._faces = FaceDetector(Path(face_model)) if face_model else None

    @cached_property
    def features(self) -> PointFeatures:
        """See `SeenFeatures`."""
        return skin_features(self._model.body, anatomy_of(self._model.body))

    @property
    def needed_cues(self) -> tuple[str, ...]:
        """See `SeenFeatures`: the pictures are given where any is used, and these two are also used for poses."""
        return ("edges", "silhouette")

    def check(self, observation: Observation) -> None:
        """See `SeenFeatures`."""
        _check_one_camera(observation)
        if not observation.cues or observation.cues[0].picture is None:
            problem = "needs the picture of one camera, and there is none"
            remedy = f'one clip, with --cues edges,silhouette, or features = "{KEYPOINTS}"'
            raise InputError("dual-chain", problem, remedy=remedy)

    def learned(self, observation: Observation, pixels: np.ndarray) -> SkinModel:
        """See `SeenFeatures`: the colour at the keypoints of face and hands, without any where the pose has them."""
        cues, names = observation.cues[0], self._model.body.landmark_names
        assert cues.picture is not None
        points, faces = skin_points(names, observation.pixels[0])
        if not len(points):
            points, faces = pixels, np.array([name == HEAD for name in self.features.names])
        size = observation.cameras[0].image_size
        points = resized_pixels(points, size, cues.camera.image_size)
        extent = image_extent(observation.pixels[0], observation.confidence[0])
        extent *= cues.camera.image_size[0] / size[0]
        source = f"frame {observation.index} of {cues.camera.name}"
        return learned_skin(cues.picture, points, faces, extent, self._settings, source, _foreground(cues))

    def detected(self, observation: Observation, skin: SkinModel | None) -> Detections:
        """See `SeenFeatures`."""
        names = self.features.names
        seen = [of_faces(names, self._face(observation))]
        for cues in observation.cues[:1]:
            if cues.picture is None or skin is None:
                continue
            blobs = of_blobs(names, skin_blobs(cues.picture, skin, _foreground(cues), self._settings))
            faces = Faces.none() if self._faces is None else self._faces.faces(cues.picture)
            both = all_of([blobs, of_faces(names, faces)])
            seen.append(at_size(both, cues.camera.image_size, observation.cameras[0].image_size))
        return all_of(seen)

    def _face(self, observation: Observation) -> Faces:
        """By keypoints."""
        pixels, confidence = observation.pixels[0], observation.confidence[0]
        sigma = float(np.median(self._model.keypoint_sigma(observation)[0]))
        size = image_extent(pixels, confidence)
        return face_of_keypoints(self._model.body.landmark_names, pixels, confidence, size, sigma)


class KeypointFeatures:
    """All landmarks, as keypoints."""

    def __init__(self, model: CostModel) -> None:
        self._model = model

    @cached_property
    def features(self) -> PointFeatures:
        """See `SeenFeatures`."""
        return landmark_features(self._model.body, anatomy_of(self._model.body))

    @property
    def needed_cues(self) -> tuple[str, ...]:
        """See `SeenFeatures`."""
        return ()

    def check(self, observation: Observation) -> None:
        """See `SeenFeatures`."""
        _check_one_camera(observation)

    def learned(self, observation: Observation, pixels: np.ndarray) -> None:
        """See `SeenFeatures`: nothing."""

    def detected(self, observation: Observation, skin: SkinModel | None) -> Detections:
        """See `SeenFeatures`."""
        sigma = self._model.keypoint_sigma(observation)[0]
        pixels = np.where(observation.confidence[0][:, None] > 0.0, observation.pixels[0], np.nan)
        return of_keypoints(self.features.names, pixels, sigma)


def _check_one_camera(observation: Observation) -> None:
    if len(observation.cameras) != 1:
        problem = f"uses one camera, there are {len(observation.cameras)}"
        raise InputError("dual-chain", problem, remedy="one clip, or css-dual, which uses several")


def _foreground(cues: ImageCues) -> np.ndarray | None:
    """(H, W) bool: where the person can be, None where that is not known."""
    silhouette = cues.get("silhouette")
    return None if silhouette is None else silhouette.mask
