"""Faces as Gaussians, from keypoints or from a user's detector; detectors with a given truth."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from estimator.inference.chains.evidence import Detections, EvidenceSettings, evidence_of
from estimator.inference.chains.feature_density import gaussian
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.point_features import skin_features
from estimator.trackers.dual_chain.faces import FACE, FaceDetector, Faces, face_of_keypoints, skin_points
from estimator.trackers.dual_chain.seen_features import all_of, fused, of_faces
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError

SIZE, SIGMA = 100.0, 2.0
NAMES = (*FACE, "left_wrist", None)
PIXELS = np.array([[50.0, 60], [45, 50], [55, 50], [40, 55], [60, 55], [90, 90], [1, 1]])


def test_a_face_is_the_mean_of_its_landmarks() -> None:
    face = face_of_keypoints(NAMES, PIXELS, np.ones(7), SIZE, SIGMA)
    np.testing.assert_allclose(face.mean, [PIXELS[:5].mean(axis=0)])
    np.testing.assert_allclose(face.covariance, [SIGMA**2 / 5.0 * np.eye(2)])


def test_a_face_of_few_landmarks_is_less_certain_and_one_of_none_is_absent() -> None:
    pixels = PIXELS.copy()
    spread = []
    for missing in (2, 3, 4):
        pixels[missing] = np.nan
        face = face_of_keypoints(NAMES, pixels, np.ones(7), SIZE, SIGMA)
        off = np.linalg.norm(face.mean[0] - PIXELS[:5].mean(axis=0))
        spread.append(np.sqrt(face.covariance[0, 0, 0]))
        assert off < 2.0 * spread[-1]
    assert spread == sorted(spread)
    assert len(face_of_keypoints(NAMES, PIXELS, np.zeros(7), SIZE, SIGMA).mean) == 0
    assert len(face_of_keypoints(NAMES[5:], PIXELS[5:], np.ones(2), SIZE, SIGMA).mean) == 0


def test_skin_points_are_on_face_and_hands() -> None:
    """In a parallel projection the middle of a hand is on the line of the forearm."""
    body = Body(load_subject("upper13"))
    q = body.integrate(body.neutral, np.linspace(-0.2, 0.4, body.nv))
    pixels = 400.0 * body.landmarks(body.at(q))[:, 1:]
    points, faces = skin_points(body.landmark_names, pixels)
    assert faces.tolist() == [True, False, False]
    true = skin_features(body, anatomy_of(body)).points(body.placed(q[None]))[0]
    np.testing.assert_allclose(points, 400.0 * true[:, 1:], atol=1.0)
    lost = pixels.copy()
    lost[body.landmark_names.index("left_elbow")] = np.nan
    assert len(skin_points(body.landmark_names, lost)[0]) == 2
    assert skin_points(("left_hip",), np.zeros((1, 2)))[0].shape == (0, 2)


HANDS = ("head", "left_hand", "right_hand")


def skin(*places: tuple[float, float]) -> Detections:
    """Blobs of which each may be the head or a hand."""
    covariance = np.tile(64.0 * np.eye(2), (len(places), 1, 1))
    suits = np.tile([0.6, 0.4, 0.4], (len(places), 1))
    return Detections(HANDS, np.array(places), covariance, suits, np.zeros(len(places), bool), 4.0 * covariance)


def share_of_a_hand_alone(detections: Detections) -> float:
    """Probability that a hand whose place is unknown is in the first detection and the head is not."""
    place = np.array([[100.0, 50.0], [150.0, 100.0], [150.0, 100.0]])
    prior = gaussian(HANDS, place, np.diag([100.0] * 2 + [1e4] * 4))
    evidence = evidence_of(detections, EvidenceSettings(), prior)
    weights = np.exp(evidence.density.log_mass(prior) - np.logaddexp.reduce(evidence.density.log_mass(prior)))
    alone = (evidence.detection[:, 1:] == 0).any(axis=1) & (evidence.detection[:, 0] != 0)
    return float(weights[alone].sum())


def test_a_detected_face_and_its_blob_are_one_detection() -> None:
    """The blob of a face that a detector finds is not left to a hand; faces elsewhere are detections of their own."""
    blobs, score = skin((100.0, 50.0), (220.0, 170.0)), 0.95
    there = of_faces(HANDS, Faces(np.array([[104.0, 47.0]]), 9.0 * np.eye(2)[None], np.array([score])))
    joint = fused(blobs, there)
    assert len(joint.mean) == 2
    assert share_of_a_hand_alone(joint) < 0.5 * share_of_a_hand_alone(blobs)
    assert share_of_a_hand_alone(all_of([blobs, there])) > share_of_a_hand_alone(blobs)
    # head: by both; a hand beside it: anywhere in the blob, about the new middle
    precision = np.linalg.inv(blobs.covariance[0]) + np.linalg.inv(there.covariance[0])
    np.testing.assert_allclose(np.linalg.inv(joint.covariance[0]), precision, rtol=1e-9)
    off = joint.mean[0] - blobs.mean[0]
    np.testing.assert_allclose(joint.shared[0], blobs.shared[0] + np.outer(off, off))
    np.testing.assert_allclose(joint.suits[0], [score, 0.4 * (1.0 - score), 0.4 * (1.0 - score)])
    np.testing.assert_array_equal(joint.mean[1], blobs.mean[1])
    elsewhere = of_faces(HANDS, Faces(np.array([[400.0, 40.0]]), 9.0 * np.eye(2)[None], np.array([score])))
    for apart in (fused(blobs, elsewhere), fused(Detections.none(HANDS), elsewhere)):
        np.testing.assert_array_equal(apart.mean[-1], elsewhere.mean[0])
    np.testing.assert_array_equal(fused(blobs, of_faces(HANDS, Faces.none())).suits, blobs.suits)


class StandIn:
    """Answers of OpenCV's detector, without its model."""

    rows: np.ndarray | None = None

    @classmethod
    def create(cls, *args: object, **options: object) -> StandIn:
        if Path(str(args[0])).read_bytes() != b"yunet":
            raise cv2.error
        return cls()

    def setInputSize(self, size: tuple[int, int]) -> None:
        self.size = size

    def detect(self, picture: np.ndarray) -> tuple[int, np.ndarray | None]:
        assert self.size == picture.shape[1::-1]
        return 1, self.rows


def test_detected_faces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "FaceDetectorYN", StandIn)
    model = tmp_path / "yunet.onnx"
    model.write_bytes(b"yunet")
    detector, empty = FaceDetector(model), np.zeros((20, 30, 3), np.uint8)
    assert len(detector.faces(empty).mean) == 0
    row = np.array([10.0, 20, 30, 40, 15, 30, 35, 30, 25, 45, 18, 50, 32, 50, 0.7], np.float32)
    StandIn.rows = np.stack([row, row + np.where(np.arange(15) < 14, 100.0, 0.2).astype(np.float32)])
    faces = detector.faces(empty)
    np.testing.assert_allclose(faces.mean, [[125.0, 135.0], [25.0, 35.0]], rtol=1e-6)
    assert faces.score[0] > faces.score[1]
    assert (np.linalg.eigvalsh(faces.covariance) > 0.0).all()
    StandIn.rows = None
    (tmp_path / "other.onnx").write_bytes(b"something else")
    with pytest.raises(InputError, match="not a model of a face detector"):
        FaceDetector(tmp_path / "other.onnx")


def test_an_unknown_detector_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="no such model file"):
        FaceDetector(tmp_path / "missing.onnx")
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"no model")
    with pytest.raises(InputError, match="not a model of a face detector"):
        FaceDetector(broken)
    monkeypatch.delattr(cv2, "FaceDetectorYN")
    with pytest.raises(InputError, match="no FaceDetectorYN"):
        FaceDetector(broken)
