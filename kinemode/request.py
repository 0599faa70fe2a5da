"""The options of `track`, `fit`, `compare`, `live` and what goes with them: each is declared here, once.

A request holds a user's options as written. From its fields come the keyword arguments of the functions of
`kinemode` and what checks and documents them (`kinemode.option`), the flags of the command line (`kinemode.flags`), the
columns of a batch's manifest (`kinemode.batches.columns`), what a run keeps of its request, the command in its report
and the reference pages. A new option is a field here; the rest of the work is to use it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, cast

from kinemode.named import kept
from kinemode.option import about, again, option
from kinemode.progress import unreported

if TYPE_CHECKING:
    import numpy as np

    from estimator.data.cameras.camera import Camera
    from estimator.retargeting.source import SourceMotion
    from estimator.runs.reference_motion import Reference
    from estimator.runs.run_reader import Run
    from humanoid.subject.subject import Subject
    from kinemode.kinds import KeypointSource
    from kinemode.named import Named, PathLike
    from kinemode.progress import Reporter

    SubjectLike = Subject | PathLike
    Pictures = np.ndarray | Iterable[np.ndarray]
    Clips = Named | Pictures | Mapping[str, PathLike | Pictures]
    Keypoints = Named | np.ndarray | Mapping[str, PathLike | np.ndarray]
    Pairs = str | Iterable[str] | Mapping[str, str] | None
    Persons = str | int | Iterable[str] | Mapping[str, str | int]
    MarkersLike = PathLike
    OutPath = PathLike  # to write; any os.PathLike will do
    CameraName = str
    Cameras = PathLike | Mapping[str, Camera] | None
    Sizes = str | tuple[int, int] | Iterable[str] | Mapping[str, str | tuple[int, int]] | None
    Rates = float | str | Iterable[str] | Mapping[str, float] | None
    Offsets = str | Iterable[str] | Mapping[str, float] | None
    Changes = Mapping[str, Any] | PathLike | None
    Layout = str | Sequence[str]
    CueNames = str | Iterable[str]  # by commas on the command line
    Names = str | Iterable[str]
    Direction = str | None
    ReferenceLike = Reference | PathLike | None
    MotionLike = Run | SourceMotion | PathLike
    Size = tuple[int, int] | None
    Jitter = float | Mapping[str, float] | None
    Device = int | PathLike
    KeypointsOrSource: TypeAlias = "PathLike | KeypointSource | None"
    Ready = Callable[[str], None]

AUTO, OFF, ALL, BY_INDEX = "auto", "off", "all", "index"
CLIP, KEYPOINTS, MASK, BACKGROUND, DEPTH = "clip", "keypoint file", "mask", "background", "depth folder"
POINTS = "file of points"
USUAL_SUBJECT = "human34"


@dataclass(frozen=True)
class SubjectOptions:
    """Options of the tracked person."""

    subject: SubjectLike = field(metadata=about("A loaded subject, a built-in name (`kinemode subjects`) or a URDF."))


@dataclass(frozen=True)
class ClipOptions:
    """The clips."""

    clips: Clips = option(
        None,
        "Videos or folders of images, each [NAME=]PATH; none where the keypoints are enough. NAME picks the camera and"
        " is the file's stem by default.",
        python="Also a mapping by name, and images that a program has: an array (T, H, W, 3) uint8 BGR or an iterator"
        " of (H, W, 3). They are kept as files until the call ends, or with the run where `out` is not given.",
        files=CLIP,
    )

    @property
    def clip_files(self) -> Named:
        """The clips, which are files once `kinemode.inputs.arrays.Spool` has written those that are not."""
        return cast("Named", self.clips)


@dataclass(frozen=True, kw_only=True)
class DetectorOptions:
    """Options of the keypoint detector."""

    detector: str = option(
        "mediapipe", "What finds the keypoints: mediapipe (33 keypoints; it brings its models) or onnx (with --model)."
    )
    model: PathLike | None = option(
        None,
        "An ONNX file: RTMPose, or another model of one person's picture whose outputs have a row and a column for each"
        " keypoint (SimCC).",
    )
    boxes: PathLike | None = option(
        None, "An ONNX file that finds people in a picture, for --detector onnx; without it one person is followed."
    )
    people: int = option(6, "How many people are followed at most.", low=1)
    python: PathLike | None = option(
        None, "The Python interpreter for the detector's environment; one that has its packages is used unchanged."
    )


@dataclass(frozen=True, kw_only=True)
class KeypointOptions:
    """Keypoints and what their files do not have."""

    keypoints: Keypoints = option(
        None,
        "2D keypoint files or folders, each [NAME=]PATH: MediaPipe 33, OpenPose BODY_25 or COCO 18, COCO 17, Halpe 26,"
        " `kinemode annotate`; AlphaPose, MMPose, rtmlib, COCO data sets, DeepLabCut csv and h5, SLEAP analysis h5, npy"
        " and npz. Names of keypoints that a file lacks go beside it: WALK.names.json for WALK.csv. With cues one frame"
        " is enough.",
        python="Also arrays (T, K, 2) of x, y [px] or (T, K, 3) with confidences, NaN where missing.",
        files=KEYPOINTS,
    )
    detect: bool = option(
        False,
        "First find the keypoints of clips that have no keypoint file, as `kinemode detect` does. They are kept in the"
        " folder OUT.keypoints beside the result, and used again while clip and detector stay the same.",
    )
    layout: Layout = option(
        AUTO,
        "What the keypoints of a file are where their number leaves it open: coco17 or h36m17, body25 or body25b, or"
        " any other known layout. auto takes the more common one and warns where another fits much better.",
        python="Of arrays also a name for each keypoint.",
    )
    person: Persons = option(
        AUTO,
        "Which of several people: auto (with one camera the largest at first; with several the person they all see), an"
        " id of the keypoint files, or CAMERA=ID for some cameras, while the others use the matching person. With"
        " `track` also all: everyone, matched across cameras, each with a run of their own (OUT.person1.run, ...).",
    )
    keypoint_size: Sizes = option(
        None,
        "[NAME=]WxH: size in pixels of the images that the detector saw, as 960x540, where the keypoint files do not"
        " give it and it is not the clip's.",
    )
    fps: Rates = option(
        None,
        "[NAME=]RATE in frames per second: of folders of images, of keypoint files and points that declare none, and of"
        " films recorded at another rate than they declare, such as slow motion.",
        low=0.5, high=2000.0, unit="frames per second",
    )  # fmt: skip
    offset: Offsets = option(
        None,
        "NAME=SECONDS by which a camera's first frame is later than time 0: above 0 for a camera that started late."
        " What it shows at its own time t belongs to t + SECONDS.",
    )

    @property
    def keypoint_files(self) -> Named:
        """The keypoints, which are files as clips are."""
        return cast("Named", self.keypoints)


@dataclass(frozen=True, kw_only=True)
class LensOptions:
    """Lenses of cameras without a calibration."""

    focal: str | None = option(
        None,
        "Focal length of cameras that no file describes: 26mm (35 mm equivalent, as phones state it), 1400px, or 0.72"
        " (of the image's longer side). By default the clip's tags are used, else that of most phones.",
    )
    phone: str | None = option(
        None,
        'In place of --focal the phone that recorded the clip: "iPhone 12 Pro" or iPhone13,3. The focal lengths are'
        " OpenCap's calibrations of video that is neither zoomed nor cropped by stabilisation.",
    )
    lenses: Cameras = option(
        None,
        "With --cameras auto: a camera file (any format of --cameras) for the cameras' lenses, by name, or one camera"
        " for all. Where its cameras stand is not used.",
    )


@dataclass(frozen=True, kw_only=True)
class SyncOptions:
    """Clocks of several cameras."""

    sync: Literal["off", "auto"] = option(
        OFF,
        "auto finds the offsets of cameras that have none, up to 10 s, from the motion of their keypoints, and their"
        " frame rates where these differ from the declared ones. It reports how certain they are, and refuses"
        " uncertain ones.",
    )


@dataclass(frozen=True, kw_only=True)
class HeightOptions:
    """Options of the person's height."""

    height: float | None = option(
        None,
        "Height of the person in metres, where it is known: one camera does not determine it.",
        low=0.5, high=2.5, unit="m",
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class CameraOptions:
    """The cameras, their world, and what goes with their images."""

    cameras: Cameras = option(
        None,
        "Calibration of each camera: kinemode's JSON (`kinemode calibrate` writes it), Pose2Sim, Anipose or Caliscope"
        " TOML, OpenCV YAML, JSON or XML, Kalibr's or EasyMocap's YAML, CMU Panoptic JSON, Qualisys .qca.txt or .xml."
        " One camera without a calibration is guessed. auto finds several cameras, with their clocks, from the person.",
    )
    mask: Named = option(
        None,
        "Videos or folders of masks, each [NAME=]PATH, white on the person; no background is needed then.",
        files=MASK,
    )
    background: Named = option(
        None, "Images of the empty scene, each [NAME=]PATH; learned from the clip by default.", files=BACKGROUND
    )
    stereo: Pairs = option(
        None, "LEFT=RIGHT: two cameras side by side whose clips show depth together; RIGHT as seen by the cameras."
    )
    depth: Named = option(
        None,
        "Folders of depth images, each [NAME=]PATH, one for every frame: 16-bit PNG in millimetres or .npy in metres.",
        files=DEPTH,
    )
    keypoint_noise: Rates = option(
        None,
        "[NAME=]PX: standard deviation of keypoints about their places on the body, in pixels of the clip where the"
        " person is as large as in the middle of it. By default that of common detectors, measured where a person is"
        " fitted.",
        low=0.1, high=1000.0, unit="pixels",
    )  # fmt: skip
    up: Direction = option(
        None,
        "The axis of the cameras' world, or of points, that points up: x, y, z, -x, -y or -z, or a direction such as"
        " 0.1,0.97,0.2. By default the file's own, or found where several cameras see the person stand or walk. The"
        " world is turned so that z points up; references are in the world of the camera file.",
    )
    floor: float | Literal["auto", "off"] = option(
        AUTO,
        "Height of the floor in metres in the cameras' world, along the axis that points up; off for none. auto uses"
        " the camera file's, or finds it from the standing feet. Nothing of the body goes below it; a given one also"
        " shows a single camera how large the person is.",
        low=-1000.0, high=1000.0, unit="m",
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class PartOptions:
    """The part of a clip that is tracked."""

    start: float | Literal["index"] | None = option(
        None,
        "Start of the tracked part in seconds; earlier frames are left out. Or index: start with the first frame, whose"
        " pose comes from an index of examples instead of keypoints, which takes depth.",
    )
    end: float | None = option(None, "End of the tracked part in seconds; later frames are left out.")


@dataclass(frozen=True, kw_only=True)
class FileOptions(
    HeightOptions, DetectorOptions, LensOptions, SyncOptions, PartOptions, CameraOptions, KeypointOptions, ClipOptions
):
    """The input of tracking, and what the files lack."""

    def __post_init__(self) -> None:
        for name in ("mask", "background", "depth", "stereo"):
            if hasattr(given := getattr(self, name), "__next__"):  # a generator can be read once
                object.__setattr__(self, name, kept(given))
        if isinstance(self.cameras, (str, Path)) and str(self.cameras) == AUTO:
            object.__setattr__(self, "cameras", AUTO)

    @property
    def world_given(self) -> bool:
        """Whether cameras are given that stand in a world which others, as a reference, may share."""
        return self.cameras is not None and self.cameras != AUTO

    @property
    def begins_by_index(self) -> bool:
        """Whether the first pose comes from an index of examples."""
        return self.start == BY_INDEX


@dataclass(frozen=True, kw_only=True)
class PointOptions:
    """Points in space that are tracked in place of what cameras see."""

    points: Named = option(
        None,
        "In place of clips, keypoints and cameras: files of points in space, such as a laboratory's markers or"
        " triangulated keypoints, in TRC, C3D, npz, npy or csv; several have points of the same instants. --up and"
        " --fps are then of these files.",
        files=POINTS,
    )
    markers: MarkersLike = option(
        AUTO,
        "What the points are: a marker set by name (landmarks, opencap, plug-in-gait, cast), or a TOML file that"
        " `kinemode subjects --markers` writes; auto uses the subject's own markers, or the set with most names.",
    )
    unit: str | None = option(None, "Unit of length of the points, m, cm or mm, where the file does not give it.")
    static: Named = option(
        None,
        "Points of a trial in which the same person stands upright, all joints about straight, with the same markers:"
        " the fit then knows the joints' zeros. Joints that are bent there are not used.",
        files=POINTS,
    )


@dataclass(frozen=True, kw_only=True)
class InputOptions(PointOptions, FileOptions):
    """Options of the tracking input."""


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """Common options of fit and track."""

    cues: CueNames = option(
        AUTO,
        "Image cues to use: off, or some of what `kinemode cues` lists, separated by commas. auto uses them where less"
        " than half of the frames have keypoints, or where there is depth: then without colour and anchors.",
    )
    seed: int = option(0, "Seed of the random numbers; equal seeds give equal results.", low=0)


@dataclass(frozen=True, kw_only=True)
class SearchOptions(FitOptions):
    """Options of the search of poses."""

    settings: Changes = option(
        None,
        "Changes to the tracker's settings: a TOML file as `kinemode settings` writes it. A tracker uses those that"
        " concern it; those of cost, search and cues also reach the fit.",
        python="Or a nested mapping, see `estimator.tracking.registry`.",
    )
    modes: int | None = option(
        None, "How many hypotheses are kept, by trackers that keep several; by default the tracker's own number."
    )
    index: PathLike | None = option(
        None,
        "Index of examples in which poses are looked up, see `kinemode train-index`: by elmo and psh, for the first"
        " pose with --start index, and by css beside its other starts. Where one is needed, the subject's own in the"
        " cache by default, which is made at first use.",
    )


@dataclass(frozen=True, kw_only=True)
class MethodOptions(SearchOptions):
    """Options of tracking a clip."""

    fit: Literal["auto", "proportions", "markers", "off"] = option(
        AUTO,
        "auto fits a built-in subject to the person, from parts of the clip: its proportions, and its flesh where edges"
        " or silhouettes are used (CSS section 5). A URDF file is used as measured. proportions leaves the flesh as it"
        " is, off everything. With points, lengths and places of markers are fitted (auto or markers).",
    )


@dataclass(frozen=True, kw_only=True)
class TrackerOptions:
    """The tracker and its options."""

    tracker: str | None = option(None, "The tracker, see `kinemode trackers`; css by default, markers with points.")


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Where a result goes."""

    out: OutPath | None = option(
        None,
        "Where the result is written.",
        python="By default a temporary file, removed with the last `Run` of it.",
        kept=False,
    )
    resume: bool = option(False, "Continue an interrupted result.", kept=False)
    overwrite: bool = option(False, "Replace an existing result.", kept=False)


@dataclass(frozen=True, kw_only=True)
class ProgressOptions:
    """Options of progress reports."""

    progress: Reporter | None = option(
        None, "Opens a progress report for each stage, such as `kinemode.reported`; none by default.", kept=False
    )

    @property
    def reporter(self) -> Reporter:
        """The progress reporter."""
        return self.progress or unreported


@dataclass(frozen=True, kw_only=True)
class TrackRequest(ProgressOptions, RunOptions, MethodOptions, TrackerOptions, InputOptions, SubjectOptions):
    """The request of `kinemode.track`."""


@dataclass(frozen=True, kw_only=True)
class FitRequest(ProgressOptions, FitOptions, InputOptions, SubjectOptions):
    """The request of `kinemode.fit`."""

    out: OutPath | None = option(None, "The URDF file to write.", kept=False)


@dataclass(frozen=True, kw_only=True)
class CompareRequest(ProgressOptions, RunOptions, MethodOptions, FileOptions, SubjectOptions):
    """The request of `kinemode.compare`."""

    out: OutPath = field(
        metadata=about("Folder for the runs (NAME.run), compare.csv, compare.json and compare.png.", kept=False)
    )
    trackers: Names = field(
        metadata=about("Names of the trackers, or one text with commas between them, see `kinemode trackers`.")
    )
    reference: ReferenceLike = option(
        None,
        "Known 3D landmarks, see `kinemode evaluate`, in the world of the camera file: the table then has errors, and"
        " where each tracker lost the person.",
    )


@dataclass(frozen=True, kw_only=True)
class DetectRequest(ProgressOptions, DetectorOptions, ClipOptions):
    """The request of `kinemode.detect`."""

    out: OutPath = field(
        metadata=about(
            "The file of one clip; of several clips, or where it is a folder, the folder for NAME.json.", kept=False
        )
    )
    overwrite: bool = option(False, "Replace existing files.", kept=False)


@dataclass(frozen=True)
class _Motion:
    source: MotionLike = field(
        metadata=about(
            "The motion to follow: a run, BVH, points with landmarks' names (TRC, C3D, npz, csv), or an npz of joints"
            " in the order of SMPL or of another program.",
            python="Or landmarks that a program has (`SourceMotion`).",
        )
    )
    subject: SubjectLike = field(metadata=about("The body to move: a built-in name (`kinemode subjects`) or a URDF."))


@dataclass(frozen=True, kw_only=True)
class RetargetRequest(ProgressOptions, _Motion):
    """The request of `kinemode.retarget`."""

    match: PathLike | None = option(
        None,
        "A TOML file of which limbs and landmarks correspond; by default those with equal names. `kinemode retarget"
        " --match SUBJECT` writes a template.",
    )
    contacts: PathLike | None = option(
        None,
        "A csv of when points of the source's feet stand, as `kinemode contact` writes it; found by default from how"
        " fast and how high they are.",
    )
    method: Literal["windows", "frames"] = option(
        "windows", "windows: all frames, in windows. frames: each from the one before, faster and less smooth."
    )
    velocity: float = option(1.0, "Share of the URDF's velocity limits that may be used.")
    clearance: float = option(0.002, "Metres that parts of the body keep from each other.")
    fps: float | None = option(None, "Frames per second of the source, where its file does not give them.")
    up: Direction = option(None, "The axis of the source that points up, where its file does not give it.")
    unit: str | None = option(None, "Unit of length of points, m, cm or mm, where the file does not give it.")
    layout: str | None = option(
        None,
        "The order of joints that have no names: smpl, lafan1, kinect25, h36m17, ...; by default found by the limbs'"
        " lengths.",
    )
    modes: int = option(
        0,
        "How many of a run's other hypotheses in each frame are carried through, the heaviest, so that the motion has a"
        " spread; each is searched from the motion, frame by frame.",
        low=0,
    )
    seed: int = option(
        0,
        "Seed of the random configurations that the first frame is searched from; equal seeds give motions that are"
        " equal to some 1e-4 rad, since the solver's last digits depend on the memory.",
        low=0,
    )
    out: OutPath | None = option(
        None,
        "The run file.",
        python="By default a temporary file, removed with the last `Run` of it.",
        kept=False,
    )
    overwrite: bool = option(False, "Replace an existing run file.", kept=False)


@dataclass(frozen=True, kw_only=True)
class RigRequest(ProgressOptions, DetectorOptions, LensOptions, HeightOptions, KeypointOptions, ClipOptions):
    """The request of `kinemode.calibrate_from_person`."""

    subject: SubjectLike = option(USUAL_SUBJECT, "Whose landmarks and lengths the person has.")
    out: OutPath | None = option(None, "The camera file to write; its world has z up and the floor about 0.")
    picture: OutPath | None = option(
        None,
        "A PNG to write: the cameras with the person from above and from the side, and how far keypoints are from where"
        " the points of all cameras are seen.",
    )


@dataclass(frozen=True, kw_only=True)
class _CheckedCameras:
    cameras: Cameras = field(metadata=about("The camera file to check, or cameras by name."), kw_only=False)


@dataclass(frozen=True, kw_only=True)
class CheckRequest(ProgressOptions, DetectorOptions, SyncOptions, KeypointOptions, ClipOptions, _CheckedCameras):
    """The request of `kinemode.check_cameras`."""

    subject: SubjectLike = option(USUAL_SUBJECT, "Whose landmarks the person has; the cameras determine the size.")


@dataclass(frozen=True, kw_only=True)
class StreamOptions(SearchOptions):
    """Options of frame-by-frame tracking."""

    cameras: Cameras = option(None, "A camera file, in any format of `kinemode track`.", python="Or cameras by name.")
    layout: Layout = again(KeypointOptions, "layout")
    cues: CueNames = option(OFF, "Image cues to use: off, or some of what `kinemode cues` lists, separated by commas.")
    tracker: str = option("css", "The tracker, see `kinemode trackers`.")
    lag: int = option(
        0, "Frames by which results are late, each smoothed with those that came since.", low=0, unit="frames"
    )
    floor: float | Literal["auto", "off"] = option(
        AUTO,
        "With a lag: height of the floor in metres in the cameras' world, along the axis that points up, which nothing"
        " of what is smoothed goes below; off for none. auto uses the camera file's; none is found in a stream.",
        low=-1000.0, high=1000.0, unit="m",
    )  # fmt: skip


@dataclass(frozen=True)
class _Frames:
    subject: SubjectLike = field(metadata=about("Who is tracked, used as measured; `kinemode.fit` fits one."))
    camera: Camera | None = option(None, "The one camera, a `kinemode.Camera`.")


@dataclass(frozen=True, kw_only=True)
class StepRequest(StreamOptions, _Frames):
    """The request of `kinemode.Tracker`."""

    image_size: Size = option(
        None, "Without camera and cameras: width and height [px] of the keypoints' images, from which one is guessed."
    )
    background: Named = option(
        None, "An image of the empty scene for the silhouette, or a mapping by camera.", files=BACKGROUND
    )
    jitter: Jitter = option(
        None,
        "How much the keypoints tremble [px], a number or a mapping by camera; `run.observation(0).jitter` has what"
        " `kinemode.track` measured in a whole clip. By default it is measured in the last frames, 150 at most.",
    )


@dataclass(frozen=True)
class _Source:
    source: Device = option(
        0, "The number of a camera of this machine, or a clip, which is played at its own frame rate."
    )


@dataclass(frozen=True, kw_only=True)
class LiveRequest(StreamOptions, DetectorOptions, _Source):
    """The request of `kinemode.live`."""

    keypoints: KeypointsOrSource = option(
        None,
        "A keypoint file of the clip, which is played back. By default a detector finds the largest person.",
        python="Also a function of an image (H, W, 3) uint8 BGR and its time [s] that returns keypoints (K, 3), x, y"
        " [px] and confidence, or None.",
    )
    subject: SubjectLike = option(USUAL_SUBJECT, "Who is tracked, used as measured; `kinemode fit` fits one.")
    camera: str | None = option(None, "The camera's name in the camera file, where it is not the clip's.")
    background: PathLike | None = option(None, "An image of the empty scene, for the silhouette.")
    realtime: bool = option(True, "Drop images that come while another is tracked; without it all of a clip are used.")
    out: OutPath | None = option(None, "The run file, complete at the end; its poses are not smoothed.", kept=False)
    overwrite: bool = option(False, "Replace an existing run file.", kept=False)
    show: bool = option(True, "Show a preview.", kept=False)
    port: int = option(0, "Port of the preview, on this machine alone; 0 takes a free one.", low=0, kept=False)
    browser: bool = option(True, "Open the preview; otherwise its address is printed.", kept=False)
    ready: Ready | None = option(None, "Called with the preview's address, which is then not printed.", kept=False)
