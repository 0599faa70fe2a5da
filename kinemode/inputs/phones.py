"""The lenses of phones by their model, from the calibrations that OpenCap ships (Apache-2.0; see phone_lenses.json)."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from statistics import median
from typing import NamedTuple

from humanoid.support.errors import InputError, near_names, shown

_TABLE = Path(__file__).with_name("phone_lenses.json")


class Phone(NamedTuple):
    """name: as Apple writes it, the model's identifier where that is not listed. focal: length over the picture's
    longer side."""

    name: str
    focal: float


def phone(model: str) -> Phone | None:
    """The phone of a model, None where it is not in the table.

    The focal length is that of the back camera's video as OpenCap records it: 1280 x 720, not zoomed, without the crop
    of stabilisation. A film that was zoomed or stabilised has a longer one.

    model: its identifier ("iPhone13,3") or marketing name ("iPhone 12 Pro"); case, spaces and brackets do not count.
    """
    return _phones().get(_plain(model))


def checked_phone(model: str) -> Phone:
    """`phone`; raises InputError, with the nearest names, where it is not in the table."""
    known = phone(model)
    if known is None:
        meant = dict.fromkeys(_phones()[near].name for near in near_names(_plain(model), _phones()))
        near = f"did you mean {' or '.join(meant)}?" if meant else "Apple's are, as iPhone13,3 or 'iPhone 12 Pro'"
        raise InputError(
            "--phone", f"the lens of {shown(model)} is not known", remedy=f"{near}; otherwise give --focal"
        )
    return known


def _plain(model: str) -> str:
    return re.sub(r"[^a-z0-9,]", "", str(model).lower())


@cache
def _phones() -> dict[str, Phone]:
    """By identifier, and by name: the median of the identifiers that have it, which differ by 0.002 at most."""
    phones: dict[str, Phone] = {}
    named: dict[str, list[float]] = {}
    for model, (focal, *names) in json.loads(_TABLE.read_text(encoding="utf-8"))["phones"].items():
        name = names[0] if names else model
        phones[_plain(model)] = Phone(name, focal)
        named.setdefault(name, []).append(focal)
    return {_plain(name): Phone(name, median(focal)) for name, focal in named.items()} | phones
