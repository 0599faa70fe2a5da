"""The subject: one articulated body as its URDF describes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin

from humanoid import urdf_elements
from humanoid.urdf_elements import Flesh, Landmark, Proportion, Stabiliser

__all__ = ["Flesh", "Landmark", "Proportion", "Stabiliser", "Subject", "load_subject"]

URDF_FOLDER = Path(__file__).parent / "urdf"
Base = Literal["auto", "free", "fixed"]


@dataclass(frozen=True)
class Subject:
    """A validated subject.

    Attributes
    ----------
    name: name of the robot in the file.
    source: what was asked for: a built-in name or a path.
    urdf: the whole URDF as text, extra elements included; it loads again.
    base: "free" (root xyz + quaternion xyzw lead q) or "fixed".
    model: Pinocchio model; shared, never changed.
    landmarks, flesh, stabilisers, proportions: the extra elements (see `humanoid.urdf_elements`).
    """

    name: str
    source: str
    urdf: str
    base: Literal["free", "fixed"]
    model: pin.Model
    landmarks: tuple[Landmark, ...] = ()
    flesh: tuple[Flesh, ...] = ()
    stabilisers: tuple[Stabiliser, ...] = ()
    proportions: tuple[Proportion, ...] = ()

    def scaled(self, scales: Mapping[str, float]) -> Subject:
        """This subject with some proportions changed; keys are `Proportion.joint`, values scale the file's lengths."""
        text = urdf_elements.scaled_urdf(self.urdf, self.proportions, scales)
        return subject_from_text(text, source=self.source, base=self.base)


def subject_from_text(text: str, *, source: str, base: Base = "auto") -> Subject:
    """Build a Subject from URDF text; `source` names it in errors."""
    elements = urdf_elements.parse(text, source)
    floating = (elements.base or "fixed") if base == "auto" else base
    if floating == "free":
        model = pin.buildModelFromXML(elements.plain_urdf, pin.JointModelFreeFlyer())
    else:
        model = pin.buildModelFromXML(elements.plain_urdf)
    return Subject(
        name=model.name,
        source=source,
        urdf=text,
        base="free" if floating == "free" else "fixed",
        model=model,
        landmarks=elements.landmarks,
        flesh=elements.flesh,
        stabilisers=elements.stabilisers,
        proportions=elements.proportions,
    )


def load_subject(source: str | Path, *, base: Base = "auto") -> Subject:
    """Load a built-in subject by name or any URDF by path."""
    path = URDF_FOLDER / f"{source}.urdf"
    if not path.is_file():
        path = Path(source)
    return subject_from_text(path.read_text(), source=str(source), base=base)

