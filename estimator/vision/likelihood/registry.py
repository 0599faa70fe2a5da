"""The cues there are, by name."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from estimator.vision.cues.base import Cue
from estimator.vision.cues.depth.cue import Depth
from estimator.vision.cues.edges.cue import Edges
from estimator.vision.cues.flow.cue import Flow
from estimator.vision.cues.silhouette.cue import Outline
from humanoid.support.errors import InputError
from humanoid.support.plugins import Registry


def _check(cue: Cue, others: Iterable[Cue]) -> None:
    if (
        not cue.name.isidentifier()
        or cue.name.startswith("use_")
        or cue.name in ("auto", "off", "working_size", "surface")
    ):
        raise InputError("cue", f"none can be named {cue.name!r}", remedy="a plain word, not auto or off")


CUES: Registry[Cue] = Registry("cue", (Edges(), Flow(), Outline(), Depth()), _check)
"""All cues by name, in the order in which their energies are summed."""


def register(cue: Cue) -> None:
    """Make a cue known: to `--cues`, the settings and all that uses the pictures.

    It is read, and its energy summed, after the existing ones. Worker processes have it too, if they can import its
    class. Raises InputError where the name is taken, or no plain word.
    """
    CUES.register(cue)


def cues_of(read: Collection[str]) -> list[Cue]:
    """The cues that something was read for, in the order of `CUES`."""
    return [cue for cue in CUES.values() if cue.name in read]
