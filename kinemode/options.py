"""Kinds of options that several commands share, and the manifests of batches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

ClipArgument = Annotated[
    str, Parameter(name="clip", help="Video files or folders of images; none where the keypoints are enough.")
]
PictureArgument = Annotated[str, Parameter(name="clip", help="Video files or folders of images.")]
SubjectOption = Annotated[str, Parameter(help="A built-in name (see `kinemode subjects`) or a URDF file.")]
Files = Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")]
Ids = Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")]


def _no_option(_: object, value: str | None) -> None:
    if value is not None and value.startswith("--"):
        raise ValueError("x, y, z, -x, -y, -z or a direction is needed")


UpOption = Annotated[str | None, Parameter(allow_leading_hyphen=True, validator=_no_option)]
"""An axis, which may begin with a minus."""
Flag = Annotated[bool, Parameter(negative="")]


@Parameter(name="*")
@dataclass(frozen=True)
class DetectorOptions:
    """What finds the keypoints.

    Parameters
    ----------
    detector
        mediapipe (33 keypoints, its models come with it) or onnx (by the file of --model).
    model
        An ONNX file: RTMPose, or another model with a line and a column for each keypoint of one person's picture.
    boxes
        An ONNX file that finds people in a picture, for --detector onnx; without it one person is followed.
    people
        At most so many are followed.
    python
        An interpreter to make the detector's environment with; one that has the packages is taken as it is.
    """

    detector: str = "mediapipe"
    model: Path | None = None
    boxes: Path | None = None
    people: int = 6
    python: Path | None = None

    def arguments(self) -> dict[str, Any]:
        """The options as `kinemode.detect` takes them."""
        return dict(vars(self))


MEDIAPIPE = DetectorOptions()


@Parameter(name="*")
@dataclass(frozen=True)
class InputOptions:
    """What a body is tracked from, and what the files do not say themselves.

    Parameters
    ----------
    cameras
        Calibration of each camera: kinemode's JSON (K, distortion, R, t; `calibrate` writes it), Pose2Sim, Anipose or
        Caliscope TOML, OpenCV YAML, JSON or XML, Kalibr's or EasyMocap's YAML, CMU Panoptic JSON, Qualisys .qca.txt or
        .xml; one camera without it is guessed. auto: several are found from the person, with their clocks.
    keypoints
        2D keypoint files or folders: MediaPipe 33, OpenPose BODY_25 or COCO 18, COCO 17, Halpe 26, `annotate`'s;
        AlphaPose, MMPose, rtmlib, COCO data sets, DeepLabCut csv and h5, SLEAP analysis h5, npy and npz. Names that the
        file does not have, or has in its own words, stand beside it: WALK.names.json for WALK.csv.
    detect
        Find the keypoints of clips without a keypoint file first, as `kinemode detect` does, into OUT.keypoints beside
        the result (compare: into its folder); they are taken from there as long as clip and detector are the same.
    mask
        Videos or folders of masks, white on the person; the background is then not needed.
    background
        Pictures of the empty scene; learned from the clip unless given.
    stereo
        LEFT=RIGHT: two cameras side by side whose clips show depth together, the right one as seen by them second.
    depth
        Folders of depth pictures, one for every frame: 16-bit PNG in millimetres or .npy in metres.
    person
        Which of several people: auto (one camera: the largest, then continuity; several: the person they see
        together), an id of the keypoint files, or CAMERA=ID for some cameras; the others then take the person that
        fits them. With `track` also all: everybody, matched across cameras, into OUT.person1.run, ...
    keypoint_size
        [NAME=]WxH of the pictures that the detector saw, as 960x540, where the keypoint files do not say it.
    keypoint_noise
        [NAME=]PX: standard deviation of keypoints about their places on the body, in pixels of the clip where the
        person is as large as in the middle of it. Unless given it is what detectors of people err, measured anew where
        a person is fitted.
    fps
        [NAME=]RATE in frames per second of the pictures: of folders, of keypoint files that declare none, and of films
        taken at another rate than they are played at, as slow motion.
    offset
        NAME=SECONDS that a camera's first frame was taken after moment 0: above 0 for a camera that started late,
        below for one that started early. What it shows at its own time t belongs to t + SECONDS.
    up
        The axis of the cameras' world that points up: x, y, z, -x, -y or -z, or a direction as 0.1,0.97,0.2. Unless
        it, or the camera file, says so it is found where several cameras see the person stand or walk. The world is
        turned so that z points up; references are of the world of the camera file.
    focal
        Focal length of the one camera without a camera file: 26mm (on 35 mm film, as phones state it), 1400px, or 0.72
        (of the picture's longer side). Unless given the clip's own tags say it, or it is that of most phones.
    phone
        In place of --focal the phone that took it: "iPhone 12 Pro" or iPhone13,3. Its focal length is that of video
        which is neither zoomed nor cropped by stabilisation, as OpenCap has calibrated it.
    lenses
        With --cameras auto a calibration, in any format of --cameras, whose lenses the cameras have, by name; the one
        camera in it serves all. Where they stand is not used.
    floor
        Its height [m] in the cameras' world, along the axis that points up; off where there is none; auto takes the
        camera file's word, or finds it from the feet that stand. Nothing goes below it; one that is given tells a
        single camera how large the person is.
    layout
        What the keypoint files' points are, where their number leaves it open: coco17 or h36m17, body25 or body25b;
        or any other known layout. auto takes the more common one, and says so where another fits much better.
    sync
        auto finds the offsets of cameras that none is given for, from what moves in their keypoints, up to 10 s, and
        their rates where these differ from what is declared, and says how sure they are; what is not sure is refused.
    start
        Begin here, in seconds; frames before it are left out. Or `index`: the first pose comes from an index of
        examples, without keypoints; that takes depth.
    end
        End here, in seconds; frames after it are left out.
    """

    cameras: Path | None = None
    keypoints: Files = None
    detect: Flag = False
    by: DetectorOptions = MEDIAPIPE
    mask: Files = None
    background: Files = None
    stereo: Files = None
    depth: Files = None
    person: Ids = ("auto",)
    keypoint_size: Files = None
    keypoint_noise: Files = None
    fps: Files = None
    offset: Files = None
    sync: Literal["off", "auto"] = "off"
    up: UpOption = None
    layout: str = "auto"
    focal: str | None = None
    phone: str | None = None
    lenses: Path | None = None
    floor: float | Literal["auto", "off"] = "auto"
    start: float | Literal["index"] | None = None
    end: float | None = None

    def arguments(self) -> dict[str, Any]:
        """The options as `kinemode.track`, `fit` and `compare` take them."""
        given = dict(vars(self))
        given["masks"] = given.pop("mask")
        by = given.pop("by")
        if by != MEDIAPIPE and not self.detect:
            import kinemode as km

            raise km.InputError("detector", "has options, but there is nothing to detect", remedy="add --detect")
        given["detect"] = by.arguments() if self.detect else False
        return given


NO_INPUT = InputOptions()


@Parameter(name="*")
@dataclass(frozen=True)
class PointOptions:
    """Points in space that are tracked in place of what cameras see.

    Parameters
    ----------
    points
        In place of clips, keypoints and cameras, points in space: markers of a laboratory or triangulated keypoints, in
        TRC, C3D, npz, npy or csv; several files have points of the same instants. --up is then the axis that points up
        in the file, --fps its rate, where it does not say them.
    markers
        What the points are: a set of markers by name (landmarks, opencap, plug-in-gait, cast), or a TOML file that
        `subjects --markers` has begun; auto takes the subject's own, or the set that knows most of the names.
    unit
        Of length of the points, m, cm or mm, where the file does not say it.
    static
        Points of a trial in which the same person stands upright, all joints about straight, with the same markers: the
        fit then knows the joints' zeros. Joints that are bent there are not taken as known.
    """

    points: Files = None
    markers: str = "auto"
    unit: str | None = None
    static: Files = None

    def arguments(self) -> dict[str, Any]:
        """The options as `kinemode.track` and `fit` take them."""
        return dict(vars(self))


NO_POINTS = PointOptions()


@Parameter(name="*")
@dataclass(frozen=True)
class FromPersonOptions:
    """What cameras are found from, with --from-person, or checked by, with --check.

    Parameters
    ----------
    keypoints
        2D keypoint files of the cameras, as `track` takes them.
    detect
        Find the keypoints of clips without a keypoint file first, into OUT.keypoints beside the result.
    height
        The person's height [m], which makes the metres right; without it an average person is taken.
    focal
        Of all lenses: 26mm (on 35 mm film, as phones state it), 1400px, or 0.72 of the longer side; without it, and
        without tags in the clips, they are found from the person around those of most phones.
    phone
        In place of --focal the phone that took all clips: "iPhone 12 Pro" or iPhone13,3.
    lenses
        A calibration, in any format of `track --cameras`, whose lenses the cameras have, by name; the one camera in it
        serves all. Where they stand is not used.
    offset
        NAME=SECONDS that a camera's first frame was taken after moment 0; clocks are found unless all but one are said.
    sync
        With --check: auto finds the clocks from the motion, off takes them as they are told.
    person
        Which of several people, see `track`.
    keypoint_size
        [NAME=]WxH: size of the pictures that the detector saw, where the files do not say it.
    fps
        [NAME=]RATE: frames per second of the pictures, see `track`.
    """

    keypoints: Files = None
    detect: Flag = False
    height: float | None = None
    focal: str | None = None
    phone: str | None = None
    lenses: Path | None = None
    offset: Files = None
    sync: Literal["off", "auto"] = "off"
    person: Ids = ("auto",)
    keypoint_size: Files = None
    fps: Files = None

    def arguments(self) -> dict[str, Any]:
        """The options as `kinemode.calibrate_from_person` takes them; raises InputError for one of a check."""
        return self._without(("sync",), "is for --check: clocks are found, or given with --offset")

    def of_check(self) -> dict[str, Any]:
        """The options as `kinemode.check_cameras` takes them; raises InputError for one of cameras that are found."""
        return self._without(("height", "focal", "phone", "lenses"), "is of cameras that are found")

    def _without(self, names: Sequence[str], problem: str) -> dict[str, Any]:
        import kinemode as km

        for name in names:
            if getattr(self, name) != getattr(NO_PERSON, name):
                raise km.InputError(f"--{name}", problem, remedy="leave it out")
        return {name: value for name, value in vars(self).items() if name not in names}


NO_PERSON = FromPersonOptions()


@Parameter(name="*")
@dataclass(frozen=True)
class TrackerOptions:
    """What is tracked, by what, and how.

    Parameters
    ----------
    cues
        What the pictures are looked at for: off, or some of what `kinemode cues` lists, with commas between them; auto
        takes all of them where less than half of the frames have keypoints, or where there is depth.
    settings
        A TOML file of settings, see `kinemode settings`; a tracker takes those that are about it.
    modes
        How many hypotheses are kept, by trackers that keep several; unless given the tracker's own number, see
        `kinemode settings --tracker NAME`.
    seed
        Seed of the tracker's random numbers; the same seed gives the same run.
    fit
        auto fits a built-in subject to the person in pieces of the clip: the proportions, and the flesh where edges or
        silhouettes are looked at; a file is taken as measured. proportions leaves the flesh, off everything as it is.
        With --points lengths and the places of markers are fitted together (auto, markers).
    height
        The person's height [m], where it is known: one camera does not see how large somebody is.
    index
        Index of examples in which poses are looked up, see `train-index`: by elmo and psh, for the first pose with
        --start index, and by css beside its other starts. Where one is needed, that of the subject in the cache unless
        given, which is made when it is first needed.
    """

    subject: SubjectOption = "human34"
    cues: str = "auto"
    settings: Path | None = None
    modes: int | None = None
    seed: int = 0
    fit: Literal["auto", "proportions", "markers", "off"] = "auto"
    height: float | None = None
    index: Path | None = None

    def arguments(self) -> dict[str, Any]:
        """The options but the subject, as `kinemode.track` and `compare` take them."""
        return {name: value for name, value in vars(self).items() if name != "subject"}


USUAL = TrackerOptions()
