"""Inverse kinematics of one picture: several bodies project onto the same points.

A known pose is projected into one camera and found again from its projections alone. Hypotheses with much the same
projection can differ in space: a limb that points towards the camera looks like one that points away.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import kinemode as km

BENDS = {
    "left_shoulder_elevation": 0.6,
    "left_elbow_flexion": 0.9,
    "right_elbow_flexion": 0.7,
    "left_knee_flexion": 0.8,
}


def known_pose(body: km.Body) -> np.ndarray:
    """A standing person with a few joints bent, q (nq,)."""
    q = body.clamp(np.zeros(body.nq))
    q[6] = 1.0  # the root's quaternion is xyzw
    names = body.q_names
    for joint, angle in BENDS.items():
        q[names.index(joint)] = angle
    return body.clamp(q)


def camera_in_front() -> km.Camera:
    """4 m in front of the person, who faces +x; x right, y down, z forward."""
    K = np.array([[1000.0, 0.0, 480.0], [0.0, 1000.0, 480.0], [0.0, 0.0, 1.0]])
    R_camera_world = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    return km.Camera("front", (960, 960), K, np.zeros(5), R_camera_world, -R_camera_world @ np.array([4.0, 0.0, 0.0]))


def main() -> None:
    """Project, recover, compare."""
    subject = km.load_subject("human34")
    body, camera = km.Body(subject), camera_in_front()
    truth = body.landmarks(body.at(known_pose(body)))
    pixels = camera.project(truth)[None]
    track = km.KeypointTrack(
        "landmarks", body.landmark_names, pixels, np.ones(pixels.shape[:2]), camera.image_size, 30.0
    )

    with tempfile.TemporaryDirectory() as folder:
        keypoints = Path(folder) / "front.json"
        km.write_keypoints(keypoints, track)
        cameras = {"front": camera}
        run = km.track(subject, None, keypoints=keypoints, cameras=cameras, fit="off", out=Path(folder) / "ik.run")
        print("hypothesis  weight  in the picture [px]  in space [mm]")
        for k, points in enumerate(run.mode_landmarks[0]):
            if not np.isfinite(points).all():
                continue
            off = np.linalg.norm(camera.project(points) - pixels[0], axis=1).mean()
            error = 1000.0 * np.linalg.norm(points - truth, axis=1).mean()
            print(f"{k:10d}  {run.mode_weight[0, k]:6.3f}  {off:19.2f}  {error:13.1f}")


if __name__ == "__main__":
    main()
