"""What the arrays of a run file have to be: a file may be whole, with right checksums, and still say what cannot be."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.formats.packing import valid_text
from estimator.modes.origin import PREFIX, families
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError, shown

_LARGEST = 1e9  # of configurations, covariances and times
_LEAST = 1e-20  # of variances
_NORM = 1e-3  # by how much a quaternion of a configuration may be off one


class _Field(NamedTuple):
    """One array. kinds: numpy's letters. shape: sizes, by name (K, nq, nv, ...). finite: all numbers are."""

    kinds: str
    shape: tuple[str, ...] = ()
    finite: bool = True


_FRAME = {
    "index": _Field("i"),
    "time": _Field("f"),
    "status": _Field("U"),
    "q": _Field("f", ("K", "nq")),
    "weight": _Field("f", ("K",)),
    "energy": _Field("f", ("K",), finite=False),
    "covariance": _Field("f", ("K", "triangle")),
    "parent": _Field("i", ("K",)),
    "kkt_residual": _Field("f", ("K",), finite=False),
    "penetration": _Field("f", ("K",), finite=False),
    "association": _Field("U", ("K",)),
}
_STATE = {
    "time": _Field("f"),
    "log_scores": _Field("f", ("K",), finite=False),
    "weights": _Field("f", ("K",)),
    "q": _Field("f", ("K", "nq")),
    "covariance": _Field("f", ("K", "nv", "nv")),
    "velocity": _Field("f", ("K", "nv")),
    "parent": _Field("i", ("K",)),
    "status": _Field("U", ("K",)),
    "association": _Field("U", ("K",)),
    "energy": _Field("f", ("K",), finite=False),
    "kkt_residual": _Field("f", ("K",), finite=False),
    "penetration": _Field("f", ("K",), finite=False),
}
_VELOCITY = {"velocity": _Field("f", ("K", "nv"))}  # runs made before it was kept have none
_UNOBSERVED = {"unobserved": _Field("f")}  # states, too
_ORIGINS = {
    f"{PREFIX}family": _Field("U", ("K",)),
    f"{PREFIX}paid": _Field("b", ("K",)),
    f"{PREFIX}price": _Field("f", ("K",)),
}
_ORIGIN_POSES = {
    f"{PREFIX}{name}": _Field("f", ("K", "nq"), finite=False) for name in ("q_previous", "q_predicted", "q_assigned")
}
_ORIGIN_EXTENT = {f"{PREFIX}extent": _Field("f", ("K", "any"), finite=False)}
_PARTICLES = {
    "particle_states": _Field("f", ("N", "any")),
    "particle_weights": _Field("f", ("N",)),
    "particle_owner": _Field("i", ("N",)),
}
_OBSERVATION = {
    "pixels": _Field("f", ("C", "L", "2"), finite=False),
    "confidence": _Field("f", ("C", "L")),
}


class DamageError(ValueError):
    """What is wrong with an array of a run file."""


def check_frame(arrays: Mapping[str, np.ndarray], body: Body, planned: int, before: int | None) -> None:
    """The arrays of a frame. planned: frames of the whole run. before: hypotheses of the frame before it.

    Raises
    ------
    DamageError: an array is missing, misshapen or of another kind, or has numbers that cannot be.
    """
    count = _length(arrays, "weight")
    _check(arrays, _FRAME, {**_sizes(body), "K": count})
    if not 0 <= int(arrays["index"]) < planned:
        raise DamageError(f"index {int(arrays['index'])} of {planned} frames")
    _check_weights(arrays["weight"], "weight")
    _check_parents(arrays["parent"], before)
    _check_configurations(body, arrays["q"], "q")
    _check(arrays, _there(_VELOCITY, arrays), {"nv": body.nv, "K": count})
    _check_origins(arrays, body, count)


def check_state(arrays: Mapping[str, np.ndarray], body: Body) -> None:
    """A tracker's state, with its particles where it has them; raises DamageError as `check_frame` does."""
    _check(arrays, _STATE | _there(_UNOBSERVED, arrays), {**_sizes(body), "K": _length(arrays, "weights")})
    _check_weights(arrays["weights"], "weights")
    _check_parents(arrays["parent"], None)
    _check_configurations(body, arrays["q"], "q")
    if "particle_weights" not in arrays:
        _check_covariances(arrays["covariance"])
        return
    _check(arrays, _PARTICLES, {"N": _length(arrays, "particle_weights")})
    _check_weights(arrays["particle_weights"], "particle_weights")
    if not ((arrays["particle_owner"] >= -1) & (arrays["particle_owner"] < len(arrays["weights"]))).all():
        raise DamageError("particle_owner is no hypothesis")


def checked_state(arrays: Mapping[str, np.ndarray], body: Body, source: Path) -> Mapping[str, np.ndarray]:
    """The arrays of a tracker's state; raises InputError where they cannot be."""
    try:
        check_state(arrays, body)
    except DamageError as error:
        raise InputError(source, f"is damaged: {error}", place="state", remedy="--overwrite starts anew") from None
    return arrays


def check_observation(arrays: Mapping[str, np.ndarray], cameras: int, landmarks: int) -> None:
    """The keypoints of a frame; raises DamageError as `check_frame` does."""
    _check(arrays, _OBSERVATION, {"C": cameras, "L": landmarks, "2": 2})
    confidence, pixels = arrays["confidence"], arrays["pixels"]
    if not ((confidence >= 0.0) & (confidence <= 1.0)).all():
        raise DamageError("confidence is not between 0 and 1")
    if not (np.abs(pixels[confidence > 0.0]) < _LARGEST).all():
        raise DamageError("pixels are not finite")
    if "jitter" in arrays:
        _check(arrays, {"jitter": _Field("f", ("any",))}, {})
        if arrays["jitter"].size not in (0, cameras) or (arrays["jitter"] < 0.0).any():
            raise DamageError("jitter does not fit the cameras")
    if "given" in arrays:
        _check(arrays, {"given": _Field("b")}, {})


def check_trajectory(arrays: Mapping[str, np.ndarray], body: Body) -> None:
    """Smoothed configurations q (T, nq), NaN in frames without a pose; raises DamageError as `check_frame` does."""
    q = arrays.get("q", np.zeros(0))
    if q.dtype.kind != "f" or q.ndim != 2:
        raise DamageError("q is no trajectory")
    if q.shape[1] == body.nq:
        _check_configurations(body, q[~np.isnan(q).all(axis=1)], "q")


def _sizes(body: Body) -> dict[str, int]:
    return {"nq": body.nq, "nv": body.nv, "triangle": body.nv * (body.nv + 1) // 2}


def _there(fields: Mapping[str, _Field], arrays: Mapping[str, np.ndarray]) -> dict[str, _Field]:
    """Those of the fields that may be left out which are there."""
    return {name: field for name, field in fields.items() if name in arrays}


def _length(arrays: Mapping[str, np.ndarray], name: str) -> int:
    if name not in arrays or arrays[name].ndim != 1:
        raise DamageError(f"{name} is missing" if name not in arrays else f"{name} is no list")
    return len(arrays[name])


def _check(arrays: Mapping[str, np.ndarray], fields: Mapping[str, _Field], sizes: Mapping[str, int]) -> None:
    for name, field in fields.items():
        if name not in arrays:
            raise DamageError(f"{name} is missing")
        array = arrays[name]
        empty = field.shape[:1] == ("K",) and sizes["K"] == 0 and array.size == 0  # of any type, shape and length
        if empty:
            continue
        wanted = tuple(sizes.get(size, -1) for size in field.shape)
        fits = array.ndim == len(wanted) and all(w in (-1, n) for w, n in zip(wanted, array.shape, strict=True))
        if array.dtype.kind not in field.kinds or not fits:
            raise DamageError(f"{name} has the shape {array.shape} and type {array.dtype}")
        if array.dtype.kind == "U" and not valid_text(array):
            raise DamageError(f"{name} has characters that are none")
        if array.dtype.kind == "f" and field.finite and not (np.abs(array) < _LARGEST).all():
            raise DamageError(f"{name} has numbers that are not finite, or beyond all measure")


def _check_origins(arrays: Mapping[str, np.ndarray], body: Body, count: int) -> None:
    """Where modes came from; poses and extents that there are not are NaN, or are left out."""
    if not any(name.startswith(PREFIX) for name in arrays):
        return
    sizes = {"nq": body.nq, "K": count}
    _check(arrays, _ORIGINS, sizes)
    try:
        families(arrays)
    except ValueError as error:
        raise DamageError(f"{PREFIX}family: {error}") from None
    poses = _there(_ORIGIN_POSES, arrays)
    _check(arrays, poses | _there(_ORIGIN_EXTENT, arrays), sizes)
    for name in poses:
        _check_configurations(body, arrays[name][~np.isnan(arrays[name]).all(axis=1)], name)


def _check_weights(weight: np.ndarray, name: str) -> None:
    if (weight < 0.0).any() or (len(weight) and not weight.sum() > 0.0):
        raise DamageError(f"{name} has negative numbers, or none above zero")


def _check_parents(parent: np.ndarray, before: int | None) -> None:
    if parent.size and (parent.min() < -1 or (before is not None and parent.max() >= max(before, 1))):
        raise DamageError(f"parent {shown(int(parent.max()))} is no hypothesis of the frame before")


def _check_covariances(covariance: np.ndarray) -> None:
    """Matrices (K, nv, nv): positive definite, but for directions held by limits, whose rows are zero."""
    matrices = covariance.copy()
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    np.einsum("kii->ki", matrices)[variance == 0.0] = 1.0
    sound = (
        np.array_equal(covariance, covariance.transpose(0, 2, 1))
        and not (np.abs(variance[variance != 0.0]) < _LEAST).any()
    )
    try:
        np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        sound = False
    if not sound:
        raise DamageError("covariance is not symmetric and positive definite")


def _check_configurations(body: Body, q: np.ndarray, name: str) -> None:
    if not (np.abs(q) < _LARGEST).all() or not all(pin.isNormalized(body.model, one, _NORM) for one in q):
        raise DamageError(f"{name} is no configuration of the subject")
