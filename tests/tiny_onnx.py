"""ONNX files of a few operations, written without a library: a pose model of two colours, a model of constant boxes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

FLOAT, INT64 = 1, 7


def _varint(value: int) -> bytes:
    head = bytearray()
    while value > 127:
        head.append(value & 127 | 128)
        value >>= 7
    return bytes([*head, value])


def field(number: int, value: int | str | bytes) -> bytes:
    """A field of a protocol buffer message."""
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    content = value.encode() if isinstance(value, str) else value
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def node(kind: str, inputs: Sequence[str], output: str, axes: Sequence[int] = ()) -> bytes:
    more = b""
    if axes:
        ints = b"".join(field(8, axis) for axis in axes)
        more = field(5, field(1, "axes") + ints + field(20, 7))
        more += field(5, field(1, "keepdims") + field(3, 0) + field(20, 2))
    return field(1, b"".join(field(1, name) for name in inputs) + field(2, output) + field(4, kind) + more)


def constant(name: str, values: np.ndarray) -> bytes:
    kind = FLOAT if values.dtype == np.float32 else INT64
    dims = b"".join(field(1, length) for length in values.shape)
    return field(5, dims + field(2, kind) + field(8, name) + field(9, values.tobytes()))


def port(number: int, name: str, shape: Sequence[int], kind: int = FLOAT) -> bytes:
    """An input (11) or an output (12) of the graph."""
    dims = b"".join(field(1, field(1, length)) for length in shape)
    return field(number, field(1, name) + field(2, field(1, field(1, kind) + field(2, dims))))


def write(path: Path, graph: bytes) -> Path:
    path.write_bytes(field(1, 7) + field(8, field(1, "") + field(2, 11)) + field(7, graph + field(2, "tiny")))
    return path


def two_colours(path: Path, size: tuple[int, int]) -> Path:
    """A model with SimCC outputs: nine keypoints where red begins, eight where blue does, from the left and the top."""
    width, height = size
    channels = np.zeros((17, 3), np.float32)
    channels[:9, 0], channels[9:, 2] = 1.0, 1.0
    bins = {name: np.repeat(np.eye(n, dtype=np.float32), 2, axis=1) for name, n in (("bx", width), ("by", height))}
    graph = constant("channels", channels) + b"".join(constant(name, values) for name, values in bins.items())
    for axis, name in ((2, "x"), (3, "y")):
        graph += node("ReduceMax", ["picture"], f"max_{name}", [axis])
        graph += node("MatMul", ["channels", f"max_{name}"], f"of_{name}")
        graph += node("MatMul", [f"of_{name}", f"b{name}"], f"simcc_{name}")
    graph += port(11, "picture", (1, 3, height, width))
    graph += port(12, "simcc_x", (1, 17, 2 * width)) + port(12, "simcc_y", (1, 17, 2 * height))
    return write(path, graph)


def constant_boxes(path: Path, size: tuple[int, int], boxes: np.ndarray, labels: Sequence[int]) -> Path:
    """A model that finds the same boxes (N, 5) in every picture."""
    graph = constant("b", boxes[None].astype(np.float32)) + constant("l", np.array([labels], np.int64))
    graph += node("Identity", ["b"], "dets") + node("Identity", ["l"], "labels")
    graph += port(11, "picture", (1, 3, size[1], size[0]))
    graph += port(12, "dets", (1, len(boxes), 5)) + port(12, "labels", (1, len(boxes)), INT64)
    return write(path, graph)
