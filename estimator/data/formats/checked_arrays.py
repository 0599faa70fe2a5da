"""Checks of stored arrays: a file may be whole, with correct checksums, and still have impossible contents."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.data.formats.packing import valid_text
from humanoid.kinematics.body import Body
from humanoid.support.errors import shown

LARGEST = 1e9  # of configurations, covariances and times
LEAST_VARIANCE = 1e-20
_NORM = 1e-3  # tolerance of the norm of a configuration's quaternion


class Field(NamedTuple):
    """One array. kind: numpy's letter. shape: sizes, by name (K, nq, nv, ...). finite: all numbers are."""

    kind: str
    shape: tuple[str, ...] = ()
    finite: bool = True

    @property
    def dtype(self) -> type[np.generic]:
        """The type that an array has which is made here."""
        return {"f": np.float64, "i": np.int64, "b": np.bool_, "U": np.str_}[self.kind]

    def array(self, values: object) -> np.ndarray:
        """Values as such an array."""
        return np.asarray(values, dtype=self.dtype)

    def nothing(self, *shape: int) -> np.ndarray:
        """An array of missing values: NaN, -1 for indices, false, or empty text."""
        return np.full(shape, {"f": np.nan, "i": -1, "b": False, "U": ""}[self.kind], self.dtype)


class DamageError(ValueError):
    """A fault of an array in a stored file."""


def check_arrays(arrays: Mapping[str, np.ndarray], fields: Mapping[str, Field], sizes: Mapping[str, int]) -> None:
    """Raise DamageError where an array is missing, misshapen or of another kind, or has impossible numbers.

    sizes: by the names in the fields' shapes; a name without one means any size.
    """
    for name, field in fields.items():
        if name not in arrays:
            raise DamageError(f"{name} is missing")
        array = arrays[name]
        empty = field.shape[:1] == ("K",) and sizes["K"] == 0 and array.size == 0  # of any type, shape and length
        if empty:
            continue
        wanted = tuple(sizes.get(size, -1) for size in field.shape)
        fits = array.ndim == len(wanted) and all(w in (-1, n) for w, n in zip(wanted, array.shape, strict=True))
        if array.dtype.kind != field.kind or not fits:
            raise DamageError(f"{name} has the shape {array.shape} and type {array.dtype}")
        if array.dtype.kind == "U" and not valid_text(array):
            raise DamageError(f"{name} has invalid characters")
        if array.dtype.kind == "f" and field.finite and not (np.abs(array) < LARGEST).all():
            raise DamageError(f"{name} has numbers that are not finite, or at least {LARGEST:g} in size")


def sizes_of(body: Body) -> dict[str, int]:
    """The sizes of a body's arrays; triangle: entries of a symmetric matrix (nv, nv)."""
    return {"nq": body.nq, "nv": body.nv, "triangle": body.nv * (body.nv + 1) // 2}


def those_there(fields: Mapping[str, Field], arrays: Mapping[str, np.ndarray]) -> dict[str, Field]:
    """The optional fields that are present."""
    return {name: field for name, field in fields.items() if name in arrays}


def length_of(arrays: Mapping[str, np.ndarray], name: str) -> int:
    """Number of entries of a list; raises DamageError where it is missing or not a list."""
    if name not in arrays or arrays[name].ndim != 1:
        raise DamageError(f"{name} is missing" if name not in arrays else f"{name} is not a list")
    return len(arrays[name])


def check_weights(weight: np.ndarray, name: str) -> None:
    """Weights (K,): none negative, and one above zero where there are any; raises DamageError."""
    if (weight < 0.0).any() or (len(weight) and not weight.sum() > 0.0):
        raise DamageError(f"{name} has negative numbers, or none above zero")


def check_parents(parent: np.ndarray, before: int | None) -> None:
    """Parents (K,): -1 or one of the `before` hypotheses of the frame before, any where that is None; raises
    DamageError."""
    if parent.size and (parent.min() < -1 or (before is not None and parent.max() >= max(before, 1))):
        raise DamageError(f"parent {shown(int(parent.max()))} is not a hypothesis of the frame before")


def check_covariances(covariance: np.ndarray) -> None:
    """Matrices (K, nv, nv): positive definite, but for directions held by limits, whose rows are zero; raises
    DamageError."""
    matrices = covariance.copy()
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    np.einsum("kii->ki", matrices)[variance == 0.0] = 1.0
    sound = (
        np.array_equal(covariance, covariance.transpose(0, 2, 1))
        and not (np.abs(variance[variance != 0.0]) < LEAST_VARIANCE).any()
    )
    try:
        np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        sound = False
    if not sound:
        raise DamageError("covariance is not symmetric and positive definite")


def check_configurations(body: Body, q: np.ndarray, name: str) -> None:
    """Configurations (K, nq) of a body: finite, their quaternions of length one; raises DamageError."""
    if not (np.abs(q) < LARGEST).all() or not all(pin.isNormalized(body.model, pose, _NORM) for pose in q):
        raise DamageError(f"{name} is not a configuration of the subject")
