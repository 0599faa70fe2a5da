"""A person's motion in the coordinates of the common gait models of OpenSim, joint by joint as in docs/opensim.md.

Their segments have x forward, y up and z to the right, and so do ours in OpenSim's axes, where the subject stands with
hanging arms and elbows that would bend forward. A coordinate follows from the rotation of a segment in its parent
alone: three turns about z, x and y in this order, as in their pelvis, hips, back and shoulders, or the turn about an
axis that is nearest to the rotation.

The models: gait2392 (S. Delp et al., IEEE Trans. Biomed. Eng. 37(8), 1990, and the files of OpenSim) and Rajagopal2016
(A. Rajagopal et al., IEEE Trans. Biomed. Eng. 63(10), 2016), from which the models of OpenCap and Pose2Sim were made.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from estimator.data.formats.opensim import R_OPENSIM_WORLD
from estimator.runs.coordinates import turns_zxy, unwrapped
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError

_ANKLE = (-0.10501355, -0.17402245, 0.97912632)
_ELBOW = (0.226047, 0.022269, 0.973863)
_SIDES = (("right", "r"), ("left", "l"))
_UNMEASURED = ("subtalar_angle", "mtp_angle", "pro_sup", "wrist_flex", "wrist_dev")


@dataclass(frozen=True)
class GaitModel:
    """Properties of a model.

    title: its name in files. knee_axis: positive turns about it are positive angles. mid_hip: the middle of its hips in
    the pelvis [m]. arms: whether it has them. patella: whether a coordinate of its own repeats the knee's.
    """

    title: str
    knee_axis: tuple[float, float, float]
    mid_hip: tuple[float, float, float]
    arms: bool
    patella: bool


GAIT_MODELS = {
    "gait2392": GaitModel("gait2392", (0.0, 0.0, 1.0), (-0.0707, -0.0661, 0.0), arms=False, patella=False),
    "rajagopal": GaitModel("Rajagopal2016", (0.0, 0.0, -1.0), (-0.056276, -0.07849, 0.0), arms=True, patella=True),
}


def gait_coordinates(body: Body, q: np.ndarray, model: GaitModel) -> tuple[tuple[str, ...], np.ndarray]:
    """Names (N) and values (T, N) of a model's coordinates from q (T, nq): degrees, and metres for the pelvis' place.

    What our body has no joint for is 0. The middle of the hips is where it is in q, whatever the model's size.

    Raises
    ------
    InputError: the body lacks a segment, or has no free root.
    """
    known = np.isfinite(q).all(axis=1)
    placed = _Segments(body, q[known], ["pelvis", "torso", *_of_both_sides(model)])
    columns: dict[str, np.ndarray] = {}
    tilt, sideways, turn = continuous_turns(placed.rotation("pelvis")).T
    columns |= {"pelvis_tilt": tilt, "pelvis_list": sideways, "pelvis_rotation": turn}
    middle = 0.5 * (placed.origin("left_thigh") + placed.origin("right_thigh"))
    place = middle - placed.rotation("pelvis") @ np.array(model.mid_hip)
    for side, letter in _SIDES:
        columns |= _leg(placed, side, letter, model)
    own = ("lumbar_extension", "lumbar_bending", "lumbar_rotation")
    columns |= dict(zip(own, continuous_turns(placed.of("pelvis", "torso")).T, strict=True))
    for side, letter in _SIDES if model.arms else ():
        columns |= _arm(placed, side, letter)
    degrees = {name: np.rad2deg(unwrapped(angle)) for name, angle in columns.items()}
    names = [*list(degrees)[:3], "pelvis_tx", "pelvis_ty", "pelvis_tz", *list(degrees)[3:]]
    values = np.full((len(q), len(names)), np.nan)
    angles = np.stack(list(degrees.values()), axis=1)
    values[known] = np.concatenate([angles[:, :3], place, angles[:, 3:]], axis=1)
    return tuple(names), values


def is_measured(coordinate: str) -> bool:
    """Whether our body has a joint for a coordinate, and no other coordinate repeats it, as the kneecap's do."""
    return not coordinate.startswith(_UNMEASURED) and not coordinate.endswith("_beta")


def _of_both_sides(model: GaitModel) -> list[str]:
    parts = ["thigh", "shank", "foot", *(["upper_arm", "forearm"] if model.arms else [])]
    return [f"{side}_{part}" for side, _ in _SIDES for part in parts]


def _leg(placed: _Segments, side: str, letter: str, model: GaitModel) -> dict[str, np.ndarray]:
    mirror = _mirror(side)
    hip = continuous_turns(placed.of("pelvis", f"{side}_thigh")) * mirror[[2, 0, 1]]
    knee = turn_about(placed.of(f"{side}_thigh", f"{side}_shank"), np.array(model.knee_axis))
    ankle = turn_about(placed.of(f"{side}_shank", f"{side}_foot"), mirror * _ANKLE)
    still = np.zeros(len(knee))
    named = ("hip_flexion", "hip_adduction", "hip_rotation", "knee_angle", "ankle_angle", "subtalar_angle", "mtp_angle")
    of_leg = {f"{name}_{letter}": angle for name, angle in zip(named, (*hip.T, knee, ankle, still, still), strict=True)}
    return of_leg | ({f"knee_angle_{letter}_beta": knee} if model.patella else {})


def _arm(placed: _Segments, side: str, letter: str) -> dict[str, np.ndarray]:
    mirror = _mirror(side)
    shoulder = continuous_turns(placed.of("torso", f"{side}_upper_arm")) * mirror[[2, 0, 1]]
    elbow = turn_about(placed.of(f"{side}_upper_arm", f"{side}_forearm"), mirror * _ELBOW)
    still = np.zeros(len(elbow))
    named = ("arm_flex", "arm_add", "arm_rot", "elbow_flex", "pro_sup", "wrist_flex", "wrist_dev")
    return {
        f"{name}_{letter}": angle for name, angle in zip(named, (*shoulder.T, elbow, still, still, still), strict=True)
    }


def _mirror(side: str) -> np.ndarray:
    """Factors from an axis of the right side to that of the left: turns mirrored in the plane of x and y."""
    return np.array([1.0, 1.0, 1.0] if side == "right" else [-1.0, -1.0, 1.0])


class _Segments:
    """Links over time, in OpenSim's axes."""

    def __init__(self, body: Body, q: np.ndarray, links: list[str]) -> None:
        missing = [name for name in links if not body.model.existFrame(name, pin.FrameType.BODY)]
        if missing or not body.has_free_root:
            problem = f"has no link {missing[0]}" if missing else "has a fixed base"
            remedy = "the coordinates of gait models need a whole person such as human34; mot takes every subject"
            raise InputError(body.subject.source, problem, remedy=remedy)
        self._frames = {name: body.model.frames[body.model.getFrameId(name, pin.FrameType.BODY)] for name in links}
        self._placed = body.placed(q)

    def rotation(self, link: str) -> np.ndarray:
        """Rotations (T, 3, 3) in the ground."""
        frame, C = self._frames[link], R_OPENSIM_WORLD
        return np.asarray(C @ self._placed.rotations_of(frame.parentJoint) @ frame.placement.rotation @ C.T)

    def origin(self, link: str) -> np.ndarray:
        """Places (T, 3) in the ground [m]."""
        frame = self._frames[link]
        R_world_joint = self._placed.rotations_of(frame.parentJoint)
        at = self._placed.placements[:, frame.parentJoint, 9:]
        return np.asarray((R_world_joint @ frame.placement.translation + at) @ R_OPENSIM_WORLD.T)

    def of(self, parent: str, child: str) -> np.ndarray:
        """Rotations (T, 3, 3) of a child in its parent."""
        return np.asarray(self.rotation(parent).transpose(0, 2, 1) @ self.rotation(child))


def turn_about(R: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """The turns (T,) [rad] about an axis (3,) that leave the least angle to rotations (T, 3, 3)."""
    twice_sine = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    unit = axis / np.linalg.norm(axis)
    along = np.einsum("i,tij,j->t", unit, R, unit)
    return np.asarray(np.arctan2(twice_sine @ unit, np.trace(R, axis1=1, axis2=2) - along))


def continuous_turns(R: np.ndarray) -> np.ndarray:
    """Turns (T, 3) [rad] about z, x, y in this order with Rz Rx Ry = R (T, 3, 3), without jumps.

    Two triples give the same rotation, (a, b, c) and (a + pi, pi - b, c + pi): the first frame has the one with the
    smaller angles, every other the one that is nearer to the frame before. Where b is a right angle, a and c are one.
    """
    turns = turns_zxy(R)
    other = np.stack([turns[:, 0] + np.pi, np.pi - turns[:, 1], turns[:, 2] + np.pi], axis=1)
    out, before = np.empty_like(turns), np.zeros(3)
    for t, pair in enumerate(np.stack([turns, other], axis=1)):
        near = pair + 2.0 * np.pi * np.round((before - pair) / (2.0 * np.pi))
        out[t] = before = near[np.argmin(np.abs(near - before).sum(axis=1))]
    return out
