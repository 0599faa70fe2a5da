"""The output of the commands: summaries and tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from estimator.fitting.fit import Fit, ShapeFit
from estimator.numerics.stretches import stretches
from estimator.runs.contact import Contact
from estimator.runs.coordinate_errors import JointScore
from estimator.runs.evaluation import LIMB_JOINTS, Evaluation
from estimator.runs.events import SIDES, Event
from estimator.runs.forces import Forces
from estimator.runs.gait import METHODS, Gait
from estimator.runs.keypoint_residuals import KeypointResiduals
from estimator.runs.pairs import CENTRED
from estimator.runs.run_reader import Run
from estimator.tracking.registry import TRACKERS
from estimator.vision.cues.settings import CUES
from humanoid.subject.subject import subject_names
from kinemode.explain import Explanation
from kinemode.findings import findings, status_counts, status_lines
from kinemode.terminal.program import command

if TYPE_CHECKING:
    from estimator.data.boards.calibrate import BoardCalibration
    from estimator.data.rigs.calibrate import PersonCalibration
    from estimator.data.rigs.check import RigCheck


_FEW = 16  # numbers that are printed of a tracker's diagnostics


def console() -> Console:
    """Where tables go; plain and unwrapped when it is not a terminal."""
    plain = Console(highlight=False, markup=False)
    return plain if plain.is_terminal else Console(highlight=False, markup=False, width=160)


def table(title: str, *columns: str) -> Table:
    """An empty table; every column but the first holds numbers."""
    made = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left")
    for i, column in enumerate(columns):
        made.add_column(column, justify="left" if i == 0 else "right")
    return made


def print_run(run: Run) -> None:
    """Summary of a run, and what to do with it next."""
    statuses = run.status.tolist()
    seconds = float(run.time[-1] - run.time[0]) if len(run) else 0.0
    limits = int(run.body.bounded_q.size)
    deepest = _largest(run.mode_penetration)
    lines = [
        f"{len(run)} of {run.planned_count} frames ({seconds:.2f} s): {status_counts(statuses)}",
        *(f"  {line}" for line in status_lines(statuses)),
        f"subject {run.subject.name}: {run.body.nv} degrees of freedom, {limits} with limits;"
        f" up to {run.hypothesis_count} hypotheses a frame",
        f"deepest interpenetration {1000.0 * deepest:.1f} mm",
        *(f"check: {sentence}" for sentence in findings(run)),
        f"run file: {run.file}",
        "",
        "next:",
    ]
    video, values = (run.file.with_suffix(suffix) for suffix in (".mp4", ".csv"))
    lines += [
        f"  {command('view', run.file)}",
        f"  {command('overlay', run.file, '--out', video)}",
        f"  {command('export', run.file, '--format', 'csv', values)}",
    ]
    for line in lines:
        console().print(line, soft_wrap=True)


def _largest(values: np.ndarray) -> float:
    return float(np.nanmax(values)) if np.isfinite(values).any() else 0.0


def print_evaluation(result: Evaluation) -> None:
    """The compared landmarks and joints, and the errors: of landmarks in millimetres, of joints in degrees or
    millimetres."""
    out = console()
    if result.joints:
        _print_landmark_errors(result, out)
    if result.joint_scores:
        _print_coordinate_errors(result, out)
    out.print(f"frames compared: {result.frames_compared}, without a counterpart: {result.frames_missing}")
    out.print(f"frames beyond a joint limit: {result.violations}")
    out.print(f"largest interpenetration: {millimetres(result.penetration)} mm")


def _print_landmark_errors(result: Evaluation, out: Console) -> None:
    limbs = set(result.joints) <= set(LIMB_JOINTS)
    what = f"{len(result.joints)} {'limb joints' if limbs else 'shared landmarks'}"
    made = table(f"errors of {what} [mm]", "measure", "best hypothesis", "best of K")
    made.add_row(f"MPJPE ({result.aligned})", millimetres(result.mpjpe), millimetres(result.best_of_k_mpjpe))
    made.add_row("PA-MPJPE", millimetres(result.pa_mpjpe), millimetres(result.best_of_k_pa_mpjpe))
    joints = table(f"mean error of each, {result.aligned} [mm]", "joint" if limbs else "landmark", "error")
    for name, error in result.per_joint.items():
        joints.add_row(name.replace("_", " ") if limbs else name, millimetres(error))
    out.print(made)
    out.print(joints)
    out.print("best hypothesis: the final trajectory, smoothed where the tracker smooths", soft_wrap=True)
    out.print("best of K: the nearest of each frame's K hypotheses, as they were tracked", soft_wrap=True)
    if result.aligned == CENTRED:
        out.print("centred: the mean of the landmarks is moved to the origin, without hips to align", soft_wrap=True)


def _print_coordinate_errors(result: Evaluation, out: Console) -> None:
    own = ("without bias", "RMSE without bias")
    made = table("errors of each joint, best hypothesis", "joint", "mean absolute", "RMSE", "bias", *own, "frames")
    groups = {f"mean of {group}": score for group, score in result.group_scores.items()}
    for name, score in {**result.joint_scores, **groups}.items():
        if name in groups and name == next(iter(groups)):
            made.add_section()
        sizes = (_error(score, score.mean_absolute), _error(score, score.rms))
        rest = (_error(score, score.mean_absolute_without_bias), _error(score, score.rms_without_bias))
        made.add_row(name, *sizes, _error(score, score.bias, sign="+"), *rest, str(score.frames))
    out.print(made)
    out.print("bias: the mean of run less reference; two definitions of a joint's zero differ by it", soft_wrap=True)
    if "mean of legs" in groups:
        out.print("legs: flexion of hips, knees and ankles, both sides", soft_wrap=True)


def _error(score: JointScore, value: float, sign: str = "") -> str:
    """An error in the joint's unit: degrees, or millimetres where it slides."""
    if not np.isfinite(value):
        return "-"
    return f"{value:{sign}.2f} deg" if score.unit == "deg" else f"{1e3 * value:{sign}.1f} mm"


def print_contact(contact: Contact) -> None:
    """The floor, when feet start and stop standing, and how far they slide."""
    out = console()
    if contact.remark:
        out.print(contact.remark, soft_wrap=True)
    floor = contact.floor
    if floor is None:
        out.print("no floor: it is off, or nothing stands long enough to find one", soft_wrap=True)
    else:
        tilt = np.degrees(np.arccos(np.clip(floor.normal[2], -1.0, 1.0)))
        out.print(f"floor at z = {floor.height:.3f} +- {floor.std:.3f} m, {tilt:.1f} degrees off level", soft_wrap=True)
        below = max(0.0, -float(np.nanmin(contact.heights)))
        out.print(f"the lowest point is {1e3 * below:.0f} mm below it", soft_wrap=True)
    if contact.belt is not None:
        if not contact.belt.known:
            return
        out.print(f"treadmill: the feet stand on a belt that moves at {contact.belt.described}", soft_wrap=True)
    made = table("while they stand", "point", "of the time", "stances", "slide [mm], median", "largest")
    stances = contact.stances
    for k, name in enumerate(contact.names):
        slides = [1e3 * s.slide for s in stances if s.point == name]
        sizes = (f"{np.median(slides):.0f}", f"{max(slides):.0f}") if slides else ("-", "-")
        made.add_row(name, f"{np.mean(contact.standing[:, k] > 0.5):.0%}", str(len(slides)), *sizes)
    out.print(made)
    for name in contact.hand_names:
        spans = ", ".join(f"{s.begin:.2f} to {s.end:.2f}" for s in contact.hand_stances if s.point == name)
        out.print(f"{name.replace('_', ' ')} stands [s]: {spans or 'never'}", soft_wrap=True)
    _print_events(contact.events, (("strike", "foot starts to stand"), ("off", "foot stops standing")), out)


def _print_events(events: Sequence[Event], kinds: Sequence[tuple[str, str]], out: Console) -> None:
    for kind, words in kinds:
        for side in SIDES:
            times = [f"{e.time:.2f}" for e in events if (e.kind, e.side) == (kind, side)]
            out.print(f"{side} {words} [s]: {', '.join(times) or 'none'}", soft_wrap=True)


def print_gait(gait: Gait) -> None:
    """The strides and their events, and why there are none."""
    out = console()
    if gait.strides:
        made = table("strides, from a strike of the foot to its next", *_STRIDE_COLUMNS)
        for s in gait.strides:
            row = (s.start, s.off, s.end, s.seconds, s.length, s.width, s.speed)
            rest = (f"{s.cadence:.0f}", f"{s.stance:.0f}", f"{s.swing:.0f}", f"{s.flight:.0f}", str(s.unsure))
            made.add_row(s.side, *(f"{value:.2f}" if np.isfinite(value) else "-" for value in row), *rest)
        out.print(made)
    if gait.events:
        _print_events(gait.events, (("strike", "heel strikes"), ("off", "toe-offs")), out)
        out.print(f"events by {METHODS[gait.method]}", soft_wrap=True)
    if gait.belt is not None and np.isfinite(gait.belt):
        out.print(f"treadmill: lengths and speeds are along a belt that moves at {gait.belt:.2f} m/s", soft_wrap=True)
    if gait.remark:
        out.print(gait.remark, soft_wrap=True)


def print_forces(forces: Forces) -> None:
    """What each foot carries, and the largest moments."""
    out, weight = console(), forces.weight
    out.print(f"mass {forces.mass.kilograms:.1f} +- {forces.mass.std:.1f} kg, {forces.mass.source}", soft_wrap=True)
    if forces.feet:
        made = table("forces on the feet, % of the weight", "foot", "mean", "largest", "90 %", "at [s]")
        halves = forces.half_width("force")
        for k, foot in enumerate(forces.feet):
            upwards = forces.force[:, k, 2]
            t = int(np.nanargmax(upwards))
            parts = (np.nanmean(upwards), upwards[t], halves[t, k, 2])
            mean, most, half = (f"{100.0 * value / weight:.0f}" for value in parts)
            made.add_row(foot, mean, most, f"+- {half}", f"{forces.time[t]:.2f}")
        out.print(made)
        seat = np.nan_to_num(forces.seat[:, 2])
        if (carries := seat > _SEATED * weight).any():
            spans = ", ".join(f"{forces.time[a]:.2f} to {forces.time[b - 1]:.2f}" for a, b in stretches(carries))
            out.print(f"something else than the feet carries at the hips [s]: {spans}", soft_wrap=True)
        for h, hand in enumerate(forces.hand_names):
            most = np.nanmax(forces.hands[:, h, 2], initial=0.0) / weight
            if most > _SEATED:
                out.print(f"{hand.replace('_', ' ')} carries up to {100.0 * most:.0f} % of the weight", soft_wrap=True)
        lacking = 100.0 * np.sqrt(np.nanmean(np.square(forces.residual[:, :3]).sum(axis=1))) / weight
        out.print(f"the root's balance lacks {lacking:.1f} % of the weight (root mean square)", soft_wrap=True)
    made = table("moments of the joints per kilogram", "joint", "least", "largest", "unit")
    least, most = (edge(forces.moment, axis=0) / forces.mass.kilograms for edge in (np.nanmin, np.nanmax))
    for j in np.argsort(-np.maximum(-least, most), kind="stable")[:_LARGEST]:
        made.add_row(forces.names[j], f"{least[j]:.2f}", f"{most[j]:.2f}", f"{forces.units[j]}/kg")
    out.print(made)


_SEATED, _LARGEST = 0.05, 10
_STRIDE_COLUMNS = (
    "foot", "strike [s]", "off [s]", "strike [s]", "time [s]", "length [m]", "width [m]", "speed [m/s]", "steps/min",
    "stance [%]", "swing [%]", "flight [%]", "unsure frames",
)  # fmt: skip


def print_statuses(statuses: Sequence[str]) -> None:
    """The number of frames of each status, and advice where needed."""
    console().print(f"frames: {status_counts(statuses)}")
    print_lines(status_lines(statuses))


def print_lines(lines: Sequence[str]) -> None:
    """Sentences, a line each."""
    for line in lines:
        console().print(line, soft_wrap=True)


def print_notes(notes: Sequence[str]) -> None:
    """Notes on a run's input: with a guessed camera, for example, only errors after a similarity mean anything."""
    for note in notes:
        console().print(f"note: {note}")


def print_explanation(explanation: Explanation) -> None:
    """A frame's energy in its parts, and their sum beside the stored one."""
    e = explanation
    title = f"energy of frame {e.frame}, hypothesis {e.hypothesis} ({e.weight:.0%} of the weight; {e.status})"
    made = table(title, "term", "energy", "share", "features", "mean distance [sd]")
    total = e.total
    for part in e.parts:
        made.add_row(
            f"{part.camera}: {part.name}".removeprefix(": "),
            f"{part.energy:.3f}",
            f"{part.energy / total:.1%}" if total else "-",
            "" if part.count is None else str(part.count),
            f"{part.distance:.2f}" if np.isfinite(part.distance) else "",
        )
    if e.parts:
        made.add_section()
        made.add_row("sum", f"{total:.3f}")
    made.add_row("as the run has it", f"{e.stored:.3f}")
    out = console()
    out.print(made)
    if e.origin is not None:
        parent = f"; continues hypothesis {e.parent} of the frame before" if e.parent >= 0 else ""
        out.print(f"searched as: {e.origin.family}{parent}")
        if e.origin.penalty > 0.0:
            out.print(f"constant penalty of the jump, part of the weight but not of the energy: {e.origin.penalty:g}")
            out.print("the transition counts from the pose that it jumped to")
    for name, values in e.extra.items():
        if values.size <= _FEW:
            out.print(f"{name.replace('_', ' ')}: {np.array2string(values, precision=4, separator=', ')}")
    print_notes(e.notes)
    if e.keypoints is not None:
        _print_keypoints(e.keypoints)


def _print_keypoints(residuals: KeypointResiduals) -> None:
    """Distances of one frame's keypoints from their places on the body, the largest in deviations first."""
    places = residuals.places
    made = table(
        "keypoints, from the body along the trajectory",
        "name",
        *(f"{name} [px]" for name in residuals.cameras),
        "mm",
        "sd",
        "off the landmark [mm]",
    )
    worst = np.nan_to_num(residuals.deviations[0], nan=-1.0).max(axis=0)
    for k in np.argsort(-worst, kind="stable").tolist():
        if worst[k] >= 0.0:
            pixels = (f"{value:.1f}" if np.isfinite(value) else "" for value in residuals.pixels[0, :, k])
            metres = float(np.nanmax(residuals.at_person[0, :, k]))
            std = f" +- {1e3 * places.std[k]:.0f}" if np.isfinite(places.std[k]) else ""
            place = f"{1e3 * places.apart[k]:.0f}{std}"
            made.add_row(places.names[k], *pixels, f"{1e3 * metres:.0f}", f"{worst[k]:.1f}", place)
    console().print(made)


def print_subjects() -> None:
    """The subjects that have a name."""
    made = table("subjects by name; any other URDF by its path", "name", "degrees of freedom")
    made.add_column("about")
    for subject in subject_names():
        made.add_row(subject.name, str(subject.dof), subject.about)
    console().print(made)


def print_trackers() -> None:
    """The trackers by name."""
    made = table("trackers by name", "name")
    made.add_column("about")
    for name, spec in TRACKERS.items():
        made.add_row(name, spec.sentence)
    console().print(made)


def print_cues() -> None:
    """The cues by name."""
    made = table("cues by name", "name")
    made.add_column("about")
    for name, cue in CUES.items():
        made.add_row(name, cue.summary)
    console().print(made)


def print_fit(fitted: Fit, out: object) -> None:
    """Fitted proportions and flesh relative to the given subject."""
    made = table("proportions relative to the given subject", "joint", "scale", "std")
    for name, scale, std in zip(fitted.names, fitted.scales, fitted.std, strict=True):
        made.add_row(name, f"{scale:.3f}", f"{std:.3f}")
    console().print(made)
    if fitted.shape is not None:
        _print_shape(fitted.shape)
    else:
        console().print("flesh as given: it is fitted where edges or silhouettes show it")
    used = len(fitted.frames)
    console().print(f"fitted on {used} frame{'s' * (used != 1)}; subject written to {out}", soft_wrap=True)


def _print_shape(shape: ShapeFit) -> None:
    columns = "half-axis a", "half-axis b", "std", "taper of a", "taper of b", "std"
    made = table("cross-sections relative to the given subject (tapers: change)", "part", *columns)
    for part, (a, b), tapers, (girth, _, *of_tapers) in zip(
        shape.parts, shape.factors, shape.tapers, shape.std, strict=True
    ):
        free = np.max(of_tapers) > 0.0
        changes = [f"{t:+.3f}" for t in tapers] if free else ["", ""]
        spread = f"{np.max(of_tapers):.3f}" if free else ""
        made.add_row(part.replace("_", " "), f"{a:.3f}", f"{b:.3f}", f"{girth:.3f}", *changes, spread)
    console().print(made)
    frames = ("frame " if len(shape.frames) == 1 else "frames ") + ", ".join(map(str, shape.frames))
    before, after = shape.agreement
    overlap = "" if np.isnan(after) else f"; outline on the silhouettes {before:.0%} before, {after:.0%} after"
    console().print(f"cross-sections from the pictures of {frames}{overlap}", soft_wrap=True)


def millimetres(metres: float) -> str:
    """A length in millimetres, a dash where it is unknown."""
    return "-" if not np.isfinite(metres) else f"{1000.0 * metres:.1f}"


_MOST_VIEWS = 10  # of a camera that are listed


def print_rig(rig: PersonCalibration, out: Path, picture: Path | None) -> None:
    """Places of cameras found from a person, their uncertainty, and the written files."""
    columns = ["camera", "start [s]", "focal length [px]", "turn +- [deg]", "place +- [cm]", "error [px]"]
    made = table("cameras from the person", *columns)
    for name, camera in rig.cameras.items():
        began = f"{rig.offsets[name]:.3f} +- {rig.offset_stds[name]:.3f}"
        focal = f"{camera.K[0, 0]:.0f} +- {rig.focal_stds[name]:.0%}"
        turn, place = f"{rig.turn_stds[name]:.1f}", f"{100.0 * rig.shift_stds[name]:.0f}"
        made.add_row(name, began, focal, turn, place, f"{rig.errors[name]:.1f}")
    console().print(made)
    print_lines([f"note: {note}" for note in rig.notes])
    late = " ".join(f"{name}={offset:.4f}" for name, offset in rig.offsets.items() if offset)
    offsets = f" --offset {late}" if late else ""
    print_lines([*_written(out, picture), f"to track with them: --cameras {out}{offsets}"])


def print_check(check: RigCheck, cameras: Path) -> None:
    """Errors of a person's keypoints, the differences of the cameras placed by the person, and the verdict."""
    made = table(f"{cameras.name} by a person", "camera", "error [px]", "turn [deg]", "place [cm]")
    for name, camera in check.cameras.items():
        turn = f"{camera.turn:.1f} +- {camera.turn_std:.1f}"
        made.add_row(name, f"{camera.error:.1f}", turn, f"{100.0 * camera.shift:.0f} +- {100.0 * camera.shift_std:.0f}")
    console().print(made)
    print_lines([f"note: {note}" for note in check.notes])
    better = f"rays meet {check.gain:.2f} times as well where the cameras may stand otherwise"
    if check.agrees:
        print_lines([f"the cameras hold: {better}"])
    else:
        which = " or ".join(check.moved)
        print_lines([f"{which} does not stand where {cameras} has it: {better}; calibrate again, or check the clocks"])


def print_calibration(calibration: BoardCalibration, out: Path, picture: Path | None) -> None:
    """Errors of the cameras and of their views, the worst first, the place of the world, and the written files."""
    several = len(calibration.cameras) > 1
    columns = ["camera", "pictures", "with the board", "focal length [px]", "error [px]"]
    made = table("cameras", *columns, *(["error across cameras [px]"] if several else []))
    for name, camera in calibration.cameras.items():
        views = calibration.of(name)
        across = [f"{calibration.placed_errors[name]:.3f}"] if several else []
        focal = f"{camera.K[0, 0]:.1f}, {camera.K[1, 1]:.1f}"
        error = f"{calibration.lens_errors[name]:.3f}"
        made.add_row(name, str(calibration.looked_at[name]), str(len(views)), focal, error, *across)
    each = table("views, the worst first", "camera", "picture", "corners", "error [px]")
    left_out = 0
    for name in calibration.cameras:
        views = calibration.of(name)
        for view in views[:_MOST_VIEWS]:
            each.add_row(name, view.view.label, str(int(view.view.seen.sum())), f"{view.error:.3f}")
        left_out += len(views[_MOST_VIEWS:])
    console().print(made)
    console().print(each)
    lines = [f"{left_out} views with smaller errors are not listed"] if left_out else []
    if calibration.origin is None:
        lines.append("no placement: the camera stands level at the origin; --origin FRAME takes the board there")
    else:
        lines.append(
            f"world: the board in picture {calibration.origin}, x along its columns, z out of its face: up where it"
            " lies on the floor"
        )
    print_lines([*lines, *_written(out, picture)])
    print_notes(calibration.notes)


def _written(out: Path, picture: Path | None) -> list[str]:
    return [f"cameras written to {out}"] + ([] if picture is None else [f"picture written to {picture}"])
