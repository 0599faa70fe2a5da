"""The commands that make input: rendered clips and clicked keypoints."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from kinemode.flags import Files, Flag, flags_of
from kinemode.making_requests import AnnotateRequest, RenderRequest
from kinemode.request import DetectRequest


def demo(*, out: Path = Path("demo-out"), seed: int = 0, occlusion: Flag = False, index: Path | None = None) -> None:
    """Render a short clip with known motion, track it from one camera, and show the errors.

    Writes overlay.mp4, preview.html and contact_sheet.png.

    For example:

    kinemode demo --out demo-out

    kinemode demo --occlusion --out occlusion-out

    Parameters
    ----------
    out
        Folder for the clip, the run and the pictures.
    seed
        Seed of the tracker's random numbers.
    occlusion
        Instead: a screen hides the person for a while, who is found again by depth and an index of examples, no pose
        given; writes overlay.mp4 and contact_sheet.png.
    index
        With --occlusion: the index of examples of human34; a small one is made in the folder unless given.
    """
    from kinemode.demo import shown

    shown(out, seed, occlusion=occlusion, index=index)


@flags_of(RenderRequest)
def render(
    *,
    background: Literal["room", "textured", "pillar", "black", "moving"] | None = None,
    cameras: int = 1,
    azimuth: float | None = None,
    occluder: Literal["none", "post", "box"] = "none",
    hidden: Files = None,
    sleeves: Literal["short", "long"] = "short",
    boards: int = 0,
    swinging: int = 0,
    noise: float = 2.5,
    shutter: float = 0.0,
    lens_blur: float = 0.0,
    keypoint_noise: float = 2.5,
    outliers: float = 0.01,
    missing: float = 0.02,
    stereo: float = 0.0,
    parallel: Flag = False,
    **given: Any,
) -> None:
    """Render a clip whose motion is known: videos, cameras, keypoints, the exact first frame, the truth, the body.

    For example:

    kinemode render --motion turn_reach --out turn

    kinemode render --motion walk.bvh --cameras 2 --shutter 0.5 --out walk

    kinemode render --motion random --subject arm8 --seconds 3 --out arm

    kinemode render --motion random --subject upper13 --parallel --out upper

    kinemode render --motion reach --background textured --stereo 0.12 --depth --hidden 1.0:2.0 --out pair

    Parameters
    ----------
    background
        What is behind the person; what suits the motion unless given.
    cameras
        How many.
    azimuth
        Of the first camera in degrees, from the person's front to the person's left.
    occluder
        What stands between the first camera and the person.
    hidden
        FROM:TO in seconds: a screen before every camera hides the person from then until before that.
    sleeves
        How far the shirt's go: long ones leave only hands and head bare.
    boards
        So many boards in the colour of skin on the wall.
    swinging
        So many of them that swing behind the person.
    noise
        Of the sensor, in grey values.
    shutter
        Share of the time between frames that the shutter is open: motion blur.
    lens_blur
        Standard deviation of the lens's blur in pixels.
    keypoint_noise
        Standard deviation of the keypoints in pixels.
    outliers
        Share of the keypoints that are far off.
    missing
        Share of the keypoints that are missing.
    stereo
        Metres from every camera to another one to its right, NAME_right, parallel to it; 0 for none. Stereo needs
        --background textured: the walls of the others look the same everywhere.
    parallel
        Parallel (orthographic) cameras: the person looks as large at any distance.
    """
    import kinemode as km

    scene = km.SceneSettings(
        background=background, occluder=occluder, hidden=hidden or (), sleeves=sleeves, boards=boards,
        swinging=swinging, noise=noise, shutter=shutter, lens_blur=lens_blur,
    )  # fmt: skip
    km.render(
        **given,
        scene=scene,
        view=km.ViewSettings(count=cameras, azimuth=azimuth, baseline=stereo, parallel=parallel),
        detector=km.DetectorSettings(keypoint_noise, outliers, missing),
        progress=km.reported,
    )
    print(given["folder"])


@flags_of(DetectRequest, clips=("clip", "Videos or folders of images, each [NAME=]PATH."))
def detect(**given: Any) -> None:
    """Find the keypoints of all people in clips, and write them as keypoint files.

    The detector gets an environment of its own in the cache folder when it is first needed, made by uv, for which a
    network connection is needed. The same command resumes an interrupted one.

    For example:

    kinemode detect walk.mp4 --out walk.json

    kinemode detect cam01.mp4 cam02.mp4 --out keypoints

    kinemode detect walk.mp4 --detector onnx --model rtmpose.onnx --out walk.json
    """
    import kinemode as km

    for path in km.detect(**given, progress=km.reported).values():
        print(path)


@flags_of(AnnotateRequest, arguments=("clip",))
def annotate(**given: Any) -> None:
    """Click a subject's landmarks on frames of a clip, in the browser, and save them as keypoints.

    The page is served on this machine only. Ctrl-C ends it; saved files stay.

    For example:

    kinemode annotate walk.mp4 --out clicks.json

    kinemode annotate walk.mp4 --keypoints walk.json --out corrected.json
    """
    import kinemode as km

    command = km.annotate(**given)
    print(f"{given['out']}\nnext: {command}")
