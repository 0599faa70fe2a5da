"""A motion as trainers of policies that track motions read it: root, joints and links at one rate.

World z up; quaternions are xyzw, without changes of sign from one frame to the next. Joints and links are in the order
of the URDF's text, joints that follow others among them; links that are fixed to others are links, too.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from estimator.data.formats.opensim import frame_rate
from estimator.runs.coordinates import JointEntry, joint_entries
from estimator.runs.filtering import even_motion
from estimator.runs.joint_angle import joint_value
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import ROOT_PLACE_Q, ROOT_TURN_Q, Body
from humanoid.subject.joint_names import ROOT_POSITION, ROOT_QUATERNION
from humanoid.subject.urdf_document import read_document
from humanoid.support.errors import InputError, first_of

_RATE_DIGITS = 6  # a rate of 30 whose times are rounded is 30


def motion_arrays(run: Run) -> dict[str, np.ndarray]:
    """The arrays of a run of T frames, at even times (see `even_motion`).

    fps (). root_position (T, 3) [m] and root_quaternion_xyzw (T, 4) of a body with a free root, of its root link.
    joint_names (J,), joint_position (T, J) [rad or m], joint_velocity (T, J) [rad/s or m/s]: central differences, of
    the first and last frame one-sided. link_names (B,), link_position (T, B, 3) [m], link_quaternion_xyzw (T, B, 4):
    of the links' own frames.

    Raises InputError for a run without a frame, or with frames that have no pose, and a joint that no single number
    places.
    """
    if not run.frame_count:
        raise InputError(run.file, "contains no frames", remedy="track with --resume first")
    body, motion = run.body, even_motion(run.body, run.q, run.time, run.status != "unobserved")
    missing = int((~np.isfinite(motion.q).all(axis=1)).sum())
    if missing:
        problem = f"has no pose in {missing} of {len(motion.q)} frames, which a motion for trainers cannot leave out"
        raise InputError(run.file, problem, remedy="npz marks them")
    fps = round(frame_rate(motion.time), _RATE_DIGITS)
    names, positions = _joints(body, motion.q)
    velocities = np.gradient(positions, 1.0 / fps, axis=0) if len(positions) > 1 else np.zeros_like(positions)
    root: dict[str, np.ndarray] = {}
    if body.has_free_root:
        turns = continuous_quaternions(motion.q[:, ROOT_TURN_Q])
        root = {"root_position": motion.q[:, ROOT_PLACE_Q], "root_quaternion_xyzw": turns}
    joints = {"joint_names": np.array(names, dtype=np.str_), "joint_position": positions, "joint_velocity": velocities}
    return {"fps": np.array(fps), **root, **joints, **_links(body, motion.q)}


def continuous_quaternions(quaternions: np.ndarray) -> np.ndarray:
    """Quaternions xyzw (T, ..., 4) of the same turns without changes of sign from one to the next."""
    flips = np.cumsum(np.sum(quaternions[1:] * quaternions[:-1], axis=-1) < 0.0, axis=0) % 2
    signs = np.concatenate([np.ones((1, *quaternions.shape[1:-1])), np.where(flips, -1.0, 1.0)])
    return np.asarray(signs[..., None] * quaternions)


def write_motion_npz(run: Run, path: Path) -> None:
    """Write `motion_arrays`."""
    arrays = motion_arrays(run)
    with path.open("wb") as file:  # given a path, numpy would append .npz to it
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def write_motion_csv(run: Run, path: Path) -> None:
    """Write a row a frame below one line of names: root_x, root_y, root_z [m], root_qx, root_qy, root_qz, root_qw of a
    free root, then the joints [rad or m]; every number to the last bit."""
    arrays = motion_arrays(run)
    parts = [arrays[name] for name in ("root_position", "root_quaternion_xyzw", "joint_position") if name in arrays]
    names = [*ROOT_POSITION, *ROOT_QUATERNION] if "root_position" in arrays else []
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow([*names, *arrays["joint_names"].tolist()])
        rows.writerows([repr(float(value)) for value in row] for row in np.concatenate(parts, axis=1))


def _joints(body: Body, q: np.ndarray) -> tuple[list[str], np.ndarray]:
    """Names (J) and values (T, J) of the joints, in the order of the URDF."""
    entries = {entry.name: entry for entry in joint_entries(body)}
    if body.has_free_root:
        del entries[next(iter(entries))]
    several = [entry.name for entry in entries.values() if not _is_single(entry)]
    if several:
        problem = f"a motion for trainers has one number a joint, and these have several: {first_of(several, 4)}"
        raise InputError(body.subject.source, problem, remedy="npz has q as it is")
    names = [name for name in _order(body, "joint") if name in entries]
    values = [joint_value(entries[name], q) for name in names]
    return names, np.array(values).reshape(len(names), len(q)).T.copy()


def _is_single(entry: JointEntry) -> bool:
    return entry.kind in ("turn", "slide", "endless")


def _links(body: Body, q: np.ndarray) -> dict[str, np.ndarray]:
    """Names, places and turns of the links, in the order of the URDF."""
    frames = {frame.name: frame for frame in body.model.frames if frame.type == pin.FrameType.BODY}
    names = [name for name in _order(body, "link") if name in frames]
    placed = body.placed(q)
    places, turns = np.empty((len(q), len(names), 3)), np.empty((len(q), len(names), 4))
    for b, name in enumerate(names):
        own, joint = frames[name].placement, frames[name].parentJoint
        R = placed.rotations_of(joint)
        places[:, b] = placed.placements[:, joint, 9:] + R @ own.translation
        turns[:, b] = Rotation.from_matrix(R @ own.rotation).as_quat()
    return {
        "link_names": np.array(names, dtype=np.str_), "link_position": places,
        "link_quaternion_xyzw": continuous_quaternions(turns),
    }  # fmt: skip


def _order(body: Body, kind: str) -> list[str]:
    """Names of the URDF's elements of a kind, "joint" or "link", in the order of its text."""
    root = read_document(body.subject.urdf, body.subject.source).root
    return [element.get("name", "").strip() for element in root.findall(kind)]
