"""kinemode: how a person, or any articulated body with a URDF, moved in a clip.

>>> import kinemode as km
>>> subject = km.load_subject("human34")
>>> run = km.track(subject, "walk.mp4", cameras="calibration.json", keypoints="walk.json", out="walk.run")
>>> run.q, run.landmarks, run.mode_weight
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from estimator.results.run_file import Run
    from humanoid.subject.subject import Subject, load_subject
    from humanoid.support.errors import InputError
    from kinemode.api import fit, open_run, track
    from kinemode.comparison.compare import compare

__all__ = ["InputError", "Run", "Subject", "__version__", "compare", "fit", "load_subject", "open_run", "track"]

# Pinocchio, OpenCV and numba take a second to import; a name costs only when it is first used.
_HOME = {
    "InputError": "humanoid.support.errors",
    "Run": "estimator.results.run_file",
    "Subject": "humanoid.subject.subject",
    "compare": "kinemode.comparison.compare",
    "fit": "kinemode.api",
    "load_subject": "humanoid.subject.subject",
    "open_run": "kinemode.api",
    "track": "kinemode.api",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'kinemode' has no attribute '{name}'; it has {', '.join(sorted(_HOME))}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
