"""The tracked subject, its body and its geometry. Independent of images."""

from __future__ import annotations

from typing import TYPE_CHECKING

from humanoid.support.lazy import lazy_names

if TYPE_CHECKING:
    from humanoid.kinematics.body import Body, PosedBody
    from humanoid.subject.subject import Flesh, Landmark, Proportion, Stabiliser, Subject, load_subject, subject_names
    from humanoid.support.errors import InputError

__all__ = [
    "Body",
    "Flesh",
    "InputError",
    "Landmark",
    "PosedBody",
    "Proportion",
    "Stabiliser",
    "Subject",
    "load_subject",
    "subject_names",
]

# Pinocchio and numba take half a second to import, which those who need `humanoid.support` alone need not wait for.
__getattr__ = lazy_names(
    __name__,
    dict.fromkeys(__all__, "humanoid.subject.subject")
    | {
        "Body": "humanoid.kinematics.body",
        "InputError": "humanoid.support.errors",
        "PosedBody": "humanoid.kinematics.body",
    },
)
