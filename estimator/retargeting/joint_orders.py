"""The orders in which programs write a body's joints, and which of them an array of joints is in.

An order is accepted by evidence. Under the right one limbs keep their lengths and are as long on the left as on the
right; under a wrong one a "thigh" leads from hip to toe on one side, or from hip to hip. The limits stand between the
two as measured on 53 captured motions (CMU) written in each of 14 orders and read in all others of as many joints,
exact or with 20 and 30 mm of noise along each axis; the wrong column has a limit exceeded in each of them:

    figure                                  right order         wrong orders, smallest to largest of all motions
    logarithm of left over right            0.18 at most        0.12 to 2.7 (0.5 and more of LAFAN1 read as SMPL)
    spread of a length over its middle      0.25 at most        0.00 to 0.8
    logarithm of shank over thigh           -0.28 to 0.29       -1.3 to 1.1
    logarithm of forearm over upper arm     -0.48 to 0.13       -1.3 to 0.8
    logarithm of arms over legs             below 0             up to 2.0

Right orders of whole motions were accepted with all noise, and no wrong one was; of ten frames with 30 mm of noise 4 %
of the right ones fit none. Lengths do not show which side is left.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from humanoid.subject.landmarks import FORMATS, landmark_name

SMPL = "smpl"
_SIDES = ("left", "right")
_PAIRS = {
    "thigh": ("hip", "knee"), "shank": ("knee", "ankle"), "upper arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
}  # fmt: skip
_ENDS = {f"{side}_{end}" for pair in _PAIRS.values() for end in pair for side in _SIDES}
_ASYMMETRY = 0.23  # logarithm of left over right, in medians
_SPREAD = 0.3  # of a length, over its middle: a deviation of noise
_RATIO = 0.7  # logarithm of shank over thigh and of forearm over upper arm: either half as long as the other
_ARMS = 0.25  # logarithm of arms over legs
_TO_DEVIATION = 1.4826  # of a median absolute deviation of normal noise
_SAMPLED = 1.5  # standard deviations that noise in few frames may add to the ratio
_CLEARLY = 0.5  # misfit of an order over that of the next best
_SHORTEST = 1e-6  # m
_MANY = 22  # joints from which files of SMPL's family have SMPL's order at first


def _sided(side: str, *parts: str) -> tuple[str, ...]:
    return tuple(f"{side}_{part}" for part in parts)


_LEG = ("hip", "knee", "ankle", "big_toe")
_ARM = ("shoulder", "elbow", "wrist")
_KINECT20 = (
    "mid_hip", None, "neck", "head", *_sided("left", *_ARM), None, *_sided("right", *_ARM), None,
    *_sided("left", *_LEG), *_sided("right", *_LEG),
)  # fmt: skip

ORDERS: dict[str, tuple[str | None, ...]] = {
    SMPL: (
        None, "left_hip", "right_hip", None, "left_knee", "right_knee", None, "left_ankle", "right_ankle", None,
        "left_big_toe", "right_big_toe", "neck", None, None, "head", "left_shoulder", "right_shoulder", "left_elbow",
        "right_elbow", "left_wrist", "right_wrist",
    ),
    "lafan1": (
        None, *_sided("left", *_LEG), *_sided("right", *_LEG), None, None, None, "neck", "head", None,
        *_sided("left", *_ARM), None, *_sided("right", *_ARM),
    ),
    "kinect20": _KINECT20,
    "kinect25": (*_KINECT20, None, None, None, None, None),
    "kinect32": (
        None, None, None, "neck", None, *_sided("left", *_ARM), None, None, None, None, *_sided("right", *_ARM), None,
        None, None, *_sided("left", *_LEG), *_sided("right", *_LEG), "head", "nose", "left_eye", "left_ear",
        "right_eye", "right_ear",
    ),
    "h36m32": (
        None, *_sided("right", *_LEG), None, *_sided("left", *_LEG), None, None, None, "neck", "nose", "head_top", None,
        *_sided("left", *_ARM), None, None, None, None, None, *_sided("right", *_ARM), None, None, None, None,
    ),
    "xsens23": (
        None, None, None, None, None, "neck", "head", None, *_sided("right", *_ARM), None, *_sided("left", *_ARM),
        *_sided("right", *_LEG), *_sided("left", *_LEG),
    ),
    "mpi_inf_3dhp17": (
        "head_top", "neck", *_sided("right", *_ARM), *_sided("left", *_ARM), *_sided("right", *_LEG[:3]),
        *_sided("left", *_LEG[:3]), None, None, None,
    ),
    "panoptic19": (
        "neck", "nose", None, *_sided("left", *_ARM), *_sided("left", *_LEG[:3]), *_sided("right", *_ARM),
        *_sided("right", *_LEG[:3]), "left_eye", "left_ear", "right_eye", "right_ear",
    ),
    **FORMATS,
}  # fmt: skip
"""Landmark of each joint; None for pelvis, spine, collars and hands, which have none. `head` is the joint at its base.

smpl: the first 22 joints of SMPL, SMPL-H and SMPL-X, of which hands follow. lafan1: Ubisoft's LAFAN1. kinect20,
kinect25, kinect32: Kinect for Xbox 360, Kinect v2 (NTU RGB+D too) and Azure Kinect. h36m32: Human3.6M with all joints.
xsens23: the origins of MVN's segments. mpi_inf_3dhp17, panoptic19: MPI-INF-3DHP and CMU Panoptic. The others:
`FORMATS`.
"""


class Misfit(NamedTuple):
    """The misfit of joints to a body in an order: 1 is the largest that is accepted, NaN where too little is known.
    why: what is the furthest, for messages."""

    value: float
    why: str


def orders_of(count: int) -> tuple[str, ...]:
    """The known orders of so many joints; SMPL's of all that have as many as it or more."""
    exact = [name for name, joints in ORDERS.items() if len(joints) == count and name != SMPL]
    return (*((SMPL,) if count >= _MANY else ()), *exact)


def clear_order(misfits: Mapping[str, Misfit]) -> str | None:
    """The one order that fits, or fits much better than all others; None where none does, or several do. An order that
    is alone is taken where too little is known to test it."""
    if len(misfits) == 1 and all(np.isnan(misfit.value) for misfit in misfits.values()):
        return next(iter(misfits))
    ranked = sorted((misfit.value, name) for name, misfit in misfits.items() if misfit.value <= 1.0)
    if not ranked or any(np.isnan(misfit.value) for misfit in misfits.values()):
        return None
    if len(ranked) > 1 and not ranked[0][0] <= _CLEARLY * ranked[1][0]:
        return None
    return ranked[0][1]


def order_misfit(joints: np.ndarray, names: Sequence[str | None]) -> Misfit:
    """How far joints (T, J, 3), NaN where missing, are from a body's if the first have these names. It is undecidable
    where the ends of the limbs are not all among them."""
    at = {name: i for i, name in enumerate(names) if name is not None}
    if not at.keys() >= _ENDS:
        return Misfit(float("nan"), "too few limbs are known")
    lengths, misfits, sides = dict[str, float](), [Misfit(0.0, "")], 0
    for bone, (a, b) in _PAIRS.items():
        both = [_length(joints[:, at[f"{side}_{a}"]] - joints[:, at[f"{side}_{b}"]]) for side in _SIDES]
        for side, length in zip(_SIDES, both, strict=True):
            misfits.append(Misfit(length.spread / _SPREAD, f"the {side} {bone}'s length varies by {length.spread:.0%}"))
        left, right = both
        known = [length.middle for length in both if length.frames]
        if len(known) == len(_SIDES):
            sides += 1
            off = abs(float(np.log(left.middle / right.middle))) - _SAMPLED * float(np.hypot(left.error, right.error))
            why = f"the left {bone} is {left.middle:.2f} m long, the right one {right.middle:.2f} m"
            misfits.append(Misfit(off / _ASYMMETRY, why))
        if known:
            lengths[bone] = float(np.mean(known))
    if sides < len(_SIDES):  # both thighs and shanks, or arms
        return Misfit(float("nan"), "too few limbs are known")
    return max([*misfits, *_proportions(lengths)], key=lambda misfit: misfit.value)


class _Length(NamedTuple):
    """The length of a limb's part: median [m], and spread relative to it, over so many frames; 0 frames where it is not
    known."""

    middle: float
    spread: float
    frames: int

    @property
    def error(self) -> float:
        """Standard deviation of the logarithm of the middle, as a median's."""
        return 1.25 * self.spread / float(np.sqrt(max(self.frames, 1)))


def _length(way: np.ndarray) -> _Length:
    """The length of vectors (T, 3) from end to end, NaN where missing."""
    length = np.linalg.norm(way, axis=1)
    length = length[np.isfinite(length)]
    if not len(length):
        return _Length(0.0, 0.0, 0)
    middle = max(float(np.median(length)), _SHORTEST)
    return _Length(middle, _TO_DEVIATION * float(np.median(np.abs(length - middle))) / middle, len(length))


def _proportions(lengths: Mapping[str, float]) -> list[Misfit]:
    """Misfits of the parts of a limb, and of arms and legs."""
    misfits = []
    for far, near in (("shank", "thigh"), ("forearm", "upper arm")):
        if {far, near} <= lengths.keys():
            off = abs(float(np.log(lengths[far] / lengths[near])))
            why = f"the {far} is {lengths[far]:.2f} m long, the {near} {lengths[near]:.2f} m"
            misfits.append(Misfit(off / _RATIO, why))
    if len(lengths) == len(_PAIRS):
        arms, legs = lengths["upper arm"] + lengths["forearm"], lengths["thigh"] + lengths["shank"]
        off = max(0.0, float(np.log(arms / legs)))
        misfits.append(Misfit(off / _ARMS, f"the arms are {arms:.2f} m long, the legs {legs:.2f} m"))
    return misfits


def landmarks_named(names: Sequence[str]) -> tuple[str | None, ...]:
    """The landmark of each joint by what programs call it (LeftUpLeg, L_Hip, HIP_LEFT, RKnee), None of others.

    A foot is an ankle where nothing is called ankle, as in BVH, otherwise a toe; a shoulder does not count where
    something is called arm.
    """
    parts = [_side_and_part(name) for name in names]
    known = {part for _, part in parts}
    meant = dict(_PARTS)
    meant["foot"] = "big_toe" if "ankle" in known else "ankle"
    if known & {"arm", "upper_arm", "uparm"}:
        meant |= {"shoulder": "", "hand": "wrist"} if "wrist" not in known else {"shoulder": ""}
    landmarks: list[str | None] = []
    for name, (side, part) in zip(names, parts, strict=True):
        own = meant.get(part, part)
        landmark = f"{side}_{own}" if side and own else own
        plain = landmark if landmark in _MIDDLE or not landmark else landmark_name(landmark)
        if not side and part not in _MIDDLE:
            plain = landmark_name(name)
        landmarks.append(plain if plain and plain not in landmarks else None)
    return tuple(landmarks)


_PARTS = {
    "up_leg": "hip", "upper_leg": "hip", "upleg": "hip", "leg": "knee", "lower_leg": "knee", "low_leg": "knee",
    "toe": "big_toe", "toe_base": "big_toe", "arm": "shoulder", "upper_arm": "shoulder", "uparm": "shoulder",
    "fore_arm": "elbow", "forearm": "elbow", "lower_arm": "elbow",
}  # fmt: skip
_MIDDLE = ("head", "neck", "head_top", "nose", "mid_hip")
_SIDE_WORDS = {"l": "left", "r": "right", "left": "left", "right": "right"}


def _side_and_part(name: str) -> tuple[str, str]:
    """left, right or nothing, and the rest in lower case: of `mixamorig:LeftUpLeg` left and up_leg."""
    text = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name.strip().rpartition(":")[2])
    text = re.sub(r"^([LR])(?=[A-Z])", r"\1_", text)
    words = re.sub(r"[\s\-.]+", "_", text).lower().split("_")
    sides = [word for word in words if word in _SIDE_WORDS]
    part = "_".join(word for word in words if word and word not in _SIDE_WORDS)
    return (_SIDE_WORDS[sides[0]] if len(sides) == 1 else ""), part
