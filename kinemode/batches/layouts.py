"""Layouts of folders: a video a clip, a folder a clip, the sessions of Pose2Sim and of OpenCap."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from kinemode.batches.recordings import ClipFiles, Listing, is_calibration, is_calibration_folder, with_cameras

_CAMERA_NAME = re.compile(
    r"(int|ext)?[ ._-]?(cam|camera|view|gopro|phone|c)[ ._-]?([0-9]{1,3}|[a-d])|left|right|front|back|rear|side|top",
    re.IGNORECASE,
)
_PARTICIPANT = re.compile(r"(S[0-9]+_P[0-9]+)(?!.*multi)(_.*)?", re.IGNORECASE)
_BESIDE_VIDEOS = re.compile(r"videos|raw[-_]2d|(pose|keypoints|kinematics)([-_].*)?", re.IGNORECASE)
_OF_KEYPOINTS = re.compile(r".*(_json|\.keypoints)|keypoints|pose", re.IGNORECASE)
_NO_TRIAL = re.compile(r"calib|extrinsic|intrinsic", re.IGNORECASE)
_METADATA = "sessionMetadata.yaml"
_PICKLE = "cameraIntrinsicsExtrinsics.pickle"
_HEIGHTS = (0.5, 2.5)  # m; others are not a person's
_FEWEST_PICTURES = 3  # of a folder that may be a clip


def recordings_in(listing: Listing, folder: Path) -> list[ClipFiles]:
    """The recordings in a folder and below it, each in its layout; guesses and unplaced files are
    noted."""
    return _walk(listing, folder, frozenset())


def _walk(listing: Listing, folder: Path, above: frozenset[Path]) -> list[ClipFiles]:
    real = folder.resolve()
    if real in above:  # a link to a folder above
        return []
    skipped: set[Path] = {path for path in listing.folders(folder) if is_calibration_folder(path)}
    places = _opencap_places(listing, folder)
    if places:
        return [recording for place in places for recording in _opencap(listing, folder, place)]
    if _is_trial(listing, folder):
        recordings = [_trial(listing, folder)]
        skipped |= {path for path in listing.folders(folder) if _BESIDE_VIDEOS.fullmatch(path.name)}
    else:
        recordings = _plain(listing, folder)
        if recordings:
            skipped |= {path for path in listing.folders(folder) if _OF_KEYPOINTS.fullmatch(path.name)}
        elif listing.pictures(folder) >= _FEWEST_PICTURES and folder != listing.top:
            listing.note(folder, "a folder of pictures, not placed: name it in the column clips if it is a clip")
    for path in listing.folders(folder):
        if path not in skipped:
            recordings += _walk(listing, path, above | {real})
    return recordings


def _parts(listing: Listing, folder: Path, *more: str) -> tuple[str, ...]:
    """Names of the folders from the top to one, the top's own only where there is no other."""
    return (*folder.relative_to(listing.top).parts, *more) or (listing.top.name or "clip",)


def _plain(listing: Listing, folder: Path) -> list[ClipFiles]:
    """The videos that lie in a folder: one, several cameras of one recording, or several clips."""
    videos = listing.videos(folder)
    if not videos:
        return []
    places = (folder, *(path for path in listing.folders(folder) if _OF_KEYPOINTS.fullmatch(path.name)))
    keypoints = {stem: path for stem in videos if (path := listing.keypoints(stem, places)) is not None}
    _note_unused(listing, folder, set(keypoints.values()))
    person = _person(folder, listing.top)
    if len(videos) == 1:
        parts = _parts(listing, folder) if folder != listing.top else tuple(videos)
        return [with_cameras(listing, folder, parts, videos, keypoints, person)]
    if _are_cameras(listing, folder, set(videos)):
        listing.note(folder, f"its {len(videos)} videos are taken as cameras of one recording")
        return [with_cameras(listing, folder, _parts(listing, folder), videos, keypoints, person)]
    listing.note(folder, f"its {len(videos)} videos are taken as clips of their own")
    own = [{stem: keypoints[stem]} if stem in keypoints else {} for stem in videos]
    return [
        with_cameras(listing, folder, _parts(listing, folder, stem), {stem: path}, of_stem, person)
        for (stem, path), of_stem in zip(videos.items(), own, strict=True)
    ]


def _are_cameras(listing: Listing, folder: Path, stems: set[str]) -> bool:
    """Whether several videos of a folder show one recording: a camera file has as many cameras, or those of their
    names; or they are called as cameras are."""
    if all(map(_CAMERA_NAME.fullmatch, stems)):
        return True
    file = listing.calibration(folder)
    cameras = [] if file is None else listing.camera_names(file) or []
    return stems <= set(cameras) or len(stems) == len(cameras)


def _note_unused(listing: Listing, folder: Path, used: set[Path]) -> None:
    for path in listing.of(folder):
        own = path.name.endswith(".names.json") or is_calibration(path)
        if path.suffix.lower() == ".json" and path.is_file() and path not in used and not own:
            listing.note(path, "not placed: no video beside it has its name")


def _person(folder: Path, top: Path) -> dict[str, str]:
    """The person by Pose2Sim's folder names, S01_P02_...; none for several people."""
    for place in (folder, *folder.parents):
        named = _PARTICIPANT.fullmatch(place.name)
        if named is not None:
            return {"person": named[1]}
        if place == top or re.match(r"S[0-9]+_P[0-9]+", place.name, re.IGNORECASE):
            break
    return {}


def _is_trial(listing: Listing, folder: Path) -> bool:
    """Whether a folder is a trial as Pose2Sim has them: videos/, pose/ or a calibration beside or above."""
    pose, videos = (listing.subfolder(folder, name) for name in ("pose", "videos"))
    if listing.videos(videos):
        return bool(listing.of(pose)) or listing.calibration(folder) is not None
    return not listing.videos(folder) and any(map(listing.has_frames, listing.folders(pose)))


def _trial(listing: Listing, folder: Path) -> ClipFiles:
    videos = listing.videos(listing.subfolder(folder, "videos"))
    pose = listing.subfolder(folder, "pose")
    places = (pose, listing.subfolder(folder, "keypoints"))
    if videos:
        keypoints = {stem: path for stem in videos if (path := listing.keypoints(stem, places)) is not None}
    else:
        frames = [path for path in listing.folders(pose) if listing.has_frames(path)]
        keypoints = {re.sub(r"^pose_|(_pose)?_json$", "", path.name): path for path in frames}
    if any(re.fullmatch(r"pose[-_]sync", path.name, re.IGNORECASE) for path in listing.folders(folder)):
        sentence = "pose-sync is not used, its frames are not the videos': write auto in the column sync"
        listing.note(folder, sentence)
    return with_cameras(listing, folder, _parts(listing, folder), videos, keypoints, _person(folder, listing.top))


def _opencap_places(listing: Listing, folder: Path) -> list[Path]:
    """Folders of a session of OpenCap whose subfolders are its cameras."""
    validation = listing.folders(listing.subfolder(folder, "videodata"))
    return [place for place in (listing.subfolder(folder, "videos"), *validation) if _opencap_cameras(listing, place)]


def _opencap_cameras(listing: Listing, place: Path) -> dict[str, Path]:
    """Folders of input by camera."""
    media = {path.name: path / "InputMedia" for path in listing.folders(place)}
    return {name: path for name, path in media.items() if path.is_dir()}


def _opencap(listing: Listing, session: Path, place: Path) -> list[ClipFiles]:
    cameras = _opencap_cameras(listing, place)
    trials = list(dict.fromkeys(trial.name for media in cameras.values() for trial in listing.folders(media)))
    told, phones = _metadata(listing, session)
    recordings = []
    for trial in trials:
        if _NO_TRIAL.match(trial):
            listing.note(place, f"the trial {trial} is left out, it shows a board")
            continue
        videos = {name: path for name, media in cameras.items() if (path := _opencap_video(listing, media / trial))}
        keypoints = {
            name: output / trial
            for name in videos
            for output in listing.folders(cameras[name].parent)
            if "json" in output.name.lower() and listing.has_frames(output / trial)
        }
        if not videos:
            listing.note(place, f"the trial {trial} has no video")
            continue
        others = dict(told)
        if len(videos) == 1 and (phone := phones.get(next(iter(videos)))):
            others["phone"] = phone
        if len(videos) > 1 and not all("sync" in path.stem.lower() for path in videos.values()):
            others["sync"] = "auto"
        between = place.relative_to(session).parts[1:]
        parts = _parts(listing, session, *between, trial)
        recordings.append(_opencap_recording(listing, session, parts, videos, keypoints, others))
    return recordings


def _opencap_recording(
    listing: Listing, session: Path, parts: tuple[str, ...], videos: dict[str, Path], keypoints: dict[str, Path],
    others: dict[str, str],
) -> ClipFiles:  # fmt: skip
    pickled = [path for path in videos.values() if (path.parents[2] / _PICKLE).exists()]
    if len(videos) == 1 or (pickled and listing.calibration(session) is None):
        if len(videos) > 1:
            sentence = (
                f"its cameras are in pickles ({_PICKLE}), which can run any program, so none is read: convert them "
                "with Pose2Sim (convert_from 'opencap') and name the .toml in the column cameras, or write auto"
            )
            listing.note(session, sentence)
        return ClipFiles(parts, videos, keypoints, None, others)
    return with_cameras(listing, session, parts, videos, keypoints, others)


def _opencap_video(listing: Listing, folder: Path) -> Path | None:
    """The film of a trial: the synchronised one goes before that which the phone has sent."""
    videos = listing.videos(folder)
    wanted = sorted(videos, key=lambda stem: ("sync" not in stem.lower(), stem != folder.name))
    return videos[wanted[0]] if wanted else None


def _metadata(listing: Listing, session: Path) -> tuple[dict[str, str], dict[str, str]]:
    """Person and height by column, and the phone of each camera whose lens is known."""
    file = session / _METADATA
    if file not in listing.of(session):
        return {}, {}
    import yaml

    from kinemode.inputs.phones import phone

    try:
        content: Any = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError):
        content = None
    if not isinstance(content, dict):
        listing.note(file, "cannot be read: person and height are left empty")
        return {}, {}
    told = {}
    if isinstance(content.get("subjectID"), (str, int)) and str(content["subjectID"]).strip():
        told["person"] = str(content["subjectID"]).strip()
    if isinstance(content.get("height_m"), (int, float)) and _HEIGHTS[0] <= content["height_m"] <= _HEIGHTS[1]:
        told["height"] = f"{content['height_m']:g}"
    models = content.get("iphoneModel")
    phones = {str(k): str(v) for k, v in models.items()} if isinstance(models, dict) else {}
    return told, {camera: model for camera, model in phones.items() if phone(model) is not None}
