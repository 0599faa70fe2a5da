"""Landmark names: what detectors call them, which mirror which, and how well each is found."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

COCO17 = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder", "left_elbow",
    "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle",
    "right_ankle",
)  # fmt: skip
"""COCO's keypoints (Lin et al., Microsoft COCO, ECCV 2014); landmarks take COCO's name where there is one."""

_RIGHT_ARM = ("right_shoulder", "right_elbow", "right_wrist")
_LEFT_ARM = ("left_shoulder", "left_elbow", "left_wrist")
_RIGHT_LEG = ("right_hip", "right_knee", "right_ankle")
_LEFT_LEG = ("left_hip", "left_knee", "left_ankle")
_EYES_EARS = ("right_eye", "left_eye", "right_ear", "left_ear")

_HALPE26 = (
    *COCO17, "head_top", "neck", "mid_hip", "left_big_toe", "right_big_toe", "left_small_toe", "right_small_toe",
    "left_heel", "right_heel",
)  # fmt: skip

FORMATS: dict[str, tuple[str | None, ...]] = {
    "mediapipe33": (
        "nose", None, "left_eye", None, None, "right_eye", None, "left_ear", "right_ear", None, None,
        "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_pinky",
        "right_pinky", "left_index", "right_index", "left_thumb", "right_thumb", "left_hip", "right_hip", "left_knee",
        "right_knee", "left_ankle", "right_ankle", "left_heel", "right_heel", "left_big_toe", "right_big_toe",
    ),
    "coco17": COCO17,
    "coco18": ("nose", "neck", *_RIGHT_ARM, *_LEFT_ARM, *_RIGHT_LEG, *_LEFT_LEG, *_EYES_EARS),
    "body25": (
        "nose", "neck", *_RIGHT_ARM, *_LEFT_ARM, "mid_hip", *_RIGHT_LEG, *_LEFT_LEG, *_EYES_EARS, "left_big_toe",
        "left_small_toe", "left_heel", "right_big_toe", "right_small_toe", "right_heel",
    ),
    "halpe26": _HALPE26,
    "halpe136": (*_HALPE26, *(None,) * 110),
    "wholebody133": (
        *COCO17, "left_big_toe", "left_small_toe", "left_heel", "right_big_toe", "right_small_toe", "right_heel",
        *(None,) * 110,
    ),
    "h36m17": (
        "mid_hip", "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", None, "neck",
        "nose", "head_top", "left_shoulder", "left_elbow", "left_wrist", "right_shoulder", "right_elbow", "right_wrist",
    ),
    "body25b": (
        *COCO17, "neck", "head_top", "left_big_toe", "left_small_toe", "left_heel", "right_big_toe", "right_small_toe",
        "right_heel",
    ),
}  # fmt: skip
"""Landmark of each keypoint of a format, in file order; None where no landmark corresponds. Of two formats with the
same number of keypoints the first is used unless one is named.

mediapipe33: MediaPipe Pose. coco17: COCO. coco18, body25: OpenPose. halpe26, halpe136: Halpe full body, whose first 26
are the body. wholebody133: COCO-WholeBody, whose first 23 are body and feet. h36m17: Human3.6M, as in VideoPose3D.
body25b: OpenPose's experimental BODY_25B.
"""

_SPREAD = {
    "nose": 0.26, "eye": 0.25, "ear": 0.35, "shoulder": 0.79, "elbow": 0.72, "wrist": 0.62, "hip": 1.07, "knee": 0.87,
    "ankle": 0.89, "neck": 0.79, "mid_hip": 1.07, "head_top": 0.6, "heel": 0.9, "big_toe": 0.8, "small_toe": 0.8,
    "index": 0.75, "pinky": 0.75, "thumb": 0.75,
}  # fmt: skip
_UNKNOWN_SPREAD = 0.8
_FOOT = ("heel", "big_toe", "small_toe")

_SYNONYMS = {"foot_index": "big_toe", "midhip": "mid_hip", "head": "head_top", "hip": "mid_hip"}


def mirror_index(names: Sequence[str]) -> np.ndarray:
    """Index (L,) of each landmark's other side; its own where there is none."""
    place = {name: i for i, name in enumerate(names)}
    return np.array([place.get(_other_side(name), i) for i, name in enumerate(names)], dtype=np.int64)


def _other_side(name: str) -> str:
    if name.startswith("left_"):
        return "right_" + name[5:]
    return "left_" + name[6:] if name.startswith("right_") else name


def foot_landmarks(names: Sequence[str]) -> tuple[str, ...]:
    """The heels and toes among landmarks, the left foot's first."""
    return tuple(n for side in ("left", "right") for part in _FOOT if (n := f"{side}_{part}") in names)


def foot_parts(names: Sequence[str]) -> np.ndarray:
    """Numbers (P,) of `foot_landmarks`, equal for the same part of both feet."""
    return np.array([_FOOT.index(name.partition("_")[2]) for name in names], dtype=np.int64)


def landmark_spread(names: Sequence[str]) -> np.ndarray:
    """Typical spread (L,) of a detector's error at each landmark, relative to the others.

    Ten times COCO's per-keypoint constants of the object keypoint similarity (Ronchi and Perona, Benchmarking and
    error diagnosis in multi-instance pose estimation, ICCV 2017); points COCO lacks take a neighbour's, a name that
    is not known 0.8.
    """
    return np.array([_SPREAD.get(without_side(name), _UNKNOWN_SPREAD) for name in names])


def relative_spread(names: Sequence[str]) -> np.ndarray:
    """`landmark_spread` (L,) over its mean among these."""
    spread = landmark_spread(names)
    return np.asarray(spread / spread.mean())


def without_side(name: str) -> str:
    """A name as left_knee without its side."""
    return re.sub(r"^(left|right)_", "", name)


def landmark_name(name: str) -> str | None:
    """The landmark another program's name means (`RBigToe`, `left_foot_index`, `Nose`, ...), None without one."""
    text = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name.strip())
    text = re.sub(r"[\s\-]+", "_", re.sub(r"^([LR])_?(?=[A-Z])", _side, text)).lower()
    side, _, part = text.partition("_") if text.startswith(("left_", "right_")) else ("", "", text)
    part = part.replace("foot_index", "big_toe") if side else _SYNONYMS.get(part, part)
    text = f"{side}_{part}" if side else part
    return text if part in _SPREAD else None


def _side(match: re.Match[str]) -> str:
    return "left_" if match.group(1) == "L" else "right_"
