"""The person of the demonstrations."""

from __future__ import annotations

from humanoid.subject.subject import Subject, load_subject

# other lengths than the built-in subject's but hardly another stature: one camera cannot see absolute size
PROPORTIONS = {
    "left_hip_flexion": 1.03,
    "left_clavicle_elevation": 0.97,
    "left_shoulder_elevation": 1.05,
    "left_elbow_flexion": 1.04,
    "left_wrist": 0.97,
    "left_knee_flexion": 1.04,
    "left_ankle_dorsiflexion": 0.98,
    "skull": 1.02,
}


def demo_subject() -> Subject:
    """The person in the clip: human34 with other proportions."""
    return load_subject("human34").scaled(PROPORTIONS)
