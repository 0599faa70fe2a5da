"""Compiled functions, made once before many processes need them."""

from __future__ import annotations

import warnings
from contextlib import suppress
from pathlib import Path

from humanoid.support.compiled_folder import cache_roots
from humanoid.support.compiled_sources import sources_digest

_FRAMES, _RATE = 6, 30.0


def are_made() -> bool:
    """Whether these sources were compiled on this machine before."""
    mark = _mark()
    return mark is not None and mark.exists()


def _mark() -> Path | None:
    root = next(cache_roots(), None)
    return None if root is None else root / f"kernels-{sources_digest(Path(__file__), __name__)}"


def made_kernels() -> None:
    """Track somebody who stands, from keypoints: fit, frames and smoothing leave what they have compiled in the cache,
    from where other processes on this machine take it. Nothing is done where these sources were compiled before."""
    mark = _mark()
    if mark is None or mark.exists():
        return
    track_stand()
    with suppress(OSError):
        mark.touch()


def track_stand() -> None:
    """Track somebody who stands, for a few frames."""
    import numpy as np

    import kinemode as km
    from estimator.synthesis import ViewSettings, framing_cameras

    body = km.Body(km.load_subject("human34"))
    points = body.landmarks(body.at(body.neutral))
    (camera,) = framing_cameras(points[None], ViewSettings(count=1))
    pixels = np.tile(camera.project(points), (_FRAMES, 1, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        km.track(
            body.subject, (), cameras={camera.name: camera}, keypoints=pixels, layout=body.landmark_names, fps=_RATE
        )
