"""A person tracked frame by frame, as a program that has keypoints one at a time would.

The person is fitted to the first second, all at once; from then on every frame is reported as it comes, and once more
four frames later, smoothed with those that came since.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import kinemode as km

FPS, SECONDS, LAG = 25.0, 2.0, 4
JOINT = "left_knee_flexion"


def main() -> None:
    """Render a clip, fit, and step through its keypoints."""
    with tempfile.TemporaryDirectory() as folder:
        clip = km.render(Path(folder), "reach", fps=FPS, seconds=SECONDS, seed=1, videos=False)
        ((name, file),) = clip.keypoints.items()
        seen, camera = km.load_keypoints(file), km.load_cameras(clip.cameras)[name]
        points = np.concatenate([seen.pixels, seen.confidence[..., None]], axis=2)  # (T, K, 3): x, y [px], confidence

        first = points[: round(FPS)]
        person = km.fit(
            "human34", None, keypoints={name: first}, cameras={name: camera}, layout=seen.layout, fps=FPS
        ).subject

    now = km.Tracker(person, camera, layout=seen.layout)
    late = km.Tracker(person, camera, layout=seen.layout, lag=LAG)
    for i, frame in enumerate(points):
        step, before = now.step(frame, time=i / FPS), late.step(frame, time=i / FPS)
        if step is None or before is None:
            continue  # the first frames of a tracker with a lag come later
        angle, smoothed = (each.angle(JOINT, degrees=True) for each in (step, before))
        print(f"{step.time:.2f} s {step.status}: {JOINT} {angle:.1f} deg, {len(step.weights)} hypotheses", end="; ")
        print(f"smoothed at {before.time:.2f} s: {smoothed:.1f} deg")
    print(f"{len(late.finish())} frames were still held back")


if __name__ == "__main__":
    main()
