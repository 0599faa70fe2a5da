"""The arrays of a run file's frames and of its smoothing, and their checks. A tracker's state is checked by its
tracker.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from estimator.data.formats.checked_arrays import (
    LARGEST,
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
from estimator.inference.ground import Ground
from estimator.inference.origin import ORIGIN_FIELDS, PREFIX, Origins, families
from estimator.trackers.frame_result import RESULT_FIELDS, FrameResult, check_extra
from estimator.tracking.smoothing import Smoothed
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import foot_landmarks, foot_parts

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


_FLOOR = "floor_"  # before what is kept of one
_UNCERTAINTY = {
    "covariance": Field("f", ("T", "triangle"), finite=False),
    "mode": Field("i", ("T",)),
    "weight": Field("f", ("T", "K"), finite=False),
    "draws": Field("f", ("T", "S", "nv"), finite=False),
}
_PART = 200  # frames
_SUM = 1e-6  # by which weights may miss one


def smoothed_parts(smoothed: Smoothed) -> Iterator[dict[str, np.ndarray]]:
    """A smoothed trajectory as arrays: of a short clip all together, of a long one first all but the covariances, then
    these, of some frames after the other. Covariances are upper triangles in single precision."""
    arrays = {"q": smoothed.q}
    if smoothed.floor is not None:
        arrays |= {_FLOOR + name: np.asarray(value) for name, value in vars(smoothed.floor).items()}
    short = len(smoothed.q) <= _PART
    if short and smoothed.covariance is not None:
        arrays["covariance"] = _triangles(smoothed.covariance[:])
    if smoothed.mode is not None and smoothed.weight is not None:
        arrays |= {"mode": smoothed.mode.astype(np.int64), "weight": smoothed.weight}
    if smoothed.draws is not None:
        arrays["draws"] = smoothed.draws
    yield arrays
    if smoothed.covariance is not None and not short:
        for first in range(0, len(smoothed.covariance), _PART):
            yield {"covariance": _triangles(smoothed.covariance[first : first + _PART])}


def _triangles(covariances: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    whole = np.asarray(covariances)
    rows, columns = triangle_of(whole.shape[-1])
    return whole[:, rows, columns].astype(np.float32)


def joined(parts: Iterable[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """The arrays of all parts."""
    arrays: dict[str, np.ndarray] = {}
    covariances = list[np.ndarray]()
    for part in parts:
        arrays |= part
        covariances += [part["covariance"]] if "covariance" in part else []
    try:
        return arrays if len(covariances) < 2 else {**arrays, "covariance": np.concatenate(covariances)}
    except (ValueError, TypeError):
        raise DamageError("covariance has parts that do not fit each other") from None


def smoothed_in(arrays: Mapping[str, np.ndarray], body: Body) -> Smoothed:
    """The smoothed trajectory among checked arrays."""
    covariance = symmetric(arrays["covariance"], body.nv) if "covariance" in arrays else None
    drawn = arrays.get("draws")
    return Smoothed(arrays["q"], floor_in(arrays), covariance, arrays.get("mode"), arrays.get("weight"), drawn)


def floor_in(arrays: Mapping[str, np.ndarray]) -> Ground | None:
    """The floor among checked arrays, if any."""
    if _FLOOR + "normal" not in arrays:
        return None
    normal, height, std, above = (arrays[_FLOOR + name] for name in ("normal", "height", "std", "above"))
    return Ground(normal, float(height), float(std), above)


def check_smoothed(arrays: Mapping[str, np.ndarray], body: Body) -> None:
    """The arrays of a smoothed trajectory.

    Raises
    ------
    DamageError: an array is missing, misshapen or of another kind, or has impossible numbers.
    """
    q = arrays.get("q", np.zeros(0))
    if q.dtype.kind != "f" or q.ndim != 2:
        raise DamageError("q is not a trajectory")
    known = ~np.isnan(q).all(axis=1)
    if q.shape[1] == body.nq:
        check_configurations(body, q[known], "q")
    _check_floor(arrays, int(foot_parts(foot_landmarks(body.landmark_names)).max(initial=-1)) + 1)
    weight = arrays.get("weight", np.zeros((0, 0)))
    drawn = arrays.get("draws", np.zeros((0, 0, 0)))
    sizes = {**sizes_of(body), "T": len(q), "K": weight.shape[-1] if weight.ndim else 0}
    sizes["S"] = drawn.shape[1] if drawn.ndim > 1 else 0
    check_arrays(arrays, those_there(_UNCERTAINTY, arrays), sizes)
    if ("mode" in arrays) != ("weight" in arrays):
        raise DamageError("mode and weight are not both there")
    if "covariance" in arrays:
        there, (rows, columns) = arrays["covariance"][known], triangle_of(body.nv)
        if not (np.abs(there) < LARGEST).all() or (there[:, rows == columns] < 0.0).any():
            raise DamageError("covariance has invalid numbers")
    if "draws" in arrays and not (np.abs(drawn[known]) < LARGEST).all():
        raise DamageError("draws has invalid numbers")
    if "weight" in arrays:
        _check_weight(arrays["mode"][known], weight[known])


def _check_weight(mode: np.ndarray, weight: np.ndarray) -> None:
    """Check the weights of frames with a pose."""
    if len(mode) and not ((mode >= 0) & (mode < weight.shape[1])).all():
        raise DamageError("mode is not one of a frame's")
    if (weight < 0.0).any() or (weight > 1.0 + _SUM).any() or np.isnan(weight[np.arange(len(mode)), mode]).any():
        raise DamageError("weight has invalid numbers")
    if (np.abs(np.nansum(weight, axis=1) - 1.0) > _SUM).any():
        raise DamageError("weight does not sum to one")


def _check_floor(arrays: Mapping[str, np.ndarray], kinds: int) -> None:
    """The floor among arrays, if any, for a number of kinds of points."""
    if _FLOOR + "normal" not in arrays:
        return
    shapes = {"normal": (3,), "height": (), "std": (), "above": (kinds,)}
    for name, shape in shapes.items():
        value = arrays.get(_FLOOR + name, np.zeros(0, dtype=bool))
        if value.dtype.kind != "f" or value.shape != shape or not np.isfinite(value).all():
            raise DamageError(f"{_FLOOR}{name} has no floor")
    if abs(float(np.linalg.norm(arrays[_FLOOR + "normal"])) - 1.0) > 1e-6:
        raise DamageError(f"{_FLOOR}normal is not a unit vector")
