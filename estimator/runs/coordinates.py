"""Names and units of the entries of q, joint by joint."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from estimator.data.formats.opensim import R_OPENSIM_WORLD
from estimator.data.formats.osim import component_name
from humanoid.kinematics.body import Body
from humanoid.subject.joint_names import ROOT, ROOT_POSITION, ROOT_TURNS, joint_names


@dataclass(frozen=True)
class JointEntry:
    """A joint's place in q. kind: "free", "slide", "turn", "endless" (cosine, sine), "planar" (x, y, cosine, sine) or
    "other".

    A joint that follows another has its master's place, and is multiplier times its entry, plus offset.
    """

    name: str
    kind: str
    start: int
    count: int
    multiplier: float = 1.0
    offset: float = 0.0
    follows: bool = False

    def of(self, q: np.ndarray) -> np.ndarray:
        """The joint's entries (T, count) of q (T, nq)."""
        own = q[:, self.start : self.start + self.count]
        return self.multiplier * own + self.offset if self.follows else own


def joint_entries(body: Body) -> Iterator[JointEntry]:
    """The joints of a body in the order of its model, which is that of q; those that follow others among them."""
    model = body.model
    mimics = {mimic.joint: mimic for mimic in body.subject.mimics}
    for j, name in enumerate(joint_names(model), 1):
        if name in mimics:
            m = mimics[name]
            kind = "slide" if m.slides else "turn"
            yield JointEntry(name, kind, int(model.idx_qs[j]), 1, m.multiplier, m.offset, follows=True)
            continue
        count, short = int(model.nqs[j]), model.joints[j].shortname()
        if count == 7:
            kind = "free"
        elif count == 2 and model.nvs[j] == 1:
            kind = "endless"
        elif count == 1:
            kind = "slide" if short.startswith("JointModelP") else "turn"
        elif short == "JointModelPlanar":
            kind = "planar"
        else:
            kind = "other"
        yield JointEntry(name, kind, int(model.idx_qs[j]), count)


def q_columns(body: Body) -> tuple[str, ...]:
    """A name with its unit for each entry of q: `root_x_m`, `root_qw`, `left_knee_flexion_rad`."""
    names = list(body.q_names)
    for entry in joint_entries(body):
        if entry.follows:
            continue
        lengths = {"free": 3, "slide": 1}.get(entry.kind, 0)
        for k in range(entry.start, entry.start + lengths):
            names[k] += "_m"
        if entry.kind == "turn":
            names[entry.start] += "_rad"
    return tuple(names)


def follower_columns(body: Body, q: np.ndarray) -> tuple[tuple[str, ...], np.ndarray]:
    """Names with units (F) and values (T, F) [rad or m] of the joints that follow others, from q (T, nq)."""
    entries = [entry for entry in joint_entries(body) if entry.follows]
    names = tuple(entry.name + ("_m" if entry.kind == "slide" else "_rad") for entry in entries)
    return names, np.concatenate([np.zeros((len(q), 0)), *(entry.of(q) for entry in entries)], axis=1)


def opensim_coordinates(body: Body, q: np.ndarray) -> tuple[tuple[str, ...], np.ndarray]:
    """Names (N) and values (T, N) of coordinates for OpenSim from q (T, nq): degrees and metres.

    Position and joints have the names and values that they have in q. The root's quaternion becomes three turns about
    OpenSim's Z, X and Y in this order, those of the pelvis in its gait models. With OpenSim's ground y up, `root_x`,
    `root_z` and `root_y` are along its X, Y and -Z. A joint in a plane has its two lengths and one turn, `NAME_turn`.
    """
    names: list[str] = []
    columns: list[np.ndarray] = []
    for entry in joint_entries(body):
        part = entry.of(q)
        names += opensim_names(body, entry)
        if entry.kind == "free":
            columns += [*_turns(part[:, 3:]).T, *part[:, :3].T]
        elif entry.kind == "other":
            columns += list(part.T)
        elif entry.kind == "planar":
            columns += [*part[:, :2].T, np.rad2deg(unwrapped(np.arctan2(part[:, 3], part[:, 2])))]
        else:
            angle = unwrapped(np.arctan2(part[:, 1], part[:, 0])) if entry.kind == "endless" else part[:, 0]
            columns.append(angle if entry.kind == "slide" else np.rad2deg(angle))
    return tuple(names), np.stack(columns, axis=1)


def opensim_names(body: Body, entry: JointEntry) -> list[str]:
    """Names of a joint's coordinates in files for OpenSim, in their order there."""
    names = [entry.name]
    if entry.kind == "free":
        names = [entry.name + own.removeprefix(ROOT) for own in (*ROOT_TURNS, *ROOT_POSITION)]
    elif entry.kind == "planar":
        names = [f"{entry.name}_{own}" for own in ("x", "y", "turn")]
    elif entry.kind == "other":
        names = list(body.q_names[entry.start : entry.start + entry.count])
    return [component_name(name) for name in names]


def _turns(quaternion: np.ndarray) -> np.ndarray:
    """Quaternions xyzw (T, 4) of the z-up world -> turns (T, 3) [deg] about z, x, y of the y-up one."""
    x, y, z, w = quaternion.T
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    tilt, sideways, turn = turns_zxy(R_OPENSIM_WORLD @ R @ R_OPENSIM_WORLD.T).T
    return np.rad2deg(np.stack([unwrapped(tilt), sideways, unwrapped(turn)], axis=1))


def turns_zxy(R: np.ndarray) -> np.ndarray:
    """Turns (T, 3) [rad] about z, x, y in this order with Rz Rx Ry = R (T, 3, 3); the second within a right angle."""
    tilt = np.arctan2(-R[:, 0, 1], R[:, 1, 1])
    sideways = np.arcsin(np.clip(R[:, 2, 1], -1.0, 1.0))
    return np.stack([tilt, sideways, np.arctan2(-R[:, 2, 0], R[:, 2, 2])], axis=1)


def unwrapped(angle: np.ndarray) -> np.ndarray:
    """Angles (T,) [rad] without jumps of a whole turn; frames without a value stay so."""
    out = angle.copy()
    known = np.isfinite(angle)
    out[known] = np.unwrap(angle[known])
    return out
