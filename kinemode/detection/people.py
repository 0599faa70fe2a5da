"""People from picture to picture: a detector finds new people and follows each; here they get their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np

State = dict[str, Any]
SEEN = ("keypoints", "world")
Seen = dict[str, np.ndarray]
"""The keypoints (K, 3; x, y [px], confidence) of a person, and where the detector gives it their world (K, 3) [m], see
`estimator.data.formats.keypoints_own`."""
Search = Literal["whole", "parts"] | None
SEARCHED = 10  # pictures: people are searched for in every so many, and in the one after a person was lost
CLOSELY = 30  # pictures: so that people are found who are small in them
_SAME_BOX = 0.5  # of two boxes' union that they share: a person who is followed already, as MediaPipe has it
_SAME_POINTS = 0.1  # mean distance of two people's keypoints by the larger one's size: one person twice
_REMEMBERED = 30  # pictures: a person found where another was lost is that person
_BACK = 0.3  # of two boxes' union that they share then


class Asked(Protocol):
    """Answers requests about pictures; see `process.DetectorProcess.ask`."""

    def ask(self, picture: np.ndarray | None, states: Sequence[State], *, search: Search = None) -> dict[str, Any]:
        """The detections."""


@dataclass
class People:
    """The people who are followed; `content` and `of` keep them in a file.

    states: by number, the detector's state for finding them. lost: by number, box and picture of those not seen since.
    index: of the next picture. born: how many numbers were given. search: whether the next picture is searched anyway.
    """

    most: int
    states: dict[int, State] = field(default_factory=dict)
    lost: dict[int, tuple[list[float], int]] = field(default_factory=dict)
    index: int = 0
    born: int = 0
    search: bool = True

    def content(self) -> dict[str, Any]:
        """All of it, for JSON."""
        states = {str(number): state for number, state in self.states.items()}
        lost = {str(number): list(where) for number, where in self.lost.items()}
        return {"states": states, "lost": lost, "index": self.index, "born": self.born, "search": self.search}

    @staticmethod
    def of(content: dict[str, Any], most: int) -> People:
        """The inverse of `content`."""
        states = {int(number): state for number, state in content["states"].items()}
        lost = {int(number): (box, index) for number, (box, index) in content["lost"].items()}
        return People(most, states, lost, content["index"], content["born"], content["search"])

    def see(self, detector: Asked, picture: np.ndarray) -> dict[int, Seen]:
        """The people in the next picture, by their numbers."""
        searched: Search = "whole" if self.search or self.index % SEARCHED == 0 else None
        searched = "parts" if self.index % CLOSELY == 0 else searched
        numbers = list(self.states)
        answer = detector.ask(picture, list(self.states.values()), search=searched)
        seen = {n: person for n, person in zip(numbers, answer["people"], strict=True) if person is not None}
        seen = _without_doubles(seen)
        self.lost |= {n: (self.states[n]["box"], self.index) for n in numbers if n not in seen}
        starts = _apart(answer.get("starts", []), [person["state"]["box"] for person in seen.values()])
        if starts := starts[: self.most - len(seen)]:
            seen = self._joined(seen, [p for p in detector.ask(None, starts)["people"] if p is not None])
        self.search = not seen or len(seen) < len(numbers)
        self.states = {number: person["state"] for number, person in seen.items()}
        self.index += 1
        return {n: {name: np.array(person[name]) for name in SEEN if name in person} for n, person in seen.items()}

    def _joined(self, seen: dict[int, State], newcomers: Sequence[State]) -> dict[int, State]:
        """The followed people with new and returning ones."""
        for newcomer in newcomers:
            number = self._number(newcomer["state"]["box"])
            together = _without_doubles({**seen, number: newcomer})
            if number in together:
                self.lost.pop(number, None)
                self.born = max(self.born, number + 1)
            seen = together
        return seen

    def _number(self, box: list[float]) -> int:
        """The number of a person lost there recently, otherwise a new one."""
        self.lost = {n: where for n, where in self.lost.items() if self.index - where[1] <= _REMEMBERED}
        likeness = {n: shared(box, where[0]) for n, where in self.lost.items()}
        best = max(likeness, key=lambda n: likeness[n], default=None)
        return self.born if best is None or likeness[best] < _BACK else best


def shared(first: Sequence[float], second: Sequence[float]) -> float:
    """The share of two boxes' union (left, top, right, bottom) that belongs to both."""
    width = min(first[2], second[2]) - max(first[0], second[0])
    height = min(first[3], second[3]) - max(first[1], second[1])
    common = max(width, 0.0) * max(height, 0.0)
    areas = sum((box[2] - box[0]) * (box[3] - box[1]) for box in (first, second))
    return common / (areas - common) if areas > common else 0.0


def _apart(starts: Sequence[State], boxes: list[list[float]]) -> list[State]:
    """The states that are not about a person with one of the boxes, nor about one of an earlier state."""
    kept: list[State] = []
    for state in starts:
        if all(shared(state["box"], box) < _SAME_BOX for box in (*boxes, *(other["box"] for other in kept))):
            kept.append(state)
    return kept


def _without_doubles(seen: dict[int, State]) -> dict[int, State]:
    """The people without duplicates of earlier ones."""
    kept: dict[int, State] = {}
    for number, person in sorted(seen.items()):
        points = np.array(person["keypoints"])[:, :2]
        if not any(_same(points, np.array(other["keypoints"])[:, :2]) for other in kept.values()):
            kept[number] = person
    return kept


def _same(first: np.ndarray, second: np.ndarray) -> bool:
    size = max(float(np.hypot(*np.ptp(points, axis=0))) for points in (first, second))
    return float(np.linalg.norm(first - second, axis=1).mean()) < _SAME_POINTS * size
