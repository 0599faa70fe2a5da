"""kinemode: how a person, or any articulated body with a URDF, moved in a clip.

>>> import kinemode as km
>>> subject = km.load_subject("human34")
>>> run = km.track(subject, "walk.mp4", cameras="calibration.json", keypoints="walk.json", out="walk.run")
>>> run.q, run.landmarks, run.mode_weight
>>> km.overlay(run, "walk-overlay.mp4")
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from humanoid.support.extras import lazy_names

__version__ = "0.1.0"

# Pinocchio, OpenCV and numba take a second to import; a name costs only when it is first used.
if TYPE_CHECKING:
    from estimator.data.cameras.camera import Camera as Camera
    from estimator.data.formats.cameras import load_cameras as load_cameras, write_cameras as write_cameras
    from estimator.data.formats.keypoints import (
        KeypointTrack as KeypointTrack,
        load_keypoints as load_keypoints,
        write_keypoints as write_keypoints,
    )
    from estimator.retargeting.source import SourceMotion as SourceMotion
    from estimator.runs.evaluation import Evaluation as Evaluation
    from estimator.runs.reference_motion import Reference as Reference
    from estimator.runs.run_reader import Run as Run
    from estimator.synthesis.settings import (
        DetectorSettings as DetectorSettings,
        SceneSettings as SceneSettings,
        ViewSettings as ViewSettings,
    )
    from humanoid.kinematics.body import Body as Body
    from humanoid.subject.subject import Subject as Subject, load_subject as load_subject
    from humanoid.support.errors import InputError as InputError
    from kinemode.batches.tables import ManifestError as ManifestError
    from kinemode.notices import FindingWarning as FindingWarning, InputWarning as InputWarning
    from kinemode.progress import reported as reported
    from kinemode.public.batches import Batch as Batch, batch as batch, make_manifest as make_manifest
    from kinemode.public.cameras import (
        calibrate as calibrate,
        calibrate_from_person as calibrate_from_person,
        check_cameras as check_cameras,
    )
    from kinemode.public.clips import annotate as annotate, render as render
    from kinemode.public.detection import detect as detect
    from kinemode.public.landmarks import landmark_start as landmark_start, marker_start as marker_start
    from kinemode.public.results import (
        contact as contact,
        evaluate as evaluate,
        export as export,
        forces as forces,
        gait as gait,
        open_run as open_run,
        overlay as overlay,
        plot as plot,
        report as report,
        samples as samples,
        view as view,
    )
    from kinemode.public.retargeting import Retargeter as Retargeter, match_start as match_start, retarget as retarget
    from kinemode.public.stepping import Tracker as Tracker, live as live
    from kinemode.public.tracking import compare as compare, fit as fit, track as track
    from kinemode.public.training import train_index as train_index, train_templates as train_templates

_names, __getattr__ = lazy_names(__name__)
__all__ = ["__version__", *_names]


def __dir__() -> list[str]:
    return sorted(__all__)
