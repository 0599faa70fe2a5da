"""People whose feet stand on the floor, on something else, or on nothing: motions of the built-in person of known
angles, made and captured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.retarget import retarget
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import foot_landmarks

FPS, SECONDS = 30.0, 2.0
CAPTURED = (
    "mocap/walk_straight_07_01", "mocap/walk_turn_26_01", "mocap/bend_scoop_lift_02_06", "mocap/dance_05_10",
    "mocap/jump_16_01", "mocap/run_02_03", "mocap/punch_02_05", "mocap/wave_hello_fair1", "mocap_more/cmu_05_03",
    "mocap_more/cmu_06_01", "mocap_more/cmu_07_03", "mocap_more/cmu_02_08",
)  # fmt: skip
Angles = Mapping[str, float | np.ndarray]
_BACK = (0.0, -90.0, 0.0)  # degrees about x, y and z
_ARMS: Angles = {"shoulder_elevation": 0.5, "elbow_flexion": 0.6}
_SIT: Angles = {"hip_flexion": 1.45, "knee_flexion": 1.5, "ankle_dorsiflexion": 0.05}


class Scene(NamedTuple):
    """q (T, nq): at FPS, z up."""

    name: str
    q: np.ndarray


def scenes(body: Body, data: Path | None) -> Iterator[Scene]:
    """All of them; data: the folder with captured motion, None for those made alone."""
    yield from made_scenes(body)
    if data is None:
        return
    for name in CAPTURED:
        mocap = load_mocap(data / f"{name}.bvh")
        q = retarget(body, mocap, np.arange(0.0, min(mocap.seconds, 2.0 * SECONDS), 1.0 / FPS)).q
        yield Scene(name.split("/")[1], q)


def made_scenes(body: Body) -> Iterator[Scene]:
    """People who lie, sit, hang, climb and stand."""
    still = _Maker(body)
    for height, knees in ((0.45, 1.5), (0.30, 1.2)):
        yield still.lying(f"supine, calves on a stool of {height:g} m", hip=knees + 0.05, knee=knees)
    yield still.lying("supine, legs up a wall", hip=1.6, knee=0.05)
    yield still.lying("supine, feet on a step", hip=0.9, knee=1.3)
    yield still.lying("supine, legs straight", hip=0.0, knee=0.05)
    yield still.lying("prone", hip=0.0, knee=0.05, turn=(0.0, 90.0, 0.0))
    yield still.lying("on one side", hip=0.3, knee=0.5, turn=(-90.0, 0.0, 0.0), up=0.22)
    yield still.sitting("on a chair, feet on another", {"hip_flexion": 1.75, "knee_flexion": 0.25}, 0.45)
    yield still.sitting("on a sofa, feet on a table", {"hip_flexion": 1.9, "knee_flexion": 0.1}, 0.4)
    yield still.sitting("on the floor, legs straight", {"hip_flexion": 1.5, "knee_flexion": 0.1}, 0.1)
    yield still.sitting("on a chair, one leg on a stool", _SIT, 0.48, {"hip_flexion": 1.7, "knee_flexion": 0.3})
    yield still.sitting("on a chair, feet on the floor", _SIT, None)
    yield still.sitting("on a high chair, feet on a bar", _SIT, 0.9)
    yield still.sitting("against a wall without a chair", {"hip_flexion": 1.57, "knee_flexion": 1.57}, None)
    yield still.cycling("on a recumbent bicycle", back=60.0)
    yield still.cycling("on an upright bicycle", back=-20.0)
    yield still.rowing("on a rowing machine")
    yield still.inverted("handstand")
    yield still.inverted("headstand, legs bent", knee=1.2)
    yield still.hanging("from a bar")
    for rise in (0.15, 0.2, 0.3):
        yield still.climbing(f"stairs of {rise:g} m", rise)
    yield still.climbing("down stairs", -0.17)
    yield still.standing("one foot on a stool of 0.4 m", {"hip_flexion": 1.2, "knee_flexion": 1.4})
    yield still.standing("one foot on a kerb", {"hip_flexion": 0.4, "knee_flexion": 0.6})
    yield still.standing("stands", {})
    yield still.squatting("squats", 1.6)
    yield still.squatting("bends the knees a little", 0.5)
    yield still.walking("walks", 1.1)
    yield still.walking("walks on a treadmill", 0.0)
    yield still.walking("runs on a treadmill", 0.0, stride=1.4)


class _Maker:
    """Makes scenes of a body, arms moving, two seconds each."""

    def __init__(self, body: Body) -> None:
        self._body = body
        self._t = np.arange(round(SECONDS * FPS)) / FPS
        self._column = {name: i for i, name in enumerate(body.q_names)}
        self._feet = [body.landmark_names.index(name) for name in foot_landmarks(body.landmark_names)]

    def lying(
        self, name: str, hip: float, knee: float, *, turn: tuple[float, float, float] = _BACK, up: float = 0.11
    ) -> Scene:
        legs: Angles = {"hip_flexion": hip, "knee_flexion": knee, "ankle_dorsiflexion": -0.3 if knee < 0.2 else 0.05}
        q = self._posed(legs, legs, turn)
        q[:, 2] = up
        return Scene(name, q)

    def sitting(self, name: str, legs: Angles, seat: float | None, right: Angles | None = None) -> Scene:
        """seat [m]: height of the hips; None where the feet are on the floor."""
        q = self._posed(legs, legs if right is None else right)
        if seat is None:
            return Scene(name, self._grounded(q))
        q[:, 2] = seat + 0.1
        return Scene(name, q)

    def cycling(self, name: str, back: float) -> Scene:
        phase = 2.0 * np.pi * 1.2 * self._t
        legs: list[Angles] = [
            {"hip_flexion": 1.1 + 0.4 * np.sin(phase + p), "knee_flexion": 1.0 + 0.5 * np.sin(phase + p + 0.3)}
            for p in (0.0, np.pi)
        ]
        q = self._posed(legs[0], legs[1], (0.0, -back, 0.0))
        q[:, 2] = 0.6 if back > 0.0 else 1.0
        return Scene(name, q)

    def rowing(self, name: str) -> Scene:
        share = 0.5 - 0.5 * np.cos(2.0 * np.pi * 0.5 * self._t)
        legs: Angles = {
            "hip_flexion": 1.5 + 0.4 * share,
            "knee_flexion": 0.2 + 1.6 * share,
            "ankle_dorsiflexion": 0.1 * share,
        }
        q = self._posed(legs, legs)
        toes = self._landmarks(q)[:, self._feet]
        q[:, :3] += np.array([0.0, 0.0, 0.3]) - toes.mean(axis=1) + np.array([0.6, 0.0, 0.0])
        return Scene(name, q)

    def inverted(self, name: str, knee: float = 0.05) -> Scene:
        legs: Angles = {"hip_flexion": 0.05, "knee_flexion": knee}
        q = self._posed(legs, legs, (180.0, 0.0, 0.0), {"shoulder_flexion": 2.05, "elbow_flexion": 0.3})
        q[:, 2] += 0.05 - self._landmarks(q)[..., 2].min(axis=1)
        return Scene(name, q)

    def hanging(self, name: str) -> Scene:
        legs: Angles = {"hip_flexion": 0.1, "knee_flexion": 0.2, "ankle_dorsiflexion": -0.4}
        q = self._posed(legs, legs, arms={"shoulder_flexion": 2.05, "elbow_flexion": 0.3})
        q[:, 2] = 1.6
        return Scene(name, q)

    def climbing(self, name: str, rise: float) -> Scene:
        """Steps of 0.5 s, each as high as the one before; the foot that stands stays."""
        phase = np.pi * self._t / 0.5
        swing = [np.clip(np.sin(phase + p), 0.0, None) for p in (0.0, np.pi)]
        high = 1.0 + abs(rise)
        legs: list[Angles] = [{"hip_flexion": 0.2 + high * 0.7 * s, "knee_flexion": 0.2 + high * s} for s in swing]
        return Scene(name, self._standing_on(self._posed(legs[0], legs[1]), swing, rise, 0.28))

    def standing(self, name: str, right: Angles) -> Scene:
        q = self._posed({"knee_flexion": 0.05}, right or {"knee_flexion": 0.05})
        return Scene(name, self._grounded(q))

    def squatting(self, name: str, depth: float) -> Scene:
        share = depth * (0.5 - 0.5 * np.cos(2.0 * np.pi * 0.5 * self._t))
        legs: Angles = {"hip_flexion": 0.9 * share, "knee_flexion": share, "ankle_dorsiflexion": 0.3 * share}
        q = self._grounded(self._posed(legs, legs))
        ankle = self._landmarks(q)[:, self._body.landmark_names.index("left_ankle"), :2]
        q[:, :2] -= ankle - ankle[0]
        return Scene(name, q)

    def walking(self, name: str, speed: float, stride: float = 1.0) -> Scene:
        phase = 2.0 * np.pi * 0.9 * stride * self._t
        legs: list[Angles] = [
            {
                "hip_flexion": 0.18 + 0.42 * stride * np.sin(phase + p),
                "knee_flexion": 0.25 + 0.5 * stride * np.clip(np.sin(phase + p + 0.9), 0.0, None) ** 1.5,
                "ankle_dorsiflexion": 0.05 + 0.12 * np.sin(phase + p + 2.5),
            }
            for p in (0.0, np.pi)
        ]
        q = self._grounded(self._posed(legs[0], legs[1]))
        q[:, 0] += speed * (self._t - 0.5 * self._t[-1])
        return Scene(name, q)

    def _posed(
        self,
        left: Angles,
        right: Angles,
        turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
        arms: Angles = _ARMS,
    ) -> np.ndarray:
        q = np.tile(self._body.neutral, (len(self._t), 1)).astype(np.float64)
        q[:, 3:7] = Rotation.from_euler("xyz", turn, degrees=True).as_quat()
        moving = {"elbow_flexion": 0.2 * np.sin(np.pi * self._t)}
        for side, legs in (("left", left), ("right", right)):
            for joint, angle in {**legs, **arms}.items():
                q[:, self._column[f"{side}_{joint}"]] = angle + moving.get(joint, 0.0)
        return q

    def _landmarks(self, q: np.ndarray) -> np.ndarray:
        return self._body.landmarks_of(self._body.placed(q))

    def _grounded(self, q: np.ndarray) -> np.ndarray:
        """The lowest point of the feet at height 0 in every frame."""
        q[:, 2] -= self._landmarks(q)[:, self._feet, 2].min(axis=1)
        return q

    def _standing_on(self, q: np.ndarray, swing: list[np.ndarray], rise: float, run: float) -> np.ndarray:
        """The foot that swings less stays where it is, a step above the one that stood before."""
        landmarks = self._landmarks(q)
        heel = [landmarks[:, self._body.landmark_names.index(f"{side}_heel")] for side in ("left", "right")]
        step = np.floor(self._t / 0.5 + 1e-9)
        stands = np.where((step % 2 == 0)[:, None], heel[1], heel[0])  # the left one swings first
        q[:, :3] += np.column_stack([run * step, 0.0 * step, rise * step]) - stands * [1.0, 0.0, 1.0]
        return q
