"""Placements and spatial Jacobian of a model at q, by Pinocchio, as plain arrays."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import pinocchio as pin

MOST_DOF_WITH_DATA = 150
"""Degrees of freedom up to which `pin.Data` is used. It holds four derivatives of the dynamics, nv x nv x nv numbers
each, that kinematics never uses: 108 MB here, 2 GB at 400."""
_SE3_DOUBLES = 12  # Pinocchio keeps an SE3 as its rotation, column by column, then its translation


def columns_of(model: pin.Model, joint: int) -> range:
    """The columns of the spatial Jacobian that are a joint's."""
    first = int(model.idx_vExtendeds[joint])
    return range(first, first + int(model.nvExtendeds[joint]))


class Kinematics(Protocol):
    """Forward kinematics and Jacobians of one model."""

    def at(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Placements (njoints, 12) and spatial Jacobian (nc, 6) at q (nq,), see `PosedBody`; the caller owns them."""
        ...

    def placed(self, q: np.ndarray) -> np.ndarray:
        """Placements (N, njoints, 12) alone at q (N, nq), the same to the last bit."""
        ...

    def columns(self, q: np.ndarray) -> np.ndarray:
        """Spatial Jacobians (N, nc, 6) alone at q (N, nq), the same to the last bit."""
        ...


def kinematics_of(model: pin.Model) -> Kinematics:
    """The fastest kinematics that fits into the memory."""
    return DataKinematics(model) if model.nv <= MOST_DOF_WITH_DATA else JointKinematics(model)


class DataKinematics:
    """All joints in one call of Pinocchio."""

    def __init__(self, model: pin.Model) -> None:
        self._model, self._data = model, model.createData()
        pin.computeJointJacobians(model, self._data, pin.neutral(model))
        self._raw_placements = _raw_placements(self._data, model.njoints)
        self._raw_columns = self._data.J.reshape(6, -1).T  # a matrix of a single column comes as a vector

    def at(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Kinematics`."""
        pin.computeJointJacobians(self._model, self._data, q)
        raw = self._raw_placements
        placements = _gathered_placements(self._data) if raw is None else raw.copy()
        return placements, self._raw_columns.copy()

    def placed(self, q: np.ndarray) -> np.ndarray:
        """See `Kinematics`."""
        model, data, raw = self._model, self._data, self._raw_placements
        placements = np.empty((len(q), model.njoints, _SE3_DOUBLES))
        for row, each in zip(placements, q, strict=True):
            pin.forwardKinematics(model, data, each)
            row[:] = _gathered_placements(data) if raw is None else raw
        return placements

    def columns(self, q: np.ndarray) -> np.ndarray:
        """See `Kinematics`."""
        columns = np.empty((len(q), *self._raw_columns.shape))
        for row, each in zip(columns, q, strict=True):
            pin.computeJointJacobians(self._model, self._data, each)
            row[:] = self._raw_columns
        return columns


class JointKinematics:
    """Joint by joint: a hundred times as slow as `DataKinematics`, in memory that grows with nv only."""

    def __init__(self, model: pin.Model) -> None:
        self._model = model
        self._joints = [(joint, joint.createData()) for joint in list(model.joints)[1:]]
        self._parents = list(model.parents)[1:]
        self._offsets = list(model.jointPlacements)[1:]
        self._column_joint = np.repeat(np.arange(model.njoints), list(model.nvExtendeds))

    def placed(self, q: np.ndarray) -> np.ndarray:
        """See `Kinematics`."""
        return np.array([self.at(each)[0] for each in q]).reshape(-1, self._model.njoints, _SE3_DOUBLES)

    def columns(self, q: np.ndarray) -> np.ndarray:
        """See `Kinematics`."""
        return np.array([self.at(each)[1] for each in q]).reshape(-1, self._model.nvExtended, 6)

    def at(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Kinematics`."""
        T_world_joint = [pin.SE3.Identity()]
        subspace = np.zeros((self._model.nvExtended, 6))  # of each column, in its joint's frame
        first = 0
        for (joint, data), parent, T_parent_joint in zip(self._joints, self._parents, self._offsets, strict=True):
            joint.calc(data, q)
            T_world_joint.append(T_world_joint[parent] * T_parent_joint * data.M)
            subspace[first : first + joint.nvExtended] = data.S.T
            first += joint.nvExtended
        placements = _as_rows(T_world_joint)
        rotation = placements[self._column_joint, :9].reshape(-1, 3, 3).transpose(0, 2, 1)
        angular = np.einsum("vij,vj->vi", rotation, subspace[:, 3:])
        linear = np.einsum("vij,vj->vi", rotation, subspace[:, :3])
        linear += np.cross(placements[self._column_joint, 9:], angular)
        return placements, np.concatenate([linear, angular], axis=1)


def _raw_placements(data: pin.Data, njoints: int) -> np.ndarray | None:
    """The memory of data.oMi seen as one array (njoints, 12); None where this build of Pinocchio lays it out otherwise.

    Pinocchio's vector of SE3 is contiguous; looking through it costs one copy instead of a Python loop ten times as
    slow as the kinematics.
    """
    first, last = data.oMi[0].rotation, data.oMi[njoints - 1].rotation
    if last.ctypes.data - first.ctypes.data != 8 * _SE3_DOUBLES * (njoints - 1) or first.strides != (8, 24):
        return None
    raw = np.lib.stride_tricks.as_strided(first, (njoints, _SE3_DOUBLES), (8 * _SE3_DOUBLES, 8))
    return raw if np.array_equal(raw, _gathered_placements(data)) else None


def _gathered_placements(data: pin.Data) -> np.ndarray:
    """The placements read joint by joint, (njoints, 12)."""
    return _as_rows(list(data.oMi))


def _as_rows(placements: list[pin.SE3]) -> np.ndarray:
    return np.array([np.concatenate([M.rotation.T.ravel(), M.translation]) for M in placements])
