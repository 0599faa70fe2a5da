"""C3D files as capture systems write them: whole numbers with a scale, or floating point, and analog channels."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

_BLOCK = 512
_INTEL = 84


def c3d_file(
    labels: Sequence[str],
    points: np.ndarray,
    *,
    unit: str = "mm",
    up: str = "+Z",
    rate: float = 100.0,
    first: int = 1,
    scale: float = 0.1,
    whole: bool = True,
) -> bytes:
    """Points (T, L, 3) in `unit`, NaN where missing (residual -1), with two analog samples of one channel a frame.

    up: POINT:Y_SCREEN, left out where empty. first: number of the first frame, from 1 on. whole: 16-bit numbers of
    `scale` units each, else floating point.
    """
    frames, count = points.shape[:2]
    step = scale if whole else -scale
    parameters = _parameters(labels, frames, step, unit, up, rate)
    blocks = -(-(len(parameters) + 4) // _BLOCK)
    start = 2 + blocks
    header = struct.pack(
        "<BBHHHHHfHHf", 2, 80, count, 2, first, first + frames - 1, 10, step, start, 2, rate
    ).ljust(_BLOCK, b"\0")  # fmt: skip
    section = (struct.pack("<BBBB", 1, 80, blocks, _INTEL) + parameters).ljust(blocks * _BLOCK, b"\0")
    missing = np.isnan(points).any(axis=2)
    values = np.where(missing[..., None], 0.0, points)
    kind = "<i2" if whole else "<f4"
    where = np.round(values / scale) if whole else values
    of_points = np.concatenate([where, np.where(missing, -1.0, 0.0)[..., None]], axis=2).reshape(frames, -1)
    data = np.concatenate([of_points, np.zeros((frames, 2))], axis=1).astype(kind).tobytes()
    return header + section + data.ljust(-(-len(data) // _BLOCK) * _BLOCK, b"\0")


def _parameters(labels: Sequence[str], frames: int, step: float, unit: str, up: str, rate: float) -> bytes:
    start = 2 + 1  # of the data, which readers take from the header
    screens = [_texts(1, "Y_SCREEN", [up])] if up else []
    return b"".join([
        _group(1, "POINT"), _number(1, "USED", len(labels)), _real(1, "SCALE", step), _real(1, "RATE", rate),
        _number(1, "DATA_START", start), _number(1, "FRAMES", frames), _texts(1, "LABELS", labels),
        _texts(1, "DESCRIPTIONS", labels), _texts(1, "UNITS", [unit] if unit else []), *screens,
        _group(2, "ANALOG"), _number(2, "USED", 1), _texts(2, "LABELS", ["Fz"]), _texts(2, "DESCRIPTIONS", ["force"]),
        _real(2, "GEN_SCALE", 1.0), _entry(2, "SCALE", 4, (1,), struct.pack("<f", 1.0)),
        _entry(2, "OFFSET", 2, (1,), struct.pack("<h", 0)), _texts(2, "UNITS", ["N"]), _real(2, "RATE", 2 * rate),
    ])  # fmt: skip


def _group(number: int, name: str) -> bytes:
    return struct.pack("<bb", len(name), -number) + name.encode() + struct.pack("<hB", 3, 0)


def _entry(group: int, name: str, kind: int, sizes: Sequence[int], data: bytes) -> bytes:
    """kind: bytes of a number, -1 of texts."""
    body = struct.pack("<bB", kind, len(sizes)) + bytes(sizes) + data + b"\0"
    return struct.pack("<bb", len(name), group) + name.encode() + struct.pack("<h", len(body) + 2) + body


def _number(group: int, name: str, value: int) -> bytes:
    return _entry(group, name, 2, (), struct.pack("<h", value))


def _real(group: int, name: str, value: float) -> bytes:
    return _entry(group, name, 4, (), struct.pack("<f", value))


def _texts(group: int, name: str, values: Sequence[str]) -> bytes:
    width = max((len(value) for value in values), default=0)
    return _entry(group, name, -1, (width, len(values)), b"".join(value.ljust(width).encode() for value in values))
