"""What is tracked: the subject, its body and its geometry. Knows no image."""

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
