"""Pictures: what is drawn lands where the camera says, and the files are whole."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from estimator.imaging.camera import Camera
from humanoid import Body, load_subject
from viz.scene import Scene


def looking_camera(name: str, eye: tuple[float, float, float], target: tuple[float, float, float]) -> Camera:
    """A camera of 640 x 480 px with some distortion, level, looking at a point."""
    forward = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[620.0, 0.0, 322.0], [0.0, 618.0, 238.0], [0.0, 0.0, 1.0]])
    return Camera(name, (640, 480), K, np.array([-0.05, 0.1, 0.001, -0.001, 0.0]), R, -R @ np.array(eye))


def moving_scene(instants: int = 12, modes: int = 3, with_frames: bool = True) -> Scene:
    """human34 swinging smoothly within its limits, 3.5 m from a camera, with perturbed hypotheses beside it."""
    body = Body(load_subject("human34"))
    rng = np.random.default_rng(1)
    camera = looking_camera("front", (3.5, 0.6, 1.2), (0.0, 0.0, 0.95))
    time = np.arange(instants) / 30.0
    amplitude, phase = rng.uniform(0.2, 0.6, body.nv), rng.uniform(0.0, 6.28, body.nv)
    amplitude[:6] = 0.05
    start = pin.neutral(body.model)
    start[2] = 0.92
    q = np.array([body.integrate(start, amplitude * np.sin(3.0 * t + phase)) for t in time])
    mode_q = np.full((instants, modes, body.nq), np.nan)
    mode_weight = np.full((instants, modes), np.nan)
    bend = rng.normal(0.0, 0.35, (modes, body.nv))
    bend[:, :6] *= 0.3
    bend[0] = 0.0
    for t in range(instants):
        for k in range(modes if t % 5 else modes - 1):
            mode_q[t, k] = body.integrate(q[t], bend[k])
            mode_weight[t, k] = 0.6**k
        mode_weight[t] /= np.nansum(mode_weight[t])
    landmarks = np.array([body.landmarks(body.at(x)) for x in q])
    pixels = camera.project(landmarks)[:, None] + rng.normal(0.0, 3.0, (instants, 1, len(body.landmark_names), 2))
    confidence = rng.uniform(0.1, 1.0, pixels.shape[:3])
    pictures = [np.full((480, 640, 3), 90 + t, dtype=np.uint8) for t in range(instants)]
    return Scene(
        body, (camera,), ((lambda: iter(pictures)) if with_frames else None,), np.arange(instants), time,
        ("tracked",) * instants, q, mode_q, mode_weight, np.zeros(instants, dtype=int), pixels, confidence,
    )  # fmt: skip
