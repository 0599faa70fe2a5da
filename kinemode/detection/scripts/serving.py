"""The detector's side of the talk: requests and pictures on standard input, lines of JSON on standard output.

A request is a line of JSON. "size": [width, height] means that the bytes of an image follow (height, width, 3; BGR);
without it the request is about the picture before. "search" requests "starts", where people seem to be: "whole" or
"parts" (a closer look, for people who are small), else null.
"states" are people to follow: "people" in the answer has for each null, or its "keypoints" [x, y, confidence] in
pixels, perhaps their "world" [x, y, z] in metres (see `estimator.data.formats.keypoints_own`), and the "state" to look
for it with in the next picture. A state has a "box" (left, top, right, bottom in shares
of the picture); whatever else is in it is the detector's own.
"""

from __future__ import annotations

import json
import os
import sys
from typing import Any, BinaryIO, Protocol, TextIO

import numpy as np


class Detector(Protocol):
    """Finds people in images; `about` describes once what it returns."""

    about: dict[str, Any]

    def search(self, picture: np.ndarray, parts: bool) -> list[dict[str, Any]]:
        """States of the people who seem to be in a picture, the surest first; parts: look closely."""

    def look(self, picture: np.ndarray, state: dict[str, Any]) -> dict[str, Any] | None:
        """Keypoints, perhaps their world, and next state of a person, None where there is none."""


def main(make: Any) -> None:
    """Serve until standard input ends; `make(options)` makes the detector, whose options are the first argument."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # libraries print what they like: it must not come between the answers
    try:
        detector: Detector = make(json.loads(sys.argv[1]))
        _say(answers, detector.about)
        _serve(detector, sys.stdin.buffer, answers)
    except Exception as error:
        _say(answers, {"error": str(error) or type(error).__name__, "kind": type(error).__name__})
        raise


def _serve(detector: Detector, requests: BinaryIO, answers: TextIO) -> None:
    picture = np.zeros((0, 0, 3), np.uint8)
    while line := requests.readline():
        request = json.loads(line)
        if "size" in request:
            width, height = request["size"]
            content = requests.read(3 * width * height)
            if len(content) < 3 * width * height:
                return
            picture = np.frombuffer(content, np.uint8).reshape(height, width, 3)
        answer: dict[str, Any] = {"people": [detector.look(picture, state) for state in request["states"]]}
        if request["search"]:
            answer["starts"] = detector.search(picture, request["search"] == "parts")
        _say(answers, answer)


def _say(answers: TextIO, content: dict[str, Any]) -> None:
    print(json.dumps(content), file=answers, flush=True)
