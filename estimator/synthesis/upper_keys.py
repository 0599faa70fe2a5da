"""Authored motions of an upper body before a parallel camera, as of Taycher, Fisher and Darrell 2004, Figure 2."""

from __future__ import annotations

from types import MappingProxyType

from estimator.synthesis.keyed_motion import KeyedMotion

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
