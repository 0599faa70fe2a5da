"""Times and number of frames by a video's container: stored, counted, or only estimated.

FFmpeg gives a rate and a count for every file. Streams without a container (a camera's raw .h264) store no times, and
their rate is FFmpeg's own assumption; Matroska, MPEG-TS and others store no count, and theirs is duration times rate;
an MP4's edit list may leave out frames that are counted.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

_START_CODES = (b"\x00\x00\x00\x01", b"\x00\x00\x01")  # of H.264 and H.265 (Annex B)
_PROGRAM, _SEQUENCE = 0xBA, 0xB3  # after such a code: MPEG program streams and MPEG-2 video, which store times
_JPEG = b"\xff\xd8\xff"
_FOLDERS = {b"moov", b"trak", b"mdia", b"edts"}
_MOST = 1_000_000  # bytes of one box that is read


class Container(NamedTuple):
    """timed: the file stores when frames were taken, or how many a second. counted: it stores how many frames it shows.
    shown [s]: how long an edit list lets it be, None where it has none that leaves anything out."""

    timed: bool = True
    counted: bool = False
    shown: float | None = None


def container_of(path: Path) -> Container:
    """The container by a file's first bytes, and by the header of an MP4; raises OSError where it cannot be read."""
    with path.open("rb") as file:
        start = file.read(12)
        for code in _START_CODES:
            if start.startswith(code) and start[len(code)] not in (_PROGRAM, _SEQUENCE):
                return Container(timed=False)
        if start.startswith(_JPEG):
            return Container(timed=False)
        if start.startswith(b"RIFF") and start[8:] == b"AVI ":
            return Container(counted=True)
        if start[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"):
            try:
                shown = _shown(file)
            except (struct.error, IndexError, RecursionError):  # damaged: what FFmpeg makes of it is all there is
                shown = None
            return Container(counted=shown is None, shown=shown)
    return Container()


def _shown(file: BinaryIO) -> float | None:
    """Length [s] that the edit list of an MP4's first video track leaves, None where nothing is left out."""
    lists: list[tuple[int, int]] = []
    scale, length, unit, video = 0, 0, 1, False
    for kind, content in _boxes(file, 0, file.seek(0, 2)):
        if kind == b"mvhd":
            (scale,) = struct.unpack_from(">I", content, 20 if content[0] else 12)
        elif kind == b"trak" and not video:
            lists = []
        elif kind == b"elst" and not video:
            lists = _edits(content)
        elif kind == b"mdhd" and not video:
            unit, length = struct.unpack_from(">IQ" if content[0] else ">II", content, 20 if content[0] else 12)
        elif kind == b"hdlr":
            video = video or content[8:12] == b"vide"
    shown = [duration for duration, begins in lists if begins >= 0]  # the others are empty
    if not video or not scale or not unit or not shown:
        return None
    seconds = sum(shown) / scale
    return seconds if seconds < length / unit - 1.5 / scale else None


def _edits(content: bytes) -> list[tuple[int, int]]:
    """Duration in the movie's units and beginning in the track's, of each entry of an edit list."""
    form = ">qq" if content[0] else ">ii"
    (count,) = struct.unpack_from(">I", content, 4)
    step = struct.calcsize(form) + 4
    return [struct.unpack_from(form, content, 8 + i * step) for i in range(min(count, (len(content) - 8) // step))]


def _boxes(file: BinaryIO, start: int, end: int) -> Iterator[tuple[bytes, bytes]]:
    """Type and content of an MP4's boxes below moov, in order; of one that holds others no content."""
    while start + 8 <= end:
        file.seek(start)
        size, kind = struct.unpack(">I4s", file.read(8))
        head = 8
        if size == 1:
            size, head = struct.unpack(">Q", file.read(8))[0], 16
        stop = end if size == 0 else min(end, start + size)
        if stop < start + head:
            return  # damaged
        if kind in _FOLDERS:
            yield kind, b""
            yield from _boxes(file, start + head, stop)
        elif kind in (b"mvhd", b"mdhd", b"hdlr", b"elst") and stop - start <= _MOST:
            yield kind, file.read(stop - start - head)
        start = stop
