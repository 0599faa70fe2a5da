"""Track an upper body in long sleeves by face and hands: one camera, the pictures, a click on each joint of one frame.

    python examples/upper_body.py [CLIP CLICKS EMPTY]

Without arguments a person who talks with both hands is rendered and tracked, so that it can be tried at once.

How to film a clip of one's own:

- The camera stands still, about 2 m away at the height of the chest; the person faces it, from the hips up in the
  picture, and may bend, turn and move both arms.
- Long sleeves and a shirt to the neck, in no colour like skin; nothing else in the picture in the colour of skin, such
  as wood or cardboard. Over a fifth of the picture in that colour is refused; smaller areas count as hands where they
  move.
- Even light. A picture of the scene before the person comes in, from the same place, as EMPTY.
- In the first frame the hands are apart from each other and from the face. Click the joints there:

      kinemode annotate clip.mp4 --subject upper13 --out clicks.json

What is learned from that frame is the colour of skin; from then on only the pictures are used. Writes
NAME.run, NAME-samples.png, 40 poses of the posterior from the camera and from the side, and NAME-overlay.mp4.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import kinemode as km


def rendered(folder: Path) -> tuple[Path, Path, Path]:
    """A clip of somebody who talks, with the places of all joints in its first frame and the empty scene."""
    clip = km.render(folder, "talk", seconds=3.0, scene=km.SceneSettings(sleeves="long"))
    ((name, video),) = clip.videos.items()
    return video, clip.first_frame[name], clip.plates[name]


def main(*given: str) -> None:
    """Track, print the beliefs about the hands, draw."""
    folder = Path(tempfile.mkdtemp())
    video, clicks, empty = (Path(path) for path in given) if given else rendered(folder)
    name = f"{video.stem}-upper"
    run = km.track(
        "upper13", video, keypoints=clicks, background=empty, tracker="dual-chain", out=f"{name}.run", overwrite=True
    )
    hands = [k for k, mark in enumerate(run.body.landmark_names) if mark.endswith("wrist")]
    for t in range(0, len(run), max(1, len(run) // 10)):
        where = ", ".join(f"{run.body.landmark_names[k]} {run.landmarks[t, k].round(2)} m" for k in hands)
        print(f"{run.time[t]:6.2f} s  {run.status[t]:9} {where}")
    print(km.samples(run, f"{name}-samples.png"), km.overlay(run, f"{name}-overlay.mp4"))


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except km.InputError as error:
        sys.exit(str(error))
