"""A face in a picture as a Gaussian: from keypoints, or by a detector whose model file the user names; and the points
of a person at which skin is bare."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from estimator.data.media.threads import one_thread
from humanoid.support.errors import InputError

FACE = ("nose", "left_eye", "right_eye", "left_ear", "right_ear")
"""Landmarks of a face, whose mean is its middle."""
HAND_BEYOND = 0.33
"""Distance of the middle of a hand beyond the wrist, in lengths of the forearm: 85 of 261 mm (de Leva 1996)."""
IN_BOX = 0.12
"""Standard deviation of the middle of a detected face in its box, as a share of its sides."""
_OFF = 0.25  # how far the mean of a single keypoint is from the face's middle, as a share of the person's size
_SURE = 0.6  # score from which the detector's faces count
_EYES_AND_NOSE = (slice(4, 6), slice(6, 8), slice(8, 10))  # of a detector's row
_SCORE = 14


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces in a picture, the surest first. mean (D, 2) [px]: between eyes, nose and ears, as the mean of these
    landmarks. covariance (D, 2, 2) [px^2]. score (D,): from 0 to 1."""

    mean: np.ndarray
    covariance: np.ndarray
    score: np.ndarray

    @staticmethod
    def none() -> Faces:
        """A picture without a face."""
        return Faces(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))


def face_of_keypoints(
    names: Sequence[str | None], pixels: np.ndarray, confidence: np.ndarray, size: float, sigma: float
) -> Faces:
    """The face where any keypoint of it is, else none.

    The fewer of the five there are, the farther their mean may be from that of all. pixels (J, 2) [px], NaN where
    missing; confidence (J,). size [px]: root mean square distance of the person's keypoints from their centre. sigma
    [px]: of each coordinate of a keypoint.
    """
    rows = [k for k, name in enumerate(names) if name in FACE and np.isfinite(pixels[k]).all() and confidence[k] > 0.0]
    if not rows:
        return Faces.none()
    missing = 1.0 - len(rows) / len(FACE)
    variance = sigma**2 / len(rows) + missing * (_OFF * size) ** 2
    return Faces(pixels[rows].mean(axis=0)[None], variance * np.eye(2)[None], np.array([confidence[rows].mean()]))


def skin_points(names: Sequence[str | None], pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (K, 2) [px] of a person's bare skin in a picture, and which of them are on the face (K,) bool.

    That is the middle of the face, and the middle of each hand: beyond the wrist on the line from the elbow. A hand
    whose elbow or wrist is missing is left out. pixels (J, 2) [px]: of keypoints, NaN where missing.
    """
    at = {name: pixels[k] for k, name in enumerate(names) if name is not None and np.isfinite(pixels[k]).all()}
    face = [at[name] for name in FACE if name in at]
    hands = [
        at[f"{side}_wrist"] + HAND_BEYOND * (at[f"{side}_wrist"] - at[f"{side}_elbow"])
        for side in ("left", "right")
        if {f"{side}_wrist", f"{side}_elbow"} <= at.keys()
    ]
    points = np.array([*([np.mean(face, axis=0)] if face else []), *hands]).reshape(-1, 2)
    return points, np.arange(len(points)) < (1 if face else 0)


class FaceDetector:
    """OpenCV's YuNet detector (Wu, Peng and Yu 2023, `cv2.FaceDetectorYN`), which is not downloaded: model is its ONNX
    file.

    Raises
    ------
    InputError: the file is missing or not such a model, or this OpenCV has no such detector.
    """

    def __init__(self, model: Path) -> None:
        if not hasattr(cv2, "FaceDetectorYN"):
            remedy = 'opencv-python 4.5.4 or later, or features = "keypoints"'
            raise InputError(model, "this OpenCV has no FaceDetectorYN to read it", remedy=remedy)
        if not model.is_file():
            raise InputError(model, "no such model file", remedy="the path of a YuNet face detector (.onnx)")
        try:
            self._net: Any = cv2.FaceDetectorYN.create(str(model), "", (320, 320), score_threshold=_SURE)
        except cv2.error:
            raise InputError(
                model, "is not a model of a face detector", remedy="a YuNet face detector (.onnx)"
            ) from None
        self._model = model

    @one_thread()
    def faces(self, picture: np.ndarray) -> Faces:
        """Faces in a picture (H, W, 3) uint8 BGR. Raises InputError where the model is of something else."""
        self._net.setInputSize((picture.shape[1], picture.shape[0]))
        try:
            _, rows = self._net.detect(picture)
        except cv2.error:
            raise InputError(
                self._model, "is not a model of a face detector", remedy="a YuNet face detector (.onnx)"
            ) from None
        if rows is None or not len(rows):
            return Faces.none()
        rows = np.asarray(rows, dtype=float)[np.argsort(-np.asarray(rows)[:, _SCORE], kind="stable")]
        mean = np.mean([rows[:, part] for part in _EYES_AND_NOSE], axis=0)
        covariance = np.square(IN_BOX * rows[:, 2:4])[:, :, None] * np.eye(2)
        return Faces(mean, covariance, rows[:, _SCORE])
