"""The numbers of a pose prior: a mixture of Gaussians over joint angles, and its file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from estimator.data.formats.checked_json import mapping, member, read_json, sequence, shaped
from humanoid.support.atomic import replacing
from humanoid.support.errors import InputError

SHIPPED = Path(__file__).with_name("pose_prior.json")
"""Learned from captured motion by `python -m benchmarks pose_prior --write`."""

_AXIS_DECIMALS = 3
_DECIMALS = 5  # of angles [rad] and covariances [rad^2] in a file


@dataclass(frozen=True)
class PoseMixture:
    """Gaussians over the angles of D joints. Each stands for two: itself and its mirror image, half the weight each.

    joints (D): names. axes (D, 3): unit vectors about which they turn, in the root's frame with all angles at zero;
    they show whether a body has other conventions. other_side (D,) int, mirror_sign (D,): angle i of the mirrored pose
    is mirror_sign[i] times the angle of joint other_side[i]. background: share of the poses that no component explains.
    weight (K,): shares of the pairs, their sum is 1. mean (K, D) [rad], covariance (K, D, D) [rad^2].
    """

    joints: tuple[str, ...]
    axes: np.ndarray
    other_side: np.ndarray
    mirror_sign: np.ndarray
    background: float
    weight: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray

    def mirrored(self, angles: np.ndarray) -> np.ndarray:
        """Angles (..., D) of the mirrored pose."""
        return self.mirror_sign * angles[..., self.other_side]

    def both_sides(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shares (2K,), of sum 1 - background, means (2K, D), covariances (2K, D, D), mirror images after the rest."""
        turned = self.covariance[:, self.other_side][:, :, self.other_side]
        turned = turned * np.outer(self.mirror_sign, self.mirror_sign)
        half = 0.5 * (1.0 - self.background) * self.weight
        return (
            np.concatenate([half, half]),
            np.concatenate([self.mean, self.mirrored(self.mean)]),
            np.concatenate([self.covariance, turned]),
        )

    def save(self, path: Path, about: str) -> None:
        """Write a file that `load_mixture` reads; `about`: what the numbers are, and where they are from."""
        below = np.tril_indices(len(self.joints))
        content = {
            "about": about,
            "joints": list(self.joints),
            "axes": self.axes.round(_AXIS_DECIMALS).tolist(),
            "other_side": [self.joints[i] for i in self.other_side],
            "mirror_sign": self.mirror_sign.astype(int).tolist(),
            "background": self.background,
            "components": [
                {"weight": round(float(w), _DECIMALS), "mean": m.round(_DECIMALS).tolist(),
                 "covariance": c[below].round(_DECIMALS).tolist()}
                for w, m, c in zip(self.weight, self.mean, self.covariance, strict=True)
            ],
        }  # fmt: skip
        with replacing(path) as temporary:
            temporary.write_text(_laid_out(content), encoding="utf-8")


def load_mixture(path: str | Path = SHIPPED) -> PoseMixture:
    """Read a mixture: JSON as `PoseMixture.save` writes it, lower triangles of the covariances row by row.

    Raises
    ------
    InputError: the file is not readable or not a mixture: something is missing, has another size, is not a share
        between 0 and 1 or not an axis, or a covariance is not positive definite.
    """
    content = mapping(read_json(path), path)
    joints = [str(name) for name in sequence(member(content, "joints", path, ""), path, "joints")]
    other = [str(name) for name in sequence(member(content, "other_side", path, ""), path, "other_side")]
    if not joints or sorted(other) != sorted(joints) or len(set(joints)) < len(joints):
        raise InputError(path, "does not name every joint once", place="joints, other_side")
    count = len(joints)
    axes = shaped(member(content, "axes", path, ""), (count, 3), path, "axes")
    if not np.allclose(np.linalg.norm(axes, axis=1), 1.0, atol=0.01):
        raise InputError(path, "has an axis that is not a unit vector", place="axes")
    sign = shaped(member(content, "mirror_sign", path, ""), (count,), path, "mirror_sign")
    background = float(shaped(member(content, "background", path, ""), (), path, "background"))
    weight, mean, covariance = _components(content, count, path)
    if not (0.0 < background < 1.0 and np.all(weight > 0.0) and np.all(np.abs(sign) == 1.0)):
        place, remedy = "background, weight, mirror_sign", "0 < background < 1, weights more than 0, signs 1 or -1"
        raise InputError(path, "has shares or signs that cannot work", place=place, remedy=remedy)
    index = np.array([joints.index(name) for name in other], dtype=np.int64)
    return PoseMixture(tuple(joints), axes, index, sign, background, weight / weight.sum(), mean, covariance)


@cache
def shipped_mixture() -> PoseMixture:
    """The shipped one, read once; its arrays are read-only."""
    mixture = load_mixture(SHIPPED)
    for array in (
        mixture.axes,
        mixture.other_side,
        mixture.mirror_sign,
        mixture.weight,
        mixture.mean,
        mixture.covariance,
    ):
        array.setflags(write=False)
    return mixture


def _components(content: object, count: int, path: str | Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights (K,), means (K, D) and covariances (K, D, D)."""
    listed = sequence(member(mapping(content, path), "components", path, ""), path, "components")
    if not listed:
        raise InputError(path, "has no component", place="components")
    below = np.tril_indices(count)
    weights, means, covariances = [], [], []
    for k, component in enumerate(listed):
        place = f"components[{k}]"
        component = mapping(component, path, place)
        weights.append(float(shaped(member(component, "weight", path, place), (), path, f"{place}.weight")))
        means.append(shaped(member(component, "mean", path, place), (count,), path, f"{place}.mean"))
        lower = np.zeros((count, count))
        triangle = member(component, "covariance", path, place)
        lower[below] = shaped(triangle, (len(below[0]),), path, f"{place}.covariance")
        covariances.append(lower + np.tril(lower, -1).T)
        if np.linalg.eigvalsh(covariances[-1])[0] <= 0.0:
            raise InputError(path, "is not positive definite", place=f"{place}.covariance")
    return np.array(weights), np.array(means), np.array(covariances)


def _laid_out(content: dict[str, object]) -> str:
    """JSON with a line for each entry, so that a change of the numbers can be read."""
    lines = []
    for key, value in content.items():
        if key == "components":
            assert isinstance(value, list)
            value = "[\n" + ",\n".join(f"  {json.dumps(component)}" for component in value) + "\n ]"
        else:
            value = json.dumps(value)
        lines.append(f" {json.dumps(key)}: {value}")
    return "{\n" + ",\n".join(lines) + "\n}\n"
