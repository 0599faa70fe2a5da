"""Damage done to files: bytes, numbers, texts and JSON values replaced by what a hostile or broken program writes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

NUMBERS = (
    "0", "-1", "-0.0", "1e308", "-1e308", "1e-308", "5e-324", "NaN", "nan", "inf", "-Infinity", "1e999", "0.5", "1e11",
    "2147483648", "9007199254740993", "18446744073709551616", "1" + 400 * "0", 5000 * "9", "1_000", "0x7f", "1e5", "3",
    "1000", "1e9", "1e-9", "\u0663", "true",
)  # fmt: skip
TEXTS = (
    "", " ", "\0", 100_000 * "n", "\ufeff", "\u202eabc", "e\u0301", "\U0001f600", "'", '"', "<b>&amp;",
    "../../etc/passwd", "a\n\nb", "%s%n{0}", "\x1b[31m", "nan", "None", "\ud800", "a" + 300 * " b",
)  # fmt: skip
DEPTHS = (40, 1500, 100_000)
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_QUOTED = re.compile(rb'"[^"\n]*"')
_MOST_NODES = 4000

Mutation = Callable[[bytes, Random, Sequence[bytes]], bytes]


def mutated(data: bytes, kind: str, random: Random, others: Sequence[bytes]) -> bytes:
    """The content of a file with one to three mutations of its kind, "json", "text" or "binary"; others: of splices."""
    for _ in range(random.choice((1, 1, 2, 3))):
        data = random.choice(MUTATIONS[kind])(data, random, others)
    return data


def _flip(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    changed = bytearray(data or b"x")
    for _each in range(random.choice((1, 1, 4, 32))):
        changed[random.randrange(len(changed))] ^= 1 << random.randrange(8)
    return bytes(changed)


def _cut(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    return data[: random.randrange(len(data) + 1)]


def _left_out(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    start = random.randrange(len(data) + 1)
    return data[:start] + data[start + random.choice((1, 4, 30, 200)) :]


def _repeated(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    start = random.randrange(len(data) + 1)
    end = start + random.choice((1, 8, 60, 400))
    return data[:end] + data[start:end] * random.choice((1, 1, 20)) + data[end:]


def _spliced(data: bytes, random: Random, others: Sequence[bytes]) -> bytes:
    other = random.choice(others)
    return data[: random.randrange(len(data) + 1)] + other[random.randrange(len(other) + 1) :]


def _inserted(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    piece = random.choice((b"\0", b"\xef\xbb\xbf", b"\xff\xfe", b"\xff", b"\xc3\x28", b"\r", b"\x1a", b"\xed\xa0\x80"))
    at = random.choice((0, random.randrange(len(data) + 1)))
    return data[:at] + piece + data[at:]


def _other_number(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    return _substituted(data, _NUMBER, random.choice(NUMBERS).encode(), random)


def _other_text(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    return _substituted(data, _QUOTED, b'"' + _encoded(random.choice(TEXTS)) + b'"', random)


def _substituted(data: bytes, what: re.Pattern[bytes], new: bytes, random: Random) -> bytes:
    places = list(what.finditer(data))
    if not places:
        return data + new
    place = random.choice(places)
    return data[: place.start()] + new + data[place.end() :]


def _encoded(text: str) -> bytes:
    return text.encode("utf-8", errors="surrogatepass")


def _other_word(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    words = re.split(rb"([\s=<>,]+)", data)
    words[random.randrange(len(words))] = random.choice((_encoded(random.choice(TEXTS)), random.choice(words)))
    return b"".join(words)


def _lines(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    """A line dropped, repeated or moved; repeated keys and tables come from it."""
    lines = data.splitlines(keepends=True) or [b""]
    line = lines.pop(random.randrange(len(lines)))
    for _each in range(random.choice((0, 1, 2, 3))):
        lines.insert(random.randrange(len(lines) + 1), line)
    return b"".join(lines)


def _deep(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    opened, closed = random.choice(((b"[", b"]"), (b"<a>", b"</a>"), (b'{"a":', b"}"), (b"(", b")")))
    depth, at = random.choice(DEPTHS), random.randrange(len(data) + 1)
    return data[:at] + depth * opened + depth * closed + data[at:]


def _json_value(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    """One value of a JSON text replaced, left out, doubled or put into a list."""
    try:
        root = json.loads(data)
    except (ValueError, RecursionError):
        return _flip(data, random, ())
    places = _places(root)
    if not places:
        return json.dumps(_wild(random)).encode()
    container, key = random.choice(places)
    what = random.randrange(6)
    if what == 0:
        del container[key]
    elif what == 1 and isinstance(container, list):
        container.insert(random.randrange(len(container) + 1), container[key])
    elif what == 2:
        container[key] = random.choice(([container[key]], [container[key], container[key]], {"a": container[key]}))
    elif what == 3:
        other, other_key = random.choice(places)
        container[key] = json.loads(json.dumps(other[other_key])) if other_key in _keys(other) else None
    else:
        container[key] = _wild(random)
    return json.dumps(root).encode()


def _keys(container: Any) -> Any:
    return range(len(container)) if isinstance(container, list) else container.keys()


def _places(root: Any) -> list[tuple[Any, Any]]:
    """Container and key of every value."""
    nodes: list[tuple[Any, Any]] = []
    rest = [root]
    while rest and len(nodes) < _MOST_NODES:
        value = rest.pop()
        if isinstance(value, (list, dict)):
            for key in _keys(value):
                nodes.append((value, key))
                rest.append(value[key])
    return nodes


def _wild(random: Random) -> Any:
    """An unexpected JSON value."""
    wild: tuple[Any, ...] = (
        None, True, False, 0, -1, -0.0, 1e308, -1e308, 1e-308, float("nan"), float("inf"), 10**400, 2**31, 2**63, 2**64,
        1e11, 0.5, 3, 1e6, [], {}, [[]], [None], [1, "a"], [[1, 2], [3]], {"": 0}, [[[0.0] * 3] * 3], list(range(200)),
    )  # fmt: skip
    return random.choice((random.choice(wild), random.choice(TEXTS), random.choice(wild)))


_ANY: tuple[Mutation, ...] = (_flip, _cut, _left_out, _repeated, _spliced, _inserted)
MUTATIONS: dict[str, tuple[Mutation, ...]] = {
    "binary": (*_ANY, _flip, _flip),
    "text": (*_ANY, *2 * (_other_number, _other_text, _other_word, _lines), _other_number, _deep),
    "json": (*_ANY, *6 * (_json_value,), _other_number, _other_number, _other_text, _deep),
}
