"""Learned potentials between the limbs of a graph, and their file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.formats.checked_arrays import LEAST_VARIANCE
from estimator.data.formats.checked_json import mapping, member, numbers, read_json, sequence, shaped
from estimator.inference.beliefs.learning import TURNS, RelativePlacements
from estimator.inference.beliefs.space import PLACEMENTS
from humanoid.kinematics.body import Body
from humanoid.limbs.limb import LimbGraph, limb_placements
from humanoid.support.errors import InputError, first_of
from humanoid.support.files import replacing

SHIPPED = Path(__file__).with_name("potentials.json")
"""Potentials of human34's paper graph, learned from captured motion by `python -m benchmarks limb_learning --write`."""

Edge = tuple[int, int]

_DIGITS = 6  # of numbers in a file
_FARTHEST = 2.0  # times the longest time step: as far as its kernels are stretched
_OTHER = 2.0  # times a limb's offset on another at rest: no person's lengths differ so much
_REMEDY = (
    'the shipped ones are of human34\'s graph "paper"; of others: `python -m benchmarks limb_learning --subject NAME'
    " --drawn --write --output FILE`"
)


@dataclass(frozen=True)
class LimbSteps:
    """Placements of limbs (L) `dt` [s] later in their current frame, and dt earlier."""

    dt: float
    forward: tuple[RelativePlacements, ...]
    backward: tuple[RelativePlacements, ...]

    def at(self, dt: float) -> LimbSteps:
        """The steps of another time step at the same speeds: means and deviations grow with time."""
        by = dt / self.dt
        return LimbSteps(dt, tuple(_slower(p, by) for p in self.forward), tuple(_slower(p, by) for p in self.backward))


@dataclass(frozen=True)
class LimbPotentials:
    """Densities of relative placements of limbs that joints connect, and of each limb from one time to another.

    limbs (L): names. spatial: by directed edge (i, j), of X_j in the frame of X_i. rest: by the same edges, where j is
    in the frame of i with the body at rest (3,) [m]: another person's differs. temporal: of several time steps.
    """

    limbs: tuple[str, ...]
    spatial: Mapping[Edge, RelativePlacements]
    rest: Mapping[Edge, np.ndarray]
    temporal: tuple[LimbSteps, ...]

    @property
    def longest(self) -> float:
        """The longest time step of `steps` [s]; 0 without any."""
        return (_FARTHEST + 1e-6) * max((s.dt for s in self.temporal), default=0.0)

    def steps(self, dt: float) -> LimbSteps:
        """The steps of a time step [s], from the nearest that was learned.

        Raises
        ------
        InputError: the step is invalid, or more than twice the longest.
        """
        nearest = min(self.temporal, key=lambda s: abs(math.log(max(dt, 1e-9) / s.dt)), default=None)
        if nearest is None or not 0.0 < dt <= self.longest:
            learned = ", ".join(f"{s.dt:.4g}" for s in self.temporal) or "none"
            remedy = "pictures at another rate, or potentials learned for it"
            raise InputError("limb potentials", f"of {dt:g} s: learned are {learned} s", remedy=remedy)
        return nearest if math.isclose(dt, nearest.dt, rel_tol=1e-6) else nearest.at(dt)

    def of_graph(self, graph: LimbGraph, body: Body, source: str | Path = "limb potentials") -> LimbPotentials:
        """The same for a graph with these limbs, in its order, and the lengths of its body.

        With other lengths the joints are elsewhere on the limbs: each mean is moved by how far the inner limb's joint
        with the outer one is from where it was on the body that was learned from. How they turn stays.

        Raises
        ------
        InputError: the graph has other limbs or edges, or its joints are nowhere near.
        """
        missing = sorted(set(self.limbs) ^ set(graph.names))
        if missing:
            raise InputError(source, f"are of another graph: {first_of(missing, 4)} in one of both", remedy=_REMEDY)
        place = [self.limbs.index(name) for name in graph.names]
        own = {(i, j): (place[i], place[j]) for i, j in graph.directed}
        if set(own.values()) != set(self.spatial):
            raise InputError(source, "connect other limbs than the graph does", remedy=_REMEDY)
        now = rest_offsets(graph, body)
        spatial = {}
        for (i, j), edge in own.items():
            first = i < j  # the joint is fixed on the inner limb, see `LimbGraph`
            before = self.rest[edge if first else edge[::-1]]
            there = now[(i, j) if first else (j, i)]
            if not _alike(before, there):
                problem = f"{graph.names[j]} is elsewhere on {graph.names[i]} at rest"
                raise InputError(source, f"are of another graph: {problem}", remedy=_REMEDY)
            spatial[i, j] = _moved(self.spatial[edge], there - before, first)
        temporal = tuple(
            replace(s, forward=tuple(s.forward[k] for k in place), backward=tuple(s.backward[k] for k in place))
            for s in self.temporal
        )
        return LimbPotentials(graph.names, spatial, now, temporal)

    def save(self, path: Path, about: str) -> None:
        """Write a file that `load_potentials` reads; about: what it was learned from."""
        names = self.limbs
        content = {
            "about": about,
            "frames": "t and its covariance along the axes of the sending limb [m]; rotation vectors in the"
            " mean's own frame [rad]; quaternions x, y, z, w",
            "limbs": list(names),
            "spatial": [
                {"from": names[i], "to": names[j], "rest": _plain(self.rest[i, j]), **_numbers(p)}
                for (i, j), p in self.spatial.items()
            ],
            "temporal": [
                {"dt": float(f"{s.dt:.9g}"), "limb": name, "forward": _numbers(f), "backward": _numbers(b)}
                for s in self.temporal
                for name, f, b in zip(names, s.forward, s.backward, strict=True)
            ],
        }
        with replacing(path) as temporary:
            temporary.write_text(_laid_out(content), encoding="utf-8")


def rest_offsets(graph: LimbGraph, body: Body) -> dict[Edge, np.ndarray]:
    """By directed edge (i, j), where limb j is in the frame of i (3,) [m] with the body at rest."""
    t, R = limb_placements(graph, body, body.neutral)
    return {(i, j): R[i].T @ (t[j] - t[i]) for i, j in graph.directed}


def load_potentials(path: str | Path = SHIPPED) -> LimbPotentials:
    """Read potentials: JSON as `LimbPotentials.save` writes it.

    Raises
    ------
    InputError: the file is not readable, or something is missing, has another size or is outside its range.
    """
    content = mapping(read_json(path), path)
    limbs = tuple(str(name) for name in sequence(member(content, "limbs", path, ""), path, "limbs"))
    if len(set(limbs)) < max(len(limbs), 2):
        raise InputError(path, "does not name two limbs or more, each once", place="limbs")

    def limb(entry: Mapping[str, Any], key: str, place: str) -> int:
        name = member(entry, key, path, place)
        if name not in limbs:
            raise InputError(path, f"{name!r} is not one of the limbs", place=f"{place}.{key}")
        return limbs.index(name)

    spatial, rest = {}, {}
    for k, value in enumerate(sequence(member(content, "spatial", path, ""), path, "spatial")):
        place = f"spatial[{k}]"
        entry = mapping(value, path, place)
        edge = limb(entry, "from", place), limb(entry, "to", place)
        if edge in spatial or edge[0] == edge[1]:
            raise InputError(path, "is an edge of a limb with itself, or appears twice", place=place)
        rest[edge] = shaped(member(entry, "rest", path, place), (3,), path, f"{place}.rest")
        spatial[edge] = _read(entry, path, place)
    if not spatial or any(edge[::-1] not in spatial for edge in spatial):
        raise InputError(path, "needs edges, each in both directions", place="spatial")
    of_step: dict[float, dict[int, tuple[RelativePlacements, RelativePlacements]]] = {}
    for k, value in enumerate(sequence(member(content, "temporal", path, ""), path, "temporal")):
        place = f"temporal[{k}]"
        entry = mapping(value, path, place)
        dt = float(shaped(member(entry, "dt", path, place), (), path, f"{place}.dt"))
        if not dt > 0.0:
            raise InputError(path, f"{dt:g} s is not a time step", place=f"{place}.dt")
        both = [mapping(member(entry, key, path, place), path, f"{place}.{key}") for key in ("forward", "backward")]
        of_step.setdefault(dt, {})[limb(entry, "limb", place)] = (
            _read(both[0], path, f"{place}.forward"), _read(both[1], path, f"{place}.backward"),
        )  # fmt: skip
    if any(len(of) < len(limbs) for of in of_step.values()):
        raise InputError(path, "lacks a limb at one of the time steps", place="temporal")
    steps = [
        LimbSteps(dt, tuple(of[k][0] for k in range(len(limbs))), tuple(of[k][1] for k in range(len(limbs))))
        for dt, of in sorted(of_step.items())
    ]
    return LimbPotentials(limbs, spatial, rest, tuple(steps))


@cache
def shipped_potentials() -> LimbPotentials:
    """The shipped potentials, read once."""
    return load_potentials()


def _read(entry: Mapping[str, Any], path: str | Path, place: str) -> RelativePlacements:
    weight = numbers(member(entry, "weight", path, place), path, f"{place}.weight")
    count = weight.size
    if weight.ndim != 1 or count == 0 or not (weight >= 0.0).all() or not weight.sum() > 0.0:
        raise InputError(path, "are not shares", place=f"{place}.weight", remedy="numbers of 0 or more, not all 0")
    t = shaped(member(entry, "t", path, place), (count, 3), path, f"{place}.t")
    quaternion = shaped(member(entry, "quaternion", path, place), (count, 4), path, f"{place}.quaternion")
    length = np.linalg.norm(quaternion, axis=1)
    if not np.allclose(length, 1.0, atol=1e-3):
        raise InputError(path, "are not of length 1", place=f"{place}.quaternion")
    covariance = numbers(member(entry, "covariance", path, place), path, f"{place}.covariance")
    if covariance.shape == (count, 6):  # diagonals
        covariance = covariance[:, :, None] * np.eye(6)
    if covariance.shape != (count, 6, 6):
        problem = f"{count} x 6 or {count} x 6 x 6 numbers are needed"
        raise InputError(path, problem, place=f"{place}.covariance")
    symmetric = np.allclose(covariance, covariance.transpose(0, 2, 1))
    if not symmetric or not (np.linalg.eigvalsh(covariance) > LEAST_VARIANCE).all():
        raise InputError(path, "is not symmetric and positive definite", place=f"{place}.covariance")
    mean = np.concatenate([t, quaternion / length[:, None]], axis=1)
    return RelativePlacements(weight / weight.sum(), mean, covariance)


def _numbers(placements: RelativePlacements) -> dict[str, Any]:
    covariance = placements.covariance
    diagonal = np.einsum("mii->mi", covariance)
    if not np.any(covariance - diagonal[:, :, None] * np.eye(6)):
        covariance = diagonal
    return {
        "weight": _plain(placements.weight),
        "t": _plain(placements.mean[:, :3]),
        "quaternion": _plain(placements.mean[:, 3:]),
        "covariance": _plain(covariance),
    }


def _plain(array: np.ndarray) -> Any:
    """Nested lists of numbers with as many digits as a file needs."""
    if array.ndim:
        return [_plain(a) for a in array]
    return float(f"{float(array):.{_DIGITS}g}")


def _laid_out(content: dict[str, Any]) -> str:
    """JSON with a line for each edge, so that a change of the numbers can be read."""
    lines = []
    for key, value in content.items():
        text = json.dumps(value, separators=(",", ":"))
        if key in ("spatial", "temporal"):
            text = "[\n" + ",\n".join("  " + json.dumps(v, separators=(",", ":")) for v in value) + "\n ]"
        lines.append(f" {json.dumps(key)}: {text}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _alike(was: np.ndarray, now: np.ndarray) -> bool:
    size = max(float(np.linalg.norm(was)), 0.02)
    return float(np.linalg.norm(now - was)) < (_OTHER - 1.0) * size


def _moved(placements: RelativePlacements, by: np.ndarray, first: bool) -> RelativePlacements:
    """The placements with the joint moved on the inner limb, `by` (3,) [m] in its frame. first: the inner limb is i."""
    mean = placements.mean.copy()
    if first:
        mean[:, :3] += by
    else:  # t_ji = -R_ij^T t_ij, and R_ji is the mean's rotation
        still = np.concatenate([by, [0.0, 0.0, 0.0, 1.0]])
        turned = PLACEMENTS.composed(np.pad(mean[:, 3:], ((0, 0), (3, 0))), still[None])[:, 0]
        mean[:, :3] -= turned[:, :3]
    return replace(placements, mean=mean)


def _slower(placements: RelativePlacements, by: float) -> RelativePlacements:
    """Means and deviations times a number."""
    still = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    turn = by * TURNS.differences(still[3:], placements.mean[:, 3:])
    quaternion = TURNS.moved(still[3:], turn)
    mean = np.concatenate([by * placements.mean[:, :3], quaternion], axis=1)
    return replace(placements, mean=mean, covariance=by**2 * placements.covariance)
