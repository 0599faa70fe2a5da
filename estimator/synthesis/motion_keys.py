"""Authored motions as joint angles at key times: of a whole body, and of an upper body before a parallel camera, as of
Taycher, Fisher and Darrell 2004, Figure 2.
"""

from __future__ import annotations

from types import MappingProxyType

from estimator.synthesis.keyed_motion import KeyedMotion
from humanoid.support.errors import InputError

CROSS_ARMS = KeyedMotion(
    name="cross_arms",
    subject="upper13",
    background="room",
    azimuth=0.0,
    times=(0.0, 0.533, 1.067, 1.6, 2.133, 2.667, 3.2, 3.733, 4.267, 4.8, 5.333, 5.867, 6.4),
    angles=MappingProxyType(
        {
            "trunk_left": (0.0, 0.01, 0.02, 0.02, 0.0, -0.02, -0.03, -0.01, 0.0, 0.02, 0.02, 0.01, 0.0),
            "trunk_up": (0.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, -0.01, -0.01, -0.01, 0.0, 0.0),
            "left_shoulder_elevation": (13, 44, 33, 46, 31, 45, 33, 8, 17, 10, 27, 25, 13),
            "left_shoulder_flexion": (-23, 15, 44, 12, -6, 46, -12, -12, -18, 17, -25, -27, -23),
            "left_shoulder_rotation": (-20, -21, -2, -22, -35, -28, -68, -15, -20, 17, -21, -32, -21),
            "left_elbow_flexion": (62, 86, 66, 87, 106, 100, 118, 98, 140, 116, 141, 108, 62),
            "neck_flexion": (6, 4, 2, 2, -2, 0, 2, 6, 8, 8, 8, 4, 6),
            "neck_lateral": (0, 2, 3, 3, 0, -2, -3, 0, 3, 3, 3, 0, 0),
            "neck_axial": (0, 6, 10, 10, 0, -6, -12, 4, 8, 8, 8, 0, 0),
            "right_shoulder_elevation": (13, 17, 10, 27, 34, 17, 41, 29, 44, 33, 46, 12, 14),
            "right_shoulder_flexion": (-23, -18, 17, -25, -8, -20, 46, -18, 15, 44, 12, -11, -24),
            "right_shoulder_rotation": (-20, -20, 17, -21, -33, -21, -27, -55, -21, -2, -22, -8, -18),
            "right_elbow_flexion": (62, 140, 116, 141, 106, 88, 99, 108, 86, 66, 87, 97, 62),
        }
    ),
)
"""Arms that cross before the trunk, either hand before the other and before the face."""

REACH_OUT = KeyedMotion(
    name="reach_out",
    subject="upper13",
    background="room",
    azimuth=0.0,
    times=(0.0, 0.711, 1.422, 2.133, 2.844, 3.556, 4.267, 4.978, 5.689, 6.4),
    angles=MappingProxyType(
        {
            "trunk_left": (0.0, 0.02, 0.03, 0.0, -0.03, -0.04, 0.0, 0.02, 0.02, 0.0),
            "trunk_up": (0.0, 0.0, 0.01, 0.01, 0.0, -0.01, -0.02, 0.0, 0.01, 0.0),
            "left_shoulder_elevation": (13, 47, 68, 48, 31, 20, 43, 26, 74, 12),
            "left_shoulder_flexion": (-23, 18, 46, -12, -43, 5, 33, -35, -1, -23),
            "left_shoulder_rotation": (-20, -31, -37, -62, -63, -15, -24, -37, -60, -22),
            "left_elbow_flexion": (62, 70, 43, 105, 99, 94, 42, 84, 115, 62),
            "neck_flexion": (6, 2, 0, -4, 0, 4, 8, 2, -6, 6),
            "neck_lateral": (0, 0, 2, 0, -3, -2, 0, 0, 4, 0),
            "neck_axial": (0, -8, -14, 4, 12, 14, 0, 0, -6, 0),
            "right_shoulder_elevation": (13, 13, 17, 47, 65, 50, 40, 26, 29, 14),
            "right_shoulder_flexion": (-23, -27, -21, 20, 43, -14, 31, -36, 26, -24),
            "right_shoulder_rotation": (-20, -19, -20, -31, -35, -62, -27, -40, -15, -19),
            "right_elbow_flexion": (62, 76, 98, 71, 44, 102, 49, 87, 80, 62),
        }
    ),
)
"""Arms that come towards the camera and go back, out of the plane of the image."""

TALK = KeyedMotion(
    name="talk",
    subject="upper13",
    background="room",
    azimuth=0.0,
    times=(0.0, 0.667, 1.333, 2.0, 2.667, 3.333, 4.0, 4.667, 5.333, 6.0, 6.667, 7.333, 8.0, 8.667, 9.333, 10.0),
    angles=MappingProxyType(
        {
            "trunk_left": (
                0.0,
                0.02,
                0.01,
                0.02,
                0.02,
                0.0,
                -0.02,
                -0.03,
                -0.03,
                -0.01,
                0.0,
                0.02,
                0.02,
                0.0,
                0.02,
                0.0,
            ),
            "trunk_up": (0.0, 0.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0, -0.01, -0.01, -0.01, -0.02, 0.0, 0.0),
            "left_shoulder_elevation": (13, 47, 44, 33, 46, 49, 53, 28, 39, 10, 17, 10, 27, 44, 27, 12),
            "left_shoulder_flexion": (-23, 18, 15, 44, 12, -15, 43, -39, -24, -13, -18, 17, -25, 33, -35, -23),
            "left_shoulder_rotation": (-20, -31, -21, -2, -22, -60, -30, -67, -61, -13, -20, 17, -21, -23, -37, -21),
            "left_elbow_flexion": (62, 70, 86, 66, 87, 105, 100, 99, 118, 98, 140, 116, 141, 42, 84, 62),
            "neck_flexion": (6, 2, 4, 2, 2, -4, 0, 0, 2, 6, 8, 8, 8, 8, 2, 6),
            "neck_lateral": (0, 0, 2, 3, 3, 0, -2, -3, -3, 0, 3, 3, 3, 0, 0, 0),
            "neck_axial": (0, -8, 6, 10, 10, 4, -6, 12, -12, 4, 8, 8, 8, 0, 0, 0),
            "right_shoulder_elevation": (13, 13, 17, 10, 27, 48, 18, 66, 50, 30, 44, 33, 46, 42, 26, 12),
            "right_shoulder_flexion": (-23, -27, -18, 17, -25, 19, -21, 43, 43, -19, 15, 44, 12, 30, -36, -23),
            "right_shoulder_rotation": (-20, -19, -20, 17, -21, -30, -20, -35, -28, -54, -21, -2, -22, -25, -39, -22),
            "right_elbow_flexion": (62, 76, 140, 116, 141, 71, 88, 44, 99, 108, 86, 66, 87, 49, 87, 62),
        }
    ),
)
"""Ten seconds of both: hands that reach, cross and cover the face, as in a vivid talk."""


REACH = KeyedMotion(
    name="reach",
    subject="human34",
    background="room",
    azimuth=-38.0,
    times=(0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0),
    angles=MappingProxyType(
        {
            "lumbar_flexion": (5, 4, 8, 16, 24, 12, 8),
            "lumbar_lateral": (0, 2, 6, -3, -7, 0, 2),
            "lumbar_axial": (0, -6, -12, 2, 12, 6, 0),
            "neck_flexion": (6, 2, -4, 4, 10, 6, 4),
            "neck_lateral": (0, 2, 3, -2, -3, 0, 0),
            "neck_axial": (0, 12, 18, 0, -12, -4, 0),
            "left_clavicle_elevation": (1, 3, 8, 14, 8, 3, 1),
            "left_clavicle_protraction": (0, 0, 2, 6, 12, 4, 0),
            "left_shoulder_elevation": (10, 24, 88, 138, 86, 36, 13),
            "left_shoulder_flexion": (4, 12, 38, 24, 48, 28, 8),
            "left_shoulder_rotation": (0, 0, -6, -8, 0, 4, 2),
            "left_elbow_flexion": (16, 42, 46, 18, 14, 44, 28),
            "right_clavicle_elevation": (1, 2, 5, 6, 8, 12, 4),
            "right_clavicle_protraction": (0, 4, 10, 10, 4, 0, 0),
            "right_shoulder_elevation": (10, 30, 84, 62, 78, 52, 16),
            "right_shoulder_flexion": (4, 26, 50, 32, 44, 8, 6),
            "right_shoulder_rotation": (0, -4, 0, -6, -4, -8, 0),
            "right_elbow_flexion": (16, 52, 12, 66, 16, 54, 30),
            "left_hip_flexion": (6, 16, 46, 22, 34, 22, 12),
            "left_hip_abduction": (5, 5, 9, 8, 9, 8, 6),
            "left_hip_rotation": (0, 4, 14, 4, 2, 2, 0),
            "left_knee_flexion": (9, 24, 58, 24, 52, 34, 18),
            "right_hip_flexion": (6, 6, 0, 30, 34, 22, 12),
            "right_hip_abduction": (5, 4, 3, 6, 8, 8, 6),
            "right_hip_rotation": (0, 2, 8, 0, 2, 2, 0),
            "right_knee_flexion": (9, 12, 18, 58, 52, 34, 18),
        }
    ),
    yaw=(-25, -24, -8, 22, 44, 50, 50),
    pitch=(0, 0, 2, 3, 6, 3, 2),
    left_stance=(0.5, 0.1, 0.0, 0.9, 0.6, 0.5, 0.5),
    start=(-0.1, -0.05),
)
"""Reach up and forwards, two steps in a turn, a knee bend: the motion of the built-in demonstration."""

ARM = KeyedMotion(
    name="arm",
    subject="arm8",
    background="pillar",
    azimuth=10.0,
    times=(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0),
    angles=MappingProxyType(
        {
            "left_clavicle_elevation": (2, 4, 8, 10, 6, 4, 12, 6, 2),
            "left_clavicle_protraction": (0, 2, 10, 18, 12, 4, 2, 6, 2),
            "left_shoulder_elevation": (28, 52, 66, 74, 60, 82, 108, 66, 34),
            "left_shoulder_flexion": (0, 12, 38, 52, 44, 6, -4, 30, 4),
            "left_shoulder_rotation": (-6, -20, 8, 24, -30, 8, 26, -12, -4),
            "left_elbow_flexion": (22, 74, 96, 30, 84, 110, 62, 36, 24),
            "left_forearm_pronation": (0, 30, -20, 40, -45, 30, -10, 25, 0),
            "left_wrist_flexion": (0, 10, -15, 5, 25, -25, 15, -5, 0),
        }
    ),
)
"""A bending and rotating arm that comes towards the camera and goes back twice (as in CSS section 6.1)."""

PIVOT = KeyedMotion(
    name="pivot",
    subject="human30",
    background="room",
    azimuth=20.0,
    times=(0.0, 0.7, 1.4, 2.1, 2.8, 3.5),
    angles=MappingProxyType(
        {
            "lumbar_flexion": (6, 10, 12, 8, 14, 8),
            "lumbar_lateral": (0, 4, -3, -5, 3, 0),
            "lumbar_axial": (-6, -22, 4, 28, 10, 2),
            "neck_flexion": (6, 8, 2, 6, 8, 5),
            "neck_lateral": (0, -2, 2, 3, -2, 0),
            "neck_axial": (2, 12, -8, -18, -4, 0),
            "left_shoulder_elevation": (14, 48, 82, 70, 46, 20),
            "left_shoulder_flexion": (4, 34, 36, 6, 14, 8),
            "left_shoulder_rotation": (0, -8, -12, 4, -10, 0),
            "left_elbow_flexion": (24, 66, 24, 44, 78, 34),
            "right_shoulder_elevation": (14, 34, 52, 84, 66, 22),
            "right_shoulder_flexion": (4, 8, 24, 50, 34, 10),
            "right_shoulder_rotation": (0, -4, -10, -8, -4, 0),
            "right_elbow_flexion": (24, 40, 76, 30, 48, 36),
            "left_hip_flexion": (8, 14, 18, 14, 20, 10),
            "left_hip_abduction": (8, 10, 9, 8, 10, 8),
            "left_hip_rotation": (4, 10, 2, -6, 2, 2),
            "left_knee_flexion": (12, 24, 30, 24, 34, 18),
            "right_hip_flexion": (8, 18, 14, 18, 16, 10),
            "right_hip_abduction": (8, 8, 10, 10, 8, 8),
            "right_hip_rotation": (4, -4, 4, 10, 4, 2),
            "right_knee_flexion": (12, 30, 24, 32, 26, 18),
        }
    ),
    yaw=(-10, -34, 6, 48, 30, 10),
    pitch=(0, 2, 3, 2, 4, 1),
    left_stance=(0.5, 0.3, 0.5, 0.7, 0.5, 0.5),
)
"""A pivoting body with arms that move in depth and hide the trunk; clavicles locked, 30 degrees of freedom."""

TURN_REACH = KeyedMotion(
    name="turn_reach",
    subject="human34",
    background="black",
    azimuth=30.0,
    times=(0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0),
    angles=MappingProxyType(
        {
            "lumbar_flexion": (6, 8, 14, 10, 6, 16, 22, 12, 6),
            "lumbar_lateral": (0, -4, -6, 2, 6, 4, -2, 0, 0),
            "lumbar_axial": (0, 14, 20, 8, -10, -18, -4, 4, 0),
            "neck_flexion": (4, 2, -6, 2, 6, 10, 8, 6, 4),
            "neck_lateral": (0, 2, 3, 0, -3, -2, 0, 0, 0),
            "neck_axial": (0, 20, 14, -8, -20, -8, 4, 2, 0),
            "left_clavicle_elevation": (1, 4, 8, 4, 2, 10, 14, 6, 1),
            "left_clavicle_protraction": (0, 4, 8, 0, 0, 6, 10, 2, 0),
            "left_shoulder_elevation": (12, 40, 70, 44, 30, 92, 118, 58, 16),
            "left_shoulder_flexion": (4, 20, 46, 18, 6, 34, 40, 20, 6),
            "left_shoulder_rotation": (0, -6, -8, 0, 2, -6, -10, -2, 0),
            "left_elbow_flexion": (20, 62, 30, 70, 50, 24, 20, 56, 26),
            "right_clavicle_elevation": (1, 6, 12, 8, 2, 3, 4, 3, 1),
            "right_clavicle_protraction": (0, 4, 12, 6, 0, 0, 2, 2, 0),
            "right_shoulder_elevation": (12, 62, 112, 76, 32, 40, 56, 34, 16),
            "right_shoulder_flexion": (4, 30, 44, 26, 4, 10, 24, 14, 6),
            "right_shoulder_rotation": (0, -8, -6, 0, 2, 0, -4, 0, 0),
            "right_elbow_flexion": (20, 46, 16, 34, 58, 72, 46, 40, 26),
            "left_hip_flexion": (6, 10, 16, 34, 18, 16, 26, 14, 8),
            "left_hip_abduction": (6, 8, 8, 10, 8, 8, 9, 7, 6),
            "left_hip_rotation": (0, -4, -8, 10, 4, -2, 0, 2, 0),
            "left_knee_flexion": (9, 20, 26, 52, 28, 30, 44, 26, 14),
            "right_hip_flexion": (6, 14, 12, 10, 30, 18, 22, 14, 8),
            "right_hip_abduction": (6, 8, 8, 7, 10, 8, 8, 7, 6),
            "right_hip_rotation": (0, 8, 6, -6, 10, 2, 0, 2, 0),
            "right_knee_flexion": (9, 24, 22, 18, 48, 32, 40, 26, 14),
        }
    ),
    yaw=(-20, 22, 86, 120, 92, 30, 2, 0, 0),
    pitch=(0, 2, 4, 2, 1, 4, 5, 3, 0),
    left_stance=(0.5, 0.5, 0.6, 0.1, 0.9, 0.5, 0.5, 0.5, 0.5),
)
"""A fast turn to the left and back with a high reach of each arm."""

MOTIONS = MappingProxyType(
    {motion.name: motion for motion in (REACH, ARM, PIVOT, TURN_REACH, REACH_OUT, CROSS_ARMS, TALK)}
)
"""The authored motions by name."""


_ALL = ", ".join((*MOTIONS, "random"))


def motion_named(name: str) -> KeyedMotion:
    """The authored motion of a name; raises InputError where there is none."""
    if name not in MOTIONS:
        raise InputError("motion", f"there is no {name!r}", remedy=f"one of {_ALL}, or a .bvh, .csv or .npz file")
    return MOTIONS[name]
