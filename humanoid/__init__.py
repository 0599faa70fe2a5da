"""What is tracked: the subject, its body and its geometry. Knows no image."""

from humanoid.body import Body, PosedBody
from humanoid.errors import InputError
from humanoid.subject import Flesh, Landmark, Proportion, Stabiliser, Subject, load_subject, subject_names

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
