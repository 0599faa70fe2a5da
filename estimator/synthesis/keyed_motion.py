"""An authored motion as angles at key times."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

Row = tuple[float, ...]


@dataclass(frozen=True)
class KeyedMotion:
    """One authored motion.

    name: by which it is requested. subject: the built-in subject it is made for.
    background: what it is rendered before by default (`SceneSettings.background`). azimuth [deg]: of its camera.
    times (K): of the keys [s]. angles: degrees at the keys, metres of sliding joints, by joint; ankles of a free body
    keep the soles level.
    yaw, pitch (K): of a free root [deg]. left_stance (K): share of the left foot in carrying the body. start: where
    the root stands at first [m].
    """

    name: str
    subject: str
    background: str
    azimuth: float
    times: Row
    angles: MappingProxyType[str, Row]
    yaw: Row = ()
    pitch: Row = ()
    left_stance: Row = ()
    start: tuple[float, float] = (0.0, 0.0)

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return self.times[-1]
