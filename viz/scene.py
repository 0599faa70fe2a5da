"""What there is to look at: a run's arrays and its pictures, without the run file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from estimator.imaging.camera import Camera
from humanoid.body import Body

Frames = Callable[[], Iterable[np.ndarray]]


@dataclass(frozen=True)
class Scene:
    """T instants of a body in front of C cameras, with up to K hypotheses each.

    cameras (C). frames (C): opens each camera's clip as BGR images from its first frame on; None without pictures.
    index (T,) int: number of each instant's frame in the clips. time (T,) [s]. status (T): see `FrameResult`.
    q (T, nq): the best hypothesis. mode_q (T, K, nq), mode_weight (T, K): all of them, NaN where there are fewer.
    path (T,) int: which mode continues into q.
    pixels (T, C, L, 2) [px], confidence (T, C, L): keypoints of the body's landmarks, NaN and 0 where missing.
    """

    body: Body
    cameras: tuple[Camera, ...]
    frames: tuple[Frames | None, ...]
    index: np.ndarray
    time: np.ndarray
    status: tuple[str, ...]
    q: np.ndarray
    mode_q: np.ndarray
    mode_weight: np.ndarray
    path: np.ndarray
    pixels: np.ndarray
    confidence: np.ndarray

    def __len__(self) -> int:
        return len(self.time)

    @property
    def rate(self) -> float:
        """Instants per second, 30 where there is only one."""
        span = float(self.time[-1] - self.time[0]) if len(self) > 1 else 0.0
        return (len(self) - 1) / span if span > 0.0 else 30.0

    def others(self, t: int) -> list[tuple[int, np.ndarray, float]]:
        """(index, q, weight) of the hypotheses at instant t other than the best one, lightest first."""
        found = [
            (k, self.mode_q[t, k], float(self.mode_weight[t, k]))
            for k in range(self.mode_q.shape[1])
            if k != self.path[t] and np.isfinite(self.mode_q[t, k]).all() and self.mode_weight[t, k] > 0.0
        ]
        return sorted(found, key=lambda mode: mode[2])

    def images(self, camera: int, rows: Sequence[int]) -> Iterator[np.ndarray | None]:
        """The picture of one camera at each of the given instants (ascending); None where there is none."""
        opener = self.frames[camera]
        stream = iter(opener()) if opener is not None else iter(())
        position, image = -1, None
        for t in rows:
            while position < self.index[t]:
                image = next(stream, None)
                position += 1
                if image is None:
                    break
            yield image


def evenly(count: int, wanted: int) -> list[int]:
    """At most `wanted` of `count` instants, evenly spaced, first and last included."""
    return sorted(set(np.linspace(0, count - 1, min(count, wanted)).round().astype(int).tolist()))
