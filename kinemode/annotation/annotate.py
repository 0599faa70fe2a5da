"""Clicking a subject's landmarks on the frames of a clip, in the browser of this machine."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable
from pathlib import Path

from estimator.data.media.clip import Clip
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Subject, load_subject
from humanoid.support.errors import InputError
from kinemode.annotation.clicks import corrected_from, inside_only, load_clicks, no_clicks
from kinemode.annotation.server import AnnotationServer
from kinemode.annotation.session import Annotation, landmark_guide
from kinemode.making_requests import AnnotateRequest
from kinemode.notices import warn
from kinemode.terminal.program import command


def serve_annotation(request: AnnotateRequest, ready: Callable[[AnnotationServer], None] | None = None) -> str:
    """The work of `kinemode.annotate` after its options are checked.

    ready: called with the server before it serves; its address is printed unless this is given.
    """
    keypoints, out = request.keypoints, Path(request.out)
    session = _session(Path(request.clip), request.subject, request.frame, request.camera, keypoints, out)
    try:
        with AnnotationServer(session, request.port) as server:
            if ready is None:
                print(f"{server.address} shows frame {request.frame}; click there, Ctrl-C ends it", flush=True)
            else:
                ready(server)
            if request.browser:
                webbrowser.open(server.address, new=2)
            server.serve_forever(poll_interval=0.1)
    except KeyboardInterrupt:
        kept = f"{session.out} is as last saved" if session.saves else "nothing was saved"
        raise KeyboardInterrupt(f"interrupted; {kept}") from None
    finally:
        session.clip.close()
    return session.command


def _session(
    clip: Path, subject: str | Path | Subject, frame: int, camera: str | None, keypoints: str | Path | None, out: Path
) -> Annotation:
    """Everything is read and checked before there is a page."""
    if camera is not None and not camera.strip():
        raise InputError("camera", "the name is empty")
    loaded = subject if isinstance(subject, Subject) else load_subject(subject)
    if not loaded.landmarks:
        raise InputError(loaded.source, "has no landmarks to click")
    opened = Clip.open(clip)
    count = opened.report.read
    if not 0 <= frame < count:
        raise InputError(clip, f"has no frame {frame}", remedy=f"--frame 0 to {count - 1}")
    guide = landmark_guide(Body(loaded))
    rate = opened.report.fps if opened.rate_known else None  # an assumed rate is not declared
    start = no_clicks(guide.names, count, opened.image_size, rate)
    if out.exists():
        start = load_clicks(out, start)
    if keypoints is not None:
        start = corrected_from(start, keypoints)
    start = inside_only(start)
    for note in (*loaded.notes, *opened.report.notes, *start.notes):
        warn(note)
    name = camera or (clip.name if clip.is_dir() else clip.stem)
    return Annotation(opened, guide, start, frame, name, out, _next(clip, camera, loaded, out))


def _next(clip: Path, camera: str | None, subject: Subject, out: Path) -> str:
    """The command that tracks from the clicks."""
    name = clip.name if clip.is_dir() else clip.stem
    view = f"{camera}=" if camera else ""
    if not view and name.startswith("-"):  # it would be read as an option
        view = f"{name.lstrip('-') or 'clip'}="
    of_view = view or ("" if out.stem == name else f"{name}=")
    chosen = [] if subject.source == "human34" else ["--subject", subject.source]
    keypoints = Path(f"{of_view}{out}")
    return command("track", Path(f"{view}{clip}"), *chosen, "--keypoints", keypoints, "--out", Path(f"{name}.run"))
