"""The work behind `kinemode.retarget`."""

from __future__ import annotations

import os
from dataclasses import asdict

from threadpoolctl import threadpool_limits

from estimator.retargeting.contacts import load_standing
from estimator.retargeting.correspondence import load_match, match_start
from estimator.retargeting.doubts import doubts_of, without_mirrored_parts
from estimator.retargeting.leaps import leaps_of, without_rest_pose
from estimator.retargeting.motion import RetargetedMotion, retarget_motion
from estimator.retargeting.problem import RetargetSettings
from estimator.retargeting.run_of import write_motion_run
from estimator.retargeting.source import SourceMotion, filled
from estimator.runs.run_header import RETARGETED, RunHeader
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Subject
from humanoid.support.files import replacing
from kinemode import __version__
from kinemode.inputs.motions import SourceOptions, hypotheses_of, load_source
from kinemode.named import PathLike
from kinemode.notices import warn
from kinemode.option import words_kept
from kinemode.request import RetargetRequest
from kinemode.target import RunTarget, run_path

FRAMES = "frames"  # the method in which each frame is followed from the one before alone
GAP = 0.5
"""[s] Gaps of a source that are not longer are filled."""


def retarget_to(subject: Subject, request: RetargetRequest) -> Run:
    """The work of `kinemode.retarget` after its arguments are checked."""
    path, _kept = run_path(request.out, "retarget.run")  # gone with this function unless the run keeps it
    RunTarget(path, overwrite=request.overwrite).check()
    source = request.source
    settings = RetargetSettings(velocity=float(request.velocity), clearance=float(request.clearance))
    if request.method == FRAMES:
        settings = settings.frame_by_frame
    read = load_source(source, SourceOptions(request.fps, request.up, request.unit, request.layout))
    read = without_rest_pose(without_mirrored_parts(read))
    motion = filled(read, GAP)
    match = None if request.match is None else load_match(request.match)
    standing = None if request.contacts is None else load_standing(request.contacts, motion)
    others = hypotheses_of(source, request.modes) if request.modes else None
    body = Body(subject)
    with threadpool_limits(limits=1), request.reporter("retarget") as step:
        made = retarget_motion(
            body,
            motion,
            match,
            settings=settings,
            seed=request.seed,
            others=others,
            standing=standing,
            progress=step,
        )
    doubts = doubts_of(body, made, motion, leaps_of(read))
    for note in (*made.notes, *doubts.findings):
        warn(note)
    header = _header(subject, _origin(source), made, request, settings)
    write_motion_run(path, header, body, made, motion, doubts=doubts, overwrite=request.overwrite)
    return Run.open(path)


def _origin(source: PathLike | Run | SourceMotion) -> str:
    """The file that a motion came from."""
    file = source.source if isinstance(source, SourceMotion) else source.file if isinstance(source, Run) else source
    return os.path.abspath(file)


def _header(
    subject: Subject, source: str, made: RetargetedMotion, request: RetargetRequest, settings: RetargetSettings
) -> RunHeader:
    return RunHeader(
        subject_urdf=subject.urdf,
        subject_source=subject.source,
        subject_base=subject.base,
        cameras=(),
        clips={},
        image_sizes={},
        times=made.times,
        tracker=RETARGETED,
        settings={
            **asdict(settings),
            "scale": made.targets.scale,
            "match": None if request.match is None else str(request.match),
        },
        seed=request.seed,
        version=__version__,
        notes=(*subject.notes, *made.notes),
        points=(source,),
        floor=0.0 if made.targets.feet else None,
        request=words_kept(request),
    )


def write_match_template(subject: Subject, out: PathLike | None) -> str:
    """The template of a correspondence, written to a file if one is named."""
    text = match_start(subject.name, Body(subject).landmark_names)
    if out is not None:
        with replacing(out) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return text
