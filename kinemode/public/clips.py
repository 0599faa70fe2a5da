"""`render` and `annotate`: clips with known truth, and keypoints by hand."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from kinemode.checks import check_exists
from kinemode.making_requests import AnnotateRequest, RenderRequest
from kinemode.option import takes
from kinemode.target import check_folder

if TYPE_CHECKING:
    from kinemode.shot import RenderedClip


@takes(RenderRequest)
def render(request: RenderRequest) -> RenderedClip:
    """Render a motion into a folder: a clip whose truth is known.

    Parameters
    ----------
    OPTIONS

    Returns the paths of the files: videos, keypoints, cameras, the true motion, the body (see `RenderedClip`).

    Raises
    ------
    InputError: a choice that does not exist, a body that the motion does not suit, a folder that cannot be written.
    """
    if Path(request.motion).suffix.lower() in (".bvh", ".csv", ".npz"):
        check_exists(request.motion)
    from kinemode.rendering import render_clip

    return render_clip(request)


@takes(AnnotateRequest)
def annotate(request: AnnotateRequest) -> str:
    """Serve a page on which a person clicks the subject's landmarks, until the page is closed.

    Parameters
    ----------
    OPTIONS

    Returns the command that tracks from the clicks.

    Raises
    ------
    InputError: anything that is wrong with the input.
    KeyboardInterrupt: on Ctrl-C, with what is finished by then.
    """
    for path in (request.clip, *([] if request.keypoints is None else [request.keypoints])):
        check_exists(path)
    check_folder(Path(request.out))
    from kinemode.annotation.annotate import serve_annotation

    return serve_annotation(request)
