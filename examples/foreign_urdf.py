"""A robot that kinemode has never seen: its URDF, its landmarks in a small TOML, its joint angles from two views.

A two-link arm is written to a folder with its landmark file, moved, projected into two cameras and tracked.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import kinemode as km

FRAMES, FPS = 30, 30.0


def link(name: str, length: float) -> str:
    """A rod along z as URDF."""
    visual = f'<visual><origin xyz="0 0 {length / 2}"/><geometry><cylinder radius="0.03" length="{length}"/></geometry>'
    return f'<link name="{name}">{visual}</visual></link>'


def joint(name: str, parent: str, child: str, height: float, axis: str) -> str:
    """A revolute joint as URDF."""
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="0 0 {height}"/><axis xyz="{axis}"/>'
    return f'<joint name="{name}" type="revolute">{ends}<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'


ARM = "\n".join(
    [
        '<robot name="arm">',
        link("base", 0.2) + link("turret", 0.1) + link("upper", 0.4) + link("lower", 0.3),
        joint("turn", "base", "turret", 0.2, "0 0 1"),
        joint("lift", "turret", "upper", 0.1, "0 1 0"),
        joint("bend", "upper", "lower", 0.4, "0 1 0"),
        "</robot>",
    ]
)
LANDMARKS = """
[landmarks]
foot = {link = "base", xyz = [0.1, 0.0, 0.0]}
neck = {link = "upper", xyz = [0.0, 0.0, 0.0]}
joint = {link = "lower", xyz = [0.0, 0.0, 0.0]}
tip = {link = "lower", xyz = [0.0, 0.0, 0.3]}
flag = {link = "lower", xyz = [0.1, 0.1, 0.2]}
"""


def looking(name: str, eye: tuple[float, float, float]) -> km.Camera:
    """A level camera facing the arm."""
    forward = np.array([0.0, 0.0, 0.5]) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[800.0, 0.0, 320.0], [0.0, 800.0, 240.0], [0.0, 0.0, 1.0]])
    return km.Camera(name, (640, 480), K, np.zeros(5), R, -R @ np.array(eye))


def main() -> None:
    """Write the robot, film it, track it, compare the angles."""
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        (here / "arm.urdf").write_text(ARM)
        (here / "arm.landmarks.toml").write_text(LANDMARKS)
        subject = km.load_subject(here / "arm.urdf")
        body = km.Body(subject)
        time = np.arange(FRAMES) / FPS
        truth = np.stack([0.8 * np.sin(3.0 * time), 0.5 + 0.3 * time, 1.0 - 0.8 * time], axis=1)
        points = np.array([body.landmarks(body.at(q)) for q in truth])
        cameras = [looking("a", (2.0, 1.0, 0.8)), looking("b", (0.5, -2.0, 1.0))]
        for camera in cameras:
            pixels = camera.project(points)
            seen = np.ones(pixels.shape[:2])
            track = km.KeypointTrack("landmarks", body.landmark_names, pixels, seen, camera.image_size, FPS)
            km.write_keypoints(here / f"{camera.name}.json", track)
        keypoints = [here / "a.json", here / "b.json"]
        run = km.track(subject, None, keypoints=keypoints, cameras={c.name: c for c in cameras}, out=here / "arm.run")
        error = np.degrees(np.abs(run.q - truth))
        for name, worst in zip(body.q_names, error.max(axis=0), strict=True):
            print(f"{name:>5}: largest error {worst:.3f} deg")


if __name__ == "__main__":
    main()
