"""From pictures to poses in real time: the loop behind `kinemode.live`."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from kinemode.kinds import KeypointSource
from kinemode.streams.capture import CapturedPicture, LatestFrameQueue
from kinemode.streams.step import Step
from kinemode.streams.stepper import Stepper
from kinemode.terminal.interruption import is_interruption

Show = Callable[[Step, CapturedPicture, int], None]
"""Is given a frame, the picture it is of, and how many pictures were dropped so far."""


@dataclass
class Session:
    """The result of a live track.

    pictures: numbers of those that were tracked, in order. dropped: how many others were overtaken. seconds: by the
    wall's clock. statuses: how many frames were given out of each. interrupted: it was ended by Ctrl-C.
    """

    pictures: list[int] = field(default_factory=list)
    dropped: int = 0
    seconds: float = 0.0
    statuses: Mapping[str, int] = field(default_factory=Counter)
    interrupted: bool = False

    @property
    def frames(self) -> int:
        """The number of frames given out."""
        return sum(self.statuses.values())

    def summary(self) -> str:
        """In a line."""
        rate = len(self.pictures) / self.seconds if self.seconds > 0.0 else 0.0
        told = "".join(f", {count} {status}" for status, count in self.statuses.items())
        taken = f"{len(self.pictures)} pictures in {self.seconds:.1f} s ({rate:.1f} a second), {self.dropped} dropped"
        return taken + told.replace(",", ":", 1)


def run_session(
    shots: Iterable[CapturedPicture], source: KeypointSource, stepper: Stepper, show: Show, *, every: bool
) -> Session:
    """Track the pictures until they end, or Ctrl-C.

    every: all of them are tracked, however long that takes; else those that are overtaken are dropped.
    """
    session, counts = Session(), Counter[str]()
    begun = time.perf_counter()
    newest = None if every else LatestFrameQueue(shots)
    waiting: dict[int, CapturedPicture] = {}  # pictures of frames that a lag holds back

    def shown(step: Step | None) -> None:
        if step is not None:
            counts[step.status] += 1
            show(step, waiting.pop(step.index), session.dropped)

    def track(pictures: Iterable[CapturedPicture]) -> None:
        for shot in pictures:
            session.dropped = 0 if newest is None else newest.dropped
            waiting[len(session.pictures)] = shot
            session.pictures.append(shot.number)
            points = source(shot.picture, shot.time)
            shown(stepper.step(points, shot.picture if stepper.cues else None, shot.time))

    try:
        if newest is None:
            track(shots)
        else:
            with newest:
                track(newest)
    except (KeyboardInterrupt, SystemError) as stop:
        if not is_interruption(stop):
            raise
        session.interrupted = True
    session.dropped = 0 if newest is None else newest.dropped
    if not session.interrupted:  # a step that was broken off has left a smoother, or a reader of cues, half-way
        for step in stepper.finish():
            shown(step)
    session.seconds, session.statuses = time.perf_counter() - begun, counts
    return session
