"""Heel strikes and toe-offs in three ways: by contact alone, by where feet are relative to the pelvis alone, and by
both, as `km.gait` has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from estimator.runs.contact import Contact
from estimator.runs.events import SIDES, Event, Feet, filtered, gait_events
from estimator.runs.gait import events_by_contact

WAYS = ("gait", "contact", "pelvis")
KINDS = ("strike", "off")
FRAMES = 2.0 / 30.0
"""[s] An event is not to be off by more."""
_MOST_OFF = 0.25  # s
_EDGE = 0.1  # s at either end of a clip, where events of the truth do not count


def events_by(contact: Contact, pelvis: np.ndarray) -> dict[str, list[Event]]:
    """The events by each of `WAYS`; pelvis (T, 3) [m]: its middle, at the contact's times."""
    place = {name: contact.points[:, k] for k, name in enumerate(contact.names)}
    heel, toe = ({side: place[f"{side}_{part}"] for side in SIDES} for part in ("heel", "big_toe"))
    by_pelvis = gait_events(filtered(Feet(contact.time, pelvis, heel, toe)))
    return dict(zip(WAYS, (events_by_contact(contact, by_pelvis), contact.events, by_pelvis), strict=True))


def loaded_events(time: np.ndarray, loaded: Mapping[str, np.ndarray]) -> list[Event]:
    """Whether feet are loaded, (T,) bool by side."""
    standing = np.stack([loaded[side] for side in SIDES], axis=1).astype(float)
    names, nowhere = tuple(f"{side}_heel" for side in SIDES), np.full((*standing.shape, 3), np.nan)
    return Contact(time, names, nowhere, standing, None, np.ones(len(SIDES))).events


class EventErrors(NamedTuple):
    """off (N,) [s]: of our event nearest to each of the truth, ours minus theirs, NaN where none is near. extra: how
    many of ours are near none of the truth's."""

    off: np.ndarray
    extra: int

    @staticmethod
    def of(ours: Sequence[Event], truth: Sequence[Event], kind: str, span: tuple[float, float]) -> EventErrors:
        """The errors of one kind of event, both feet; span [s]: the clip's, at whose ends events do not count."""
        off, extra = list[float](), 0
        for side in SIDES:
            here, there = (
                np.array([e.time for e in events if (e.kind, e.side) == (kind, side)]) for events in (ours, truth)
            )
            near = _nearest(there, here)
            off += near[(there > span[0] + _EDGE) & (there < span[1] - _EDGE)].tolist()
            inside = (here > span[0] + 2.0 * _EDGE) & (here < span[1] - 2.0 * _EDGE)
            extra += int(np.isnan(_nearest(here, there))[inside].sum())
        return EventErrors(np.array(off), extra)

    @staticmethod
    def joined(several: Sequence[EventErrors]) -> EventErrors:
        """The errors of several clips."""
        return EventErrors(np.concatenate([each.off for each in several]), sum(each.extra for each in several))

    def cells(self) -> tuple[str, ...]:
        """The number of events, the mean and the mean absolute error [ms], the share within `FRAMES`, how many are
        not there and how many are extra."""
        near = 1e3 * self.off[np.isfinite(self.off)]
        sizes = (f"{near.mean():+.0f}", f"{np.abs(near).mean():.0f}") if len(near) else ("-", "-")
        within = f"{self.within:.1%}" if len(self.off) else "-"
        return (str(len(self.off)), *sizes, within, str(len(self.off) - len(near)), str(self.extra))

    @property
    def within(self) -> float:
        """Share within `FRAMES`."""
        return float(np.mean(np.abs(self.off) <= FRAMES))


COLUMNS = ("events", "off [ms]", "|off| [ms]", "within 67 ms", "none near", "extra")
"""The columns of `EventErrors.cells`."""


def _nearest(times: np.ndarray, others: np.ndarray) -> np.ndarray:
    """For times (N,) the difference of the nearest of others (M,), theirs minus ours, NaN where none is near."""
    if not len(others):
        return np.full(len(times), np.nan)
    off = others - times[:, None]
    least = off[np.arange(len(times)), np.abs(off).argmin(axis=1)] if len(times) else np.zeros(0)
    return np.where(np.abs(least) <= _MOST_OFF, least, np.nan)
