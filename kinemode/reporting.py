"""What a report says beside the motion: what was assumed, and all that repeats the run."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

import numpy as np

from estimator.retargeting.problem import RetargetSettings
from estimator.runs.diagnosis import camera_errors, sampled_residuals
from estimator.runs.marker_residuals import marker_residuals
from estimator.runs.run_file import Run
from estimator.tracking.unused_settings import changed_values
from humanoid.subject.example_robots import PREFIX
from humanoid.subject.subject import BUILT_IN, load_subject
from humanoid.support.files import content_digest
from kinemode.explain import run_settings
from kinemode.findings import findings
from kinemode.inputs.declared import ALL, AUTO
from kinemode.inputs.named import words_of
from kinemode.motion_figures import motion_figures
from viz.report.facts import Facts

_LIBRARIES = ("pin", "coal", "proxsuite", "numpy", "opencv-python-headless", "numba")
_SAME = 1e-9  # of a length
_GUESSED = "no camera given"  # as the note of `kinemode.inputs.load` begins
_ONE_OF_ALL = f"{ALL}: "  # before the name of one of all people, in what a run keeps


_BLANKS = (
    "The run does not keep the names of keypoint and camera files, which belong where capitals stand. Where"
    " SETTINGS.toml is named it has the settings that differ."
)
_OLD_BLANKS = " Nor does it keep options of time, axes and units (--start, --end, --fps, --offset, --up, --unit)."
_OLD_MOTION_BLANKS = (
    "The run does not keep what was given beside the source: --fps, --up, --unit, --contacts and --modes."
)


def facts_of(run: Run) -> Facts:
    """All of it; digests are of the files as they are now."""
    header = run.header
    if header.retargeted:
        return _facts_of_motion(run)
    told = findings(run)
    assumed = [note for note in header.notes if note not in told]
    lengths = fitted_lengths(run)
    if lengths:
        assumed.append(f"the lengths of {header.subject_source} were fitted to this person, see below")
    elif header.subject_source in BUILT_IN:
        assumed.append(f"the person has the lengths of {header.subject_source}, an average adult")
    else:
        assumed.append(f"the subject is as large as its file says: {header.subject_source}")
    keypoints = sampled_residuals(run, run_settings(run).cost)
    return Facts(
        findings=told,
        assumed=assumed,
        lengths=lengths,
        command=_command(run),
        blanks=_BLANKS + (_OLD_BLANKS if header.given is None else ""),
        errors=camera_errors(keypoints) if keypoints is not None and len(header.cameras) > 1 else {},
        keypoints=keypoints,
        settings=changed_settings(run),
        markers=marker_residuals(run, run_settings(run).cost.markers),
        files=[(what, str(path), digest(path)) for what, path in _files(run)],
        versions=_versions(run),
    )


def _facts_of_motion(run: Run) -> Facts:
    """Of a run that was made from another motion: nothing of cameras, markers and trackers, but its figures."""
    assumed = [*run.header.notes, f"the subject is as large as {run.header.subject_source} has it"]
    return Facts(
        assumed=assumed,
        command=_command(run),
        blanks=_OLD_MOTION_BLANKS if run.header.given is None else "",
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
    """Settings that differ from the tracker's own: name, value here, value by default; which cues are looked at is the
    command's matter."""
    if run.header.retargeted:
        stored, usual = run.header.settings, asdict(RetargetSettings())
        return [(n, str(stored[n]), str(usual[n])) for n in usual if n in stored and stored[n] != usual[n]]
    changed = changed_values(run.header.tracker, run_settings(run))
    return [(name, str(here), str(usual)) for name, here, usual in changed if not name.startswith("cues.use_")]


def _command(run: Run) -> str:
    """The command that makes the run again, as far as the run knows it."""
    header = run.header
    if header.retargeted:
        words = ["retarget", *header.points, "--subject", header.subject_source, "--seed", str(header.seed)]
        changed = {name: here for name, here, _ in changed_settings(run)}
        words += ["--match", str(header.settings["match"])] if header.settings.get("match") else []
        words += ["--method", "frames"] if changed.get("rounds") == "0" else []
        words += [w for name in ("velocity", "clearance") if name in changed for w in (f"--{name}", changed[name])]
        return shlex.join(["kinemode", *words, *_given_words(run), "--out", run.file.name])
    words = ["track"]
    words += [f"{name}={clip}" for name, clip in header.clips.items() if clip is not None]
    words += ["--subject", header.subject_source, "--tracker", header.tracker, "--seed", str(header.seed)]
    if len(run.confidence) and (run.confidence > 0.0).any():
        words += ["--keypoints", *(f"{c.name}=KEYPOINTS_{c.name}" for c in header.cameras)]
    words += ["--points", *header.points] if header.points else []
    words += (
        [] if header.points or any(note.startswith(_GUESSED) for note in header.notes) else ["--cameras", "CAMERAS"]
    )
    for option, named in (("--mask", header.masks), ("--background", header.backgrounds), ("--depth", header.depths)):
        words += [option, *(f"{n}={path}" for n, path in named.items())] if named else []
    words += ["--stereo", *(f"{left}={right}" for left, right in header.stereo.items())] if header.stereo else []
    words += [] if header.points else ["--cues", ",".join(header.cues) or "off"]
    words += [] if header.settings.get("fit", "auto") == "auto" else ["--fit", str(header.settings["fit"])]
    person, out = _person_words(run)
    words += [*person, *_given_words(run)]
    words += ["--settings", "SETTINGS.toml"] if changed_settings(run) else []
    return shlex.join(["kinemode", *words, "--out", out])


def _person_words(run: Run) -> tuple[list[str], str]:
    """Whom the run is of, as options, and the name of the file that then was asked for: of one of all people in the
    clip the run's own has a number in it."""
    person, out = run.header.settings.get("person", AUTO), run.file.name
    if isinstance(person, str) and person.startswith(_ONE_OF_ALL):
        number = f".{person.removeprefix(_ONE_OF_ALL)}"
        return ["--person", ALL], out.replace(number, "", 1) if number in out else out
    words = words_of(person)
    return ([] if words == (AUTO,) else ["--person", *words]), out


def _given_words(run: Run) -> list[str]:
    """What was said of the files; of runs made before that was kept the height and the floor, which decide."""
    header = run.header
    given = header.given
    if given is None:
        height, floor = header.settings.get("height"), None if header.retargeted else header.floor
        known = (("height", height), ("floor", floor))
        given = {name: (str(value),) for name, value in known if value is not None}
    return [word for name, words in given.items() for word in _option(name, words)]


def _option(name: str, words: Sequence[str]) -> list[str]:
    """An option with its words; one that begins with a minus would be taken for an option by itself."""
    if len(words) == 1 and words[0].startswith("-"):
        return [f"--{name}={words[0]}"]
    return [f"--{name}", *words]


def _files(run: Run) -> Iterator[tuple[str, Path]]:
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
