"""Track a clip from keypoints and view the result.

    python examples/track_clip.py walk.mp4 walk.json [calibration.json]

Writes walk.run and walk.html next to where it is started.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import kinemode as km


def main(clip: str, keypoints: str, cameras: str | None = None) -> None:
    """Track, print the knee angles, write the preview."""
    name = Path(clip).stem
    subject = km.load_subject("human34")
    run = km.track(subject, clip, keypoints=keypoints, cameras=cameras, out=f"{name}.run", overwrite=True)

    knee = run.body.q_names.index("left_knee_flexion")
    print(f"{len(run)} frames, up to {run.hypothesis_count} hypotheses each")
    for t in range(0, len(run), max(1, len(run) // 10)):
        # one number per hypothesis: where they differ, the picture alone does not decide
        others = np.degrees(run.mode_q[t, :, knee])
        print(f"{run.time[t]:6.2f} s  left knee {np.degrees(run.q[t, knee]):6.1f} deg  of {np.round(others, 1)}")
    print(km.view(run, html=f"{name}.html"))


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except km.InputError as error:
        sys.exit(str(error))
