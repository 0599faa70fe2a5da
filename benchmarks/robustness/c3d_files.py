"""C3D files as capture systems write them: whole numbers with a scale, or floating point, and analog channels."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

_BLOCK = 512
INTEL, DEC, MIPS = 84, 85, 86


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
    processor: int = INTEL,
) -> bytes:
    """Points (T, L, 3) in `unit`, NaN where missing (residual -1), with two analog samples of one channel a frame.

    up: POINT:Y_SCREEN, left out where empty. first: number of the first frame, from 1 on. whole: 16-bit numbers of
    `scale` units each, else floating point. processor: one of `INTEL`, `DEC`, `MIPS`.
    """
    frames, count = points.shape[:2]
    write = _Writer(processor)
    step = scale if whole else -scale
    parameters = _parameters(write, labels, frames, step, unit, up, rate)
    blocks = -(-(len(parameters) + 4) // _BLOCK)
    header = bytes([2, 80]) + write.words(count, 2, first, first + frames - 1, 10) + write.reals(step)
    header += write.words(2 + blocks, 2) + write.reals(rate)
    section = (bytes([1, 80, blocks, processor]) + parameters).ljust(blocks * _BLOCK, b"\0")
    missing = np.isnan(points).any(axis=2)
    values = np.where(missing[..., None], 0.0, points)
    where = np.round(values / scale) if whole else values
    of_points = np.concatenate([where, np.where(missing, -1.0, 0.0)[..., None]], axis=2).reshape(frames, -1)
    numbers = np.concatenate([of_points, np.zeros((frames, 2))], axis=1)
    data = write.words(*numbers.astype(int).ravel()) if whole else write.reals(*numbers.ravel())
    return header.ljust(_BLOCK, b"\0") + section + data.ljust(-(-len(data) // _BLOCK) * _BLOCK, b"\0")


def _parameters(
    write: _Writer, labels: Sequence[str], frames: int, step: float, unit: str, up: str, rate: float
) -> bytes:
    screens = [write.texts(1, "Y_SCREEN", [up])] if up else []
    return b"".join([
        write.group(1, "POINT"), write.number(1, "USED", len(labels)), write.real(1, "SCALE", step),
        write.real(1, "RATE", rate), write.number(1, "DATA_START", 3), write.number(1, "FRAMES", frames),
        write.texts(1, "LABELS", labels), write.texts(1, "DESCRIPTIONS", labels),
        write.texts(1, "UNITS", [unit] if unit else []), *screens, write.group(2, "ANALOG"),
        write.number(2, "USED", 1), write.texts(2, "LABELS", ["Fz"]), write.texts(2, "DESCRIPTIONS", ["force"]),
        write.real(2, "GEN_SCALE", 1.0), write.entry(2, "SCALE", 4, (1,), write.reals(1.0)),
        write.entry(2, "OFFSET", 2, (1,), write.words(0)), write.texts(2, "UNITS", ["N"]),
        write.real(2, "RATE", 2 * rate), bytes(2),
    ])  # fmt: skip


class _Writer:
    """Bytes as one processor has them."""

    def __init__(self, processor: int) -> None:
        self.processor = processor
        self.order = ">" if processor == MIPS else "<"

    def words(self, *values: int) -> bytes:
        """16-bit numbers."""
        return np.array(values).astype(self.order + "i2").tobytes()

    def reals(self, *values: float) -> bytes:
        """Floating point; DEC's has its words the other way round and exponents larger by 2."""
        if self.processor != DEC:
            return np.array(values, self.order + "f4").tobytes()
        return (4.0 * np.array(values)).astype("<f4").view("<u2").reshape(-1, 2)[:, ::-1].tobytes()

    def group(self, number: int, name: str) -> bytes:
        """The head of a group."""
        return struct.pack("<bb", len(name), -number) + name.encode() + self.words(3) + b"\0"

    def entry(self, group: int, name: str, kind: int, sizes: Sequence[int], data: bytes) -> bytes:
        """A parameter; kind: bytes of a number, -1 of texts."""
        body = struct.pack("<bB", kind, len(sizes)) + bytes(sizes) + data + b"\0"
        return struct.pack("<bb", len(name), group) + name.encode() + self.words(len(body) + 2) + body

    def number(self, group: int, name: str, value: int) -> bytes:
        """A whole number."""
        return self.entry(group, name, 2, (), self.words(value))

    def real(self, group: int, name: str, value: float) -> bytes:
        """A floating-point number."""
        return self.entry(group, name, 4, (), self.reals(value))

    def texts(self, group: int, name: str, values: Sequence[str]) -> bytes:
        """A list of texts."""
        width = max((len(value) for value in values), default=0)
        return self.entry(
            group, name, -1, (width, len(values)), b"".join(value.ljust(width).encode() for value in values)
        )
