"""How well people are separated from a background that is learned from their own clip.

    python -m benchmarks silhouettes --all

Rendered clips of captured people, who stand, walk away, or come back to where they stood, have true silhouettes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, astuple, dataclass

import numpy as np

from benchmarks.accuracy.mocap import DEFAULT, rendered_motions
from benchmarks.support.common import Clips, Data, Every, Json, Work, save, tell
from estimator.data.formats.cameras import load_cameras
from estimator.data.media.picture import read_picture
from estimator.data.sequence import Cues
from estimator.vision.cues.foreground import Silhouette
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from estimator.vision.cues.silhouette import Outline
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.inputs.load import load_inputs
from kinemode.pictures import opened_cues
from kinemode.request import FileOptions
from kinemode.shot import RenderedClip
from kinemode.terminal import report

STEP = 3  # frames from one that is measured to the next
NOTHING, FIRST, ALL = "no keypoints", "keypoints of the first frame", "keypoints of all frames"
WAYS = (NOTHING, FIRST, ALL)


@dataclass(frozen=True)
class Wrong:
    """Shares of the person's area, means over the measured frames of a clip.

    extra: scene that counts as person. missed: person that counts as scene. unknown: person before a background that
    was never seen. worst: extra and missed of the worst frame.
    """

    extra: float
    missed: float
    unknown: float
    worst: float


def main(
    *,
    data: Data = None,
    clips: Clips = DEFAULT,
    every: Every = False,
    seconds: float = 4.0,
    clip_seed: int = 2,
    work: Work = None,
    json: Json = None,
) -> None:
    """Measure silhouettes by a background that is learned from the clip, by how many frames have keypoints.

    Parameters
    ----------
    seconds
        Only so much of each.
    clip_seed
        Seed of the clips: room, clothes and noise.
    """
    by_clip: dict[str, dict[str, Wrong]] = {}
    for name, clip in rendered_motions(data, clips, every, seconds, clip_seed, work, masks=True):
        by_clip[name] = {way: wrong(clip, way) for way in WAYS}
        tell(f"{name}: " + ", ".join(f"{w.extra:.0%} {w.missed:.0%}" for w in by_clip[name].values()))
    if not by_clip:
        return
    show(by_clip)
    save(
        json, {"measure": "silhouettes", "clips": {n: {w: asdict(e) for w, e in c.items()} for n, c in by_clip.items()}}
    )


def wrong(clip: RenderedClip, way: str) -> Wrong:
    """How wrong the silhouettes of a clip are, learned with the keypoints of one of `WAYS`."""
    (folder,) = clip.masks.values()
    masks = sorted(folder.iterdir())[::STEP]
    rows = []
    with silhouettes(clip, way) as read:
        for k, path in enumerate(masks):
            silhouette: Silhouette = read.at(STEP * k)[0][Outline.name]
            true = read_picture(path)[0][..., 0] > 0
            known, area = silhouette.known, max(1, int(np.count_nonzero(true)))
            parts = silhouette.mask & known & ~true, ~silhouette.mask & true, true & ~known
            rows.append([np.count_nonzero(part) / area for part in parts])
    extra, missed, unknown = np.array(rows).T
    return Wrong(float(extra.mean()), float(missed.mean()), float(unknown.mean()), float((extra + missed).max()))


@contextmanager
def silhouettes(clip: RenderedClip, way: str) -> Iterator[Cues]:
    """The reader of a clip's silhouettes."""
    chosen = cue_settings([Outline.name])
    if way == NOTHING:
        with closing(CueReader([*clip.videos.values()], [*load_cameras(clip.cameras).values()], chosen)) as alone:
            yield alone
        return
    subject = load_subject("human34")
    keypoints = clip.first_frame if way == FIRST else clip.keypoints
    inputs = load_inputs(Body(subject), FileOptions(clips=clip.videos, keypoints=keypoints, cameras=clip.cameras))
    with opened_cues(subject, inputs, chosen) as reader:
        assert reader is not None
        yield reader


def show(by_clip: dict[str, dict[str, Wrong]]) -> None:
    """Print the errors of each clip, and their means."""
    for way in WAYS:
        table = report.table(f"{way}: share of the person's area", "clip", "extra", "missed", "unknown", "worst frame")
        rows = np.array([astuple(ways[way]) for ways in by_clip.values()])
        for name, row in zip([*by_clip, "mean"], [*rows, rows.mean(axis=0)], strict=True):
            table.add_row(name, *(f"{share:.1%}" for share in row))
        report.console().print(table)
