"""Who is in the pictures of captured motion, and how they are filmed."""

from __future__ import annotations

from estimator.synthesis.settings import DetectorSettings
from humanoid.subject.subject import Subject
from kinemode import demo

FPS = 30.0
DETECTOR = DetectorSettings(noise_px=5.0, outlier_fraction=0.05, missing_fraction=0.1)
LIMBS = ("upper_arm", "forearm", "thigh", "shank")
GIRTH = 1.08  # of the limbs in the pictures, over those of the body that is tracked


def person() -> Subject:
    """The body in the pictures: human34 with the lengths of the demonstration's person and thicker limbs."""
    subject = demo.demo_subject()
    limbs = {i: part for i, part in enumerate(subject.flesh) if part.link.endswith(LIMBS)}
    return subject.reshaped({i: part.widened(GIRTH) for i, part in limbs.items()})
