"""What the user names: clips, keypoint files and cameras, matched by name, made into observations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.cameras.camera import Camera, guessed_camera
from estimator.formats.cameras import load_cameras
from estimator.formats.keypoints import KeypointTrack, load_people
from estimator.imaging.observation import Observation
from estimator.imaging.resolution import Size, declared_size, fitted_camera, fitted_track, resized_camera
from estimator.media.clip import Clip
from estimator.people.across_cameras import subject_tracks
from estimator.sequences.resampling import at_places
from estimator.sequences.sequence import assemble
from estimator.sequences.timing import CameraClock, Timeline, timeline
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError
from kinemode.inputs.clocks import clocks_of, notes_on_time
from kinemode.inputs.declared import Declared
from kinemode.inputs.doubts import checked_agreement
from kinemode.inputs.named import Named, PathLike, chosen_names, kept, matched, named_paths
from kinemode.inputs.persons import Persons, persons_of
from kinemode.terminal.program import command

KEYPOINT_FORMATS = "read are MediaPipe 33 JSON, OpenPose folders (BODY_25, COCO 18), COCO 17 and Halpe 26 JSON"
Cameras = PathLike | Mapping[str, Camera] | None


@dataclass(frozen=True)
class Inputs:
    """What there is to track.

    observations (T). times (T,) [s]. clips (C): of each camera, in the observations' order, None for keypoints alone.
    notes: what the user should hear of.
    masks, backgrounds (C): of each camera where they are given, see `estimator.imaging.cues.CueReader`.
    frames (C): number of each clip's frame at each instant (T,), None where it is the instant's own number.
    """

    observations: list[Observation]
    times: np.ndarray
    clips: tuple[Path | None, ...]
    notes: tuple[str, ...]
    masks: tuple[Path | None, ...] = ()
    backgrounds: tuple[Path | None, ...] = ()
    frames: tuple[np.ndarray | None, ...] = ()


def load_inputs(
    body: Body,
    clips: Named,
    keypoints: Named,
    cameras: Cameras,
    *,
    person: Persons,
    masks: Named = None,
    backgrounds: Named = None,
    declared: Declared | None = None,
) -> Inputs:
    """Read everything a body is tracked from; of the pictures only what there is of them.

    Raises InputError: no keypoints, files without a partner, no camera for one of several clips, too few masks, sizes
    or times that contradict each other.
    """
    told = declared or Declared()
    clips, keypoints, masks, backgrounds = map(kept, (clips, keypoints, masks, backgrounds))
    clip_files, keypoint_files = named_paths(clips, "clip"), named_paths(keypoints, "keypoint file")
    if not keypoint_files:
        raise _no_keypoints(clip_files)
    keypoint_files, notes = _of_clips(clip_files, keypoint_files, chosen_names(keypoints, "keypoint file"))
    mask_files, background_files = (
        matched(clip_files, named_paths(given, what), what, "clip", chosen=chosen_names(given, what), every=False)
        for given, what in ((masks, "mask"), (backgrounds, "background"))
    )
    persons = persons_of(person, keypoint_files)
    people = {name: load_people(path) for name, path in keypoint_files.items()}
    named = chosen_names(clips, "clip") | chosen_names(keypoints, "keypoint file")
    sizes = {name: _picture_size(path) for name, path in clip_files.items()}
    outlines = {name: file.track_of({}) for name, file in people.items()}  # sizes, rates and lengths, but nobody yet
    _, used, _ = _one_size(outlines, sizes, cameras, named, told)
    clocks, clock_notes = clocks_of(outlines, clip_files, told)
    times = {name: clock.offset + clock.keypoints for name, clock in clocks.items()}
    tracks, who = subject_tracks(people, _as_detected(outlines, used, told), persons, times)
    tracks, used, fit_notes = _one_size(tracks, sizes, cameras, named, told)
    notes += who
    line = timeline(clocks).cut(*told.part())
    notes += [f"{name}: {note}" for name, track in tracks.items() for note in track.notes]
    notes += [*fit_notes, *clock_notes, *notes_on_time(clocks, line)]
    for name, path in mask_files.items():
        _check_masks(path, int(line.frames[name].max()) + 1)
    observations = _observations(body, tracks, used, line, clocks)
    notes += checked_agreement(observations, tracks, {n: clock.offset for n, clock in clocks.items()}, told)
    by_camera = (tuple(files.get(name) for name in tracks) for files in (clip_files, mask_files, background_files))
    frames = tuple(_unlike_instants(line.frames.get(name)) for name in tracks)
    return Inputs(observations, line.times, next(by_camera), tuple(notes), next(by_camera), next(by_camera), frames)


def _no_keypoints(clips: Mapping[str, Path]) -> InputError:
    clicks = command("annotate", next(iter(clips.values()), Path("CLIP")))
    remedy = f"click them: {clicks}; or give a detector's: {KEYPOINT_FORMATS}"
    return InputError("keypoints", "are needed, of one frame at least, to find the first pose", remedy=remedy)


def _of_clips(
    clips: Mapping[str, Path], keypoints: dict[str, Path], chosen: frozenset[str]
) -> tuple[dict[str, Path], list[str]]:
    """The keypoint file of each clip, by the clip's name, and a note where a name had to be guessed."""
    if not clips:
        return keypoints, []
    found = matched(clips, keypoints, "keypoint file", "clip", chosen=chosen)
    if set(found) == set(keypoints):
        return found, []
    ((name, path),) = found.items()
    return found, [f"the keypoints {path} are taken for the clip {clips[name]}, which is called otherwise"]


def _picture_size(path: Path) -> Size:
    clip = Clip.open(path)
    clip.close()
    return clip.image_size


def _check_masks(path: Path, count: int) -> None:
    """Masks that end early are found before an hour of work, not after."""
    masks = Clip.open(path)
    read = masks.report.read
    masks.close()
    if read < count:
        raise InputError(path, f"has masks of {read} frames, the clip has {count}")


def _one_size(
    tracks: Mapping[str, KeypointTrack],
    pictures: Mapping[str, Size],
    cameras: Cameras,
    named: frozenset[str],
    told: Declared,
) -> tuple[dict[str, KeypointTrack], dict[str, Camera], list[str]]:
    """Tracks and cameras at the size of the clips, or of the cameras where there are none; and notes."""
    sizes = _detector_sizes(tracks, told)
    found, notes = _cameras(tracks, {n: pictures.get(n) or sizes[n] for n in tracks}, cameras, named)
    source = "cameras" if cameras is None or isinstance(cameras, Mapping) else str(cameras)
    scaled = {}
    for name, track in tracks.items():
        picture = pictures.get(name) or found[name].image_size
        found[name], of_camera = fitted_camera(found[name], picture, source)
        scaled[name], of_track = fitted_track(name, track, sizes[name], picture)
        notes += [*of_camera, *of_track]
    return scaled, found, notes


def _as_detected(
    tracks: Mapping[str, KeypointTrack], cameras: Mapping[str, Camera], told: Declared
) -> dict[str, Camera]:
    """The cameras of pictures of the size that the detectors saw."""
    sizes = _detector_sizes(tracks, told)
    return {name: resized_camera(cameras[name], size or cameras[name].image_size) for name, size in sizes.items()}


def _detector_sizes(tracks: Mapping[str, KeypointTrack], told: Declared) -> dict[str, Size | None]:
    """Size of the pictures that each detector saw, None where neither the file nor the user says."""
    given = told.sizes(tracks)
    return {name: declared_size(track, given.get(name)) for name, track in tracks.items()}


def _cameras(
    tracks: Mapping[str, KeypointTrack], sizes: Mapping[str, Size | None], given: Cameras, named: frozenset[str]
) -> tuple[dict[str, Camera], list[str]]:
    """Camera of each track by the track's name; the one camera of a single clip is guessed where nothing is given."""
    if given is not None:
        known = given if isinstance(given, Mapping) else load_cameras(given)
        source = "cameras" if isinstance(given, Mapping) else given
        alone = len(tracks) == len(known) == 1
        found = {name: _choose(name, known, source, alone=alone and name not in named) for name in tracks}
        notes = [
            f"the camera {camera.name!r} of {source} is taken for {name!r}, there being no other"
            for name, camera in found.items()
            if name not in known
        ]
        return found, notes
    if len(tracks) > 1:
        problem = f"several views ({', '.join(tracks)}) need their placements"
        raise InputError("cameras", problem, remedy="give a camera file: JSON with K, distortion, R and t of each")
    ((name, track),) = tracks.items()
    size = sizes[name]
    if size is None:
        remedy = "give the clip, a camera file or --keypoint-size WxH"
        raise InputError(track.source, "does not say the size of the image", remedy=remedy)
    focal = guessed_camera(name, size).K[0, 0]
    note = f"no camera given: a focal length of {focal:.0f} px is guessed for {name}; sizes and distances depend on it"
    return {name: guessed_camera(name, size)}, [note]


def _choose(name: str, cameras: Mapping[str, Camera], source: PathLike, *, alone: bool) -> Camera:
    if name in cameras:
        return cameras[name]
    if alone:
        return next(iter(cameras.values()))
    remedy = f"cameras: {', '.join(cameras)}; choose with NAME=PATH"
    raise InputError(str(source), f"there is no camera {name!r}", remedy=remedy)


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
