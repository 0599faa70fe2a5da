"""What the user names: clips, keypoint files and cameras, matched by name, made into observations."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.formats.cameras import load_cameras
from estimator.formats.keypoints import KeypointTrack, load_keypoints
from estimator.imaging.camera import Camera, guessed_camera
from estimator.imaging.clip import DEFAULT_FPS, Clip
from estimator.imaging.observation import Observation
from estimator.imaging.sequence import assemble, assembly_notes
from humanoid.body import Body
from humanoid.errors import InputError

PathLike = str | Path
KEYPOINT_FORMATS = "read are MediaPipe 33 JSON, OpenPose folders (BODY_25, COCO 18), COCO 17 and Halpe 26 JSON"
Named = PathLike | Iterable[PathLike] | Mapping[str, PathLike] | None


def named_paths(given: Named, what: str) -> dict[str, Path]:
    """Files by name, from `[NAME=]PATH` texts or a mapping; the name is the file's stem unless given.

    Raises InputError, calling the files `what`, where a name is empty or used twice or a file does not exist.
    """
    if given is None:
        return {}
    if isinstance(given, Mapping):
        pairs = [(str(name), Path(path)) for name, path in given.items()]
    else:
        pairs = [_name_and_path(p, what) for p in ([given] if isinstance(given, (str, Path)) else given)]
    found: dict[str, Path] = {}
    for name, path in pairs:
        if not path.exists():
            raise InputError(path, f"no such {what}")
        if name in found:
            remedy = "give names: NAME=" + str(path)
            raise InputError(path, f"{what} {found[name]} has the name {name!r} too", remedy=remedy)
        found[name] = path
    return found


def _name_and_path(given: PathLike, what: str) -> tuple[str, Path]:
    text = str(given)
    if Path(text).exists() or "=" not in text:  # a file may have = in its name
        return _stem(Path(text)), Path(text)
    name, _, path = text.partition("=")
    if not name or not path:
        raise InputError(text, f"not a {what}", remedy="write NAME=PATH or PATH")
    return name, Path(path)


def _stem(path: Path) -> str:
    return path.name if path.is_dir() else path.stem


def matched(
    names: Iterable[str], files: Mapping[str, Path], what: str, owner: str, *, every: bool = True
) -> dict[str, Path]:
    """One file for each name, or for some unless `every` one needs it; a single file serves a single name whatever it
    is called."""
    names = list(names)
    if len(names) == 1 and len(files) == 1:
        return {names[0]: next(iter(files.values()))}
    for name, path in files.items():
        if name not in names:
            remedy = f"{owner}s: {', '.join(names) or 'none'}; choose with NAME={path}"
            raise InputError(path, f"there is no {owner} {name!r} for this {what}", remedy=remedy)
    for name in names:
        if every and name not in files:
            raise InputError(name, f"this {owner} has no {what}", remedy=f"add {name}=FILE")
    return {name: files[name] for name in names if name in files}


@dataclass(frozen=True)
class Inputs:
    """What there is to track.

    observations (T). times (T,) [s]. clips (C): of each camera, in the observations' order, None for keypoints alone.
    masks, backgrounds (C): of each camera where they are given, see `estimator.imaging.cues.CueReader`.
    notes: what the user should hear of.
    """

    observations: list[Observation]
    times: np.ndarray
    clips: tuple[Path | None, ...]
    notes: tuple[str, ...]
    masks: tuple[Path | None, ...] = ()
    backgrounds: tuple[Path | None, ...] = ()


def load_inputs(
    body: Body,
    clips: Named,
    keypoints: Named,
    cameras: PathLike | Mapping[str, Camera] | None,
    *,
    person: str | int,
    masks: Named = None,
    backgrounds: Named = None,
) -> Inputs:
    """Read everything a body is tracked from; of the pictures only what there is of them.

    Raises InputError: no keypoints, files without a partner, no camera for one of several clips, too few masks.
    """
    clip_files, keypoint_files = named_paths(clips, "clip"), named_paths(keypoints, "keypoint file")
    if not keypoint_files:
        raise _no_keypoints(clip_files)
    if clip_files:
        keypoint_files = matched(clip_files, keypoint_files, "keypoint file", "clip")
    mask_files = matched(clip_files, named_paths(masks, "mask"), "mask", "clip", every=False)
    background_files = matched(clip_files, named_paths(backgrounds, "background"), "background", "clip", every=False)
    chosen = int(person) if isinstance(person, str) and person.isdigit() else person
    tracks = {name: load_keypoints(path, person=chosen) for name, path in keypoint_files.items()}
    videos = {name: Clip.open(path) for name, path in clip_files.items()}
    sizes = {name: clip.image_size for name, clip in videos.items()}
    used, notes = _cameras(tracks, sizes, cameras)
    times, time_notes = _times(tracks, videos)
    notes += [f"{name}: {note}" for name, track in tracks.items() for note in track.notes]
    notes += [*time_notes, *assembly_notes(tracks, len(times))]
    for clip in videos.values():
        clip.close()
    for path in mask_files.values():
        _check_masks(path, len(times))
    observations = assemble(body, tracks, used, times, clip_sizes=sizes)
    by_camera = (tuple(files.get(name) for name in tracks) for files in (clip_files, mask_files, background_files))
    of_clips, of_masks, of_backgrounds = by_camera
    return Inputs(observations, times, of_clips, tuple(notes), of_masks, of_backgrounds)


def _no_keypoints(clips: Mapping[str, Path]) -> InputError:
    clip = str(next(iter(clips.values()), "CLIP"))
    remedy = f"click them: {shlex.join(['kinemode', 'annotate', clip])}; or give a detector's: {KEYPOINT_FORMATS}"
    return InputError("keypoints", "are needed, of one frame at least, to find the first pose", remedy=remedy)


def _check_masks(path: Path, count: int) -> None:
    """Masks that end early are found before an hour of work, not after."""
    masks = Clip.open(path)
    read = masks.report.read
    masks.close()
    if read < count:
        raise InputError(path, f"has masks of {read} frames, the clip has {count}")


def _cameras(
    tracks: Mapping[str, KeypointTrack],
    sizes: Mapping[str, tuple[int, int]],
    given: PathLike | Mapping[str, Camera] | None,
) -> tuple[dict[str, Camera], list[str]]:
    """Camera of each track by the track's name; the one camera of a single clip is guessed where nothing is given."""
    if given is not None:
        known = given if isinstance(given, Mapping) else load_cameras(given)
        source = "cameras" if isinstance(given, Mapping) else given
        return {name: _choose(name, known, source, len(tracks)) for name in tracks}, []
    if len(tracks) > 1:
        problem = f"several views ({', '.join(tracks)}) need their placements"
        raise InputError("cameras", problem, remedy="give a camera file: JSON with K, distortion, R and t of each")
    ((name, track),) = tracks.items()
    size = sizes.get(name) or track.image_size
    if size is None:
        raise InputError(track.source, "does not say the size of the image", remedy="give the clip or a camera file")
    focal = guessed_camera(name, size).K[0, 0]
    note = f"no camera given: a focal length of {focal:.0f} px is guessed for {name}; sizes and distances depend on it"
    return {name: guessed_camera(name, size)}, [note]


def _choose(name: str, cameras: Mapping[str, Camera], source: PathLike, count: int) -> Camera:
    if name in cameras:
        return cameras[name]
    if count == 1 and len(cameras) == 1:
        return next(iter(cameras.values()))
    remedy = f"cameras: {', '.join(cameras)}; choose with NAME=PATH"
    raise InputError(str(source), f"there is no camera {name!r}", remedy=remedy)


def _times(tracks: Mapping[str, KeypointTrack], clips: Mapping[str, Clip]) -> tuple[np.ndarray, list[str]]:
    """Frame times (T,) [s]: those of the clip that ends first; of the keypoint files where there is no clip."""
    if clips:
        notes = [f"{name}: {note}" for name, clip in clips.items() for note in clip.report.notes]
        lengths = {name: clip.report.read for name, clip in clips.items()}
        shortest = min(lengths, key=lambda name: lengths[name])
        if len(set(lengths.values())) > 1:
            each = ", ".join(f"{name} {count}" for name, count in lengths.items())
            notes.append(f"the clips differ in length ({each} frames): all end with {shortest}")
        return clips[shortest].times, notes
    rates = {track.fps for track in tracks.values() if track.fps}
    notes = [] if rates else [f"no frame rate in the keypoint files: {DEFAULT_FPS:g} frames per second assumed"]
    if len(rates) > 1:
        raise InputError("keypoints", f"the files differ in frames per second: {sorted(rates)}")
    count = max(track.frame_count for track in tracks.values())
    return np.arange(count) / (rates.pop() if rates else DEFAULT_FPS), notes
