"""A URDF file as an XML tree with line numbers, read without entities, and the numbers in it."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from humanoid.support.errors import InputError

MAX_BYTES = 20_000_000  # as `read_bytes`
MAX_DEPTH = 64  # of nested elements; a URDF needs 6
PLAUSIBLE = 1e6  # lengths and angles beyond this are slips, and overflow in kinematics

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True)
class Document:
    """An XML tree with the place of every element.

    source: names the file in errors.
    root: the tree; callers may change it.
    prolog: comments in front of the root element.
    places: file and place of each element, for errors.
    """

    source: str
    root: ET.Element
    prolog: tuple[str, ...] = ()
    places: dict[ET.Element, tuple[str, str]] = field(default_factory=dict)

    def fault(self, element: ET.Element, problem: str, remedy: str = "") -> InputError:
        """An error about one element."""
        source, place = self.places.get(element, (self.source, title(element)))
        return InputError(source, problem, place=place, remedy=remedy)

    def text(self) -> str:
        """The document as URDF text."""
        prolog = "".join(f"<!--{comment}-->\n" for comment in self.prolog)
        return f'<?xml version="1.0"?>\n{prolog}{ET.tostring(self.root, encoding="unicode").rstrip()}\n'

    def attribute(self, element: ET.Element, key: str) -> str:
        """An attribute that has to be there and not be empty."""
        value = element.get(key, "").strip()
        if not value:
            raise self.fault(element, f"attribute {key!r} is missing", f'add {key}="..."')
        return value

    def numbers(self, element: ET.Element, key: str, count: int, default: str | None = None) -> tuple[float, ...]:
        """`count` finite numbers in an attribute."""
        text = element.get(key, default)
        if text is None:
            raise self.fault(element, f"attribute {key!r} is missing", f'add {key}="{" ".join(["0.1"] * count)}"')
        parts = text.split()
        if len(parts) != count:
            what = "1 number" if count == 1 else f"{count} numbers"
            raise self.fault(element, f"{key}={_short(text)} does not contain {what}", "separate numbers by spaces")
        return tuple(self._number(element, key, part) for part in parts)

    def number(self, element: ET.Element, key: str, default: str | None = None) -> float:
        """One finite number in an attribute."""
        return self.numbers(element, key, 1, default)[0]

    def plausible(self, element: ET.Element, key: str, default: str | None = None) -> float:
        """One number of plausible size: a length, an angle or a factor."""
        value = self.number(element, key, default)
        if abs(value) > PLAUSIBLE:
            raise self._implausible(element, key)
        return value

    def _implausible(self, element: ET.Element, key: str) -> InputError:
        value = _short(element.get(key, ""))
        return self.fault(element, f"{key}={value} is out of range", "metres and radians are meant")

    def _number(self, element: ET.Element, key: str, part: str) -> float:
        if _NUMBER.fullmatch(part):
            value = float(part)
        elif part.lower().lstrip("+-") in ("nan", "inf", "infinity"):
            value = math.nan
        else:
            raise self.fault(element, f"{key}: {_short(part)} is not a number", "write numbers like 0.25 or -1e-3")
        if not math.isfinite(value):
            raise self.fault(element, f"{key}: {_short(part)} is not finite", "give a finite number")
        return value

    def triple(self, element: ET.Element, key: str, default: str | None = "0 0 0") -> tuple[float, float, float]:
        """Three finite numbers of plausible size, lengths or angles."""
        a, b, c = self.numbers(element, key, 3, default)
        if max(abs(a), abs(b), abs(c)) > PLAUSIBLE:
            raise self._implausible(element, key)
        return a, b, c


def _short(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:37] + "...")


def title(element: ET.Element) -> str:
    """`<joint name="knee">`, or just the tag where there is no name."""
    key = next((k for k in ("name", "joint", "link") if element.get(k)), None)
    return f"<{element.tag} {key}={_short(element.get(key, ''))}>" if key else f"<{element.tag}>"


class _Reader:
    """Feeds expat's events into a tree and notes where each element starts."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.builder = ET.TreeBuilder(insert_comments=True)
        self.open: list[ET.Element] = []
        self.prolog: list[str] = []
        self.places: dict[ET.Element, tuple[str, str]] = {}
        self.started = False
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self.builder.data
        self.parser.CommentHandler = self._comment
        self.parser.StartDoctypeDeclHandler = self._doctype

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self.parser.CurrentLineNumber
        if len(self.open) >= MAX_DEPTH:
            raise InputError(
                self.source, f"elements are nested over {MAX_DEPTH} deep", place=f"line {line}", remedy="give a URDF"
            )
        element = self.builder.start(tag, attributes)
        self.started = True
        # the parts of a joint or link are found through the name of that joint or link
        named = title(element)
        if len(self.open) >= 2 and not element.get("name"):
            named = f"{title(self.open[1])} {named}"
        self.places[element] = (self.source, f"{named}, line {line}")
        self.open.append(element)

    def _end(self, tag: str) -> None:
        self.builder.end(tag)
        self.open.pop()

    def _comment(self, text: str) -> None:
        if self.open:
            self.builder.comment(text)
        elif not self.started:
            self.prolog.append(text)

    def _doctype(self, *_: object) -> None:
        raise InputError(
            self.source,
            "a DOCTYPE is refused: it can define entities that read other files or fill the memory",
            place=f"line {self.parser.CurrentLineNumber}",
            remedy="remove the <!DOCTYPE ...> declaration",
        )


def read_document(content: str | bytes, source: str) -> Document:
    """Parse XML.

    Raises
    ------
    InputError: it is empty, huge, not XML (with line and column), or has a DOCTYPE.
    """
    if len(content) > MAX_BYTES:
        raise InputError(source, f"is larger than {MAX_BYTES // 1_000_000} MB", remedy="a URDF is a short text file")
    if not content.strip():
        raise InputError(source, "is empty", remedy="give a URDF, an XML text with a <robot>")
    reader = _Reader(source)
    try:
        reader.parser.Parse(content, True)
    except expat.ExpatError as error:
        raise InputError(
            source,
            f"is not well-formed XML: {expat.ErrorString(error.code)}",
            place=f"line {error.lineno}, column {error.offset + 1}",
            remedy="give a URDF, an XML text with a <robot>",
        ) from error
    except InputError:  # the reader's own
        raise
    except (ValueError, LookupError) as error:  # unknown encodings, lone surrogates
        raise InputError(source, f"cannot be read as text: {error}", remedy="save it as UTF-8") from error
    return Document(source, reader.builder.close(), tuple(reader.prolog), reader.places)


def elements(parent: ET.Element, tag: str | None = None) -> Iterator[ET.Element]:
    """Child elements, comments left out."""
    return (child for child in parent if isinstance(child.tag, str) and (tag is None or child.tag == tag))
