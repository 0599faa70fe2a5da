"""What a detector's program needs, as its first lines say (PEP 723: inline script metadata)."""

from __future__ import annotations

import hashlib
import re
import sys
from dataclasses import dataclass
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_BLOCK = re.compile(r"^# /// script\n((?:#.*\n)+?)# ///$", re.MULTILINE)
Version = tuple[int, int]


@dataclass(frozen=True)
class Requirements:
    """The Python and the packages of a program.

    lowest, beyond: versions of Python that it runs with, from the first up to before the second. packages: all of
    them, those that others need too, each with its version. digest: of both.
    """

    lowest: Version
    beyond: Version
    packages: tuple[str, ...]
    digest: str

    @property
    def versions(self) -> tuple[Version, ...]:
        """The versions of Python, the newest first."""
        major = self.lowest[0]
        return tuple((major, minor) for minor in range(self.beyond[1] - 1, self.lowest[1] - 1, -1))

    @property
    def python(self) -> str:
        """The versions of Python as installers write them."""
        return ">={}.{},<{}.{}".format(*self.lowest, *self.beyond)

    @property
    def span(self) -> str:
        """The versions of Python as a sentence says them."""
        (newest, *_), oldest = self.versions, self.lowest
        return "{}.{} to {}.{}".format(*oldest, *newest)


def read_requirements(script: Path) -> Requirements:
    """What a program says that it needs; ValueError where its first lines are not as ours are."""
    block = _BLOCK.search(script.read_text(encoding="utf-8"))
    if block is None:
        raise ValueError(f"{script} does not say what it needs")
    text = "".join(line[1:].removeprefix(" ") + "\n" for line in block.group(1).splitlines())
    content = tomllib.loads(text)
    limits = re.fullmatch(r">=(\d+)\.(\d+),<(\d+)\.(\d+)", content["requires-python"])
    if limits is None:
        raise ValueError(f"{script}: requires-python is to be >=A.B,<C.D")
    a, b, c, d = map(int, limits.groups())
    digest = hashlib.sha256(text.encode()).hexdigest()[:16]
    return Requirements((a, b), (c, d), tuple(content["dependencies"]), digest)
