"""Where modes came from and what they paid, as their search had it: nothing of it can be told from the modes alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

START, PARENT, READING, SAMPLE, PARTICLES = "start", "parent", "other reading", "sample", "particles"
JUMP, LIMB, LIMBS = "jump in depth", "limb elsewhere", "limbs exchanged"
PREFIX = "origin_"


@dataclass(frozen=True)
class Origin:
    """Of one mode.

    family: what it was searched from: "start" (of a track), "parent" (a parent's own pose), "other reading" (of the
        keypoints), "sample", "jump in depth", "limb elsewhere", "limbs exchanged"; or "particles", its mean.
    q_previous (nq,): where the body was before: the parent's configuration, of a jump the pose that it jumped to. Flow
        is followed from there. None where there is no past.
    paid: whether the energy has the price of the change since then.
    price: flat price of a jump. The weight has paid it, the energy has not.
    q_predicted (nq,): where the parent's velocity took it, from where flow is looked for too; None where it is not.
    q_assigned (nq,): the pose at which the pictures' features were assigned, None without pictures.
    extent (C,): extent of the body in each camera's pictures [px], by which their noise is told; empty without.
    """

    family: str
    q_previous: np.ndarray | None = None
    paid: bool = False
    price: float = 0.0
    q_predicted: np.ndarray | None = None
    q_assigned: np.ndarray | None = None
    extent: tuple[float, ...] = ()


@dataclass(frozen=True)
class Origins:
    """Of the K modes of a frame, as arrays; see `Origin`. NaN stands for what there is not.

    family (K): text. q_previous, q_predicted, q_assigned (K, nq). paid (K,) bool. price (K,). extent (K, C).
    """

    family: np.ndarray
    q_previous: np.ndarray
    paid: np.ndarray
    price: np.ndarray
    q_predicted: np.ndarray
    q_assigned: np.ndarray
    extent: np.ndarray

    @staticmethod
    def of(origins: Sequence[Origin | None], nq: int) -> Origins | None:
        """From those of single modes; None where one is not known."""
        known = [origin for origin in origins if origin is not None]
        if not known or len(known) < len(origins):
            return None
        return Origins(
            family=np.array([o.family for o in known], dtype=np.str_),
            q_previous=_rows([o.q_previous for o in known], nq),
            paid=np.array([o.paid for o in known]),
            price=np.array([o.price for o in known]),
            q_predicted=_rows([o.q_predicted for o in known], nq),
            q_assigned=_rows([o.q_assigned for o in known], nq),
            extent=np.array([o.extent for o in known]).reshape(len(known), -1),
        )

    def one(self, k: int) -> Origin:
        """That of mode k."""
        return Origin(
            str(self.family[k]), _row(self.q_previous[k]), bool(self.paid[k]), float(self.price[k]),
            _row(self.q_predicted[k]), _row(self.q_assigned[k]), tuple(self.extent[k].tolist()),
        )  # fmt: skip

    def arrays(self) -> dict[str, np.ndarray]:
        """As arrays to be stored, those left out that say nothing; `from_arrays` is the inverse."""
        found = {f.name: getattr(self, f.name) for f in fields(self)}
        return {PREFIX + name: a for name, a in found.items() if a.dtype.kind != "f" or np.isfinite(a).any()}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray], nq: int) -> Origins | None:
        """Rebuild them from `arrays`, among others; None where there are none, as in frames without modes of their own
        and in runs that were made before they were kept."""
        family = arrays.get(PREFIX + "family")
        if family is None:
            return None
        count = len(family)
        shapes = {"q_previous": nq, "q_predicted": nq, "q_assigned": nq, "extent": 0}
        rows = {name: arrays.get(PREFIX + name, np.full((count, width), np.nan)) for name, width in shapes.items()}
        paid, price = arrays[PREFIX + "paid"], arrays[PREFIX + "price"]
        return Origins(family=family, paid=paid, price=price, **rows)


def _rows(found: Sequence[np.ndarray | None], nq: int) -> np.ndarray:
    return np.array([np.full(nq, np.nan) if q is None else q for q in found])


def _row(q: np.ndarray) -> np.ndarray | None:
    return q if np.isfinite(q).all() else None
