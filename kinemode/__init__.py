"""kinemode: how a person, or any articulated body with a URDF, moved in a clip.

>>> import kinemode as km
>>> subject = km.load_subject("human34")
>>> run = km.track(subject, "walk.mp4", cameras="calibration.json", keypoints="walk.json", out="walk.run")
>>> run.q, run.landmarks, run.mode_weight
>>> km.overlay(run, "walk-overlay.mp4")
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from humanoid.support.lazy import lazy_names

__version__ = "0.1.0"

if TYPE_CHECKING:
    from estimator.data.cameras.camera import Camera
    from estimator.data.formats.cameras import load_cameras, write_cameras
    from estimator.data.formats.keypoints import KeypointTrack, load_keypoints, write_keypoints
    from estimator.retargeting.source import SourceMotion
    from estimator.runs.evaluation import Evaluation
    from estimator.runs.reference_motion import Reference
    from estimator.runs.run_reader import Run
    from estimator.synthesis.settings import DetectorSettings, SceneSettings, ViewSettings
    from humanoid.kinematics.body import Body
    from humanoid.subject.subject import Subject, load_subject
    from humanoid.support.errors import InputError
    from kinemode.batches.faults import ManifestError
    from kinemode.notices import FindingWarning, InputWarning
    from kinemode.progress import reported
    from kinemode.public.batches import Batch, batch, make_manifest
    from kinemode.public.cameras import calibrate
    from kinemode.public.clips import annotate, render
    from kinemode.public.detection import detect
    from kinemode.public.landmarks import landmark_start, marker_start
    from kinemode.public.results import contact, evaluate, export, gait, open_run, overlay, plot, report, samples, view
    from kinemode.public.retargeting import Retargeter, match_start, retarget
    from kinemode.public.rigs import calibrate_from_person, check_cameras
    from kinemode.public.stepping import Tracker, live
    from kinemode.public.tracking import compare, fit, track
    from kinemode.public.training import train_index, train_templates

# Pinocchio, OpenCV and numba take a second to import; a name costs only when it is first used.
_MODULES = {
    "Batch": "kinemode.public.batches",
    "Body": "humanoid.kinematics.body",
    "Camera": "estimator.data.cameras.camera",
    "DetectorSettings": "estimator.synthesis.settings",
    "Evaluation": "estimator.runs.evaluation",
    "FindingWarning": "kinemode.notices",
    "InputError": "humanoid.support.errors",
    "InputWarning": "kinemode.notices",
    "KeypointTrack": "estimator.data.formats.keypoints",
    "ManifestError": "kinemode.batches.faults",
    "Reference": "estimator.runs.reference_motion",
    "Retargeter": "kinemode.public.retargeting",
    "Run": "estimator.runs.run_reader",
    "SceneSettings": "estimator.synthesis.settings",
    "SourceMotion": "estimator.retargeting.source",
    "Subject": "humanoid.subject.subject",
    "Tracker": "kinemode.public.stepping",
    "ViewSettings": "estimator.synthesis.settings",
    "annotate": "kinemode.public.clips",
    "batch": "kinemode.public.batches",
    "calibrate": "kinemode.public.cameras",
    "calibrate_from_person": "kinemode.public.rigs",
    "check_cameras": "kinemode.public.rigs",
    "compare": "kinemode.public.tracking",
    "contact": "kinemode.public.results",
    "detect": "kinemode.public.detection",
    "evaluate": "kinemode.public.results",
    "export": "kinemode.public.results",
    "fit": "kinemode.public.tracking",
    "gait": "kinemode.public.results",
    "landmark_start": "kinemode.public.landmarks",
    "marker_start": "kinemode.public.landmarks",
    "live": "kinemode.public.stepping",
    "load_cameras": "estimator.data.formats.cameras",
    "load_keypoints": "estimator.data.formats.keypoints",
    "load_subject": "humanoid.subject.subject",
    "make_manifest": "kinemode.public.batches",
    "match_start": "kinemode.public.retargeting",
    "open_run": "kinemode.public.results",
    "overlay": "kinemode.public.results",
    "plot": "kinemode.public.results",
    "samples": "kinemode.public.results",
    "render": "kinemode.public.clips",
    "report": "kinemode.public.results",
    "retarget": "kinemode.public.retargeting",
    "reported": "kinemode.progress",
    "track": "kinemode.public.tracking",
    "train_index": "kinemode.public.training",
    "train_templates": "kinemode.public.training",
    "view": "kinemode.public.results",
    "write_cameras": "estimator.data.formats.cameras",
    "write_keypoints": "estimator.data.formats.keypoints",
}

__all__ = [
    "Batch",
    "Body",
    "Camera",
    "DetectorSettings",
    "Evaluation",
    "FindingWarning",
    "InputError",
    "InputWarning",
    "KeypointTrack",
    "ManifestError",
    "Reference",
    "Retargeter",
    "Run",
    "SceneSettings",
    "SourceMotion",
    "Subject",
    "Tracker",
    "ViewSettings",
    "__version__",
    "annotate",
    "batch",
    "calibrate",
    "calibrate_from_person",
    "check_cameras",
    "compare",
    "contact",
    "detect",
    "evaluate",
    "export",
    "fit",
    "gait",
    "landmark_start",
    "live",
    "load_cameras",
    "load_keypoints",
    "load_subject",
    "make_manifest",
    "marker_start",
    "match_start",
    "open_run",
    "overlay",
    "plot",
    "render",
    "report",
    "reported",
    "retarget",
    "samples",
    "track",
    "train_index",
    "train_templates",
    "view",
    "write_cameras",
    "write_keypoints",
]


__getattr__ = lazy_names(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted(__all__)
