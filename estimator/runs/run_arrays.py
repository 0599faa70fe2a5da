"""The arrays of a run file's frames and what they have to be. A tracker's state is checked by its tracker."""

from __future__ import annotations

import functools
from collections.abc import Mapping

import numpy as np

from estimator.data.formats.checked_arrays import (
    DamageError,
    Field,
    check_arrays,
    check_configurations,
    check_covariances,
    check_parents,
    check_weights,
    length_of,
    sizes_of,
    those_there,
)
from estimator.data.formats.packing import valid_text
from estimator.inference.origin import ORIGIN_FIELDS, PREFIX, Origins, families
from estimator.trackers.frame_result import RESULT_FIELDS, FrameResult, check_extra
from humanoid.kinematics.body import Body

EXTRA = "extra_"
"""Prefix of the names of a frame's extra arrays (see `FrameResult.extra`) in a run file."""
_LARGEST = 1e9  # of pixels

_FRAME = {
    "index": Field("i"),
    "time": Field("f"),
    "status": Field("U"),
    **{name: field for name, field in RESULT_FIELDS.items() if name != "velocity"},
    "covariance": Field("f", ("K", "triangle")),
}
_VELOCITY = {"velocity": RESULT_FIELDS["velocity"]}  # runs made before it was kept have none
_ORIGINS = {PREFIX + name: field for name, field in ORIGIN_FIELDS.items()}
_ESTIMATE = {"estimate_q": Field("f", ("nq",)), "estimate_covariance": Field("f", ("nv", "nv"))}
_LIFTED = {"lifted": Field("f", ("L", "3"), finite=False), "lifted_share": Field("f")}
_MARKERS = {"markers": Field("f", ("M", "3"), finite=False)}
_OBSERVATION = {
    "pixels": Field("f", ("C", "L", "2"), finite=False),
    "confidence": Field("f", ("C", "L")),
}


def frame_arrays(result: FrameResult) -> dict[str, np.ndarray]:
    """The stored arrays of a frame; covariances as the upper triangle in single precision, as the exact ones are in the
    state."""
    rows, columns = triangle_of(result.covariance.shape[-1])
    return {
        "index": _FRAME["index"].array(result.index),
        "time": _FRAME["time"].array(result.time),
        "status": _FRAME["status"].array(result.status),
        **result.arrays(),
        "covariance": result.covariance[:, rows, columns].astype(np.float32),
        **({} if result.origins is None else result.origins.arrays()),
        **{EXTRA + name: array for name, array in result.extra.items()},
    }


def frame_result(arrays: Mapping[str, np.ndarray], body: Body) -> FrameResult:
    """The frame that was stored so."""
    hypotheses = {**arrays, "covariance": symmetric(arrays["covariance"], body.nv)}
    origins = Origins.from_arrays(arrays, body.nq)
    index, time, status = int(arrays["index"]), float(arrays["time"]), str(arrays["status"])
    return FrameResult.of(index, time, status, hypotheses, origins, extra_of(arrays))


def symmetric(triangle: np.ndarray, n: int) -> np.ndarray:
    """Symmetric matrices (K, n, n) from their upper triangles (K, n (n + 1) / 2)."""
    rows, columns = triangle_of(n)
    full = np.zeros((len(triangle), n, n))
    full[:, rows, columns] = full[:, columns, rows] = triangle
    return full


@functools.lru_cache(maxsize=4)
def triangle_of(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the upper triangle of an n x n matrix."""
    return np.triu_indices(n)


def check_frame(arrays: Mapping[str, np.ndarray], body: Body, planned: int, before: int | None) -> None:
    """The arrays of a frame. planned: frames of the whole run. before: hypotheses of the frame before it.

    Raises
    ------
    DamageError: an array is missing, misshapen or of another kind, or has impossible numbers.
    """
    count = length_of(arrays, "weight")
    check_arrays(arrays, _FRAME, {**sizes_of(body), "K": count})
    if not 0 <= int(arrays["index"]) < planned:
        raise DamageError(f"index {int(arrays['index'])} of {planned} frames")
    check_weights(arrays["weight"], "weight")
    check_parents(arrays["parent"], before)
    check_configurations(body, arrays["q"], "q")
    check_arrays(arrays, those_there(_VELOCITY, arrays), {"nv": body.nv, "K": count})
    _check_origins(arrays, body, count)
    extra = extra_of(arrays)
    check_extra(extra)
    for name, array in extra.items():
        if not valid_text(array):
            raise DamageError(f"{EXTRA}{name} has invalid characters")


def extra_of(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The extra arrays of a frame by their own names, from among the stored ones."""
    return {name.removeprefix(EXTRA): array for name, array in arrays.items() if name.startswith(EXTRA)}


def check_observation(arrays: Mapping[str, np.ndarray], body: Body, cameras: int) -> None:
    """The keypoints of a frame, and the prior estimate of the pose; raises DamageError as `check_frame` does."""
    check_arrays(arrays, _OBSERVATION, {"C": cameras, "L": len(body.landmark_names), "2": 2})
    confidence, pixels = arrays["confidence"], arrays["pixels"]
    if not ((confidence >= 0.0) & (confidence <= 1.0)).all():
        raise DamageError("confidence is not between 0 and 1")
    if not (np.abs(pixels[confidence > 0.0]) < _LARGEST).all():
        raise DamageError("pixels are not finite")
    for name in ("jitter", "noise"):
        if name in arrays:
            check_arrays(arrays, {name: Field("f", ("any",))}, {})
            if arrays[name].size not in (0, cameras) or (arrays[name] < 0.0).any():
                raise DamageError(f"{name} does not fit the cameras")
    if "given" in arrays:
        check_arrays(arrays, {"given": Field("b")}, {})
    if any(name in arrays for name in _ESTIMATE):
        check_arrays(arrays, _ESTIMATE, sizes_of(body))
        check_configurations(body, arrays["estimate_q"][None], "estimate_q")
        check_covariances(arrays["estimate_covariance"][None])
    if any(name in arrays for name in _LIFTED):
        check_arrays(arrays, _LIFTED, {"L": len(body.landmark_names), "3": 3})
        if np.isinf(arrays["lifted"]).any() or not 0.0 <= arrays["lifted_share"] <= 1.0:
            raise DamageError("lifted has invalid numbers")
    if "markers" in arrays:
        check_arrays(arrays, _MARKERS, {"M": len(body.marker_names), "3": 3})
        if np.isinf(arrays["markers"]).any():
            raise DamageError("markers are infinite")


def _check_origins(arrays: Mapping[str, np.ndarray], body: Body, count: int) -> None:
    """Check the origins of modes; missing poses and extents are NaN, or are left out."""
    if not any(name.startswith(PREFIX) for name in arrays):
        return
    there = {name: field for name, field in _ORIGINS.items() if field.finite or name in arrays}
    check_arrays(arrays, there, {"nq": body.nq, "K": count})
    try:
        families(arrays)
    except ValueError as error:
        raise DamageError(f"{PREFIX}family: {error}") from None
    for name in (name for name, field in there.items() if "nq" in field.shape):
        check_configurations(body, arrays[name][~np.isnan(arrays[name]).all(axis=1)], name)
