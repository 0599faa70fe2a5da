"""The arrays of the smoothing in a run file, and their checks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from estimator.data.formats.checked_arrays import (
    LARGEST,
    DamageError,
    Field,
    check_arrays,
    check_configurations,
    sizes_of,
    those_there,
)
from estimator.inference.ground import Ground
from estimator.runs.run_arrays import symmetric, triangle_of
from estimator.tracking.smoothing import Smoothed
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import foot_landmarks, foot_parts

_FLOOR = "floor_"  # before what is kept of one
_UNCERTAINTY = {
    "covariance": Field("f", ("T", "triangle"), finite=False),
    "mode": Field("i", ("T",)),
    "weight": Field("f", ("T", "K"), finite=False),
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
    return Smoothed(arrays["q"], floor_in(arrays), covariance, arrays.get("mode"), arrays.get("weight"))


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
    sizes = {**sizes_of(body), "T": len(q), "K": weight.shape[-1] if weight.ndim else 0}
    check_arrays(arrays, those_there(_UNCERTAINTY, arrays), sizes)
    if ("mode" in arrays) != ("weight" in arrays):
        raise DamageError("mode and weight are not both there")
    if "covariance" in arrays:
        there, (rows, columns) = arrays["covariance"][known], triangle_of(body.nv)
        if not (np.abs(there) < LARGEST).all() or (there[:, rows == columns] < 0.0).any():
            raise DamageError("covariance has invalid numbers")
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
