"""Cameras placed by a moving person: errors of beam4cam's cameras, whose placements are hidden, and of
random rigs around captured people; clocks that are wrong; and time.

Errors are of each camera against the first: its rotation, and its place, after the scale that suits all best, in % of
the first camera's distance to the person. A rig's are those of its worst camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.accuracy.rig_clips import FPS, SECONDS, RigClip, drawn_rig, drawn_standing_rig
from benchmarks.support.common import Data, Json, beam_folder, in_processes, save, tell
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files
from estimator.data.cameras.camera import Camera, guessed_camera
from estimator.data.formats.cameras import load_cameras
from estimator.data.formats.keypoints import KeypointTrack, load_keypoints
from estimator.data.rigs.calibrate import PersonCalibration, calibrate_by_person
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.inputs.lens import PHONES, PHONES_STD
from kinemode.terminal import report

NAMES = ("cam01", "cam02", "cam03", "cam04")
LIMITS = {"K given": (1.5, 4.0), "K guessed": (3.0, 8.0), "random": (2.0, 4.0)}  # degrees; % of the distance
SHIFTS = (0.1, 1.5)  # [s]
FRAME = 1.0 / 60.0  # of beam4cam [s]
RIGS, TRIALS, LONG, LONG_SEED = 40, 10, 60.0, 9  # a seed of two cameras and a person of so many seconds
STANDING_SECONDS, STANDING_LATE = 12.0, 10.0  # of movement; s, starts apart
TARGETS = {
    "beam4cam": "5 of 6 pairs and all four",
    "clocks": "9 of 10",
    "random": "90 %, all others reported",
    "time": 30,
}


@dataclass(frozen=True)
class RigOutcome:
    """A rig as it was placed. turns [deg], places [%]: errors of all cameras but the first. turn_stds [deg], place_stds
    [%]: predicted. clock: the worst camera's error [s]. seconds: processor time. refusal: empty unless it was refused.
    """

    name: str
    seconds: float
    turns: tuple[float, ...] = ()
    places: tuple[float, ...] = ()
    turn_stds: tuple[float, ...] = ()
    place_stds: tuple[float, ...] = ()
    clock: float = np.nan
    sure: bool = False
    refusal: str = ""

    def within(self, limits: tuple[float, float]) -> bool:
        """Whether every camera's rotation [deg] and place [%] are."""
        return not self.refusal and max(self.turns) <= limits[0] and max(self.places) <= limits[1]

    def cells(self, limits: tuple[float, float]) -> list[str]:
        """As a table has it."""
        if self.refusal:
            return [self.name, "-", "-", "-", f"{self.seconds:.1f}", "refused"]
        figures = (f"{max(self.turns):.2f}", f"{max(self.places):.1f}", f"{max(self.turn_stds):.2f}")
        state = ("" if self.within(limits) else "beyond") + ("" if self.sure else " unsure")
        return [self.name, *figures, f"{self.seconds:.1f}", state.strip()]


@dataclass(frozen=True)
class RigTrial:
    """A clip to be calibrated. cameras: the true ones. lenses: as they are given. times: (C) of (T,) [s], by each
    camera's clock. points (T, N, 3) [m]: of the person, NaN where unknown. offsets (C,) [s]: true, of the clocks."""

    name: str
    cameras: Sequence[Camera]
    lenses: Sequence[Camera]
    tracks: Sequence[KeypointTrack]
    times: Sequence[np.ndarray]
    points: np.ndarray
    offsets: np.ndarray
    clocks_known: bool = True

    @classmethod
    def of(cls, clip: RigClip, name: str, *, clocks_known: bool) -> RigTrial:
        """The trial of a clip with known lenses."""
        times = [frame_times(track, FPS) for track in clip.tracks]
        return cls(name, clip.cameras, clip.cameras, clip.tracks, times, clip.points, clip.late, clocks_known)

    def with_guessed_lenses(self) -> RigTrial:
        """The same with the lens that most phones have in every camera."""
        lenses = [guessed_camera(c.name, c.image_size, 1.0, PHONES, PHONES_STD) for c in self.cameras]
        return replace(self, lenses=lenses)

    @property
    def by_camera(self) -> tuple[dict[str, KeypointTrack], dict[str, np.ndarray]]:
        """The keypoints and the times of their frames."""
        names = [camera.name for camera in self.cameras]
        return dict(zip(names, self.tracks, strict=True)), dict(zip(names, self.times, strict=True))

    def calibrated(self, body: Body) -> PersonCalibration:
        """The result of `calibrate_by_person`; raises InputError as that does."""
        tracks, times = self.by_camera
        lenses = dict(zip(tracks, map(hidden, self.lenses), strict=True))
        return calibrate_by_person(body, tracks, lenses, times, clocks_known=self.clocks_known, size=1.0)

    def reported(self) -> RigOutcome:
        """The outcome, with a line of progress."""
        outcome = self.outcome()
        tell(f"{self.name}: {outcome.seconds:.1f} s")
        return outcome

    def outcome(self) -> RigOutcome:
        """The outcome, for a person of the default body's proportions."""
        body, names = Body(load_subject("human34")), [camera.name for camera in self.cameras]
        begin = process_time()
        try:
            rig = self.calibrated(body)
        except InputError as error:
            return RigOutcome(self.name, process_time() - begin, refusal=str(error))
        seconds, others = process_time() - begin, names[1:]
        clock = np.abs(np.array([rig.offsets[name] for name in names]) - self.offsets).max()
        turns, places = self._errors(rig)
        turn_stds = tuple(rig.turn_stds[name] for name in others)
        place_stds = tuple(100.0 * rig.shift_stds[name] / rig.distance for name in others)
        return RigOutcome(self.name, seconds, turns, places, turn_stds, place_stds, float(clock), rig.sure)

    def _errors(self, rig: PersonCalibration) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Errors of rotations [deg] and places [%]."""
        R, centres = seen_from_first([rig.cameras[camera.name] for camera in self.cameras])
        true_R, true_centres = seen_from_first(self.cameras)
        scale = np.sum(centres * true_centres) / np.sum(centres * centres)
        distance = np.nanmedian(np.linalg.norm(self.points - self.cameras[0].centre_world, axis=-1))
        turns = np.degrees(Rotation.from_matrix(R @ np.swapaxes(true_R, 1, 2)).magnitude())
        places = 100.0 * np.linalg.norm(scale * centres - true_centres, axis=1) / distance
        return tuple(turns.tolist()), tuple(places.tolist())


def hidden(camera: Camera) -> Camera:
    """The camera without where it stands."""
    return replace(camera, R_camera_world=np.eye(3), t_camera_world=np.zeros(3))


def seen_from_first(cameras: Sequence[Camera]) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (C - 1, 3, 3) from the first camera to each other, and their centres (C - 1, 3) in the first [m]."""
    first, *others = cameras
    R = np.array([camera.R_camera_world @ first.R_camera_world.T for camera in others])
    return R, np.array([first.R_camera_world @ (c.centre_world - first.centre_world) for c in others])


def frame_times(track: KeypointTrack, rate: float) -> np.ndarray:
    """The times of its frames on its own clock [s]; rate: where the track has none."""
    return np.arange(track.frame_count) / (track.fps or rate)


def of_beam(folder: Path, names: Sequence[str], *, guess: bool = False, shifts: np.ndarray | None = None) -> RigTrial:
    """Some cameras of beam4cam. guess: whether lenses are guessed. shifts (C,) [s]: errors of the given times;
    clocks are known without."""
    known = load_cameras(folder / "calibration.json")
    cameras = [known[name] for name in names]
    tracks = [load_keypoints(folder / "keypoints" / f"{name}.json") for name in names]
    points, off = np.load(folder / "reference3d.npz")["points"], np.zeros(len(names)) if shifts is None else shifts
    times = [frame_times(track, 1.0 / FRAME) + by for track, by in zip(tracks, off, strict=True)]
    trial = RigTrial(" ".join(names), cameras, cameras, tracks, times, points, -off, clocks_known=shifts is None)
    return trial.with_guessed_lenses() if guess else trial


def of_seed(files: Sequence[Path], late: float, seconds: float, seed: int) -> RigOutcome:
    """A random rig's; its clocks are known unless they are `late` [s] at most."""
    clip = drawn_rig(files, seed, seconds=seconds, late=late)
    return RigTrial.of(clip, f"{seed}: {clip.name}", clocks_known=late == 0.0).reported()


def of_standing_seed(files: Sequence[Path], seed: int) -> RigOutcome:
    """A random rig's before somebody who first stands; clocks unknown, lenses guessed."""
    clip = drawn_standing_rig(files, seed, seconds=STANDING_SECONDS, late=STANDING_LATE)
    return RigTrial.of(clip, f"{seed}: {clip.name}", clocks_known=False).with_guessed_lenses().reported()


def beam_rigs(folder: Path) -> dict[str, Any]:
    """The six pairs of beam4cam and all four cameras, with K given and guessed."""
    rows = {}
    for kind in ("K given", "K guessed"):
        rigs = [*combinations(NAMES, 2), NAMES]
        rows[kind] = [of_beam(folder, names, guess=kind == "K guessed").outcome() for names in rigs]
        show(f"beam4cam, {kind}: at most {LIMITS[kind][0]:g} degrees, {LIMITS[kind][1]:g} %", rows[kind], LIMITS[kind])
        pairs = sum(outcome.within(LIMITS[kind]) for outcome in rows[kind][:-1])
        report.print_lines([f"{pairs} of {len(rigs) - 1} pairs; target {TARGETS['beam4cam']}"])
    return {kind: [asdict(outcome) for outcome in of] for kind, of in rows.items()}


def show(title: str, rows: Sequence[RigOutcome], limits: tuple[float, float]) -> None:
    """A table of rigs."""
    table = report.table(title, "rig", "rotation [deg]", "place [%]", "predicted [deg]", "time [s]", "")
    for outcome in rows:
        table.add_row(*outcome.cells(limits))
    report.console().print(table)


def wrong_clocks(folder: Path) -> list[dict[str, Any]]:
    """Two to four cameras of beam4cam whose given times are wrong, except the first one's."""
    rows, counts = [], {"within a frame": 0, "refused": 0, "wrong": 0}
    table = report.table(f"beam4cam, times wrong by {SHIFTS[0]:g} to {SHIFTS[1]:g} s", "cameras", "error [frames]", "")
    for seed in range(TRIALS):
        rng = np.random.default_rng((seed, 41))
        names = sorted(rng.choice(NAMES, int(rng.integers(2, 5)), replace=False).tolist())
        shifts = rng.uniform(*SHIFTS, len(names)) * rng.choice([-1.0, 1.0], len(names))
        shifts[0] = 0.0
        outcome = of_beam(folder, names, shifts=shifts).outcome()
        kind = "refused" if outcome.refusal else "within a frame" if outcome.clock <= FRAME + 1e-6 else "wrong"
        counts[kind] += 1
        table.add_row(outcome.name, "-" if outcome.refusal else f"{outcome.clock / FRAME:.2f}", kind)
        rows.append({**asdict(outcome), "kind": kind, "shifts": shifts})
    report.console().print(table)
    report.print_lines([", ".join(f"{kind}: {n}" for kind, n in counts.items()) + f"; target {TARGETS['clocks']}"])
    return rows


def random_rigs(files: Sequence[Path], seeds: range, late: float, jobs: int) -> list[dict[str, Any]]:
    """Random rigs of these seeds, K given, and whether wrong ones are reported as uncertain."""
    rows = in_processes(partial(of_seed, files, late, SECONDS), seeds, jobs)
    return shown_rigs(f"K given, {f'clocks off by up to {late:g} s' if late else 'clocks known'}", rows, late > 0.0)


def standing_rigs(files: Sequence[Path], seeds: range, jobs: int) -> list[dict[str, Any]]:
    """The same of people who first stand, lenses guessed."""
    rows = in_processes(partial(of_standing_seed, files), seeds, jobs)
    return shown_rigs(f"K guessed, standing first, clocks off by up to {STANDING_LATE:g} s", rows, True)


def shown_rigs(title: str, rows: Sequence[RigOutcome], late: bool) -> list[dict[str, Any]]:
    """Print random rigs, whether wrong ones are reported as uncertain and, where these were off, their clocks."""
    limits, count = LIMITS["random"], len(rows)
    show(f"random rigs, {title}: at most {limits[0]:g} degrees, {limits[1]:g} %", rows, limits)
    others = [outcome for outcome in rows if not outcome.within(limits)]
    unsure = sum(not outcome.sure for outcome in others)
    z = [t / max(std, 1e-3) for outcome in rows for t, std in zip(outcome.turns, outcome.turn_stds, strict=True)]
    of_places = [p / max(s, 1e-3) for outcome in rows for p, s in zip(outcome.places, outcome.place_stds, strict=True)]
    doubts = sum(not outcome.sure and outcome.within(limits) for outcome in rows)
    lines = [
        f"{count - len(others)} of {count} within; of the {len(others)} others {unsure} are reported,"
        f" {sum(bool(outcome.refusal) for outcome in others)} of them refused; target {TARGETS['random']}",
        f"{doubts} of those within are reported as uncertain; RMS rotation error over predicted deviation:"
        f" {np.sqrt(np.mean(np.square(z))) if z else np.nan:.2f}, of places"
        f" {np.sqrt(np.mean(np.square(of_places))) if of_places else np.nan:.2f}",
    ]
    if late:
        off = [outcome.clock * FPS for outcome in rows if not outcome.refusal]
        lines.append(f"clocks within a frame: {sum(o <= 1.0 + 1e-6 for o in off)} of the {len(off)} not refused")
    report.print_lines(lines)
    return [asdict(outcome) for outcome in rows]


def long_clip(files: Sequence[Path]) -> list[dict[str, Any]]:
    """Processor time of two cameras, clocks known and found."""
    of_seed(files, 0.0, 4.0, LONG_SEED)  # loads what is compiled
    rows = [of_seed(files, late, LONG, LONG_SEED) for late in (0.0, SHIFTS[1])]
    rows = [replace(r, name=f"{r.name}, {how}") for r, how in zip(rows, ("clocks known", "clocks found"), strict=True)]
    show(f"a clip of {LONG:g} s: at most {TARGETS['time']} s", rows, LIMITS["random"])
    return [asdict(outcome) for outcome in rows]


def main(
    *,
    beam4cam: bool = False,
    clocks: bool = False,
    count: int = 0,
    late: bool = False,
    standing: bool = False,
    first: int = 0,
    time: bool = False,
    data: Data = None,
    jobs: int = 1,
    json: Json = None,
) -> None:
    """Print errors of cameras that a person places, and their reported uncertainty; beam4cam unless a part is chosen.

    Parameters
    ----------
    beam4cam
        Its six pairs and all four cameras, placements hidden: K given, and K guessed.
    clocks
        Two to four cameras of beam4cam whose given times are wrong, except the first one's: ten trials.
    count
        So many random rigs around captured people, K given; 40 with --late or --standing unless given.
    late
        Of random rigs: their clocks are off by up to 1.5 s, unknown.
    standing
        Of random rigs: people stand first, clocks are off by up to 10 s, unknown, and lenses are guessed.
    first
        Of random rigs: the first seed.
    time
        Processor time of a clip of 60 s of two cameras.
    jobs
        Random rigs at a time, each in a process of its own.
    """
    if count < 0:
        raise InputError("--count", f"is {count}", remedy=f"1 or more, {RIGS} for the target")
    count = count or (RIGS if late or standing else 0)
    chosen = beam4cam or clocks or count > 0 or time
    files = captured_files(data) if count or time else []
    how = {"rigs": count, "trials": TRIALS, "seconds": SECONDS, "long": LONG}
    figures: dict[str, Any] = {"measure": "rigs", "how": how, "limits": LIMITS, "targets": TARGETS}
    if beam4cam or not chosen:
        figures["beam4cam"] = beam_rigs(beam_folder(data))
    if clocks:
        figures["clocks"] = wrong_clocks(beam_folder(data))
    if (count or time) and not files:
        print(NO_CAPTURED_FILES)
    seeds = range(first, first + count)
    if count and files and standing:
        figures["standing"] = standing_rigs(files, seeds, jobs)
    elif count and files:
        figures["late" if late else "random"] = random_rigs(files, seeds, SHIFTS[1] if late else 0.0, jobs)
    if time and files:
        figures["time"] = long_clip(files)
    save(json, figures)
