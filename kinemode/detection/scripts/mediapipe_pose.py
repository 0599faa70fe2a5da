# /// script
# requires-python = ">=3.9,<3.13"
# dependencies = [
#     "mediapipe==0.10.21",
#     "numpy==1.26.4",
#     "opencv-contrib-python-headless==4.11.0.86",
#     "protobuf==4.25.6",
#     "absl-py==2.1.0",
#     "attrs==25.1.0",
#     "flatbuffers==25.2.10",
#     "matplotlib==3.9.4",
#     "contourpy==1.3.0",
#     "cycler==0.12.1",
#     "fonttools==4.56.0",
#     "kiwisolver==1.4.7",
#     "packaging==24.2",
#     "pillow==11.1.0",
#     "pyparsing==3.2.1",
#     "python-dateutil==2.9.0.post0",
#     "six==1.17.0",
#     "importlib-resources==6.5.2; python_version < '3.10'",
#     "zipp==3.21.0; python_version < '3.10'",
# ]
# ///
"""MediaPipe Pose (BlazePose, Bazarevsky et al. 2020) for several people, by the two models that its wheel brings.

MediaPipe's own Pose follows one person. Its parts are used one by one here: the search for people in the whole picture,
and the landmarks of one person in a turned square around them, from which the next picture's square follows. For one
person the landmarks are those of MediaPipe's Pose (model_complexity 1, smooth_landmarks off, both confidences 0.5), but
for rounding, which the models make tenths of a pixel of.
The packages are installed as they are listed, without what they would draw in besides: MediaPipe would come with JAX,
for which it has no use here, and with an OpenCV that needs a display's libraries.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

SEARCH = """
input_stream: "image"
output_stream: "detections"
node { calculator: "PoseDetectionCpu" input_stream: "IMAGE:image" output_stream: "DETECTIONS:detections" }
"""
LANDMARKS = """
input_stream: "image"
input_stream: "square"
input_side_packet: "model_complexity"
output_stream: "landmarks"
output_stream: "auxiliary"
output_stream: "world"
node {
  calculator: "PoseLandmarkByRoiCpu"
  input_side_packet: "MODEL_COMPLEXITY:model_complexity"
  input_stream: "IMAGE:image"
  input_stream: "ROI:square"
  output_stream: "LANDMARKS:landmarks"
  output_stream: "AUXILIARY_LANDMARKS:auxiliary"
  output_stream: "WORLD_LANDMARKS:world"
}
"""
FULL = 1  # the model of this complexity is in the wheel; the others would be fetched
PART = 0.6  # side of the parts of a picture that are searched, by the picture's shorter one
SURE_START, SURE_POINTS = 0.7, 0.87  # of people found in a part: a leg alone looks like a person there
SCALE = 1.25  # of the square, about the circle through the person's ends
RATE = 1e6 / 33333.0  # pictures a second, as MediaPipe counts them whatever the clip's rate
MIN_CUTOFF, BETA, DERIVATE_CUTOFF = 0.01, 10.0, 1.0  # of the filter, as in MediaPipe's graph
Point = tuple[float, float]


class MediapipePose:
    """Searches for people and finds their keypoints; see `serving.Detector`."""

    def __init__(self, options: dict[str, Any]) -> None:
        from google.protobuf import text_format
        from mediapipe.framework import calculator_pb2
        from mediapipe.framework.formats import rect_pb2
        from mediapipe.python.solution_base import SolutionBase
        from mediapipe.python.solutions.pose import PoseLandmark

        def graph(text: str, inputs: Any = None) -> Any:
            config = text_format.Parse(text, calculator_pb2.CalculatorGraphConfig())
            return SolutionBase(graph_config=config, side_inputs=inputs)

        self._rect = rect_pb2.NormalizedRect
        self._search, self._landmarks = graph(SEARCH), graph(LANDMARKS, {"model_complexity": FULL})
        self.about = {"layout": "mediapipe33", "names": [mark.name.lower() for mark in PoseLandmark]}

    def search(self, picture: np.ndarray, parts: bool) -> list[dict[str, Any]]:
        """States of the people who seem to be in a picture, the surest first; then those in its parts, who may be too
        small to be seen in the whole of it."""
        size = (picture.shape[1], picture.shape[0])
        states = [_state(ends, [], size) for _, ends in self._starts(picture, (0, 0), size)]
        if parts:
            side = round(PART * min(size))
            corners = [(x, y) for y in _steps(size[1], side) for x in _steps(size[0], side)]
            starts = [s for x, y in corners for s in self._starts(picture[y : y + side, x : x + side], (x, y), size)]
            sure = sorted((start for start in starts if start[0] > SURE_START), key=lambda start: -start[0])
            states += [{**_state(ends, [], size), "doubted": True} for _, ends in sure]
        return states

    def _starts(
        self, part: np.ndarray, corner: tuple[int, int], size: tuple[int, int]
    ) -> list[tuple[float, list[Point]]]:
        """Confidences and ends (see `steadied`) of people who seem to be in a part of a picture, the surest first."""
        detections = self._search.process({"image": _rgb(part)}).detections or []
        starts = []
        for detection in sorted(detections, key=lambda d: -d.score[0]):
            points = detection.location_data.relative_keypoints[:2]
            places = [(p.x * part.shape[1] + corner[0], p.y * part.shape[0] + corner[1]) for p in points]
            starts.append((detection.score[0], [(x / size[0], y / size[1]) for x, y in places]))
        return starts

    def look(self, picture: np.ndarray, state: dict[str, Any]) -> dict[str, Any] | None:
        """Keypoints, landmarks in space and next state of a person, None where there is none."""
        x, y, width, height, turn = state["square"]
        square = self._rect(x_center=x, y_center=y, width=width, height=height, rotation=turn)
        seen = self._landmarks.process({"image": _rgb(picture), "square": square})
        if seen.landmarks is None or seen.auxiliary is None:
            return None
        if "doubted" in state and np.mean([p.visibility for p in seen.landmarks.landmark]) < SURE_POINTS:
            return None
        rows, columns = picture.shape[:2]
        keypoints = [[p.x * columns, p.y * rows, p.visibility] for p in seen.landmarks.landmark]
        ends, memory = steadied([(p.x, p.y) for p in seen.auxiliary.landmark[:2]], state["memory"], (columns, rows))
        person = {"keypoints": keypoints, "state": _state(ends, memory, (columns, rows))}
        # MediaPipe has turned them back from the square to the picture's axes
        return person if seen.world is None else {**person, "world": [[p.x, p.y, p.z] for p in seen.world.landmark]}


def steadied(
    ends: list[Point], memory: list[list[float]], size: tuple[int, int]
) -> tuple[list[Point], list[list[float]]]:
    """The two points that the next square follows from, steadied by the 1 euro filter (Casiez, Roussel, Vogel 2012) as
    in MediaPipe's graph; and what is to be known next time.

    ends: mid hips and the circle's top, in shares of the picture. memory: for each coordinate its last value, its last
    steadied value and its last steadied rate; empty the first time. size: width, height [px].
    """
    values = [share * length for point in ends for share, length in ((point[0], size[0]), (point[1], size[1]))]
    scale = 2.0 * math.hypot(
        values[2] - values[0], values[3] - values[1]
    )  # of the person; a rate is in persons a second
    if not memory or scale < 1e-6:
        steady = [[value, value, 0.0] for value in values]
    else:
        steady = [_filtered(values[k], memory[k], scale) for k in range(4)]
    x0, y0, x1, y1 = (row[1] for row in steady)
    return [(x0 / size[0], y0 / size[1]), (x1 / size[0], y1 / size[1])], steady


def _filtered(value: float, memory: list[float], scale: float) -> list[float]:
    last, steady, rate = memory
    share = _share(DERIVATE_CUTOFF)
    rate = share * (value - last) / scale * RATE + (1.0 - share) * rate
    share = _share(MIN_CUTOFF + BETA * abs(rate))
    return [value, share * value + (1.0 - share) * steady, rate]


def _share(cutoff: float) -> float:
    """The weight of a new value at the filter's cut-off frequency [Hz]."""
    return 1.0 / (1.0 + RATE / (2.0 * math.pi * cutoff))


def turned_square(ends: list[Point], size: tuple[int, int]) -> list[float]:
    """The square around a person: centre x, y, width, height in shares of the picture, and its turn [rad], 0 where the
    person is upright. ends: see `steadied`."""
    (x, y), (top_x, top_y) = ends
    across, down = (top_x - x) * size[0], (top_y - y) * size[1]
    side = 2.0 * SCALE * math.hypot(across, down)
    turn = math.pi / 2.0 - math.atan2(-down, across)
    turn -= 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi))
    return [x, y, side / size[0], side / size[1], turn]


def _state(ends: list[Point], memory: list[list[float]], size: tuple[int, int]) -> dict[str, Any]:
    square = turned_square(ends, size)
    x, y, width, height, _ = square
    box = [x - width / 2.0, y - height / 2.0, x + width / 2.0, y + height / 2.0]
    return {"box": box, "square": square, "memory": memory}


def _steps(length: int, side: int) -> list[int]:
    """Where parts begin that overlap by half or more and cover the whole length."""
    count = max(1, math.ceil(2.0 * (length - side) / side) + 1)
    return [round(k * (length - side) / max(1, count - 1)) for k in range(count)]


def _rgb(picture: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(picture[:, :, ::-1])


if __name__ == "__main__":
    import serving

    serving.main(MediapipePose)
