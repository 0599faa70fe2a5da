"""`track`, `fit` and `compare`: arguments and files are checked before the libraries that do the work are loaded."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinemode.inputs.arrays import Spool
from kinemode.inputs.declared import AUTO, SYNC_CHOICES, Declared, Offsets, Rates, Sizes, moment, wants_all
from kinemode.inputs.files import InputFiles, check_exists
from kinemode.inputs.named import Named, PathLike
from kinemode.inputs.point_options import MARKERS, check_fit, check_no_points, check_static
from kinemode.notices import InputWarning
from kinemode.public.arguments import check_arguments, check_as, choice, whole
from kinemode.public.detection import with_detected
from kinemode.public.points import point_files
from kinemode.target import RunTarget, check_folder
from kinemode.terminal.progress import Reporter, unreported

if TYPE_CHECKING:
    from estimator.runs.run_file import Run
    from estimator.tracking.fitting.fit import Fit
    from humanoid.subject.subject import Subject
    from kinemode.comparison.compare import Comparison
    from kinemode.inputs.arrays import Clips, Keypoints
    from kinemode.inputs.depth import Pairs
    from kinemode.inputs.files import Cameras
    from kinemode.inputs.persons import Persons
    from kinemode.inputs.points import PointFiles
    from kinemode.public.detection import Detect

    SubjectLike = Subject | PathLike

FIT_CHOICES = ("auto", "proportions", "markers", "off")
DEFAULT = "css"  # the tracker where none is named
_CHECKED_ELSEWHERE = ("seed", "fit", "keypoint_size", "keypoint_noise", "fps", "offset", "sync", "start", "end", "unit")


def track(
    subject: SubjectLike,
    clips: Clips = None,
    *,
    cameras: Cameras = None,
    keypoints: Keypoints = None,
    layout: str | Sequence[str] = "auto",
    cues: str | Iterable[str] = "auto",
    masks: Named = None,
    background: Named = None,
    stereo: Pairs = None,
    depth: Named = None,
    points: Named = None,
    markers: PathLike = AUTO,
    unit: str | None = None,
    static: Named = None,
    tracker: str | None = None,
    modes: int | None = None,
    seed: int = 0,
    fit: str = "auto",
    height: float | None = None,
    out: PathLike | None = None,
    resume: bool = False,
    overwrite: bool = False,
    person: Persons = "auto",
    keypoint_size: Sizes = None,
    keypoint_noise: Rates = None,
    fps: Rates = None,
    offset: Offsets = None,
    sync: str = "off",
    up: str | None = None,
    focal: str | None = None,
    phone: str | None = None,
    lenses: Cameras = None,
    floor: float | str = "auto",
    start: float | str | None = None,
    end: float | None = None,
    settings: Mapping[str, Any] | PathLike | None = None,
    index: PathLike | None = None,
    detect: Detect = False,
    progress: Reporter | None = None,
) -> Run | Any:
    """Track a subject through one clip, or several synchronised ones, into a run file.

    Parameters
    ----------
    subject: a loaded subject, a built-in name, or the path of a URDF.
    clips: paths or `NAME=PATH` texts of videos or folders of images, or a mapping by name; none where the keypoints
        are enough. The name picks the camera, and is the file's stem by default.
    cameras: camera file, or cameras by name; the one camera of a single clip is guessed without it.
        Also pictures that a program has: an array (T, H, W, 3) uint8 BGR, an iterator that gives (H, W, 3) and ends, or
        a mapping of camera names to such. They are kept as files until the call ends, or with the run where `out` is
        not given.
    keypoints: 2D keypoint files, given as the clips are; with cues those of one frame will do, tracking begins there.
        Also arrays (T, K, 2) of x, y [px] or (T, K, 3) with confidences, NaN where missing, alone or by name.
    layout: what the keypoints are called: "mediapipe33", "coco17", ..., of arrays also a name for each; "auto" uses
        their number. `fps` is their rate, `keypoint_size` the size of the pictures that they were seen in.
    cues: what is taken from the pictures: "off", or some of the cues there are (`kinemode cues` lists them), as names
        or separated by commas; "auto" takes them all where there are clips and less than half of the frames have
        keypoints.
    masks, background: for the silhouette, given as the clips are: a video or folder of masks, white on the person; a
        picture of the empty scene. Without them the background is learned from the clip.
    stereo: cameras that make pairs side by side, left to right, as a mapping by name or `LEFT=RIGHT` texts: their clips
        show depth together. depth: given as the clips are, folders of depth pictures, one for every frame: 16-bit PNG
        in millimetres or .npy in metres.
    points: in place of clips, keypoints and cameras, points in space: markers of a laboratory, or keypoints that were
        triangulated; TRC, C3D, npz, npy or csv, several of the same instants. `up` is then the axis of the file that
        points up, `fps` its rate and unit its unit of length (m, cm or mm), where it does not say them.
    markers: what the points are: the name of a set of markers, or a TOML file of one (`kinemode subjects --markers`
        begins it); "auto" takes the subject's own markers, or the set that knows most of the names.
    static: files of points in which the same person stands upright, all joints about straight, with the same markers;
        the fit then knows the joints' zeros, which a motion does not tell. Joints that are bent there, as of arms held
        out, are not taken as known. `up`, `fps` and `unit` are said of them, too.
    tracker, modes: name of the tracker ("css" unless given, "markers" with points) and how many hypotheses it keeps;
        unless given as many as its settings say, for which each tracker has its own default. A single-mode tracker
        keeps one.
    settings: nested changes to the tracker's settings (see `estimator.tracking.registry`), or a TOML file of them as
        `kinemode settings` writes it. Those of cost, search and cues also reach the fit, which tracks with css.
    seed: equal seeds give equal runs.
    fit: "auto" fits an unchanged built-in subject to the person, from pieces of the clip: proportions from the
        keypoints, and where edges or silhouettes are looked at the flesh too (CSS section 5); any other subject is
        taken as measured. With points lengths and the markers' places are fitted ("auto", "markers"). "proportions"
        leaves the flesh as it is, "off" every subject.
    height: of the person [m], where it is known: one camera does not see how large somebody is. The proportions are
        fitted around a subject of that height; of a subject that is taken as measured it is refused.
    out: the run file. Without it a temporary one, which is gone when no `Run` of it is left.
    resume: go on with `out` if it is there. overwrite: replace it.
    person: which of several people in the keypoint files: "auto" or an id, for all cameras, or by camera as a mapping
        or as CAMERA=ID texts. Cameras left to "auto" take the person that fits the others. "all": everybody, each with
        a fit and a run of their own, from when they are first seen to the last; returned is a dict of the runs by
        "person1", "person2", ..., the largest first, and `out` "walk.run" becomes "walk.person1.run", ... Who cannot
        be tracked is missing in it, and told.
    keypoint_size: width and height [px] of the pictures that the detector saw, where the files do not say it and it is
        not the clip's: (540, 960), or by name.
    keypoint_noise: standard deviation of keypoints about their places on the body, in pixels of the clip where the
        person is as large as in the middle of it; one for all cameras, or by name. Unless given it is what detectors
        of people err (`cost.keypoint_noise`), measured anew where the person is fitted.
    fps: frames per second of the pictures: of folders, of keypoint files that declare none, and of films taken at
        another rate than they declare, as slow motion; or by name.
    offset: seconds that a camera's first frame was taken after moment 0, by name: above 0 for one that started late.
    sync: "auto" finds the offsets of the cameras that none is given for from what moves in their keypoints, up to 10 s,
        and their rates where these differ from what is declared;
        where that is not sure it is refused, with the best guess. The first camera then is the one at 0, unless others
        have offsets.
    focal: length of the one camera that no file describes: "26mm" (on 35 mm film), "1400px", or "0.72" of the longer
        side. phone: in its place the model that took the clip, "iPhone 12 Pro" or "iPhone13,3": its focal length in
        OpenCap's calibrations, of video that is neither zoomed nor cropped by stabilisation. Unless one of them is
        given the clip's tags say the length or the model, or it is that of most phones.
    lenses: with cameras="auto" a camera file, or cameras by name, whose K and distortion the cameras have: by name, or
        of the one camera in it for all. Where they stand there is not used, and a focal length that the file does not
        call unsure (focal_std) is not fitted.
    up: the axis of the cameras' world that points up ("x", "y", "z", "-x", "-y" or "-z"), or a direction as
        "0.1,0.97,0.2"; unless it or the camera file says so it is found where several cameras see the person stand or
        walk, and z is taken where none do. The world is turned so that z points up, as exports, gait and previews
        take it.
    floor: its height in the cameras' world, along the axis that points up [m]; "off" where there is none; "auto" takes
        the camera file's word, or finds it from the feet that stand. Nothing of the body goes below it, as far as the
        smoothing goes; one that is given also tells a single camera how large the person is, and is the height of what
        stands on it.
    start, end: track from here to here [s], both included. start="index" instead: from the beginning, the first pose
        comes from an index of examples, so that no keypoints are needed; it takes depth. (For both, the settings have
        search.start.)
    index: file in which trackers that look poses up do so (`kinemode.train_index`), in the first frame (start="index")
        or in all (elmo, psh); unless given the one their settings name, or that of the subject in the user's cache,
        made when it is first needed. With it css also searches from examples, more after it has lost the person.
    detect: True, or the name of a detector, or a mapping of arguments of `kinemode.detect`: the keypoints of clips
        without a keypoint file are found first, into the folder OUT.keypoints beside the run, and taken from there as
        long as clip and detector are the same.
    progress: opens a progress report for each stage, such as `kinemode.reported`; none by default.

    Raises
    ------
    InputError: anything that is wrong with the input, a changed setting without effect included.
    """
    given = _checked(locals())
    seed, begin, start_by = _beginning(fit, seed, start)
    _check_target(given)
    spool = Spool(clips, keypoints, layout)
    told = _declared(given, start=begin, layout=spool.file_layout)
    by_points = _point_files(given, told)
    files = _files(spool, (settings, index), cameras, masks, background, person, told, depth, stereo, lenses)
    loaded = loaded_subject(subject)
    from kinemode import jobs

    wanted = jobs.TrackOptions(
        cues, tracker or (DEFAULT if by_points is None else MARKERS), modes, settings, seed, fit,
        spool.run_path(out), resume, overwrite, progress or unreported,
        index=index, start=start_by, height=height,
    )  # fmt: skip
    with spool.telling(), with_detected(files, detect, wanted.out, progress) as seen:
        return _work(person, by_points)(loaded, seen, wanted)


def fit(
    subject: SubjectLike,
    clips: Clips = None,
    *,
    cameras: Cameras = None,
    keypoints: Keypoints = None,
    layout: str | Sequence[str] = "auto",
    cues: str | Iterable[str] = "auto",
    masks: Named = None,
    background: Named = None,
    stereo: Pairs = None,
    depth: Named = None,
    points: Named = None,
    markers: PathLike = AUTO,
    unit: str | None = None,
    static: Named = None,
    seed: int = 0,
    height: float | None = None,
    person: Persons = "auto",
    keypoint_size: Sizes = None,
    keypoint_noise: Rates = None,
    fps: Rates = None,
    offset: Offsets = None,
    sync: str = "off",
    up: str | None = None,
    focal: str | None = None,
    phone: str | None = None,
    lenses: Cameras = None,
    floor: float | str = "auto",
    start: float | None = None,
    end: float | None = None,
    out: PathLike | None = None,
    detect: Detect = False,
    progress: Reporter | None = None,
) -> Fit:
    """Fit a subject to the person in the first frames of a clip; `out` is written as a URDF that loads again.

    Proportions are fitted to the keypoints, and where edges or silhouettes are looked at the flesh to them; with points
    to these, and the markers' places with them, which the URDF then has. The arguments are those of `track`. Raises
    InputError as `track` does, and where there is nothing to fit.
    """
    given = _checked(locals())
    seed = whole("seed", seed, 0)
    spool = Spool(clips, keypoints, layout)
    told = _declared(given, start=start, layout=spool.file_layout)
    by_points = _point_files(given, told)
    files = _files(spool, (), cameras, masks, background, person, told, depth, stereo, lenses)
    if out is not None:
        check_folder(Path(out))
    loaded = loaded_subject(subject)
    from kinemode import jobs

    if by_points is not None:
        from kinemode.from_points import fit_to_points

        return fit_to_points(loaded, by_points, seed, out)
    with spool.telling(), with_detected(files, detect, out, progress) as seen:
        return jobs.fit_subject(loaded, seen, cues, seed, out, height)


def compare(
    subject: SubjectLike,
    clips: Clips,
    *,
    trackers: str | Iterable[str],
    out: PathLike,
    reference: PathLike | None = None,
    cameras: Cameras = None,
    keypoints: Keypoints = None,
    layout: str | Sequence[str] = "auto",
    cues: str | Iterable[str] = "auto",
    masks: Named = None,
    background: Named = None,
    stereo: Pairs = None,
    depth: Named = None,
    modes: int | None = None,
    seed: int = 0,
    fit: str = "auto",
    height: float | None = None,
    resume: bool = False,
    overwrite: bool = False,
    person: Persons = "auto",
    keypoint_size: Sizes = None,
    keypoint_noise: Rates = None,
    fps: Rates = None,
    offset: Offsets = None,
    sync: str = "off",
    up: str | None = None,
    focal: str | None = None,
    phone: str | None = None,
    lenses: Cameras = None,
    floor: float | str = "auto",
    start: float | str | None = None,
    end: float | None = None,
    settings: Mapping[str, Any] | PathLike | None = None,
    index: PathLike | None = None,
    detect: Detect = False,
    progress: Reporter | None = None,
) -> Comparison:
    """Track one clip with several trackers and compare them; the subject is fitted once, for all of them.

    Parameters
    ----------
    trackers: names, or one text with commas between them.
    out: folder, made if it is not there, for the runs (NAME.run) and for compare.csv, compare.json and compare.png.
    reference: known 3D landmarks (see `kinemode.evaluate`); in the world of `cameras` where these are given.
    resume: go on with the runs that are there. overwrite: replace them.

    All others are those of `track`; keypoints that are detected go into OUT/compare.keypoints.

    Raises
    ------
    InputError: as `track` does; an unknown tracker; runs that are there, without `resume` or `overwrite`.
    """
    given = _checked(locals())
    check_as("folder", out=out)
    seed, begin, start_by = _beginning(fit, seed, start)
    spool = Spool(clips, keypoints, layout)
    told = _declared(given, start=begin, layout=spool.file_layout)
    files = _files(spool, (settings, index, reference), cameras, masks, background, person, told, depth, stereo, lenses)
    loaded = loaded_subject(subject)
    from kinemode import jobs
    from kinemode.comparison.compare import compare_trackers

    wanted = jobs.TrackOptions(
        cues, "css", modes, settings, seed, fit, out, resume, overwrite, progress or unreported,
        index=index, start=start_by, height=height,
    )  # fmt: skip
    with spool.telling(), with_detected(files, detect, Path(out) / "compare", progress) as seen:
        return compare_trackers(loaded, seen, trackers, wanted, reference)


def _checked(given: Mapping[str, Any]) -> Mapping[str, Any]:
    """Arguments by name, those checked that are not read more closely afterwards."""
    check_arguments(**{name: value for name, value in given.items() if name not in _CHECKED_ELSEWHERE})
    return dict(given)


def _beginning(fit: str, seed: int, start: float | str | None) -> tuple[int, float | None, str | None]:
    """The seed, when a track begins [s], and what its first pose comes from, with the choice of the fit checked."""
    choice("fit", fit, FIT_CHOICES)
    return (whole("seed", seed, 0), *moment(start))


def _check_target(given: Mapping[str, Any]) -> None:
    """Raise InputError for a run that cannot go where the arguments have it; those of everybody are checked later."""
    if given["out"] is not None and not wants_all(given["person"]):
        RunTarget(Path(given["out"]), given["resume"], given["overwrite"]).check()


def _declared(given: Mapping[str, Any], **changed: Any) -> Declared:
    """What the arguments, by name, declare of the files, checked; changed: values in place of those given."""
    declared = Declared(**{field.name: given[field.name] for field in fields(Declared)} | changed)
    choice("sync", declared.sync, SYNC_CHOICES)
    declared.check_lens()
    declared.known_floor()
    return declared


def _files(spool: Spool, others: Iterable[object], *given: Any) -> InputFiles:
    """What a body is tracked from; raises InputError where a file of it, or a path among the others, does not exist."""
    files = InputFiles(spool.clips, spool.keypoints, *given).checked()
    for path in others:
        if isinstance(path, (str, Path)):
            check_exists(path)
    return files


def _point_files(given: Mapping[str, Any], told: Declared) -> PointFiles | None:
    """Files of points, None where the arguments name none."""
    check_fit(given.get("fit", AUTO), points=given["points"] is not None)
    if given["points"] is None:
        check_no_points(given["markers"], given["unit"], given["static"])
        return None
    if given["static"] is not None:
        check_static(given.get("fit", AUTO))
    return point_files(given, told)


def _work(person: Persons, points: PointFiles | None) -> Callable[..., Run | dict[str, Run]]:
    """What tracks one person, or everybody, or by points."""
    if points is not None:
        from kinemode.from_points import track_points

        return lambda loaded, _, wanted: track_points(loaded, points, wanted)
    if wants_all(person):
        from kinemode.everybody import track_everybody

        return track_everybody
    from kinemode.jobs import track_subject

    return track_subject


def loaded_subject(subject: SubjectLike) -> Subject:
    """A subject as it is, or loaded from its name or path; raises InputError where there is none."""
    from humanoid.subject.subject import Subject, load_subject

    return subject if isinstance(subject, Subject) else load_subject(subject)


def noted_subject(subject: SubjectLike) -> Subject:
    """As `loaded_subject`, with a warning for each of its notes, for what does not pass them on itself."""
    loaded = loaded_subject(subject)
    for note in loaded.notes:
        warnings.warn(note, InputWarning, stacklevel=3)
    return loaded
