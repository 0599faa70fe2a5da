"""The few numbers that fit a subject's flesh to a person: girth, flatness and tapers of every part, sides tied."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from humanoid.subject.subject import Flesh, Subject
from humanoid.subject.superquadric import largest_bend
from humanoid.subject.urdf_flesh import ROUND, limb_capsule, mirror_parts

OF_PART = ("girth", "flatness", "taper x", "taper y")
GIRTHS = (0.7, 1.4)  # hard range of the factor on both half-axes
_FLATTER, _TAPERED, _LARGEST_TAPER = 0.2, 0.3, 0.6  # hard ranges: of flatness, of a taper's change, and of tapers
# Circumferences of adults vary by 6 to 10 per cent (Gordon et al., 1988 Anthropometric Survey of U.S. Army Personnel),
# much of it in common, and clothes add to them: 15 per cent for a half-axis in all.
_COMMON, _OWN, _FLAT = 0.10, 0.08, 0.075  # standard deviations of log factors: of the body, of the part, of its section
_TAPER, _TAPERS_ALIKE = 0.10, 0.7  # standard deviation of a taper, correlation of a part's two
_INSIDE = 1e-9  # of a limit that rounding must not cross


class ShapeParameters:
    """Shape parameters (S,) of a subject, zero for its own flesh, and what they make of it (CSS section 5).

    For each part, or pair of parts that mirror each other, girth g, flatness f and changes tx, ty of the tapers: its
    half-axes become a exp(g + f) and b exp(g - f); c is left to the proportions. Capsules and ellipsoids stay as they
    are. A middle part that lies across the body has no tapers of its own: they would make its sides differ.

    parts (G): names of the parts. group (S,) int, kind (S,) int: what each parameter belongs to, in `parts`, OF_PART.
    precision (S, S): inverse covariance of the Gaussian prior about zero; girths have a share in common, as fat and
        clothes do.
    low, high (S,): hard range, in which every part is a surface and stays on its side of the rule of `limb_capsule`:
        a limb's solid must not become an ellipsoid that fills its joints, nor the trunk's a thinner capsule.
    """

    def __init__(self, subject: Subject) -> None:
        self._flesh = subject.flesh
        mirror = mirror_parts([f.link for f in subject.flesh])
        shaped = [k for k, f in enumerate(subject.flesh) if f.shape == "superquadric" and k <= mirror[k]]
        self._members = [sorted({k, int(mirror[k])}) for k in shaped]
        self.parts = _names([subject.flesh[k].link for k in shaped], [len(m) == 2 for m in self._members])
        kinds = [_kinds(subject.flesh[k], alone=len(m) == 1) for k, m in zip(shaped, self._members, strict=True)]
        self.group = np.array([g for g, own in enumerate(kinds) for _ in own], dtype=np.int64)
        self.kind = np.array([kind for own in kinds for kind in own], dtype=np.int64)
        self.precision = np.linalg.inv(_prior_covariance(self.group, self.kind))
        ranges = [_range(subject.flesh[shaped[g]])[kind] for g, kind in zip(self.group, self.kind, strict=True)]
        self.low, self.high = np.array(ranges).reshape(-1, 2).T

    def of_parts(self, shape: np.ndarray) -> np.ndarray:
        """Parameters of every part (B, 9), see `humanoid.subject.superquadric`, of shape parameters (S,)."""
        values = np.zeros((len(self.parts), len(OF_PART)))
        values[self.group, self.kind] = shape
        parameters = np.array([f.parameters for f in self._flesh])
        for (girth, flatness, *tapers), members in zip(values, self._members, strict=True):
            parameters[members, :2] *= np.exp([girth + flatness, girth - flatness])
            parameters[members, 5:7] += tapers
        return parameters

    def derivatives(self, shape: np.ndarray) -> np.ndarray:
        """Derivatives of `of_parts`, (B, 9, S)."""
        by_shape = np.zeros((len(self._flesh), 9, len(shape)))
        parameters = self.of_parts(shape)
        for s, (g, kind) in enumerate(zip(self.group, self.kind, strict=True)):
            members = self._members[g]
            if kind < 2:
                by_shape[members, 0, s] = parameters[members, 0]
                by_shape[members, 1, s] = parameters[members, 1] * (1.0 if kind == 0 else -1.0)
            else:
                by_shape[members, 3 + kind, s] = 1.0
        return by_shape

    def subject(self, subject: Subject, shape: np.ndarray) -> Subject:
        """The subject with the flesh of shape parameters (S,); parts whose parameters are zero stay as written."""
        parameters, moved = self.of_parts(shape), np.unique(self.group[shape != 0.0])
        return subject.reshaped({k: parameters[k].tolist() for g in moved for k in self._members[g]})


def _names(links: Sequence[str], paired: Sequence[bool]) -> tuple[str, ...]:
    """Links without their side where both sides are meant, numbered where a link has several parts."""
    plain = [re.sub("left_|right_", "", link) if two else link for link, two in zip(links, paired, strict=True)]
    earlier = [plain[:k].count(name) for k, name in enumerate(plain)]
    return tuple(name if count == 0 else f"{name} {count + 1}" for name, count in zip(plain, earlier, strict=True))


def _kinds(flesh: Flesh, *, alone: bool) -> range:
    across = abs(flesh.R_link_part[1, 2]) > 0.5
    return range(2 if alone and across else 4)


def _prior_covariance(group: np.ndarray, kind: np.ndarray) -> np.ndarray:
    same = group[:, None] == group
    girths, tapers = np.outer(kind == 0, kind == 0), np.outer(kind >= 2, kind >= 2)
    own = np.where(kind == 0, _OWN, np.where(kind == 1, _FLAT, _TAPER * np.sqrt(1.0 - _TAPERS_ALIKE)))
    return np.asarray(np.diag(own**2) + _COMMON**2 * girths + _TAPERS_ALIKE * _TAPER**2 * (tapers & same))


def _range(flesh: Flesh) -> list[tuple[float, float]]:
    """Hard range of each of the four parameters of a part; zero is inside."""
    a, b, c = flesh.core.size  # which side of the rule a part is on is its solid's matter
    low, high = np.log(GIRTHS)
    ratio, ends = np.log(a / b), np.array([-_FLATTER, _FLATTER])
    limb = limb_capsule(flesh) is not None
    if limb:
        ends = np.clip(ends, *(0.5 * (np.array([-1.0, 1.0]) * np.log(ROUND) - ratio)))
        thickest = 0.5 * (a * np.exp(ends) + b * np.exp(-ends)).max()
        high = min(high, np.log(c / 1.5 / thickest) - _INSIDE)
    elif abs(ratio) > np.log(ROUND):
        nearest = 0.5 * (np.sign(ratio) * np.log(ROUND) - ratio)
        ends[0 if ratio > 0.0 else 1] = (max if ratio > 0.0 else min)(ends[0 if ratio > 0.0 else 1], nearest)
    else:
        low = max(low, np.log(c / 1.5 / np.sqrt(a * b)) + _INSIDE)
    tapers = [_taper_range(t) for t in flesh.taper]
    high = min(high, np.log(_room_in_bend(flesh, ends, tapers)) - _INSIDE)
    ranges = [(low, high), (ends[0] + _INSIDE, ends[1] - _INSIDE), *tapers]
    return [(min(0.0, float(lowest)), max(0.0, float(highest))) for lowest, highest in ranges]


def _taper_range(taper: float) -> tuple[float, float]:
    return max(-_TAPERED, -_LARGEST_TAPER - taper), min(_TAPERED, _LARGEST_TAPER - taper)


def _room_in_bend(flesh: Flesh, flatness: np.ndarray, tapers: Sequence[tuple[float, float]]) -> float:
    """How many times thicker a part may become before its bend folds it, however it is flattened and tapered."""
    bend = np.hypot(*flesh.bend)
    if bend == 0.0:
        return np.inf
    worst = flesh.parameters
    worst[:2] *= np.exp(np.abs(flatness).max())
    worst[5:7] = [max(abs(t + change) for change in ends) for t, ends in zip(flesh.taper, tapers, strict=True)]
    return float(largest_bend(worst) / bend)
