# /// script
# requires-python = ">=3.10,<3.14"
# dependencies = [
#     "onnxruntime==1.20.1",
#     "numpy==2.1.3",
#     "opencv-python-headless==4.11.0.86",
#     "flatbuffers==25.2.10",
#     "packaging==24.2",
#     "protobuf==5.29.3",
# ]
# ///
"""A pose model as an ONNX file that the user names: RTMPose (Jiang et al. 2023) and others with SimCC outputs (Li et
al. 2022), for each keypoint how likely it is in each column and in each line of one person's picture.

Pictures are prepared as MMPose does: the person's box grown by a quarter, RGB, ImageNet's mean and deviation. Who is in
the picture is found by a second model, if there is one (RTMDet or YOLOX with their suppression of doubles inside: boxes
(1, N, 5) left, top, right, bottom, score, and labels (1, N), 0 for people); else one person is searched for in the
whole picture. After that a person's box follows from the keypoints before.
"""

from __future__ import annotations

from typing import Any

import numpy as np

MEAN = np.array([123.675, 116.28, 103.53], np.float32)
DEVIATION = np.array([58.395, 57.12, 57.375], np.float32)
GROWN = 1.25  # the box that a model of poses is shown, as MMPose trains it
AROUND = 0.1  # of the keypoints' extent, to each side: hands and the top of the head are beyond them
SURE = 0.3  # confidence of a keypoint that counts, and on average of a person who is there
SURE_BOX = 0.5
LOOKS = 3  # at one person in a whole picture, each nearer than the one before
GREY = 114  # beyond the picture, where boxes are searched for


def decoded(columns: np.ndarray, lines: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The keypoints (K, 3) that SimCC outputs mean: x, y in the model's input picture [px] and confidence, 0 to 1.

    columns (K, W s), lines (K, H s): how likely each keypoint is at each s-th of a pixel. size: W, H. The confidence is
    that of the less sure of the two coordinates.
    """
    x, y = columns.argmax(axis=1), lines.argmax(axis=1)
    sure = np.minimum(columns.max(axis=1), lines.max(axis=1))
    return np.stack([x * size[0] / columns.shape[1], y * size[1] / lines.shape[1], np.clip(sure, 0.0, 1.0)], axis=1)


def window(box: list[float], picture: tuple[int, int], size: tuple[int, int]) -> tuple[float, float, float]:
    """Left and top [px] of what a model is shown of a picture, and pixels of it to a pixel of the model's input.

    box: left, top, right, bottom in shares of the picture. picture, size: width, height of picture and input.
    """
    left, right = box[0] * picture[0], box[2] * picture[0]
    top, bottom = box[1] * picture[1], box[3] * picture[1]
    scale = GROWN * max((right - left) / size[0], (bottom - top) / size[1], 1.0 / max(size))
    return 0.5 * (left + right - scale * size[0]), 0.5 * (top + bottom - scale * size[1]), scale


class OnnxPose:
    """Searches for people and finds their keypoints; see `serving.Detector`."""

    def __init__(self, options: dict[str, Any]) -> None:
        self._pose = _session(options["model"])
        self._size = _input_size(self._pose, options["model"])
        self._boxes = _session(options["boxes"]) if options.get("boxes") else None
        self._boxes_size = _input_size(self._boxes, options["boxes"]) if self._boxes is not None else (0, 0)
        # YOLOX takes pictures as they are, RTMDet with mean and deviation taken out
        self._plain = "yolo" in str(options.get("boxes", "")).lower()
        self._order = _columns_first(self._pose, options["model"])
        self.about = {"layout": None, "names": None}

    def search(self, picture: np.ndarray, parts: bool) -> list[dict[str, Any]]:
        """States of the people who seem to be in a picture, the surest first; in the whole of it alone."""
        if self._boxes is not None:
            return [{"box": box} for box in self._people(picture)]
        state: dict[str, Any] = {"box": [0.0, 0.0, 1.0, 1.0]}
        for _ in range(LOOKS):
            seen = self.look(picture, state)
            if seen is None:
                break
            state = seen["state"]
        return [state]

    def look(self, picture: np.ndarray, state: dict[str, Any]) -> dict[str, Any] | None:
        """Keypoints and next state of a person, None where there is none."""
        rows, columns = picture.shape[:2]
        left, top, scale = window(state["box"], (columns, rows), self._size)
        prepared = (_cut(picture, left, top, scale, self._size)[:, :, ::-1] - MEAN) / DEVIATION
        outputs = _run(self._pose, prepared)
        points = decoded(outputs[self._order[0]][0], outputs[self._order[1]][0], self._size)
        points[:, :2] = points[:, :2] * scale + [left, top]
        if points[:, 2].mean() < SURE:
            return None
        return {"keypoints": points.tolist(), "state": {"box": _box_of(points, (columns, rows))}}

    def _people(self, picture: np.ndarray) -> list[list[float]]:
        rows, columns = picture.shape[:2]
        scale = max(columns / self._boxes_size[0], rows / self._boxes_size[1])
        prepared = _cut(picture, 0.0, 0.0, scale, self._boxes_size, GREY)
        if not self._plain:
            prepared = (prepared - MEAN[::-1]) / DEVIATION[::-1]
        boxes, *labels = _run(self._boxes, prepared)
        if boxes.ndim != 3 or boxes.shape[2] != 5:
            raise ValueError(
                f"the boxes' model gives {boxes.shape}, (1, N, 5) is needed: left, top, right, bottom, score"
            )
        is_person = labels[0][0] == 0 if labels else np.ones(boxes.shape[1], bool)
        sure = boxes[0][is_person & (boxes[0, :, 4] > SURE_BOX)]
        ordered = sure[np.argsort(-sure[:, 4], kind="stable"), :4] * scale / [columns, rows, columns, rows]
        return [[float(share) for share in box] for box in ordered]


def _box_of(points: np.ndarray, picture: tuple[int, int]) -> list[float]:
    sure = points[points[:, 2] >= SURE, :2]
    low, high = sure.min(axis=0), sure.max(axis=0)
    around = AROUND * (high - low).max()
    return [float(share) for share in np.concatenate([low - around, high + around]) / [*picture, *picture]]


def _cut(
    picture: np.ndarray, left: float, top: float, scale: float, size: tuple[int, int], beyond: int = 0
) -> np.ndarray:
    import cv2

    onto = np.array([[1.0 / scale, 0.0, -left / scale], [0.0, 1.0 / scale, -top / scale]])
    cut = cv2.warpAffine(picture, onto, size, flags=cv2.INTER_LINEAR, borderValue=(beyond, beyond, beyond))
    return cut.astype(np.float32)


def _session(path: str) -> Any:
    import onnxruntime

    try:
        return onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise ValueError(f"{path} cannot be loaded: {error}") from error


def _input_size(session: Any, path: str) -> tuple[int, int]:
    (shape,) = [given.shape for given in session.get_inputs()]
    if len(shape) != 4 or shape[1] != 3 or not all(isinstance(length, int) for length in shape[2:]):
        raise ValueError(f"{path} takes {shape}, (1, 3, height, width) with fixed height and width is needed")
    return shape[3], shape[2]


def _columns_first(session: Any, path: str) -> tuple[int, int]:
    """Which outputs are the columns (x) and the lines (y)."""
    names = [output.name for output in session.get_outputs()]
    if len(names) != 2:
        raise ValueError(f"{path} gives {', '.join(names)}; two outputs are needed, as SimCC has: simcc_x and simcc_y")
    return (1, 0) if names[0].lower().endswith("y") else (0, 1)


def _run(session: Any, prepared: np.ndarray) -> list[np.ndarray]:
    batch = np.ascontiguousarray(prepared.transpose(2, 0, 1)[None], np.float32)
    return [np.asarray(output) for output in session.run(None, {session.get_inputs()[0].name: batch})]


if __name__ == "__main__":
    import serving

    serving.main(OnnxPose)
