"""The work behind `kinemode.retarget`."""

from __future__ import annotations

import os
import warnings
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import cast

from threadpoolctl import threadpool_limits

from estimator.retargeting.contact_file import load_standing
from estimator.retargeting.doubts import doubts_of
from estimator.retargeting.handedness import without_mirrored_parts
from estimator.retargeting.leaps import leaps_of, without_rest_pose
from estimator.retargeting.match_file import load_match, match_start
from estimator.retargeting.motion import RetargetedMotion, retarget_motion
from estimator.retargeting.problem import RetargetSettings
from estimator.retargeting.run_of import write_motion_run
from estimator.retargeting.source import SourceMotion, filled
from estimator.runs.run_file import Run
from estimator.runs.run_header import RETARGETED, RunHeader
from estimator.runs.run_store import TemporaryFolder
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Subject
from humanoid.support.atomic import replacing
from kinemode import __version__
from kinemode.inputs.motions import hypotheses_of, load_source
from kinemode.inputs.named import PathLike
from kinemode.notices import InputWarning
from kinemode.target import RunTarget
from kinemode.terminal.progress import Reporter

GAP = 0.5
"""[s] Gaps of a source that are not longer are filled."""


@dataclass(frozen=True)
class MotionWanted:
    """What is made of a source: its frame rate, axis, unit and order of joints where it does not say them, the files of
    correspondence and contacts, the settings, how many other hypotheses of a run are carried through, and where the
    new run goes."""

    fps: float | None = None
    up: str | None = None
    unit: str | None = None
    match: PathLike | None = None
    contacts: PathLike | None = None
    settings: RetargetSettings = field(default_factory=RetargetSettings)
    modes: int = 0
    seed: int = 0
    out: PathLike | None = None
    overwrite: bool = False
    layout: str | None = None


def retarget_to(
    subject: Subject, source: PathLike | Run | SourceMotion, wanted: MotionWanted, progress: Reporter
) -> Run:
    """What `kinemode.retarget` does once its arguments are known to be of the right kinds."""
    temporary = TemporaryFolder() if wanted.out is None else None
    path = temporary.path / "retarget.run" if temporary is not None else Path(cast(PathLike, wanted.out))
    RunTarget(path, overwrite=wanted.overwrite).check()
    read = load_source(source, fps=wanted.fps, up=wanted.up, unit=wanted.unit, layout=wanted.layout)
    read = without_rest_pose(without_mirrored_parts(read))
    motion = filled(read, GAP)
    match = None if wanted.match is None else load_match(wanted.match)
    standing = None if wanted.contacts is None else load_standing(wanted.contacts, motion)
    others = hypotheses_of(source, wanted.modes) if wanted.modes else None
    body = Body(subject)
    with threadpool_limits(limits=1), progress("retarget") as step:
        made = retarget_motion(
            body,
            motion,
            match,
            settings=wanted.settings,
            seed=wanted.seed,
            others=others,
            standing=standing,
            progress=step,
        )
    doubts = doubts_of(body, made, motion, leaps_of(read))
    for note in (*made.notes, *doubts.findings):
        warnings.warn(note, InputWarning, stacklevel=3)
    header = _header(subject, _origin(source), made, wanted)
    write_motion_run(path, header, body, made, motion, doubts=doubts, overwrite=wanted.overwrite)
    return Run.open(path)


def _origin(source: PathLike | Run | SourceMotion) -> str:
    """The file that a motion came from."""
    file = source.source if isinstance(source, SourceMotion) else source.file if isinstance(source, Run) else source
    return os.path.abspath(file)


def _header(subject: Subject, source: str, made: RetargetedMotion, wanted: MotionWanted) -> RunHeader:
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
            **asdict(wanted.settings),
            "scale": made.targets.scale,
            "match": None if wanted.match is None else str(wanted.match),
        },
        seed=wanted.seed,
        version=__version__,
        notes=(*subject.notes, *made.notes),
        points=(source,),
        floor=0.0 if made.targets.feet else None,
        given=_words(wanted),
    )


def _words(wanted: MotionWanted) -> dict[str, tuple[str, ...]]:
    """What was given beside the source, as words of the command line by option."""
    contacts = None if wanted.contacts is None else os.path.abspath(wanted.contacts)
    given = {
        "fps": wanted.fps, "up": wanted.up, "unit": wanted.unit, "layout": wanted.layout, "contacts": contacts,
        "modes": wanted.modes or None,
    }  # fmt: skip
    return {name: (str(value),) for name, value in given.items() if value is not None}


def begun_match(subject: Subject, out: PathLike | None) -> str:
    """The text of a correspondence to begin with, written to a file if one is named."""
    text = match_start(subject.name, Body(subject).landmark_names)
    if out is not None:
        with replacing(out) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return text
