"""What is made before a track, each option declared once (see `kinemode.request`): rendered clips, clicked keypoints,
cameras by a board, indices and templates of what a body looks like; and batches of tracks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from kinemode.option import about, option
from kinemode.request import USUAL_SUBJECT, ProgressOptions
from kinemode.run_requests import PageOptions

if TYPE_CHECKING:
    from estimator.data.cameras.camera import Camera
    from estimator.synthesis.settings import DetectorSettings, SceneSettings, ViewSettings
    from kinemode.named import Named, PathLike
    from kinemode.request import CameraName, Direction, OutPath, SubjectLike

    Scales = Mapping[str, float] | None
    FleshShape = Mapping[int | str, Sequence[float]] | None
    SceneLike = SceneSettings | None
    ViewLike = ViewSettings | None
    ErrorsLike = DetectorSettings | None
    BoardSize = str | tuple[int, int]
    Rig = PathLike | Mapping[str, Camera]
    LimbNames = str | Sequence[str]
    Formats = str | Iterable[str]
    Rows = PathLike | Sequence[Mapping[str, Any]]

_WITH_FLESH = "A subject with flesh: a built-in name (see `kinemode subjects`) or a URDF."
_REPLACES = "Replace the file if it is there."


@dataclass(frozen=True, kw_only=True)
class RenderRequest(ProgressOptions):
    """The request of `kinemode.render`."""

    folder: OutPath = field(
        kw_only=False,
        metadata=about(
            "Folder for the files, made if it is not there; files of an earlier clip are replaced.", called="out"
        ),
    )
    motion: PathLike = field(
        default="reach",
        kw_only=False,
        metadata=about(
            "reach, arm, pivot, turn_reach, reach_out, cross_arms, talk; random, smooth, for any subject; a BVH file of"
            " a person; or a csv or npz of the subject's joints over time (columns time and JOINT_deg, JOINT_rad or"
            " JOINT_m, or as exported).",
        ),
    )
    subject: SubjectLike | None = option(
        None,
        "The body in the pictures: a built-in name or a URDF file; the one the motion is made for unless given.",
        python="Or a loaded subject.",
    )
    proportions: Scales = option(None, "Scales of its lengths, see `Subject.scaled`.")
    shape: FleshShape = option(None, "Its flesh then, see `Subject.reshaped`.")
    girth: float = option(1.0, "Factor on the cross-sections of its limbs.", low=0.5, high=1.6)
    scene: SceneLike = option(None, "Looks (`kinemode.SceneSettings`); those that suit the motion unless given.")
    view: ViewLike = option(None, "Cameras (`kinemode.ViewSettings`); those that suit the motion unless given.")
    detector: ErrorsLike = option(None, "Errors of the keypoints (`kinemode.DetectorSettings`).")
    fps: float = option(30.0, "Frames per second.", low=1.0, high=1000.0)
    seconds: float | None = option(None, "Only so much of the motion; 4 of a random one unless given.")
    unit: float | None = option(None, "Metres in one unit of the BVH file, where it is known.")
    up: Direction = option(
        None, "The axis of the BVH file that points up: x, y, z, -x, -y or -z. It is found unless given."
    )
    seed: int = option(
        0, "Seed of a random motion, the scene, the clothes, the sensor's noise and the keypoints' errors.", low=0
    )
    videos: bool = option(True, "False leaves the pictures out.")
    masks: bool = option(False, "Also write the person's exact silhouettes.")
    depths: bool = option(
        False, "Also write the exact depth of every pixel, as 16-bit PNG in millimetres.", called="depth"
    )


@dataclass(frozen=True, kw_only=True)
class AnnotateRequest(PageOptions):
    """The request of `kinemode.annotate`."""

    clip: PathLike = field(kw_only=False, metadata=about("A video file or a folder of images."))
    frame: int = option(0, "The frame shown first; the page goes to the others.")
    subject: SubjectLike = option(
        USUAL_SUBJECT, "A built-in name (see `kinemode subjects`) or a URDF file: whose landmarks are clicked."
    )
    camera: CameraName | None = option(None, "Name of the view, where it is not the clip's stem.")
    keypoints: PathLike | None = option(
        None, "A detector's keypoint file or folder to correct: it fills the frames without a click."
    )
    out: OutPath = option(Path("clicks.json"), "The keypoint file to write; one saved earlier is edited further.")


@dataclass(frozen=True, kw_only=True)
class BoardRequest(ProgressOptions):
    """The request of `kinemode.calibrate`."""

    pictures: Named = field(
        kw_only=False,
        metadata=about(
            "Of each camera a video or a folder of pictures, by its name (`NAME=PATH` or a mapping); picture files"
            " without a name are one camera's, called as their folder is."
        ),
    )
    board: Literal["chessboard", "charuco"] = option("chessboard", "What the board is.")
    size: BoardSize = option("9x6", "Columns by rows: inner corners of a chessboard, squares of a ChArUco board.")
    square: float = field(metadata=about("Side of a square in metres."))
    marker: float | None = option(
        None, "Side of a ChArUco marker in metres; three quarters of the square unless given."
    )
    dictionary: str = option("4X4_50", "Of the ChArUco markers, as OpenCV calls it without DICT_.")
    lens: Literal["brown", "rational", "fisheye"] = option(
        "brown", "brown has OpenCV's 5 coefficients, rational 8, fisheye the 4 of its fisheye model."
    )
    origin: int | None = option(
        None,
        "Number of the pictures, from 0, in which the board makes the world: origin at its first inner corner (of a"
        " ChArUco board at its outer one), x along the columns, z out of its face, so up where it lies on the floor. Of"
        " several cameras the pictures in which most see it unless given.",
        python="A single camera then stands as one without a calibration does.",
        low=0,
    )
    out: OutPath | None = option(None, "The camera file to write.")
    picture: OutPath | None = option(
        None, "A picture to write, with corners and how far they are from where they should be."
    )


@dataclass(frozen=True, kw_only=True)
class IndexRequest(ProgressOptions):
    """The request of `kinemode.train_index`."""

    subject: SubjectLike = field(
        kw_only=False,
        metadata=about(_WITH_FLESH, python="Or loaded."),
    )
    out: OutPath = field(kw_only=False, metadata=about("The file to write."))
    examples: int = option(60_000, "How many.", low=1)
    headings: float = option(
        360.0,
        "Range of the body's heading about facing the camera, in degrees; 120 for people who never turn away.",
        low=0.0,
        high=360.0,
        unit="degrees",
    )
    legs: bool = option(False, "Legs move too, as far as their rest positions let them.")
    elevation: float = option(8.0, "Downward pitch of the camera.", low=-10.0, high=60.0, unit="degrees")
    seed: int = option(0, "Seed of poses, clothes and light.", low=0)
    workers: int = option(1, "How many processes share the work; the index is the same with any number.")
    overwrite: bool = option(False, _REPLACES)


@dataclass(frozen=True, kw_only=True)
class TemplatesRequest(ProgressOptions):
    """The request of `kinemode.train_templates`."""

    cameras: Rig = field(
        kw_only=False,
        metadata=about(
            "Calibration of the rig; templates suit these cameras, where they stand now, in this order.",
            python="The path of a camera file, or cameras by name.",
        ),
    )
    out: OutPath = field(kw_only=False, metadata=about("The file to write."))
    subject: SubjectLike = option(USUAL_SUBJECT, _WITH_FLESH, python="Or loaded.")
    limbs: LimbNames = option(
        (),
        "Names of the limbs to detect, with commas between; those of the other side come with them. All unless given.",
    )
    poses: int = option(1500, "Number of painted pictures.", low=1)
    seed: int = option(0, "Seed of poses, places, clothes and light.", low=0)
    overwrite: bool = option(False, _REPLACES)


@dataclass(frozen=True, kw_only=True)
class BatchRequest(ProgressOptions):
    """The request of `kinemode.batch`."""

    manifest: Rows = field(
        kw_only=False,
        metadata=about(
            "A CSV or TOML file, a row for each clip: name, clips, keypoints, cameras, subject, person, detect, and any"
            " other option of `track`.",
            python="Or a mapping for each clip, see `kinemode.batches.manifest.read_manifest`.",
        ),
    )
    out: OutPath = field(metadata=about("The folder for everything, with summary.csv and index.html."))
    engine: Literal["processes", "dask"] = option(
        "processes", "processes of this machine, or dask: the workers of a scheduler that runs already."
    )
    workers: int | None = option(None, "How many processes, each with one thread; by default one per processor.")
    scheduler: str | None = option(
        None,
        "Address of Dask's scheduler, as tcp://192.168.0.5:8786.",
        python="Its workers see the clips under the same paths; where they do not see `out` their files are sent.",
    )
    export: Formats = option((), "Formats for every clip with commas between them, see `export`.")
    report: bool = option(False, "Write a report of every clip.")
