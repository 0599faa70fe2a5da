"""The command `python -m benchmarks`: lists the measures, runs one, or writes docs/history/status.md."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import groupby

from benchmarks import status
from benchmarks.registry import MEASURES, Measure, find
from humanoid.support.errors import InputError

USAGE = """\
python -m benchmarks NAME ARGS...     run a measure
python -m benchmarks NAME --help      its options
python -m benchmarks --list           every measure, its target, and what it needs
python -m benchmarks --write-status   write the tables of docs/history/status.md from benchmarks/figures.toml"""


def main(words: Sequence[str]) -> int:
    """Run a command line; the exit code. Measures end by SystemExit with their own."""
    name, *arguments = words or [""]
    try:
        if name in ("", "-h", "--help"):
            print(USAGE)
            return 0 if name else 2
        if name == "--list" and not arguments:
            print("\n".join(listing(MEASURES)))
            return 0
        if name == "--write-status" and not arguments:
            print(f"written; measures without a line: {', '.join(status.write())}")
            return 0
        if name.startswith("-"):
            raise InputError(
                "benchmarks", f"there is no option {' '.join(words)}", remedy="python -m benchmarks --help"
            )
        function = find(name).main()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    from benchmarks.support import common  # heavy: a list does without

    common.run(function, name, arguments)
    return 0


def listing(measures: Sequence[Measure]) -> list[str]:
    """The lines that `--list` prints."""
    width = max(len(measure.name) for measure in measures)
    lines = []
    for folder, group in groupby(measures, lambda measure: measure.folder):
        lines += ["", folder.replace(".", "/")]
        for measure in group:
            lines.append(f"  {measure.name:<{width}}  {measure.summary}")
            details = {"target": measure.target, "needs": ", ".join(measure.needs), "uses": ", ".join(measure.uses)}
            lines.append(f"  {'':<{width}}  " + "; ".join(f"{key}: {text}" for key, text in details.items() if text))
    return lines[1:]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
