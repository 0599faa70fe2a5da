"""The detectors by name."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from humanoid.support.errors import InputError, shown

if TYPE_CHECKING:
    from kinemode.request import DetectorOptions

SCRIPTS = Path(__file__).parent / "scripts"


@dataclass(frozen=True)
class Patience:
    """Timeouts of a detector [s].

    answer: until it must have answered, at its start and of each picture. end: that it may take to end. python:
    until it is known what packages a Python has. installation: that making the environment may take, some 150 MB over
    a slow line.
    """

    answer: float = 120.0
    end: float = 5.0
    python: float = 30.0
    installation: float = 1800.0


@dataclass(frozen=True)
class DetectorChoice:
    """A detector as requested by the user.

    name: one of `DETECTORS`. model: the file that the detector works by, where it brings none. boxes: a second model,
    which finds people in a picture. people: at most so many are followed. python: see `environment.python_for`.
    """

    name: str = "mediapipe"
    model: Path | None = None
    boxes: Path | None = None
    people: int = 6
    python: Path | None = None

    @staticmethod
    def of(options: DetectorOptions) -> DetectorChoice:
        """The requested detector."""
        model, boxes, python = (None if p is None else Path(p) for p in (options.model, options.boxes, options.python))
        return DetectorChoice(options.detector, model, boxes, options.people, python)

    @property
    def script(self) -> Path:
        """The program that its environment runs."""
        return SCRIPTS / DETECTORS[self.name].script

    @property
    def options(self) -> dict[str, Any]:
        """The options passed to the program."""
        models = {"model": self.model, "boxes": self.boxes}
        return {name: str(path.absolute()) for name, path in models.items() if path is not None}

    @property
    def most(self) -> int:
        """The number of people to follow; one where the detector cannot find several."""
        return self.people if not DETECTORS[self.name].needs_model or self.boxes is not None else 1

    @property
    def patience(self) -> Patience:
        """Its timeouts."""
        return DETECTORS[self.name].patience

    @property
    def identity(self) -> str:
        """The same for detectors that find the same in the same picture: name, and digest of programs and models."""
        digest = hashlib.sha256(json.dumps(self.most).encode())
        for path in (SCRIPTS / "serving.py", self.script, self.model, self.boxes):
            digest.update(b"-" if path is None else hashlib.sha256(path.read_bytes()).digest())
        return f"{self.name} {digest.hexdigest()[:16]}"

    def check(self) -> None:
        """Raise InputError for a model that is missing, or without use."""
        if self.name not in DETECTORS:
            raise InputError("detector", f"{shown(self.name)} is unknown", remedy=f"one of {', '.join(DETECTORS)}")
        about = DETECTORS[self.name]
        if about.needs_model and self.model is None:
            problem, remedy = f"{self.name} needs a model", "--model FILE names an ONNX file, of RTMPose for example"
            raise InputError("model", problem, remedy=remedy)
        for option, path in (("model", self.model), ("boxes", self.boxes)):
            if path is not None and not about.needs_model:
                raise InputError(option, f"{self.name} brings its own", remedy="leave it out, or --detector onnx")
            if path is not None and not path.is_file():
                raise InputError(path, "there is no such file")


@dataclass(frozen=True)
class About:
    """A known detector: its program, whether the user gives the model, and its timeouts."""

    script: str
    needs_model: bool
    patience: Patience = Patience()


DETECTORS = {"mediapipe": About("mediapipe_pose.py", False), "onnx": About("onnx_pose.py", True)}
