"""How long a hand stays where it is inside a blob of skin that it shares with the face or the other hand.

    python -m benchmarks shared_places

The setting `dual_chain.evidence.inside` is rounded from this. Captured motions are seen from all around; a hand shares
a blob while it is nearer than TOUCH to the other in the picture.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from benchmarks.support.common import Data, Json, save
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files, subject_of
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.point_features import PointFeatures, skin_features
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.retarget import retarget
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

FPS = 30.0
TOUCH = 0.15  # [m]: nearer than this in the picture, blobs of a hand and a face, or of two hands, are one
VIEWS = 12  # directions all around, from the height of the person
LAGS = (1, 2, 3, 5, 8, 12)  # frames
_FEWEST = 50  # pairs of frames of a person at a lag


def main(*, data: Data = None, seconds: float = 6.0, json: Json = None) -> None:
    """Measure how long places inside shared blobs are correlated in captured motion.

    Parameters
    ----------
    seconds
        At most so much of each clip.
    """
    files = captured_files(data)
    if not files:
        print(NO_CAPTURED_FILES)
        return
    body = Body(load_subject("human34"))
    features = skin_features(body, anatomy_of(body))
    sums: dict[str, np.ndarray] = {}
    for path in files:
        mocap = load_mocap(path)
        q = retarget(body, mocap, np.arange(0.0, min(mocap.seconds, seconds), 1.0 / FPS)).q
        own = sums.setdefault(subject_of(path.stem), np.zeros((len(LAGS), 3)))
        for offset, episode in shared(features, body, q):
            own += products(offset, episode)
    people = {who: s for who, s in sums.items() if s[:, 2].min() >= _FEWEST}
    correlation = np.array([s[:, 0] / s[:, 1] for s in people.values()])
    time = np.array(LAGS) / FPS
    table = report.table(f"places in shared blobs of {len(people)} people", "lag [s]", "correlation", "time [s]")
    for lag, of_all, own in zip(time, correlation.mean(axis=0), correlation.std(axis=0), strict=True):
        table.add_row(f"{lag:.3f}", f"{of_all:.3f} ± {own:.3f}", f"{-lag / np.log(of_all):.2f}")
    report.console().print(table)
    save(json, {"measure": "shared_places", "lag": time.tolist(), "correlation": correlation.tolist()})


def shared(features: PointFeatures, body: Body, q: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Offsets (T, 2) [m] of two features from each other in each view, and the number (T,) of the episode in which they
    share a blob, -1 outside."""
    places = features.points(body.placed(q))
    for a, b in combinations(range(places.shape[1]), 2):
        for angle in np.linspace(0.0, np.pi, VIEWS, endpoint=False):
            across = np.array([-np.sin(angle), np.cos(angle), 0.0])
            offset = np.stack([(places[:, a] - places[:, b]) @ across, places[:, a, 2] - places[:, b, 2]], axis=1)
            near = np.linalg.norm(offset, axis=1) < TOUCH
            begins = near & ~np.concatenate([[False], near[:-1]])
            yield offset, np.where(near, np.cumsum(begins) - 1, -1)


def products(offset: np.ndarray, episode: np.ndarray) -> np.ndarray:
    """For each of LAGS (L, 3): sums of products of offsets (T, 2) so many frames apart in one episode (T,), of their
    mean squares, and the number of pairs."""
    rows = []
    for lag in LAGS:
        same = (episode[lag:] == episode[:-lag]) & (episode[lag:] >= 0)
        early, late = offset[:-lag][same], offset[lag:][same]
        square = 0.5 * (np.square(early).sum() + np.square(late).sum())
        rows.append([float((early * late).sum()), float(square), float(same.sum())])
    return np.array(rows)
