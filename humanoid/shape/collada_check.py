"""Checks of a COLLADA file before coal's mesh loader reads it, and its unit, which the loader ignores.

The loader, Assimp, trusts the numbers it finds: a word among them makes it fill the memory, a count or an index beyond
the data makes it read out of bounds.
"""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from humanoid.support.errors import InputError
from humanoid.support.files import read_bytes

MOST_BYTES = 200_000_000
_FLOATS, _INDICES = ("float_array",), ("p", "v", "h", "vcount", "int_array")
_NUMBERS = re.compile(r"[-+.0-9eE\s]*", re.ASCII)
_WHOLE = re.compile(r"[-0-9\s]*", re.ASCII)
_COUNTED = ("triangles", "polylist", "polygons", "lines", "linestrips", "trifans", "tristrips")


def check_collada(path: Path) -> None:
    """Check lists of numbers, and their counts and indices.

    Raises
    ------
    InputError: the file cannot be read, is not XML, or its lists are damaged.
    """
    content = read_bytes(path, most=MOST_BYTES)
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise _damaged(path, "a DOCTYPE is refused: it can fill the memory")
    try:
        root = ET.fromstring(content)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise _damaged(path, f"malformed XML, {error}") from None
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""
    _check_numbers(path, root)
    longest = _check_sources(path, root)
    for element in root.iter():
        if element.tag in _COUNTED:
            _check_primitives(path, element, longest)


def collada_unit(path: Path) -> float:
    """The length unit of a COLLADA file [m]: its <unit meter="...">, 1 where it has none.

    Raises
    ------
    InputError: the file cannot be read, or its unit is not a length.
    """
    content = read_bytes(path, most=MOST_BYTES)
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise _damaged(path, "a DOCTYPE is refused: it can fill the memory")
    text = "1"
    try:
        for _, element in ET.iterparse(io.BytesIO(content)):  # the unit is at its start
            name = element.tag.rpartition("}")[2]
            text = element.get("meter", "1") if name == "unit" else text
            if name in ("unit", "asset"):
                break
    except (ET.ParseError, ValueError, LookupError) as error:
        raise _damaged(path, f"malformed XML, {error}") from None
    try:
        unit = float(text)
    except ValueError:
        unit = 0.0
    if not 0.0 < unit < np.inf:
        raise _damaged(path, f'<unit meter="{text[:20]}"> is not a length')
    return unit


def _check_numbers(path: Path, root: ET.Element) -> None:
    for element in root.iter():
        allowed = _NUMBERS if element.tag in _FLOATS else _WHOLE if element.tag in _INDICES else None
        if allowed is not None and (len(element) or not allowed.fullmatch(element.text or "")):
            raise _damaged(path, f"<{element.tag}> contains something other than numbers")


def _check_sources(path: Path, root: ET.Element) -> int:
    """Check that accessors stay within their arrays; the length of the longest."""
    longest = 0
    for source in root.iter("source"):
        held = [len((array.text or "").split()) for array in source if array.tag.endswith("_array")]
        for accessor in source.iter("accessor"):
            count, stride, offset = (_whole(path, accessor, key, d) for key, d in _ACCESSED)
            if offset + count * stride > max(held, default=0):
                raise _damaged(path, f"an <accessor> goes beyond its array of {max(held, default=0)} numbers")
            longest = max(longest, count)
    return longest


_ACCESSED = (("count", 0), ("stride", 1), ("offset", 0))


def _check_primitives(path: Path, element: ET.Element, longest: int) -> None:
    inputs = [_whole(path, e, "offset", 0) for e in element if e.tag == "input"]
    width = max(inputs, default=0) + 1
    corners = 0
    for p in _children(element, "p"):
        index = _integers(path, p.text or "")
        if index.size and (index.min() < 0 or index.max() >= max(longest, 1)):
            raise _damaged(path, f"<p> points beyond the {longest} entries of the longest array")
        if index.size % width:
            raise _damaged(path, f"<p> has {index.size} numbers, no multiple of its {width} inputs")
        corners += index.size // width
    wanted = _corners(path, element)
    if wanted > corners:
        raise _damaged(path, f"<{element.tag}> counts {wanted} corners and has {corners}")


def _corners(path: Path, element: ET.Element) -> int:
    """Declared number of corners of a set of primitives; 0 where it declares none."""
    count = _whole(path, element, "count", 0)
    if element.tag == "triangles":
        return 3 * count
    if element.tag == "lines":
        return 2 * count
    sides = _integers(path, " ".join(e.text or "" for e in _children(element, "vcount")))
    if element.tag == "polylist" and sides.size != count:
        raise _damaged(path, f"<polylist> counts {count} polygons, <vcount> has {sides.size}")
    if sides.size and sides.min() < 0:
        raise _damaged(path, "<vcount> has a negative number")
    return int(sides.sum())


def _children(element: ET.Element, tag: str) -> Iterator[ET.Element]:
    return (e for e in element.iter() if e.tag == tag)


def _integers(path: Path, text: str) -> np.ndarray:
    try:
        return np.array(text.split(), dtype=np.int64)
    except (ValueError, OverflowError):
        raise _damaged(path, "a list of indices has an invalid entry") from None


def _whole(path: Path, element: ET.Element, key: str, default: int) -> int:
    text = element.get(key)
    if text is None:
        return default
    if not text.isascii() or not text.isdigit() or len(text) > 9:
        raise _damaged(path, f"{key} of <{element.tag}> is not a count")
    return int(text)


def _damaged(path: Path, problem: str) -> InputError:
    return InputError(path, f"the mesh cannot be used: {problem}", remedy="export it again")
