"""Commands that can be pasted into a shell as they stand."""

from __future__ import annotations

import itertools
import shlex
import sys
from pathlib import Path


def command(*arguments: str | Path) -> str:
    """A command line of this program, which is named as it was called; paths are given as paths."""
    return shlex.join([*_called(), *map(_argument, arguments)])


def _called() -> list[str]:
    """The arguments that called this program; `kinemode` where it is used as a library."""
    program = Path(sys.argv[0])
    if program.name == "kinemode":
        import shutil  # slow to import, and `kinemode --help` has no use for it

        on_path = shutil.which("kinemode")
        return ["kinemode" if on_path is not None and Path(on_path).absolute() == program.absolute() else sys.argv[0]]
    words = sys.orig_argv
    for i, pair in enumerate(itertools.pairwise(words)):
        if pair == ("-m", "kinemode"):
            return words[: i + 2]
    return ["kinemode"]


def _argument(given: str | Path) -> str:
    text = str(given)
    return f"./{text}" if isinstance(given, Path) and text.startswith("-") else text
