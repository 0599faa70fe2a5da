"""Origins of modes, and their penalties in the search, which the modes alone do not show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from typing import NamedTuple

import numpy as np

from estimator.data.formats.checked_arrays import Field

PREFIX = "origin_"
ORIGIN_FIELDS = {
    "family": Field("U", ("K",)),
    "q_previous": Field("f", ("K", "nq"), finite=False),
    "paid": Field("b", ("K",)),
    "price": Field("f", ("K",)),
    "q_predicted": Field("f", ("K", "nq"), finite=False),
    "q_assigned": Field("f", ("K", "nq"), finite=False),
    "extent": Field("f", ("K", "C"), finite=False),
    "q_left": Field("f", ("K", "nq"), finite=False),
}
"""The fields of `Origins` by the names that run files have them by after `PREFIX`, in their order. One that may be NaN
is left out where all of it is."""


class Family(str, Enum):
    """Source of a mode's search. The values are stored in runs and shown to users."""

    START = "start"  # of a track: no frame before
    KEPT = "parent"  # the parent's own pose
    ASSOCIATION = "other association"  # the parent's own pose, keypoints assigned to landmarks in another way
    SAMPLE = "sample"  # about the parent
    DEPTH_JUMP = "kinematic jump"  # a limb or part at another depth
    LIMB_JUMP = "limb elsewhere"
    LIMB_EXCHANGE = "limbs exchanged"
    EXAMPLE = "example"  # a pose of an index that looks like the picture
    LIMBS = "limbs"  # assembled from the beliefs of single limbs
    PARTICLES = "particles"  # their mean, which nothing was searched from

    __str__ = str.__str__

    @property
    def at_previous(self) -> bool:
        """Whether hypotheses begin at the pose that they have for the frame before (see `PreviousPose`), from which
        keypoints and flow move them before the pictures are used."""
        return self not in (Family.START, Family.SAMPLE, Family.EXAMPLE, Family.LIMBS, Family.PARTICLES)

    @staticmethod
    def of_text(text: str) -> Family:
        """The family by its name in a run; raises ValueError for any other text."""
        return Family(_FORMER.get(text, text))


_FORMER = {"other reading": "other association", "jump in depth": "kinematic jump"}
"""Words that runs have which were made before these were chosen."""


class PreviousPose(NamedTuple):
    """Pose of a hypothesis in the frame before. Flow is followed from there, velocities count from there.

    q (nq,): the parent's configuration; of a jump the pose that it jumped to, as a jump is not motion.
    q_predicted (nq,): where the parent's velocity took it, where flow is searched for too; None where it is not.
    has_transition: whether the energy has the transition's penalty of the change since q.
    q_left (nq,): of a jump the parent's configuration, which it left; None where q is the parent's.
    """

    q: np.ndarray
    q_predicted: np.ndarray | None = None
    has_transition: bool = True
    q_left: np.ndarray | None = None

    @property
    def key(self) -> PoseKey:
        """Keys of the distinct previous poses whose flow must be followed."""
        return self.q.tobytes(), *(b"" if q is None else q.tobytes() for q in (self.q_predicted, self.q_left))


PoseKey = tuple[bytes, ...]


class Origin(NamedTuple):
    """Origin of one hypothesis, and of the mode found from it.

    previous: the pose in the frame before, None where there was none or none counts.
    penalty: flat penalty of a jump. The weight includes it, the energy does not.
    q_assigned (nq,): of a mode, the pose at which the pictures' features were assigned, None without pictures.
    extent (C,): of a mode, extent of the body in each camera's pictures [px], from which their noise follows; empty
        without.
    """

    family: Family
    previous: PreviousPose | None = None
    penalty: float = 0.0
    q_assigned: np.ndarray | None = None
    extent: tuple[float, ...] = ()

    @property
    def transition_from(self) -> np.ndarray | None:
        """The configuration (nq,) from which the transition's penalty counts, None where it is not paid."""
        return self.previous.q if self.previous is not None and self.previous.has_transition else None


@dataclass(frozen=True)
class Origins:
    """Origins of the K modes of a frame, as arrays; see `Origin`. NaN where missing.

    family (K): text. q_previous, q_predicted, q_left (K, nq), has_transition (K,) bool: see `PreviousPose`.
    penalty (K,). q_assigned (K, nq). extent (K, C).
    """

    family: np.ndarray
    q_previous: np.ndarray
    has_transition: np.ndarray
    penalty: np.ndarray
    q_predicted: np.ndarray
    q_assigned: np.ndarray
    extent: np.ndarray
    q_left: np.ndarray

    @staticmethod
    def of(origins: Sequence[Origin | None], nq: int) -> Origins | None:
        """The origins of single modes as arrays; None where one is unknown."""
        known = [origin for origin in origins if origin is not None]
        if not known or len(known) < len(origins):
            return None
        previous = [origin.previous for origin in known]
        return Origins(
            family=np.array([o.family.value for o in known], dtype=np.str_),
            q_previous=_rows([None if p is None else p.q for p in previous], nq),
            has_transition=np.array([p is not None and p.has_transition for p in previous]),
            penalty=np.array([o.penalty for o in known]),
            q_predicted=_rows([None if p is None else p.q_predicted for p in previous], nq),
            q_assigned=_rows([o.q_assigned for o in known], nq),
            extent=np.array([o.extent for o in known]).reshape(len(known), -1),
            q_left=_rows([None if p is None else p.q_left for p in previous], nq),
        )

    def of_mode(self, k: int) -> Origin:
        """The origin of mode k."""
        q, own, left = _row(self.q_previous[k]), bool(self.has_transition[k]), _row(self.q_left[k])
        previous = None if q is None else PreviousPose(q, _row(self.q_predicted[k]), own, left)
        return Origin(
            Family(str(self.family[k])), previous, float(self.penalty[k]), _row(self.q_assigned[k]),
            tuple(self.extent[k].tolist()),
        )  # fmt: skip

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays to be stored, without uninformative ones; `from_arrays` is the inverse."""
        own = zip(ORIGIN_FIELDS.items(), (getattr(self, f.name) for f in fields(self)), strict=True)
        return {PREFIX + name: a for (name, field), a in own if field.finite or np.isfinite(a).any()}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray], nq: int) -> Origins | None:
        """Rebuild them from `arrays`, among others; None where there are none, as in frames without modes of their own
        and in runs that were made before they were kept."""
        family = families(arrays)
        if family is None:
            return None
        sizes = {"K": len(family), "nq": nq, "C": 0}
        kept = {name: arrays.get(PREFIX + name) for name in ORIGIN_FIELDS} | {"family": family}
        absent = (f.nothing(*(sizes[size] for size in f.shape)) for f in ORIGIN_FIELDS.values())
        return Origins(*(none if a is None else a for a, none in zip(kept.values(), absent, strict=True)))


def families(arrays: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Text (K,) of the families among the arrays of a frame, None where they were not kept; raises ValueError for text
    that names none."""
    stored = arrays.get(PREFIX + "family")
    return None if stored is None else np.array([Family.of_text(str(t)).value for t in stored], dtype=np.str_)


def _rows(configurations: Sequence[np.ndarray | None], nq: int) -> np.ndarray:
    return np.array([np.full(nq, np.nan) if q is None else q for q in configurations])


def _row(q: np.ndarray) -> np.ndarray | None:
    return q if np.isfinite(q).all() else None
