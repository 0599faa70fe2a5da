"""The features of a body that are seen in a frame, as detections: bare skin and a face in a picture, or keypoints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np

from estimator.data.image_cues import ImageCues
from estimator.data.observation import Observation, image_extent
from estimator.inference.chains.evidence import Detections
from estimator.inference.chains.feature_density import gaussian
from estimator.search.cost_model import CostModel
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.point_features import HEAD, PointFeatures, landmark_features, skin_features
from estimator.trackers.dual_chain.faces import FaceDetector, Faces, face_of_keypoints, skin_points
from estimator.trackers.dual_chain.skin import Blobs, SkinModel, SkinSettings, learned_skin, skin_blobs
from estimator.vision.resolution import resized_pixels
from humanoid.subject.landmarks import mirror_index
from humanoid.support.errors import InputError

_AREA = 0.5  # standard deviation of the logarithm of a hand's or face's area from frame to frame
_LEAST = 1e-3  # of how well a blob suits
_WIDE = 0.5  # standard deviation of where the middle of a hand is in its blob, in those of the blob
_NOISE = 2.0  # px
_SWAPPED = 0.02  # share of keypoints whose side is mistaken
_FARTHEST = -2.0 * np.log(0.01)  # squared distance [standard deviations] of a face in its blob, in 99 of 100 cases
_ARRAYS = ("mean", "covariance", "suits", "merged", "shared")  # of detections, in order


def of_blobs(names: Sequence[str], blobs: Blobs) -> Detections:
    """Each blob may be of each hand, and of the head, by its area; a merged one of several of them.

    The middle of a hand is in the middle of its blob but for about half of the blob's spread; in one that is merged, or
    that is another's too, it is anywhere in it.
    """
    count = len(blobs.area)
    suits = np.zeros((count, len(names)))
    for f, name in enumerate(names):
        area = blobs.face if name == HEAD else blobs.hand
        off = np.log(np.maximum(blobs.area, 1.0) / area) / _AREA
        suits[:, f] = np.maximum(np.exp(-0.5 * off**2), _LEAST)
    suits[blobs.merged] = np.maximum(suits[blobs.merged], 0.2)
    scale = np.where(blobs.merged, 1.0, _WIDE) ** 2
    noise = _NOISE**2 * np.eye(2)
    covariance = blobs.covariance * scale[:, None, None] + noise
    return Detections(tuple(names), blobs.mean, covariance, suits, blobs.merged, blobs.covariance + noise)


def of_keypoints(names: Sequence[str], pixels: np.ndarray, sigma: np.ndarray) -> Detections:
    """Each keypoint is of its own feature, of the same on the other side, which detectors mistake it for, or wrong:
    pixels (F, 2) [px], NaN where missing, sigma (F,) [px]."""
    seen = np.flatnonzero(np.isfinite(pixels).all(axis=1))
    suits = np.zeros((len(seen), len(names)))
    suits[np.arange(len(seen)), np.array(mirror_index(names))[seen]] = _SWAPPED
    suits[np.arange(len(seen)), seen] = 1.0
    covariance = np.square(sigma[seen])[:, None, None] * np.eye(2)
    return Detections(tuple(names), pixels[seen], covariance, suits, np.zeros(len(seen), dtype=bool))


def of_faces(names: Sequence[str], faces: Faces) -> Detections:
    """Each is of the head with the detector's confidence, or of nothing."""
    suits = np.zeros((len(faces.score), len(names)))
    suits[:, [k for k, name in enumerate(names) if name == HEAD]] = np.clip(faces.score, _LEAST, 1.0)[:, None]
    covariance = faces.covariance + _NOISE**2 * np.eye(2)
    return Detections(tuple(names), faces.mean, covariance, suits, np.zeros(len(faces.score), dtype=bool))


def fused(blobs: Detections, faces: Detections) -> Detections:
    """Blobs and faces of a picture as joint detections: a face that is in a blob and the blob are one.

    Two detections of one face would leave the blob to a hand once the head has the other. Such a blob is of the head
    as the face is, in the middle of the face; of a hand alone it is as far as the face may be none; a hand that shares
    it with the head is anywhere in the blob.
    """
    names, own = blobs.names, {name: getattr(blobs, name).copy() for name in _ARRAYS}
    head, apart = np.array([name == HEAD for name in names]), []
    for k in range(len(faces.mean)):
        sure = float(faces.suits[k].max(initial=0.0))
        blob = _blob_of(blobs, faces.mean[k], faces.covariance[k])
        if blob is None:
            apart.append(k)
            continue
        by_blob = gaussian((HEAD,), own["mean"][blob][None], own["covariance"][blob])
        both = by_blob.times(gaussian((HEAD,), faces.mean[k][None], faces.covariance[k]))
        own["mean"][blob], own["covariance"][blob] = both.mean[0, 0], both.covariance[0]
        off = own["mean"][blob] - blobs.mean[blob]
        own["shared"][blob] = blobs.shared[blob] + off[:, None] * off
        own["suits"][blob, head] = np.maximum(own["suits"][blob, head], sure)
        own["suits"][blob, ~head] *= max(1.0 - sure, _LEAST)
    joint = Detections(names, *own.values())
    return all_of([joint, faces.of(np.array(apart, dtype=np.int64))])


def _blob_of(blobs: Detections, mean: np.ndarray, covariance: np.ndarray) -> int | None:
    """The blob that a face with mean (2,) [px] and covariance (2, 2) [px^2] is most likely in, None if in none."""
    if not len(blobs.mean):
        return None
    off = mean - blobs.mean
    square = np.einsum("di,di->d", off, np.linalg.solve(blobs.shared + covariance, off[..., None])[..., 0])
    blob = int(np.argmin(square))
    return blob if square[blob] < _FARTHEST else None


def all_of(detections: Sequence[Detections]) -> Detections:
    """Joint detections of several detectors of the same features."""
    arrays = [np.concatenate([getattr(each, name) for each in detections]) for name in _ARRAYS]
    return Detections(detections[0].names, *arrays)


def at_size(detections: Detections, old: tuple[int, int], new: tuple[int, int]) -> Detections:
    """Detections of a picture of size `old`, in one resized to `new`."""
    ratio = np.array(new) / np.array(old)
    covariance, together = (C * ratio[:, None] * ratio for C in (detections.covariance, detections.shared))
    mean = resized_pixels(detections.mean, old, new)
    return replace(detections, mean=mean, covariance=covariance, together=together)


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
        """See `estimator.trackers.base.RequiresCues`."""
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
    model file is given (empty: none). faces: that detector, None without one. Raises InputError where that file is not
    such a model."""

    def __init__(self, model: CostModel, settings: SkinSettings, face_model: str = "") -> None:
        self._model, self._settings = model, settings
        self.faces = FaceDetector(Path(face_model)) if face_model else None

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
        names, cues = self.features.names, observation.cues[0] if observation.cues else None
        by_keypoints = of_faces(names, self._face(observation))
        if cues is None or cues.picture is None or skin is None:
            return by_keypoints
        blobs = of_blobs(names, skin_blobs(cues.picture, skin, _foreground(cues), self._settings))
        faces = of_faces(names, Faces.none() if self.faces is None else self.faces.faces(cues.picture))
        size, full = cues.camera.image_size, observation.cameras[0].image_size
        return fused(at_size(blobs, size, full), all_of([at_size(faces, size, full), by_keypoints]))

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
