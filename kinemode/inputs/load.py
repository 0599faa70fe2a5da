"""The user's clips, keypoint files and cameras, matched by name, made into observations."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.floor import OFF, KnownFloor
from estimator.data.formats.keypoints import KeypointTrack, PeopleFile, formats_read, load_people
from estimator.data.media.clip import Clip
from estimator.data.media.depth_folder import DepthFolder
from estimator.data.observation import Observation
from estimator.data.people.across_cameras import subject_tracks
from estimator.data.people.everybody import everybody
from estimator.data.repeats import measured_keypoints
from estimator.data.sequence import assemble
from estimator.data.timing import CameraClock, Timeline, at_places, timeline
from estimator.vision.resolution import Size
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import FORMATS
from humanoid.support.errors import InputError
from kinemode.inputs.cameras import (
    BY_PERSON,
    KnownCameras,
    as_detected,
    check_by_cameras,
    in_one_size,
    lens_note,
    rig_by_person,
    rig_notes,
    with_offsets,
)
from kinemode.inputs.clocks import clocks_of, notes_on_time
from kinemode.inputs.declared import known_floor, noises, part, persons_of, sizes
from kinemode.inputs.doubts import checked_agreement
from kinemode.inputs.lens import before_subject
from kinemode.inputs.synchrony import synchronised_clocks
from kinemode.inputs.upright import turned, upright_turn
from kinemode.named import chosen_names, matched, named_pairs, named_paths
from kinemode.request import AUTO, BACKGROUND, CLIP, DEPTH, KEYPOINTS, MASK, FileOptions
from kinemode.terminal.program import command

if TYPE_CHECKING:
    from estimator.data.rigs.calibrate import PersonCalibration
    from estimator.data.rigs.check import RigCheck
    from kinemode.request import Pairs


@dataclass(frozen=True)
class Inputs:
    """The input to be tracked.

    observations (T). times (T,) [s]. clips (C): of each camera, in the observations' order, None for keypoints alone.
    notes: what the user should know of the input.
    masks, backgrounds (C): of each camera where they are given, see `estimator.vision.cues.reader.CueReader`.
    frames (C): number of each clip's frame at each instant (T,), None where it is the instant's own number.
    rights (C): number of the camera to the right of each that makes a stereo pair with it, or None. depths (C): folder
    of its depth pictures, or None. R_upright_given (3, 3): how the world of the given cameras was turned, so that z
    points up; None where it was not. floor: what is known of it in that world. points: files of points in space, in
    place of cameras. R_upright_points (3, 3): how the axes of the first of them were turned. static: points of a trial
    in which the person stands upright, for the fit alone. layout: of all keypoints, empty where they have several.
    other_layouts: makes the observations as they are if the keypoints are of another layout of as many points, by its
    name. noise (C,): standard deviation of each camera's keypoints [px] as the user gives it, NaN where it is to be
    measured; empty where none is given. has_world: whether a camera file or files of points give the world, of which
    --up names the axis that points up.
    """

    observations: list[Observation]
    times: np.ndarray
    clips: tuple[Path | None, ...]
    notes: tuple[str, ...]
    masks: tuple[Path | None, ...] = ()
    backgrounds: tuple[Path | None, ...] = ()
    frames: tuple[np.ndarray | None, ...] = ()
    rights: tuple[int | None, ...] = ()
    depths: tuple[Path | None, ...] = ()
    R_upright_given: np.ndarray | None = None
    floor: KnownFloor = None
    points: tuple[Path, ...] = ()
    static: tuple[Observation, ...] = ()
    layout: str = ""
    other_layouts: Mapping[str, Callable[[], list[Observation]]] = field(default_factory=dict)
    noise: tuple[float, ...] = ()
    has_world: bool = True
    R_upright_points: np.ndarray | None = None

    @property
    def has_depth(self) -> bool:
        """Whether there is depth of a camera."""
        return any(given is not None for given in (*self.rights, *self.depths))


def load_inputs(body: Body, files: FileOptions, keypoints_needed: Callable[[], bool] = lambda: True) -> Inputs:
    """Read everything a body is tracked from; of the pictures only what there is of them.

    keypoints_needed: called where there are clips and no keypoints.

    Raises InputError: no keypoints, files without a partner, no camera for one of several clips, too few masks, sizes
    or times that contradict each other.
    """
    read = _read(body, files, persons_of(files.person, _names(files)), keypoints_needed)
    if not read.people:
        inputs = _inputs(body, read, read.outlines, ())
    else:
        inputs = _inputs(body, read, *subject_tracks(read.people, read.detectors, read.persons, read.times))
    return _upright(body, read, [inputs])[0]


def load_everybody(body: Body, files: FileOptions) -> tuple[list[Inputs], tuple[str, ...]]:
    """As `load_inputs`, once for each person in the keypoint files, from when the person is first seen to the last; and
    notes on who is left out.

    Raises InputError: as `load_inputs` does; no keypoints; no person who is seen long enough.
    """
    read = _read(body, files, dict.fromkeys(_names(files), AUTO), lambda: True)
    people, notes = everybody(read.people, read.detectors, read.times)
    start, stop = part(read.files)
    inputs = []
    for tracks in people:
        begin, end = _presence(tracks, read.times)
        begin, end = max(begin, -np.inf if start is None else start), min(end, np.inf if stop is None else stop)
        if begin <= end:
            inputs.append(_inputs(body, read, tracks, (), (begin, end)))
    if absent := len(people) - len(inputs):
        notes += (f"{absent} of {len(people)} people are not there between --start and --end",)
    if not inputs:
        raise InputError("--person all", "finds no person between --start and --end", remedy="choose another part")
    return _upright(body, read, inputs), notes


def calibration_by_person(body: Body, files: FileOptions) -> PersonCalibration:
    """Cameras from the person in several clips or keypoint files, as `load_inputs` finds them; its notes are all that
    the user should know.

    Raises InputError: as `load_inputs` does.
    """
    read = _read(body, replace(files, cameras=BY_PERSON), persons_of(files.person, _names(files)), lambda: True)
    assert read.rig is not None  # cameras by the person are found, or refused
    return replace(read.rig, notes=(*read.notes, *read.clock_notes, *read.rig.notes))


def checked_cameras(body: Body, files: FileOptions) -> RigCheck:
    """Whether the person in several clips or keypoint files agrees with the given cameras.

    Raises InputError: as `load_inputs` does; fewer than two cameras; too little that two see at once.
    """
    read = _read(body, files, persons_of(files.person, _names(files)), lambda: True)
    check = check_by_cameras(body, read.people, read.persons, read.detectors, read.times)
    return replace(check, notes=(*read.notes, *read.clock_notes, *check.notes))


def _upright(body: Body, read: _Read, inputs: Sequence[Inputs]) -> list[Inputs]:
    """The same in a world whose z points up, one for all people: by the one seen longest."""
    longest = max(inputs, key=lambda each: len(each.observations)).observations
    R_upright_given, notes = upright_turn(
        body, longest, read.files.up or read.known.up, given=read.known.cameras is not None
    )
    noted = [replace(each, notes=(*each.notes, *notes), floor=_floor(read)) for each in inputs]
    if R_upright_given is None:
        return noted
    return [
        replace(each, observations=turned(each.observations, R_upright_given), R_upright_given=R_upright_given)
        for each in noted
    ]


def _floor(read: _Read) -> KnownFloor:
    """The floor that the user or the camera file gives: a turn about the origin leaves its height along up."""
    given = known_floor(read.files.floor)
    if given is None:
        return read.known.floor
    if given != OFF and read.known.cameras is None:
        raise InputError("--floor", "is of the cameras' world, and none is given", remedy="leave it out, or off")
    return given


def _presence(tracks: Mapping[str, KeypointTrack], times: Mapping[str, np.ndarray]) -> tuple[float, float]:
    """When a person is first and last seen [s]; times: of each camera's frames."""
    seen = {name: np.any(track.confidence[: len(times[name])] > 0.0, axis=1) for name, track in tracks.items()}
    every = np.concatenate([times[name][np.flatnonzero(there)] for name, there in seen.items()])
    return (float(every.min()), float(every.max())) if len(every) else (np.inf, -np.inf)


@dataclass(frozen=True)
class _Read:
    """The content of the files: people is empty, and outlines have no points, where there are no keypoints.

    detectors: the cameras of pictures of the size that the detectors saw. times: of each file's frames, on one clock.
    rig: where the cameras are found from the person.
    """

    files: FileOptions
    known: KnownCameras
    named: frozenset[str]
    clips: Mapping[str, Path]
    masks: Mapping[str, Path]
    backgrounds: Mapping[str, Path]
    depths: Mapping[str, Path]
    pairs: Mapping[str, str]
    people: Mapping[str, PeopleFile]
    persons: Mapping[str, str]
    outlines: Mapping[str, KeypointTrack]
    pictures: Mapping[str, Size]
    detectors: Mapping[str, Camera]
    clocks: Mapping[str, CameraClock]
    notes: tuple[str, ...]
    clock_notes: tuple[str, ...]
    rig: PersonCalibration | None = None

    @property
    def times(self) -> dict[str, np.ndarray]:
        return {name: clock.offset + clock.keypoints for name, clock in self.clocks.items()}


def _names(files: FileOptions) -> list[str]:
    """Names of the cameras with keypoints."""
    clips, keypoints = named_paths(files.clip_files, CLIP), named_paths(files.keypoint_files, KEYPOINTS)
    return list(_of_clips(clips, keypoints, chosen_names(files.keypoint_files, KEYPOINTS))[0]) if keypoints else []


def _read(body: Body, files: FileOptions, persons: Mapping[str, str], keypoints_needed: Callable[[], bool]) -> _Read:
    known = KnownCameras.of(files.cameras, files.lenses)
    clip_files, keypoint_files = named_paths(files.clip_files, CLIP), named_paths(files.keypoint_files, KEYPOINTS)
    if not keypoint_files and (not clip_files or keypoints_needed()):
        raise _no_keypoints(clip_files)
    notes: list[str] = []
    if keypoint_files:
        keypoint_files, notes = _of_clips(clip_files, keypoint_files, chosen_names(files.keypoint_files, KEYPOINTS))
    mask_files, background_files, depth_files = (
        matched(clip_files, named_paths(given, what), what, CLIP, chosen=chosen_names(given, what), every=False)
        for given, what in ((files.mask, MASK), (files.background, BACKGROUND), (files.depth, DEPTH))
    )
    pairs = pairs_of(files.stereo, clip_files)
    people = {name: load_people(path, layout=str(files.layout)) for name, path in keypoint_files.items()}
    named = chosen_names(files.clip_files, CLIP) | chosen_names(files.keypoint_files, KEYPOINTS)
    with ExitStack() as stack:
        opened = {name: stack.enter_context(closing(Clip.open(path))) for name, path in clip_files.items()}
        pictures = {name: clip.image_size for name, clip in opened.items()}
        known = known._replace(
            aspects={name: clip.pixel_aspect for name, clip in opened.items()},
            clips=clip_files,
            focal=files.focal,
            phone=files.phone,
        )
        # sizes, rates and lengths, but no points yet
        outlines = {name: file.track_of({}) for name, file in people.items()}
        outlines = outlines or {name: _without_keypoints(clip) for name, clip in opened.items()}
        _, used, of_lenses, _ = in_one_size(outlines, pictures, known, named, files)
        clocks, clock_notes = clocks_of(outlines, opened, files)
    declared = sizes(files.keypoint_size, people)
    people = {name: file.in_pixels(declared.get(name) or used[name].image_size) for name, file in people.items()}
    detectors = as_detected(outlines, used, files)
    rig = rig_by_person(body, people, persons, detectors, clocks, files) if known.by_person else None
    if rig is not None:
        notes += [] if known.cameras is None else [lens_note(known.source), *of_lenses]
        known = known.placed(rig.cameras)
        detectors, clocks = rig.cameras, with_offsets(clocks, rig)
    elif files.sync == AUTO:
        clocks, of_motion = synchronised_clocks(body.landmark_names, people, detectors, clocks, persons, files)
        clock_notes += of_motion
    return _Read(
        files, known, named, clip_files, mask_files, background_files, depth_files, pairs, people, persons, outlines,
        pictures, detectors, clocks, tuple(notes), tuple(clock_notes), rig,
    )  # fmt: skip


def _inputs(
    body: Body,
    read: _Read,
    chosen: Mapping[str, KeypointTrack],
    choice_notes: tuple[str, ...],
    during: tuple[float | None, float | None] | None = None,
) -> Inputs:
    """The input of one person, whose keypoints were chosen; during [s]: the user's unless given."""
    files, clocks, pairs = read.files, read.clocks, read.pairs
    chosen = {name: measured_keypoints(track, clocks[name].keypoints) for name, track in chosen.items()}
    tracks, used, *size_notes = in_one_size(chosen, read.pictures, read.known, read.named, files)
    line = timeline(clocks).cut(*(part(files) if during is None else during))
    notes = [*read.notes, *([] if read.rig is None else rig_notes(read.rig)), *choice_notes]
    notes += [f"{name}: {note}" for name, track in tracks.items() for note in track.notes]
    notes += [*chain(*size_notes), *read.clock_notes, *notes_on_time(clocks, line)]
    if read.known.cameras is None and not body.has_free_root:
        used, of_place = before_subject(body, tracks, used)
        notes += of_place
    check_together(pairs, clocks, line)
    for name, path in read.masks.items():
        _check_masks(path, int(line.frames[name].max()) + 1)
    for name, path in read.depths.items():
        check_depths(path, used[name].image_size, int(line.frames[name].max()) + 1)
    observations = _observations(body, tracks, used, line, clocks)
    notes += checked_agreement(body, observations, tracks, {n: clock.offset for n, clock in clocks.items()}, files)
    clips, masks, backgrounds, depths = (
        tuple(paths.get(name) for name in tracks) for paths in (read.clips, read.masks, read.backgrounds, read.depths)
    )
    frames = tuple(_unlike_instants(line.frames.get(name)) for name in tracks)
    rights = tuple(list(tracks).index(pairs[name]) if name in pairs else None for name in tracks)
    others = {
        layout: partial(_observations, body, _as_layout(tracks, layout), used, line, clocks)
        for layout in _alternatives(tracks)
    }
    return Inputs(
        observations, line.times, clips, tuple(notes), masks, backgrounds, frames, rights, depths,
        layout=common_layout(tracks), other_layouts=others, noise=_given_noise(files, list(tracks)),
        has_world=read.known.cameras is not None,
    )  # fmt: skip


def _given_noise(files: FileOptions, names: Sequence[str]) -> tuple[float, ...]:
    given = noises(files.keypoint_noise, names)
    return tuple(given.get(name, np.nan) for name in names) if given else ()


def common_layout(tracks: Mapping[str, KeypointTrack]) -> str:
    """The layout of all tracks, empty where they have several."""
    layouts = {track.layout for track in tracks.values()}
    return layouts.pop() if len(layouts) == 1 else ""


def _alternatives(tracks: Mapping[str, KeypointTrack]) -> list[str]:
    """The other layouts that all keypoints could be of, with the same number of points."""
    names = {track.names for track in tracks.values()}
    if len(names) != 1 or (own := next(iter(names))) not in FORMATS.values():
        return []
    return [layout for layout, theirs in FORMATS.items() if len(theirs) == len(own) and theirs != own]


def _as_layout(tracks: Mapping[str, KeypointTrack], layout: str) -> dict[str, KeypointTrack]:
    return {name: replace(track, layout=layout, names=FORMATS[layout]) for name, track in tracks.items()}


def _no_keypoints(clips: Mapping[str, Path]) -> InputError:
    clicks = command("annotate", next(iter(clips.values()), Path("CLIP")))
    by_us = "find them: --detect; " if clips else ""
    remedy = f"{by_us}click them: {clicks}; or give a detector's: {formats_read()}"
    return InputError("keypoints", "are needed, of one frame at least, to find the first pose", remedy=remedy)


def _without_keypoints(clip: Clip) -> KeypointTrack:
    """A track as long as a clip that has no keypoints, nor names of any."""
    count, rate = clip.report.read, clip.report.fps if clip.rate_known else None
    pixels, confidence = np.zeros((count, 0, 2)), np.zeros((count, 0))
    return KeypointTrack("none", (), pixels, confidence, clip.image_size, rate, source=str(clip.path))


def _of_clips(
    clips: Mapping[str, Path], keypoints: dict[str, Path], chosen: frozenset[str]
) -> tuple[dict[str, Path], list[str]]:
    """The keypoint file of each clip, by the clip's name, and a note where a name had to be guessed."""
    if not clips:
        return keypoints, []
    files = matched(clips, keypoints, KEYPOINTS, CLIP, chosen=chosen)
    if set(files) == set(keypoints):
        return files, []
    ((name, path),) = files.items()
    return files, [f"the keypoints {path} are used for the clip {clips[name]}, which has another name"]


def _check_masks(path: Path, count: int) -> None:
    """Masks that end early are found before an hour of work, not after."""
    masks = Clip.open(path)
    read = masks.report.read
    masks.close()
    if read < count:
        raise InputError(path, f"has masks of {read} frames, the clip has {count}")


def _observations(
    body: Body,
    tracks: Mapping[str, KeypointTrack],
    cameras: Mapping[str, Camera],
    line: Timeline,
    clocks: Mapping[str, CameraClock],
) -> list[Observation]:
    """The tracks at the instants of the timeline."""
    placed = {name: at_places(track, line.places[name], clocks[name].keypoints) for name, track in tracks.items()}
    changed = {name: track for name, track in tracks.items() if placed[name] is not track}
    return assemble(body, placed, cameras, line.times, detected=changed)


def _unlike_instants(frames: np.ndarray | None) -> np.ndarray | None:
    return None if frames is None or np.array_equal(frames, np.arange(len(frames))) else frames


OPTION = "--stereo"
_TOGETHER = 0.1  # of a frame, by how much two pictures that were taken together may be apart


def pairs_of(given: Pairs, cameras: Collection[str]) -> dict[str, str]:
    """The camera on the right of each camera on the left: from `LEFT=RIGHT` texts or a mapping.

    Raises
    ------
    InputError: no pair, an unknown camera, a camera paired with itself, a left one in two pairs.
    """
    pairs: dict[str, str] = {}
    for left, right in named_pairs(given):
        if left is None:
            raise InputError(f"{OPTION} {right}", "is not a pair of cameras", remedy="write LEFT=RIGHT")
        place = f"{OPTION} {left}={right}"
        for name in (left, right):
            if name not in cameras:
                remedy = f"cameras with clips: {', '.join(cameras) or 'none'}"
                raise InputError(place, f"there is no camera {name!r}", remedy=remedy)
        if left == right or left in pairs:
            problem = "is one camera twice" if left == right else f"{left} makes a pair with {pairs[left]} too"
            raise InputError(place, problem, remedy="write LEFT=RIGHT")
        pairs[left] = right
    return pairs


def check_together(pairs: Mapping[str, str], clocks: Mapping[str, CameraClock], line: Timeline) -> None:
    """Raise InputError for a pair whose pictures at an instant were not taken together: depth would be wrong."""
    for left, right in pairs.items():
        a, b = (clocks[name].offset + clocks[name].frames[line.frames[name]] for name in (left, right))
        apart, frame = float(np.abs(a - b).max(initial=0.0)), 1.0 / max(clocks[left].rate, clocks[right].rate)
        if apart > _TOGETHER * frame:
            problem = f"their pictures are up to {1e3 * apart:.0f} ms apart"
            remedy = "a pair that is synchronous, or --offset where only the clips' beginnings differ"
            raise InputError(f"{OPTION} {left}={right}", problem, remedy=remedy)


def check_depths(path: Path, image_size: tuple[int, int], count: int) -> None:
    """Raise InputError for a folder that ends before the clip's `count` frames, or as `DepthFolder` does: found before
    an hour of work, not after."""
    folder = DepthFolder(path, image_size)
    if len(folder) < count:
        raise InputError(path, f"has depth pictures of {len(folder)} frames, the clip has {count}")
