"""Which joints a plot shows, and which of them share a panel."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from estimator.runs.joint_angle import JointAngle
from humanoid.support.errors import InputError
from humanoid.support.near_names import nearest
from viz.solids.solid import Side, side_of, without_side

USUAL = ("hip", "knee", "ankle", "shoulder", "elbow")
"""Parts of names of the joints that are shown of a body with many."""
_FEW = 12
"""Panels up to which all joints are shown."""


class JointPanel(NamedTuple):
    """Curves in one panel: a joint, or those of both sides; their common name."""

    title: str
    curves: tuple[tuple[Side, JointAngle], ...]


def chosen_joints(names: Sequence[str], wanted: str | Iterable[str] | None) -> tuple[str, ...]:
    """The requested joints, in their own order.

    wanted: names, parts of names and sides ("left"), separated by commas or as several texts; by default the limbs of a
    body with more than twelve panels, and all joints otherwise.

    Raises
    ------
    InputError: a text that is not part of any name, with the nearest names.
    """
    if wanted is None:
        return _usual(names)
    parts = [part.strip() for text in ([wanted] if isinstance(wanted, str) else wanted) for part in text.split(",")]
    parts = [part for part in parts if part]
    if not parts:
        raise InputError("joints", "names no joint", remedy=nearest("", names, "joints"))
    chosen = {name for part in parts for name in _asked(part, names)}
    return tuple(name for name in names if name in chosen)


def _asked(part: str, names: Sequence[str]) -> list[str]:
    if part in names:
        return [part]
    text = "_".join(part.lower().split())
    asked = [name for name in names if (side_of(name) == text if text in ("left", "right") else text in name.lower())]
    if not asked:
        raise InputError("joints", f"no joint is called {part!r}", remedy=nearest(part, names, "joints"))
    return asked


def _usual(names: Sequence[str]) -> tuple[str, ...]:
    usual = tuple(name for name in names if any(part in name.lower() for part in USUAL))
    return usual if usual and len({without_side(name) for name in names}) > _FEW else tuple(names)


def panels_of(angles: Sequence[JointAngle]) -> tuple[JointPanel, ...]:
    """One panel a joint, those of both sides in one, in the order in which they first come."""
    groups: dict[tuple[str, str], list[tuple[Side, JointAngle]]] = {}
    for angle in angles:
        side = side_of(angle.name)
        title = angle.name if side == "trunk" else without_side(angle.name)
        groups.setdefault((title, angle.unit), []).append((side, angle))
    panels = []
    for (title, _), curves in groups.items():
        if len({side for side, _ in curves}) == len(curves):
            panels.append(JointPanel(title, tuple(curves)))
        else:  # names that differ by more than the side
            panels += [JointPanel(angle.name, ((side, angle),)) for side, angle in curves]
    return tuple(panels)
