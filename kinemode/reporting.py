"""The parts of a report besides the motion: assumptions, all that repeats the run, the figures of a motion on another
body.
"""

from __future__ import annotations

import csv
import platform
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.retargeting.metrics import BELOW, OVERLAP, RetargetMeter, RetargetMetrics
from estimator.retargeting.problem import RetargetSettings
from estimator.retargeting.run_of import source_of
from estimator.runs.diagnosis import camera_errors, sampled_residuals
from estimator.runs.keypoint_residuals import marker_residuals
from estimator.runs.run_reader import Run
from estimator.tracking.unused_settings import changed_values
from humanoid.subject.example_robots import PREFIX
from humanoid.subject.subject import BUILT_IN, load_subject
from humanoid.support.errors import InputError
from humanoid.support.files import content_digest, replacing
from kinemode.explain import run_settings
from kinemode.findings import findings
from kinemode.option import options_of
from kinemode.request import USUAL_SUBJECT, RetargetRequest, TrackRequest
from viz.report.pictures import Facts


class MotionFigures(NamedTuple):
    """metrics: see `RetargetMetrics`. hard: share of the frames that do not keep to all they have to."""

    metrics: RetargetMetrics
    hard: float

    def rows(self) -> list[tuple[str, str]]:
        """Names and values with their units, as they are printed; without those that do not exist, as those of a floor
        for a body without feet."""
        m = self.metrics
        rows = [
            ("frames", m.frames, f"{m.frames}, {self.hard:.1%} of them hard"),
            ("joints over their limits", m.over_limits, f"{m.over_limits:.1%} of the frames"),
            ("joints too fast", m.too_fast, f"{m.too_fast:.1%} of the steps; at most {m.speed_ratio:.2f} of a limit"),
            ("parts that overlap", m.colliding, f"{m.colliding:.1%} of the frames by over {1e3 * OVERLAP:g} mm"),
            (
                "below the floor", m.deepest,
                f"{m.below_floor:.1%} by over {1e3 * BELOW:g} mm; at most {1e3 * m.deepest:.1f} mm",
            ),
            ("slip of what stands", m.slip, f"at most {1e3 * m.slip:.1f} mm a stance"),
            ("limbs off", m.limb_angle, f"{m.limb_angle:.1f} degrees in the mean, at most {m.worst_limb_angle:.0f}"),
            ("hips off the scaled path", m.root_rms, f"{100 * m.root_rms:.1f} cm RMS"),
            ("acceleration of joints", m.acceleration, f"{m.acceleration:.1f} rad/s^2 RMS"),
        ]  # fmt: skip
        return [(name, text) for name, value, text in rows if not np.isnan(value)]


def motion_figures(run: Run) -> MotionFigures:
    """The figures of a run that `kinemode.retarget` made; raises InputError for another."""
    if not run.header.retargeted:
        raise InputError(run.file, "was tracked, not made from another motion", remedy="kinemode retarget makes one")
    source, contacts = source_of(run)
    floor = 0.0 if run.header.floor is not None else None
    metrics = RetargetMeter(run.body).metrics(
        run.q, run.time, source=source, contacts=contacts if floor is not None else None, floor=floor,
        scale=1.0,
    )  # fmt: skip
    return MotionFigures(metrics, float(np.mean(run.status == "hard")))


def write_figures(figures: MotionFigures, path: Path) -> Path:
    """Write a csv of two columns, every figure by its name in `RetargetMetrics`; returns its path."""
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["figure", "value"])
        rows.writerow(["hard", f"{figures.hard:.6g}"])
        rows.writerows([name, "" if np.isnan(v) else f"{v:.6g}"] for name, v in figures.metrics._asdict().items())
    return path


_LIBRARIES = ("pin", "coal", "proxsuite", "numpy", "opencv-python-headless", "numba")
_SAME = 1e-9  # of a length


_IN_HEADER = frozenset({"clips", "mask", "background", "depth", "points"})  # files that a run names by itself
_BLANKS = "Words in capitals stand for values made by a program, without a known file."
_NO_REQUEST = "The run was made by an earlier version, which did not store its request."


def facts_of(run: Run) -> Facts:
    """All of it; digests are of the files as they are now."""
    header = run.header
    if header.retargeted:
        return _facts_of_motion(run)
    contradictions = findings(run)
    assumed = [note for note in header.notes if note not in contradictions]
    lengths = fitted_lengths(run)
    if lengths:
        assumed.append(f"the lengths of {header.subject_source} were fitted to this person, see below")
    elif header.subject_source in BUILT_IN:
        assumed.append(f"the person has the lengths of {header.subject_source}, an average adult")
    else:
        assumed.append(f"the subject has the size in its file: {header.subject_source}")
    keypoints = sampled_residuals(run, run_settings(run).cost)
    return Facts(
        findings=contradictions,
        assumed=assumed,
        lengths=lengths,
        command=command_of(run),
        blanks=_blanks(run),
        errors=camera_errors(keypoints) if keypoints is not None and len(header.cameras) > 1 else {},
        keypoints=keypoints,
        settings=changed_settings(run),
        markers=marker_residuals(run, run_settings(run).cost.markers),
        files=[(what, str(path), digest(path)) for what, path in _files(run)],
        versions=_versions(run),
    )


def _facts_of_motion(run: Run) -> Facts:
    """Content for a run made from another motion: its figures instead of cameras, markers and trackers."""
    assumed = [*run.header.notes, f"the subject is as large as {run.header.subject_source} has it"]
    return Facts(
        assumed=assumed,
        command=command_of(run),
        blanks=_blanks(run),
        motion=motion_figures(run).rows(),
        settings=changed_settings(run),
        files=[(what, str(path), digest(path)) for what, path in _files(run)],
        versions=_versions(run),
    )


def fitted_lengths(run: Run) -> list[tuple[str, float]]:
    """Scales of the proportions of a built-in subject, by joint; none where all are one, or for another subject."""
    if run.header.subject_source not in BUILT_IN:
        return []
    whole, own = load_subject(run.header.subject_source), run.subject
    scales = []
    for proportion in whole.proportions:
        lengths = [
            np.linalg.norm(s.model.jointPlacements[s.model.getJointId(proportion.joint)].translation)
            for s in (own, whole)
            if s.model.existJointName(proportion.joint)
        ]
        if len(lengths) == 2:
            scales.append((proportion.joint, float(lengths[0] / lengths[1])))
    return scales if any(abs(scale - 1.0) > _SAME for _, scale in scales) else []


def changed_settings(run: Run) -> list[tuple[str, str, str]]:
    """Settings that differ from the tracker's own: name, value here, value by default; which cues are used is the
    command's matter."""
    if run.header.retargeted:
        stored, usual = run.header.settings, asdict(RetargetSettings())
        return [(n, str(stored[n]), str(usual[n])) for n in usual if n in stored and stored[n] != usual[n]]
    changed = changed_values(run.header.tracker, run_settings(run))
    return [(name, str(here), str(usual)) for name, here, usual in changed if not name.startswith("cues.use_")]


def command_of(run: Run) -> str:
    """The command that makes the run again, empty where the run does not have it. Its arguments come first, for an
    option may take several values."""
    request = run.header.request
    if request is None:
        return ""
    kind = RetargetRequest if run.header.retargeted else TrackRequest
    arguments = [word for name in ("clips", "source") for word in request.get(name, ())]
    options = {name: words for name, words in request.items() if name not in ("clips", "source")}
    if kind is TrackRequest and options.get("subject") == (USUAL_SUBJECT,):
        del options["subject"]
    options.setdefault("out", (run.file.name,))
    words = [word for name, given in options.items() for word in _option(name, given)]
    return shlex.join(["kinemode", "retarget" if run.header.retargeted else "track", *arguments, *words])


def _blanks(run: Run) -> str:
    """The blanks of the command."""
    request = run.header.request
    if request is None:
        return _NO_REQUEST
    options = options_of(RetargetRequest if run.header.retargeted else TrackRequest).values()
    unknown = [o for o in options if any(w.rpartition("=")[2] == o.placeholder for w in request.get(o.flag, ()))]
    return _BLANKS if unknown else ""


def _option(name: str, words: Sequence[str]) -> list[str]:
    """An option with its values; one that starts with a minus would be read as an option."""
    if len(words) == 1 and words[0].startswith("-"):
        return [f"--{name}={words[0]}"]
    return [f"--{name}", *words]


def _files(run: Run) -> Iterator[tuple[str, Path]]:
    """Every file that the run depends on, with what it is."""
    header = run.header
    yield "run", run.file
    for what, named in (
        ("clip", header.clips), ("mask", header.masks), ("background", header.backgrounds), ("depth", header.depths),
    ):  # fmt: skip
        for camera, path in named.items():
            if path is not None:
                yield f"{what} of {camera}", Path(path)
    yield from (("points", Path(path)) for path in header.points)
    if header.subject_source not in BUILT_IN and not header.subject_source.startswith(PREFIX):
        yield "subject", Path(header.subject_source)
    for option in options_of(RetargetRequest if header.retargeted else TrackRequest).values():
        for word in (header.request or {}).get(option.flag, ()) if option.name not in _IN_HEADER else ():
            name, separator, path = word.rpartition("=")
            if (option.files or option.is_read) and Path(path).is_file():
                yield f"{option.flag} of {name}" if separator else option.flag, Path(path)


def digest(path: Path) -> str:
    """The SHA-256 of a file's bytes, or why there is none."""
    if path.is_dir():
        return "a folder"
    try:
        with path.open("rb") as file:
            return content_digest(file)
    except OSError:
        return "not there any more"


def _versions(run: Run) -> list[tuple[str, str]]:
    from kinemode import __version__

    worked = "kinemode that made the motion" if run.header.retargeted else "kinemode that tracked"
    own = [(worked, run.header.version), ("kinemode that reports", __version__)]
    versions = [*own, ("Python", platform.python_version())]
    for name in _LIBRARIES:
        try:
            versions.append((name, metadata.version(name)))
        except metadata.PackageNotFoundError:
            continue
    return versions
