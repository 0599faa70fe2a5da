"""Which poses people take: a mixture of Gaussians over joint angles, learned from captured motion, in place of
independent rest positions; and its file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from estimator.data.formats.checked_json import mapping, member, read_json, sequence, shaped
from estimator.energy.kernels.mixture import mixture_record, mixture_values
from estimator.energy.kernels.priors import stabiliser_log_integral
from estimator.energy.kernels.records import MIXTURE, Record
from estimator.energy.recorded import RecordedTerm
from humanoid.kinematics.body import Body, PlacedBodies
from humanoid.support.errors import InputError, first_of
from humanoid.support.files import replacing

SHIPPED = Path(__file__).with_name("pose_prior.json")
"""Learned from captured motion by `python -m benchmarks pose_prior --write`."""

_AXIS_DECIMALS = 3
_DECIMALS = 5  # of angles [rad] and covariances [rad^2] in a file


@dataclass(frozen=True)
class PoseMixture:
    """Gaussians over the angles of D joints. Each represents two: itself and its mirror image, half the weight each.

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


_LISTED = 4  # joints in a message


class PosePrior(RecordedTerm):
    """-log p(joint angles), p = background + components, scaled by `weight` and up to a constant.

    The background is the density of the stabilisers (CSS 3.2.2): exp(-their energy) is a product of Student's t with 3
    degrees of freedom, so it can be normalised and mixed with the Gaussians. A pose far from all captured ones
    therefore has the energy of the stabilisers, plus -log of the background's share. A captured one has less, and is
    held by the correlations of the joints. Nothing is forbidden. The constant makes the background alone equal to the
    stabilisers, so it lowers the energy of known poses below zero. Limits are not considered in any normalisation.

    A body some of whose joints are locked has the marginal density of the others.

    Parameters
    ----------
    body: it suits the mixture (`misfit`). mixture: see `PoseMixture`. weight: 1 is the probabilistic one for a single
    frame.

    Raises
    ------
    InputError: the mixture is not for this body.
    """

    name, kind, lasting = "pose prior", MIXTURE, True

    def __init__(self, body: Body, mixture: PoseMixture, weight: float = 1.0) -> None:
        self._body = body
        problem = misfit(body, mixture)
        if problem is not None:
            raise InputError(body.subject.source, f"the pose prior needs {problem}", remedy=_REMEDY)
        moving = _moving(body)
        kept = [i for i, name in enumerate(mixture.joints) if name in moving]
        joints = [mixture.joints[i] for i in kept]
        model = body.model
        self._q_index = np.array([model.idx_qs[moving[name]] for name in joints], dtype=np.int64)
        self._v_index = np.array([model.idx_vs[moving[name]] for name in joints], dtype=np.int64)
        rests = {s.joint: s for s in body.subject.stabilisers}
        self._rest = np.array([rests[name].rest for name in joints])
        stds = np.array([(rests[name].std, rests[name].std_above) for name in joints])
        self._rest_precision = 1.0 / np.square(stds)
        share, mean, covariance = mixture.both_sides()
        mean, covariance = mean[:, kept], covariance[:, kept][:, :, kept]
        cholesky = np.linalg.cholesky(covariance)
        whiten = np.linalg.inv(cholesky)
        self._whiten = np.concatenate([whiten[:, j:, j].T.ravel() for j in range(len(kept))])
        self._white_mean = np.einsum("kij,kj->ik", whiten, mean).ravel()
        product = whiten.transpose(0, 2, 1) @ whiten
        precision = 0.5 * (product + product.transpose(0, 2, 1))
        self._pull = np.einsum("kij,kj->ki", precision, mean)
        below = np.tril_indices(len(kept))
        self._precision = np.ascontiguousarray(precision[:, below[0], below[1]])
        self._log_share = np.log(share) + _log_heights(cholesky, stds.mean(axis=1))
        self._log_background, self._weight = math.log(mixture.background), float(weight)

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        return mixture_record(
            self._q_index, self._v_index, self._log_share, self._whiten, self._white_mean,
            self._precision, self._pull, self._log_background, self._rest, self._rest_precision, self._weight,
        )  # fmt: skip

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        mixture_values(
            placed.q, self._q_index, self._log_share, self._whiten, self._white_mean, self._log_background,
            self._rest, self._rest_precision, self._weight, values,
        )  # fmt: skip
        return values


def _log_heights(cholesky: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Log density of every Gaussian (K, D, D) at its mean over that of the background, whose scales are std (D,), the
    mean of both sides, at rest."""
    gaussians = -np.log(np.diagonal(cholesky, axis1=1, axis2=2)).sum(axis=1) - 0.5 * len(std) * math.log(2.0 * math.pi)
    return np.asarray(gaussians + np.log(std).sum() + len(std) * stabiliser_log_integral())


_REMEDY = "the shipped prior is for human34; without one: pose_prior_weight = 0"
_SAME_AXIS = math.cos(math.radians(30.0))  # locked joints may turn those behind them a little


def misfit(body: Body, mixture: PoseMixture) -> str | None:
    """The requirement of a mixture of joint angles that a body lacks, None where it suits.

    Each of the mixture's joints has to be a joint of one angle there, about the same axis and with a stabiliser, or is
    locked: fixed, under the same name.
    """
    moving, model = _moving(body), body.model
    locked = {frame.name for frame in model.frames if frame.type == pin.FrameType.FIXED_JOINT}
    missing = [name for name in mixture.joints if name not in moving and name not in locked]
    if missing:
        return f"joints it does not have: {first_of(missing, _LISTED)}"
    kept = [i for i, name in enumerate(mixture.joints) if name in moving]
    joints = [mixture.joints[i] for i in kept]
    if not joints:
        return "joints that move"
    held = {s.joint for s in body.subject.stabilisers}
    if not held.issuperset(joints):
        return f"a <stabiliser> for {first_of([name for name in joints if name not in held], _LISTED)}"
    along = np.einsum("ij,ij->i", joint_axes(body, joints), mixture.axes[kept])
    turned = [name for name, same in zip(joints, along, strict=True) if same < _SAME_AXIS]
    return f"another axis of {first_of(turned, _LISTED)}" if turned else None


def joint_axes(body: Body, joints: Sequence[str]) -> np.ndarray:
    """Unit vectors (D, 3) about which joints of one angle turn, in the root's frame with all angles at zero."""
    moving = _moving(body)
    rows = [body.model.idx_vs[moving[name]] for name in joints]
    return np.asarray(body.dof_jacobian(body.at(pin.neutral(body.model)))[rows, 3:])


def _moving(body: Body) -> dict[str, int]:
    """Its joints of one angle, by name."""
    model = body.model
    return {model.names[j]: j for j in range(1, body.njoints) if model.nqs[j] == 1 and model.nvs[j] == 1}
