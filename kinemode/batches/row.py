"""A clip of a batch, as its row of the manifest describes it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

LONGEST_NAME = 100
_UNFIT = re.compile(r"[^\w.-]+")


@dataclass(frozen=True)
class BatchRow:
    """One clip: a recording by one or several cameras.

    Attributes
    ----------
    name: unique, and fit for a folder: letters, digits, dots, underscores and hyphens, at most 100 characters.
    place: where it is in the manifest, for messages: "row 3", the line of a CSV file, or of TOML the third [[clip]].
    person: who is seen, "" where that is unknown.
    fits: whether the person's subject is fitted from this clip.
    subject: a built-in name or the absolute path of a URDF, as `kinemode.track` takes it.
    clips: absolute paths or NAME=PATH texts; none where the keypoints are enough.
    options: the other keyword arguments of `kinemode.track` that were given, as values that JSON knows; absolute paths.
    reference: absolute path of known landmarks or joint angles, as `kinemode.evaluate` takes them.
    """

    name: str
    place: str
    person: str = ""
    fits: bool = False
    subject: str = "human34"
    clips: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    reference: str | None = None


def fitting_name(text: str) -> str:
    """The name of a clip that is nearest to a text: a part of it and underscores, empty where it has no letter."""
    return _UNFIT.sub("_", text).lstrip(".")[:LONGEST_NAME]
