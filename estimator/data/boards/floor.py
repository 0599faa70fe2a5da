"""The world of a board that lies on the floor, and what the cameras say against it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from estimator.data.boards.adjustment import Pose, angle_between, chained
from estimator.data.cameras.camera import Camera

R_WORLD_BOARD = np.diag([1.0, -1.0, -1.0])
"""The world of a board that lies on the floor, face up: origin at its first inner corner (of a ChArUco board at its
outer corner), x along its columns, y against its rows, z up out of its face."""
MIRRORED = 5.0  # degrees between two solutions that differ
LEVEL = 60.0  # degrees between up out of the floor and up in the pictures, on average, that are said
UPRIGHT = 0.3  # by which cameras have to be more upright in a solution that fits a little worse
AXES = {"x": (0, 1), "-x": (0, -1), "y": (1, 1), "-y": (1, -1), "-z": (2, -1)}


def upright(cameras: Mapping[str, Pose]) -> float:
    """How well up in the pictures of cameras agrees, 1 where it is one direction, less where some are upside down."""
    return float(np.linalg.norm(np.mean([pose[0][1] for pose in cameras.values()], axis=0)))


def choose_floor(
    floors: Sequence[tuple[float, Pose]], cameras: Mapping[str, Pose], doubted: float, origin: int
) -> tuple[Pose, list[str]]:
    """The board's pose that makes the world, and a note where a mirrored one fits as well.

    floors: its poses, the best first, with twice the difference of log-likelihoods, in doubt below `doubted`. Of those
    that fit as well the one is taken in which the cameras are the right way up: mirrored, a floor that is seen from
    the side turns them upside down.
    """
    best = floors[0][1]
    close = [pose for worse, pose in floors if worse < doubted]
    if all(angle_between(best, pose) < MIRRORED for pose in close):
        return best, []
    up = np.mean([pose[0].T @ [0.0, -1.0, 0.0] for pose in cameras.values()], axis=0)
    chosen = max(close, key=lambda pose: -up @ pose[0][:, 2])
    chosen = chosen if up @ (best[0] - chosen[0])[:, 2] > UPRIGHT else best
    note = (
        f"the floor is in doubt: the board in picture {origin} fits mirrored as well; taken so that the cameras are the"
        " right way up: lay it nearer to the cameras, or use a larger one"
    )
    return chosen, [note]


def in_world(camera: Camera, pose: Pose, floor: Pose) -> Camera:
    """The camera in the world of the floor's board; pose: the camera from, floor: the board in, the same frame."""
    R, t = chained(chained(pose, floor), (R_WORLD_BOARD.T, np.zeros(3)))
    return replace(camera, R_camera_world=R, t_camera_world=t)


def floor_notes(cameras: Mapping[str, Camera], origin: int) -> list[str]:
    """Notes where the cameras say that the board of the world does not lie on the floor."""
    notes = []
    below = [name for name, camera in cameras.items() if camera.centre_world[2] <= 0.0]
    if below:
        notes.append(
            f"{', '.join(below)} would be below the floor: the board in picture {origin} does not lie on it, or is"
            " mirrored: choose another --origin"
        )
    up = np.mean([camera.R_camera_world.T @ [0.0, -1.0, 0.0] for camera in cameras.values()], axis=0)
    if up[2] < np.cos(np.radians(LEVEL)) * np.linalg.norm(up):
        axis = max(AXES, key=lambda name: AXES[name][1] * up[AXES[name][0]])
        notes.append(
            f"the board in picture {origin} does not lie on the floor if the cameras are held level: they have up along"
            f" {axis}: choose another --origin, or track with --up={axis}"
        )
    return notes
